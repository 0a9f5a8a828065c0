//! The sections `cameras.realsense` and `cameras.recovery`: live cameras, and what is done when one fails.

use std::path::PathBuf;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::convert::within;
use super::error::Refusal;
use super::sections::Pace;
use super::serial::Serial;
use crate::capture::realsense::{self, RealsenseOptions, VideoMode};
use crate::pipeline::RecoveryOptions;

/// `cameras.realsense`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct RealsenseSection {
    /// Colour stream.
    pub color: VideoModeSection,
    /// Depth stream.
    pub depth: VideoModeSection,
    /// Whether the gyroscope is read where there is one.
    pub gyro: bool,
    /// Whether the accelerometer is read where there is one.
    pub accel: bool,
    /// Whether the infrared projector is on; `null` leaves it as it is.
    pub emitter: Option<bool>,
    /// Longest automatic exposure; `null` leaves it to the camera.
    pub max_exposure_ms: Option<f64>,
    /// Serial number of the camera that triggers the others over the sync cable; `null`: none does.
    pub sync_master: Option<Serial>,
    /// Whether stamps are translated to the host's clock.
    pub global_time: bool,
    /// Older frames are told of.
    pub late_after_ms: f64,
    /// Recordings that the SDK plays instead of cameras.
    pub playback: Vec<PathBuf>,
    /// How fast recordings are played.
    pub pace: Pace,
}

impl Default for RealsenseSection {
    fn default() -> Self {
        let RealsenseOptions { color, depth, gyro, accel, emitter, global_time, late_after, .. } =
            RealsenseOptions::default();
        Self {
            color: color.into(),
            depth: depth.into(),
            gyro,
            accel,
            emitter,
            max_exposure_ms: None,
            sync_master: None,
            global_time,
            late_after_ms: late_after.as_secs_f64() * 1e3,
            playback: Vec::new(),
            pace: Pace::RealTime,
        }
    }
}

/// Size and rate of a stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a stream: {width_px: 640, height_px: 480, rate_hz: 30}")]
pub struct VideoModeSection {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Frames per second.
    pub rate_hz: usize,
}

impl From<VideoMode> for VideoModeSection {
    fn from(VideoMode { width_px, height_px, rate_hz }: VideoMode) -> Self {
        Self { width_px, height_px, rate_hz }
    }
}

impl VideoModeSection {
    fn checked(self, key: &str) -> Result<VideoMode, Refusal> {
        let Self { width_px, height_px, rate_hz } = self;
        for (name, value, limits) in [
            ("width_px", width_px, (64.0, 4_096.0)),
            ("height_px", height_px, (48.0, 4_096.0)),
            ("rate_hz", rate_hz, (1.0, 300.0)),
        ] {
            within(&format!("{key}.{name}"), value as f64, limits)?;
        }
        Ok(VideoMode { width_px, height_px, rate_hz })
    }
}

/// The options of the back end `realsense`.
///
/// # Errors
/// Names the first value that is not allowed, and says how to build a program that has this back end.
pub(super) fn options(file: &RealsenseSection) -> Result<RealsenseOptions, Refusal> {
    if !cfg!(feature = "realsense") {
        return Err(Refusal::new("cameras.backend", realsense::how_to_build()));
    }
    let key = |name: &str| format!("cameras.realsense.{name}");
    within(&key("max_exposure_ms"), file.max_exposure_ms.unwrap_or(1.0), (0.01, 200.0))?;
    within(&key("late_after_ms"), file.late_after_ms, (1.0, 60_000.0))?;
    if let Some(empty) = file.playback.iter().position(|path| path.as_os_str().is_empty()) {
        return Err(Refusal::new(
            key(&format!("playback[{empty}]")),
            "is empty: name a recording of the SDK",
        ));
    }
    Ok(RealsenseOptions {
        color: file.color.checked(&key("color"))?,
        depth: file.depth.checked(&key("depth"))?,
        gyro: file.gyro,
        accel: file.accel,
        emitter: file.emitter,
        max_exposure: file.max_exposure_ms.map(from_ms),
        sync_master: file.sync_master.as_ref().map(|serial| serial.0.clone()),
        global_time: file.global_time,
        late_after: from_ms(file.late_after_ms),
        playback: file.playback.clone(),
        pace: match file.pace {
            Pace::RealTime => realsense::Pace::RealTime,
            Pace::Unpaced => realsense::Pace::Unpaced,
        },
    })
}

/// `cameras.recovery`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct RecoverySection {
    /// A camera that is there but gives no frames is opened again so often before it is reset.
    pub reopens_before_reset: u32,
    /// Least time between two resets of any cameras.
    pub reset_interval_s: f64,
    /// A camera that hangs in its driver for so long ends the daemon; `null`: it never does.
    pub leave_after_s: Option<f64>,
}

impl Default for RecoverySection {
    fn default() -> Self {
        let RecoveryOptions { reopens_before_reset, reset_interval, leave_after } =
            RecoveryOptions::default();
        let leave_after_s = leave_after.map(|limit| limit.as_secs_f64());
        Self { reopens_before_reset, reset_interval_s: reset_interval.as_secs_f64(), leave_after_s }
    }
}

/// The steps of recovery.
///
/// # Errors
/// Names the first value out of range.
pub(super) fn recovery(file: &RecoverySection) -> Result<RecoveryOptions, Refusal> {
    let key = |name: &str| format!("cameras.recovery.{name}");
    within(&key("reopens_before_reset"), f64::from(file.reopens_before_reset), (1.0, 1_000.0))?;
    within(&key("reset_interval_s"), file.reset_interval_s, (1.0, 86_400.0))?;
    within(&key("leave_after_s"), file.leave_after_s.unwrap_or(1.0), (1.0, 3_600.0))?;
    Ok(RecoveryOptions {
        reopens_before_reset: file.reopens_before_reset,
        reset_interval: Duration::from_secs_f64(file.reset_interval_s),
        leave_after: file.leave_after_s.map(Duration::from_secs_f64),
    })
}

fn from_ms(milliseconds: f64) -> Duration {
    Duration::from_secs_f64(milliseconds * 1e-3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(not(feature = "realsense"))]
    fn a_program_without_the_back_end_says_how_to_build_one_with_it() {
        let refusal = options(&RealsenseSection::default()).expect_err("not built");
        assert_eq!(refusal.key, "cameras.backend");
        assert!(refusal.what.contains("--features realsense"), "{}", refusal.what);
    }

    #[test]
    #[cfg(feature = "realsense")]
    fn the_default_section_is_the_default_options() {
        assert_eq!(options(&RealsenseSection::default()), Ok(RealsenseOptions::default()));
    }

    #[test]
    #[cfg(feature = "realsense")]
    fn values_out_of_range_are_refused_by_their_key() {
        let refused = |section: RealsenseSection| options(&section).expect_err("out of range").key;
        let mut section = RealsenseSection::default();
        section.color.rate_hz = 0;
        assert_eq!(refused(section), "cameras.realsense.color.rate_hz");
        let section = RealsenseSection { max_exposure_ms: Some(f64::NAN), ..RealsenseSection::default() };
        assert_eq!(refused(section), "cameras.realsense.max_exposure_ms");
        let section = RealsenseSection { playback: vec![PathBuf::new()], ..RealsenseSection::default() };
        assert_eq!(refused(section), "cameras.realsense.playback[0]");
    }

    #[test]
    fn the_default_recovery_is_the_default_options_and_leaves_before_the_watchdog_bites() {
        let options = recovery(&RecoverySection::default()).expect("the defaults");
        assert_eq!(options, RecoveryOptions::default());
        let unit = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/systemd/pelicald.service"));
        let watchdog = unit.lines().find_map(|line| line.strip_prefix("WatchdogSec=")?.strip_suffix('s'));
        let watchdog_s: f64 = watchdog.expect("a watchdog").parse().expect("seconds");
        assert!(options.leave_after.expect("a limit").as_secs_f64() + 1.0 < watchdog_s);
    }
}
