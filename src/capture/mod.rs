//! Cameras: what can be listed and opened, and what a frame is.
//!
//! A back end is a [`DeviceFactory`] that lists and opens devices; an open device is a [`FrameSource`] that one capture thread
//! owns. Everything that can go wrong with a camera is a [`CaptureError`] with a variant for what the caller can do about it.

mod bag;
pub mod frame;
pub mod nesting;
pub mod realsense;
pub mod realsense_models;
pub mod recording;
pub mod replay;
pub mod scripted;
pub mod synthetic;
pub mod writer;

use std::path::{Path, PathBuf};
use std::time::Duration;

pub use frame::{CameraInfo, FrameTiming, RgbdFrame, SpecificForce, StampClock, StampNs, TurnRate};

/// Lists and opens the devices of one back end.
pub trait DeviceFactory: Send + Sync {
    /// Short name of the back end, as in the config.
    fn name(&self) -> &'static str;

    /// Every device there is now, in a fixed order.
    ///
    /// # Errors
    /// When the back end itself cannot be reached (no such recording, no permission).
    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError>;

    /// Opens the device with this serial.
    ///
    /// # Errors
    /// [`CaptureError::NotFound`] when it is not there, others as the device says.
    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError>;

    /// Starts the device with this serial anew, as if it had been unplugged: the last that can be tried from here when opening it
    /// again does not help. It is away for some seconds then. `false` where this back end cannot.
    ///
    /// # Errors
    /// [`CaptureError::NotFound`] when it is not there, others as the device says.
    fn reset(&self, serial: &str) -> Result<bool, CaptureError> {
        let _ = serial;
        Ok(false)
    }
}

/// An open camera, owned by one thread.
pub trait FrameSource: Send {
    /// Name, serial, intrinsics, depth unit.
    fn info(&self) -> &CameraInfo;

    /// Overwrites `frame` with the next frame, waiting at most `timeout`. The buffers of `frame` are reused: after the first
    /// frame of a stream a live camera allocates nothing; one that decodes files or renders may.
    ///
    /// # Errors
    /// [`CaptureError::Timeout`] (call again), [`CaptureError::Unplugged`] (reopen later), [`CaptureError::EndOfStream`]
    /// (typed end), or what else the device says. After an error `frame` holds no usable image.
    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError>;
}

/// What a camera can answer instead of a frame; each variant is something else to do.
#[derive(Debug, thiserror::Error)]
pub enum CaptureError {
    /// No frame in time: call again; many in a row mean a stalled camera.
    #[error("no frame within {0:?}")]
    Timeout(Duration),
    /// The device went away: reopen when it is back.
    #[error("camera {0} was unplugged")]
    Unplugged(String),
    /// The recording or script is at its end.
    #[error("end of the stream")]
    EndOfStream,
    /// No device with this serial.
    #[error("no camera with serial \"{serial}\"; available: {available}")]
    NotFound {
        /// Asked for.
        serial: String,
        /// The serials that are there, joined.
        available: String,
    },
    /// The data is not what the layout promises; the message says which file and what is wrong.
    #[error("{path}: {what}")]
    BadData {
        /// File or folder.
        path: PathBuf,
        /// What is wrong and what is allowed.
        what: String,
    },
    /// The device is there and well, but not for us as it is asked for: a mode or lens that it does not have or we do not know, no permission,
    /// another program that has it. Neither opening it again nor a reset cures that.
    #[error("camera {serial}: {what}")]
    Refused {
        /// Which camera.
        serial: String,
        /// What is wrong and what to do.
        what: String,
    },
    /// The device or its driver fails; the message says how.
    #[error("camera {serial}: {what}")]
    Device {
        /// Which camera.
        serial: String,
        /// What is wrong and what to do.
        what: String,
    },
    /// The operating system refused a file.
    #[error("{path}: {source}")]
    Io {
        /// File or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl CaptureError {
    /// Data that is not what the layout promises, in `path`.
    pub(crate) fn bad_data(path: &Path, what: impl Into<String>) -> Self {
        Self::BadData { path: path.to_path_buf(), what: what.into() }
    }

    /// The device or its driver fails.
    pub(crate) fn device(serial: &str, what: impl std::fmt::Display) -> Self {
        Self::Device { serial: serial.to_owned(), what: what.to_string() }
    }

    /// No device with this serial among those that are there.
    pub(crate) fn not_found(serial: &str, there: &[CameraInfo]) -> Self {
        let quoted: Vec<String> = there.iter().map(|info| format!("\"{}\"", info.serial)).collect();
        let available = if quoted.is_empty() { "none".to_owned() } else { quoted.join(", ") };
        Self::NotFound { serial: serial.to_owned(), available }
    }

    /// What the system said about `path`.
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        Self::Io { path: path.to_path_buf(), source }
    }
}
