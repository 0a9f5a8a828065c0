//! From images to lines: segments, their lifting to 3D, what they look like and which look alike.

pub mod describe;
pub mod detect;
pub mod lift;
pub mod matching;
pub mod surface;

pub use describe::{Describer, LineDescriptor};
pub use detect::{DetectOptions, Detector};
pub use lift::{LiftOptions, Lifter};
pub use matching::{LooksOf, score_lines};
pub use surface::sample_surface;
