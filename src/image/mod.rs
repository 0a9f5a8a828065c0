//! Borrowed views of pixels. No copies, no I/O.

mod gray;
mod view;

pub use gray::gray_from_rgb;
pub use view::{DepthView, GrayView, RgbView};
