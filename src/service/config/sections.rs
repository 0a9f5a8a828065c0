//! The config file as it is written: one struct a section, its defaults, its units in the key names.
//!
//! Nothing is checked here but shape and spelling; ranges are checked where the sections become [`super::Config`].

use std::fmt;
use std::path::PathBuf;

use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::ipc::InstanceName;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected keys with values")]
pub struct ConfigFile {
    /// Name of this daemon; clients find it by this name.
    pub instance: String,
    /// What is logged, and how.
    pub log: LogSection,
    /// Which cameras.
    pub cameras: CamerasSection,
    /// What counts as one moment.
    pub sync: SyncSection,
    /// Straight edges and their lifting to 3D.
    pub lines: LinesSection,
    /// From lines to extrinsics.
    pub estimate: EstimateSection,
}

impl Default for ConfigFile {
    fn default() -> Self {
        Self {
            instance: InstanceName::default().to_string(),
            log: LogSection::default(),
            cameras: CamerasSection::default(),
            sync: SyncSection::default(),
            lines: LinesSection::default(),
            estimate: EstimateSection::default(),
        }
    }
}

/// `log`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct LogSection {
    /// Where to and in which form.
    pub format: LogFormat,
    /// The least important level that is written.
    pub level: LogLevel,
}

impl Default for LogSection {
    fn default() -> Self {
        Self { format: LogFormat::Human, level: LogLevel::Info }
    }
}

/// Form of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// Lines for people, on stderr.
    Human,
    /// One JSON object a line, on stderr.
    Json,
    /// Structured fields to the systemd journal.
    Journald,
}

/// Levels of the log, most important first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LogLevel {
    /// The daemon cannot do its job.
    Error,
    /// It does its job worse.
    Warn,
    /// A few lines per life.
    Info,
    /// Per calibration.
    Debug,
    /// Per frame.
    Trace,
}

/// `cameras`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct CamerasSection {
    /// Where frames come from.
    pub backend: Backend,
    /// Options of the back end `replay`.
    pub replay: ReplaySection,
    /// Options of the back end `synthetic`.
    pub synthetic: SyntheticSection,
    /// The cameras of the rig; empty means every camera of the back end.
    pub list: Vec<CameraEntry>,
    /// Name of the reference camera; `null` means the first.
    pub reference: Option<String>,
}

impl Default for CamerasSection {
    fn default() -> Self {
        Self {
            backend: Backend::Synthetic,
            replay: ReplaySection::default(),
            synthetic: SyntheticSection::default(),
            list: Vec::new(),
            reference: None,
        }
    }
}

/// Kinds of cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// A recording folder.
    Replay,
    /// A rendered room with known truth.
    Synthetic,
}

/// One camera of the rig.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "expected a camera: {name: ..., serial: \"...\"}")]
pub struct CameraEntry {
    /// Name in the rig.
    pub name: String,
    /// Serial number of the device.
    pub serial: Serial,
}

/// A serial number, which must be written as a string.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Serial(pub String);

/// What to say about a serial number that was written without quotes.
pub const UNQUOTED_SERIAL: &str = "a serial number is a string: write it in quotes (\"012345\"), as a number its leading zeros would be lost";

impl<'de> Deserialize<'de> for Serial {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SerialVisitor)
    }
}

struct SerialVisitor;

impl Visitor<'_> for SerialVisitor {
    type Value = Serial;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a string in quotes")
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Serial, E> {
        Ok(Serial(text.to_owned()))
    }

    fn visit_u64<E: de::Error>(self, _: u64) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }

    fn visit_i64<E: de::Error>(self, _: i64) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }

    fn visit_u128<E: de::Error>(self, _: u128) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }

    fn visit_f64<E: de::Error>(self, _: f64) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }
}

/// `cameras.replay`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct ReplaySection {
    /// The recording's folder; must be given for the back end `replay`.
    pub recording: Option<PathBuf>,
    /// How fast frames come.
    pub pace: Pace,
    /// Whether to start over at the end.
    #[serde(rename = "loop")]
    pub repeat: bool,
    /// Whether to decode everything into memory at the start.
    pub preload: bool,
}

impl Default for ReplaySection {
    fn default() -> Self {
        Self { recording: None, pace: Pace::RealTime, repeat: false, preload: false }
    }
}

/// How fast a recording is played.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// By the stamps of the frames.
    RealTime,
    /// As fast as they are taken.
    Unpaced,
}

/// `cameras.synthetic`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct SyntheticSection {
    /// Seed of the room, the motion and the noise.
    pub seed: u64,
}

impl Default for SyntheticSection {
    fn default() -> Self {
        Self { seed: 1 }
    }
}

/// `sync`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct SyncSection {
    /// Largest difference of the stamps in one frame set.
    pub max_skew_ms: f64,
    /// Without a frame for this long a camera counts as stalled.
    pub stalled_after_ms: f64,
}

impl Default for SyncSection {
    fn default() -> Self {
        Self { max_skew_ms: 8.0, stalled_after_ms: 500.0 }
    }
}

/// `lines`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct LinesSection {
    /// Shortest segment kept.
    pub min_length_px: f64,
    /// Standard deviation of one inverse-depth reading, 1/m.
    pub sigma_inverse_depth_per_m: f64,
    /// Least share of agreeing depth samples for a lifted line.
    pub min_inlier_ratio: f64,
}

impl Default for LinesSection {
    fn default() -> Self {
        let (detect, lift) = (crate::lines::DetectOptions::default(), crate::lines::LiftOptions::default());
        Self {
            min_length_px: detect.min_length_px,
            sigma_inverse_depth_per_m: lift.sigma_inverse_depth_per_m,
            min_inlier_ratio: lift.min_inlier_ratio,
        }
    }
}

/// `estimate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "expected a section of keys with values")]
pub struct EstimateSection {
    /// Largest distance between two cameras that is considered.
    pub max_baseline_m: f64,
}

impl Default for EstimateSection {
    fn default() -> Self {
        Self { max_baseline_m: crate::solver::EstimateOptions::default().max_baseline_m }
    }
}
