//! What can be chosen about RealSense cameras, in internal units.

use std::path::PathBuf;
use std::time::Duration;

/// Size and rate of one video stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct VideoMode {
    /// px.
    pub width_px: usize,
    /// px.
    pub height_px: usize,
    /// Frames per second.
    pub rate_hz: usize,
}

/// When the frames of a recording come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pace {
    /// As far apart as they were recorded.
    #[default]
    RealTime,
    /// As soon as they are asked for; none is lost.
    Unpaced,
}

/// Options of every camera of the back end.
#[derive(Debug, Clone, PartialEq)]
pub struct RealsenseOptions {
    /// Colour stream. A recording has its own.
    pub color: VideoMode,
    /// Depth stream. A recording has its own.
    pub depth: VideoMode,
    /// Whether the gyroscope is read where there is one.
    pub gyro: bool,
    /// Whether the accelerometer is read where there is one.
    pub accel: bool,
    /// Whether the infrared projector is on; `None` leaves it as it is.
    pub emitter: Option<bool>,
    /// Longest exposure that the cameras may choose by themselves; `None` leaves it to them.
    pub max_exposure: Option<Duration>,
    /// Serial number of the camera whose frames start those of all others over the sync cable; `None`: each runs freely.
    pub sync_master: Option<String>,
    /// Whether the SDK translates the cameras' clocks to the host's: without, the clocks of two cameras have nothing in common.
    pub global_time: bool,
    /// Frames that are older than this when they arrive are told of.
    pub late_after: Duration,
    /// Recordings to play instead of live cameras; empty: live cameras.
    pub playback: Vec<PathBuf>,
    /// When the frames of recordings come.
    pub pace: Pace,
}

impl Default for RealsenseOptions {
    fn default() -> Self {
        let mode = VideoMode { width_px: 640, height_px: 480, rate_hz: 30 };
        Self {
            color: mode,
            depth: mode,
            gyro: true,
            accel: true,
            emitter: Some(true),
            max_exposure: None,
            sync_master: None,
            global_time: true,
            // Above what a busy bus costs, far below the seconds of a queue that fills up.
            late_after: Duration::from_millis(300),
            playback: Vec::new(),
            pace: Pace::RealTime,
        }
    }
}
