//! From images to lines: segments, and their lifting to 3D.

pub mod detect;
pub mod lift;
pub mod surface;

pub use detect::{DetectOptions, Detector};
pub use lift::{LiftOptions, Lifter};
pub use surface::sample_surface;
