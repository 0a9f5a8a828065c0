//! Borrowed views of pixels. No copies, no I/O.

mod view;

pub use view::{DepthView, GrayView};
