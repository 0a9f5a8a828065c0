//! The config file as it is written: one struct a section, its defaults, its units in the key names.
//!
//! Nothing is checked here but shape and spelling; ranges are checked where the sections become [`super::Config`].

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::estimator::{AssociationName, EstimatorName};
use super::faults::FaultsSection;
use super::ipc::IpcSection;
use super::matcher::MatcherSection;
use super::realsense::{RealsenseSection, RecoverySection};
use super::recording::RecordingPaths;
use super::serial::Serial;
use super::store::StoreSection;
use super::supervision::ServiceSection;
use super::synthetic::MoveEntry;
use super::watch::WatchSection;
use crate::capture::synthetic::SyntheticOptions;
use crate::ipc::InstanceName;
use crate::lines::{DetectOptions, LiftOptions};
use crate::pipeline::{Association, MotionOptions, SolveOptions, SyncOptions};
use crate::solver::EstimateOptions;

/// The whole file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "keys with values")]
pub struct ConfigFile {
    /// Name of this daemon; clients find it by this name.
    pub instance: String,
    /// What is logged, and how.
    pub log: LogSection,
    /// How clients reach the daemon.
    pub ipc: IpcSection,
    /// What the service manager is told.
    pub service: ServiceSection,
    /// Which cameras.
    pub cameras: CamerasSection,
    /// What counts as one moment.
    pub sync: SyncSection,
    /// Straight edges and their lifting to 3D.
    pub lines: LinesSection,
    /// From lines to extrinsics.
    pub estimate: EstimateSection,
    /// The learned matcher.
    pub matcher: MatcherSection,
    /// After a result.
    pub watch: WatchSection,
    /// Where results are kept.
    pub store: StoreSection,
}

impl Default for ConfigFile {
    fn default() -> Self {
        Self {
            instance: InstanceName::default().to_string(),
            log: LogSection::default(),
            ipc: IpcSection::default(),
            service: ServiceSection::default(),
            cameras: CamerasSection::default(),
            sync: SyncSection::default(),
            lines: LinesSection::default(),
            estimate: EstimateSection::default(),
            matcher: MatcherSection::default(),
            watch: WatchSection::default(),
            store: StoreSection::default(),
        }
    }
}

/// `log`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
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
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct CamerasSection {
    /// Where frames come from.
    pub backend: Backend,
    /// Options of the back end `replay`.
    pub replay: ReplaySection,
    /// Options of the back end `synthetic`.
    pub synthetic: SyntheticSection,
    /// Options of the back end `realsense`.
    pub realsense: RealsenseSection,
    /// The cameras of the rig; empty means every camera of the back end.
    pub list: Vec<CameraEntry>,
    /// Name of the reference camera; `null` means the first.
    pub reference: Option<String>,
    /// What is done when a camera fails.
    pub recovery: RecoverySection,
    /// What the cameras suffer on purpose.
    pub faults: FaultsSection,
}

impl Default for CamerasSection {
    fn default() -> Self {
        Self {
            backend: Backend::Synthetic,
            replay: ReplaySection::default(),
            synthetic: SyntheticSection::default(),
            realsense: RealsenseSection::default(),
            list: Vec::new(),
            reference: None,
            recovery: RecoverySection::default(),
            faults: FaultsSection::default(),
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
    /// RealSense cameras, where the program was built with them.
    Realsense,
}

/// One camera of the rig.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a camera: {name: ..., serial: \"...\"}")]
pub struct CameraEntry {
    /// Name in the rig.
    pub name: String,
    /// Serial number of the device.
    pub serial: Serial,
}

/// `cameras.replay`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct ReplaySection {
    /// The recording's folder or bags; must be given for the back end `replay`.
    pub recording: RecordingPaths,
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
        Self { recording: RecordingPaths::default(), pace: Pace::RealTime, repeat: false, preload: false }
    }
}

/// How fast frames come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pace {
    /// As their stamps are apart.
    RealTime,
    /// As fast as they are taken.
    Unpaced,
}

/// `cameras.synthetic`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct SyntheticSection {
    /// Which cameras.
    pub rig: SyntheticRig,
    /// How far the right camera of a pair looks to the right of the left one.
    pub yaw_deg: f64,
    /// How far the right camera of a pair is to the right of the left one.
    pub baseline_m: f64,
    /// Seed of the room, the motion and the noise.
    pub seed: u64,
    /// Noise of the pictures.
    pub noise: SyntheticNoise,
    /// Standard deviation of the disparity.
    pub disparity_sigma_px: f64,
    /// How fast frames come.
    pub pace: Pace,
    /// Frames per second.
    pub rate_hz: f64,
    /// Frame sets until the end of the stream; `null` is endless.
    pub frame_sets: Option<u64>,
    /// How far the rig moves between two views, in key poses of its path.
    pub view_step: f64,
    /// Frame sets for which the rig stands still at each view.
    pub frames_per_view: u64,
    /// Frames rendered at the start and then repeated; `null` renders each frame when it is asked for.
    pub render_ahead: Option<usize>,
    /// Whether the cameras have a gyro.
    pub gyro: bool,
    /// Whether the cameras have an accelerometer.
    pub accel: bool,
    /// Cameras that are moved in the rig on the way.
    pub moves: Vec<MoveEntry>,
}

impl Default for SyntheticSection {
    fn default() -> Self {
        Self {
            rig: SyntheticRig::ThreeCameras,
            yaw_deg: 60.0,
            baseline_m: 0.3,
            seed: SyntheticOptions::demo().seed,
            noise: SyntheticNoise::D435i,
            disparity_sigma_px: 0.1,
            pace: Pace::RealTime,
            rate_hz: 30.0,
            frame_sets: None,
            // Smooth at 30 frames per second.
            view_step: 0.02,
            frames_per_view: 1,
            render_ahead: None,
            gyro: false,
            accel: false,
            moves: Vec::new(),
        }
    }
}

/// Ready-made rigs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SyntheticRig {
    /// Front, left and right, which hardly overlap.
    ThreeCameras,
    /// Left and right.
    Pair,
}

/// Noise of synthetic pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SyntheticNoise {
    /// Exact depth and clean colour.
    Off,
    /// As a D435i.
    D435i,
}

/// `sync`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct SyncSection {
    /// Largest difference of the stamps in one frame set.
    pub max_skew_ms: f64,
    /// How long a frame waits for those of the other cameras.
    pub wait_ms: f64,
    /// Without a frame for this long a camera counts as stalled.
    pub stalled_after_ms: f64,
    /// A camera that is stalled for this long is opened again.
    pub reopen_after_ms: f64,
    /// Frame sets taken while the rig turns faster are not used.
    pub max_turn_deg_per_s: f64,
}

impl Default for SyncSection {
    fn default() -> Self {
        let (sync, motion) = (SyncOptions::default(), MotionOptions::default());
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        Self {
            max_skew_ms: ms(sync.max_skew),
            wait_ms: ms(sync.wait),
            stalled_after_ms: ms(sync.stalled_after),
            reopen_after_ms: ms(sync.reopen_after),
            // People write 60, not 59.99999999999999.
            max_turn_deg_per_s: (motion.max_turn_rad_per_s.to_degrees() * 1e6).round() / 1e6,
        }
    }
}

/// `lines`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct LinesSection {
    /// Threads; 0 takes one per camera, at most one per core.
    pub threads: usize,
    /// Shortest segment kept.
    pub min_length_px: f64,
    /// Least gradient along an edge.
    pub min_gradient_levels_per_px: f64,
    /// Most segments of one image.
    pub max_segments: usize,
    /// Standard deviation of one inverse-depth reading, 1/m.
    pub sigma_inverse_depth_per_m: f64,
    /// Systematic error of inverse depth, as a share of it.
    pub relative_systematic: f64,
    /// Least share of agreeing depth samples for a lifted line.
    pub min_inlier_ratio: f64,
    /// Least share of the segment's length beside which depth agrees.
    pub min_coverage: f64,
}

impl Default for LinesSection {
    fn default() -> Self {
        let (detect, lift) = (DetectOptions::default(), LiftOptions::default());
        Self {
            threads: 0,
            min_length_px: detect.min_length_px,
            min_gradient_levels_per_px: detect.min_gradient_levels_per_px,
            max_segments: detect.max_segments,
            sigma_inverse_depth_per_m: lift.sigma_inverse_depth_per_m,
            relative_systematic: lift.relative_systematic,
            min_inlier_ratio: lift.min_inlier_ratio,
            min_coverage: lift.min_coverage,
        }
    }
}

/// `estimate`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct EstimateSection {
    /// Who finds the poses.
    pub estimator: EstimatorName,
    /// What scores candidate matches.
    pub association: AssociationName,
    /// Largest distance between two cameras that is considered.
    pub max_baseline_m: f64,
    /// Lifted lines kept per image, the most informative.
    pub max_lines_per_view: usize,
    /// Frame sets kept, the most informative.
    pub max_sets: usize,
    /// Frame sets with new evidence between two solutions of the daemon.
    pub min_new_sets: u32,
    /// Least number of independent matches of a converged pair.
    pub min_matches: usize,
    /// Least number of distinct rig views of a converged pair.
    pub min_views: usize,
    /// Factor by which the best pose must beat the runner-up.
    pub min_lead: f64,
    /// Largest standard deviation of the translation in its worst direction.
    pub max_sigma_translation_mm: f64,
    /// Largest standard deviation of the rotation about its worst axis.
    pub max_sigma_rotation_deg: f64,
    /// Largest share of surface samples that may contradict the pose.
    pub max_free_space_violated: f64,
}

impl Default for EstimateSection {
    fn default() -> Self {
        let EstimateOptions { estimator, max_baseline_m, evidence, verdict } = EstimateOptions::default();
        // People write 0.126 degrees, not 0.12605071492874652.
        let rounded = |value: f64| (value * 1e3).round() / 1e3;
        Self {
            estimator: EstimatorName::from(estimator),
            association: AssociationName::from(Association::default()),
            max_baseline_m,
            max_lines_per_view: evidence.max_lines_per_view,
            max_sets: evidence.max_sets,
            min_new_sets: SolveOptions::default().min_new_sets,
            min_matches: verdict.min_matches,
            min_views: verdict.min_views,
            min_lead: verdict.min_lead,
            max_sigma_translation_mm: rounded(verdict.max_sigma_translation_m * 1e3),
            max_sigma_rotation_deg: rounded(verdict.max_sigma_rotation_rad.to_degrees()),
            max_free_space_violated: verdict.max_free_space_violated,
        }
    }
}
