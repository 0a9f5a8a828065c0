//! The RealSense back end against the real librealsense: recordings that the SDK's own software device writes, played back as
//! cameras. `scripts/realsense_sdk.sh` makes a library to run them with.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "clippy's leave for tests stops at #[test]"
)]

#[allow(dead_code, reason = "the other integration binary needs more of it")]
#[path = "../it/env.rs"]
mod env;
mod lens;
mod playback;
mod programs;
mod recorder;
mod scenes;
mod two_paths;
