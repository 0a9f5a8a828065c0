//! The RealSense back end against the real librealsense: recordings that the SDK's own software device writes, played back as
//! cameras. `scripts/realsense_sdk.sh` makes a library to run them with.

mod lens;
mod playback;
mod recorder;
mod scenes;
