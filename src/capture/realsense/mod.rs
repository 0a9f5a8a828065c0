//! Live RealSense cameras, and recordings (`.bag`) played by the SDK as if they were cameras.
//!
//! What can be decided without the SDK stands in modules of its own and is always built and tested; what calls the SDK is behind
//! the feature `realsense`, and `raw` is the only place of this crate with `unsafe` in it.

pub mod age;
pub mod clock;
pub mod depth_unit;
#[cfg(feature = "realsense")]
mod device;
pub mod extrinsics;
#[cfg(feature = "realsense")]
mod factory;
pub mod forces;
pub mod left_out;
pub mod lens;
pub mod obstacle;
pub mod options;
pub mod pairing;
pub mod pixels;
#[cfg(feature = "realsense")]
mod raw;
#[cfg(feature = "realsense")]
mod settings;
#[cfg(feature = "realsense")]
mod source;
#[cfg(feature = "realsense")]
mod streams;
pub mod turning;
pub mod waiting;

use super::{CaptureError, DeviceFactory};

#[cfg(feature = "realsense")]
pub use factory::RealsenseFactory;
pub use options::{Pace, RealsenseOptions, VideoMode};

/// The back end with these options.
///
/// # Errors
/// Where the program was built without it.
#[cfg(feature = "realsense")]
pub fn factory(options: &RealsenseOptions) -> Result<Box<dyn DeviceFactory>, CaptureError> {
    Ok(Box::new(RealsenseFactory::new(options.clone())))
}

/// The back end with these options.
///
/// # Errors
/// Where the program was built without it.
#[cfg(not(feature = "realsense"))]
pub fn factory(_: &RealsenseOptions) -> Result<Box<dyn DeviceFactory>, CaptureError> {
    Err(CaptureError::device("any", how_to_build()))
}

/// Oldest librealsense that works: the crate `realsense-sys` asks for the interface of this version, which older libraries refuse.
pub const MIN_SDK_VERSION: &str = "2.56";

/// Whether the program was built with this back end.
pub const IS_BUILT_IN: bool = cfg!(feature = "realsense");

/// How to get a program with this back end; for the message where it was built without.
pub fn how_to_build() -> String {
    format!(
        "this program was built without RealSense cameras: install librealsense ({MIN_SDK_VERSION} or newer, with its \
         development files) and build with `cargo build --release --features realsense`"
    )
}
