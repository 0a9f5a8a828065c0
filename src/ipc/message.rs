//! What the daemon publishes, as plain types: the newest calibration, how collecting goes, how the daemon and its cameras are.

use crate::solver::{RigCalibration, State, WatchReport};

/// Name and serial number of a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraIdentity {
    /// Name from the config, at most 32 bytes.
    pub name: String,
    /// Serial number, at most 32 bytes; empty where the back end has none.
    pub serial: String,
    /// Firmware version, of which 32 bytes are told; `None` where the back end does not tell it.
    pub firmware: Option<String>,
}

/// Where a calibration comes from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Provenance {
    /// Its number in the daemon's history; `None` where it is not kept, because it has not converged or there is no store.
    pub id: Option<u64>,
    /// The number of the older calibration that somebody went back to.
    pub restored_from: Option<u64>,
    /// Version of the program that made it, at most 32 bytes.
    pub version: String,
    /// SHA-256 of the effective config it was made with, in hex.
    pub config_hash: String,
}

/// The newest calibration of the rig: converged, stored (of an earlier run, and not verified against live lines yet), or neither.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationMessage {
    /// Counts the calibrations of this daemon, from 1.
    pub sequence: u64,
    /// When it was made, ns since 1970 (`CLOCK_REALTIME`).
    pub stamp_ns: u64,
    /// Where it comes from.
    pub provenance: Provenance,
    /// One per camera, in the order of `calibration.cameras`.
    pub cameras: Vec<CameraIdentity>,
    /// The result.
    pub calibration: RigCalibration,
}

/// How collecting goes, sent for every frame set.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgressMessage {
    /// Counts the progress messages of this daemon, from 1; a gap says that the reader was too slow.
    pub sequence: u64,
    /// Stamp of the newest frame, ns of the cameras' clock.
    pub newest_frame_ns: i64,
    /// When this message was sent, ns of the machine's `CLOCK_MONOTONIC`.
    pub published_ns: u64,
    /// From the arrival of the newest frame in the daemon to the sending of this message, ns.
    pub latency_ns: u64,
    /// The verdict so far.
    pub state: State,
    /// Whether a camera was moved since the result was made.
    pub is_moved: bool,
    /// What became of the frame sets.
    pub frame_sets: FrameSetCounts,
    /// Lines of the newest frame set, one entry per camera.
    pub cameras: Vec<CameraLines>,
    /// The pair with most agreeing matches; `None` before the first match.
    pub best_pair: Option<BestPair>,
    /// How far apart the frames of a set are.
    pub skew: Skew,
    /// How fast the rig turns; `None` where nothing tells.
    pub turning: Option<Turning>,
}

/// What became of the frame sets since collecting began.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameSetCounts {
    /// Complete sets that were put together.
    pub seen: u64,
    /// Taken as evidence.
    pub used: u64,
    /// Refused, by reason.
    pub refused: RefusedCounts,
    /// Lost because a stage was busy.
    pub dropped: u64,
}

/// Why frame sets were refused.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct RefusedCounts {
    /// Skew beyond the limit.
    pub skew: u64,
    /// A gyro said that the rig turned faster than the limit.
    pub gyro: u64,
    /// An image moved as fast as that.
    pub image: u64,
    /// Nothing new in them.
    pub repeated: u64,
}

impl RefusedCounts {
    /// All of them.
    pub fn total(&self) -> u64 {
        [self.skew, self.gyro, self.image, self.repeated].into_iter().fold(0, u64::saturating_add)
    }
}

/// How fast the rig turned when the newest frame set was taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turning {
    /// That of the camera with the largest rate, rad/s.
    pub rad_per_s: f64,
    /// What tells it.
    pub sense: TurnSense,
}

/// What tells how fast a rig turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurnSense {
    /// A gyro.
    Gyro,
    /// How far an image moved.
    Image,
}

impl TurnSense {
    /// Both, in the order of the wire format.
    pub const ALL: [TurnSense; 2] = [TurnSense::Gyro, TurnSense::Image];
}

/// Lines of one camera in one frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CameraLines {
    /// Straight segments.
    pub lines: u32,
    /// Of these, with depth.
    pub lifted: u32,
}

/// The pair that is closest to a result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BestPair {
    /// Index of the target camera.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
    /// Independent matches that agree.
    pub matches: usize,
}

/// Difference between the earliest and the latest stamp of a frame set.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Skew {
    /// Of the newest set, ns.
    pub last_ns: u64,
    /// The largest since collecting began, ns.
    pub max_ns: u64,
}

/// How the daemon and its cameras are, sent about once a second.
#[derive(Debug, Clone, PartialEq)]
pub struct HealthMessage {
    /// Counts the health messages of this daemon, from 1.
    pub sequence: u64,
    /// Since the daemon started, ns.
    pub uptime_ns: u64,
    /// How the result stands; `None` while there is none.
    pub watch: Option<WatchReport>,
    /// One per camera.
    pub cameras: Vec<CameraHealth>,
    /// One per stage of the pipeline, at most 8.
    pub stages: Vec<StageLatency>,
    /// One per pair of cameras.
    pub pair_skews: Vec<PairSkew>,
}

/// How one camera is.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraHealth {
    /// Name from the config, at most 32 bytes.
    pub name: String,
    /// What it does.
    pub state: CameraState,
    /// Frames it delivered.
    pub frames: u64,
    /// Frames that were dropped before they became part of a set.
    pub dropped: u64,
    /// How long ago its last frame came, ns; `None` before the first.
    pub last_frame_age_ns: Option<u64>,
    /// Frames per second since the health message before.
    pub fps_hz: f64,
    /// Frames that the camera numbered and that never came.
    pub lost: u64,
    /// Frames that were damaged, or not as large as the camera says.
    pub bad: u64,
    /// Share of the newest depth image that has a reading, 0 to 1; `None` before the first frame.
    pub valid_depth: Option<f64>,
    /// Whose clock stamped the newest frame; `None` before it.
    pub clock: Option<FrameClock>,
    /// Angle between where this camera feels up and where the reference camera does, by the served calibration, deg; 0 for the reference
    /// camera itself. `None` without accelerometers or places of both.
    pub gravity_off_deg: Option<f64>,
}

/// Whose clock a camera's frames are stamped with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameClock {
    /// The recording's or the renderer's.
    Source,
    /// The camera's own, which has nothing in common with those of others.
    Device,
    /// The camera's own, translated to the host's.
    Translated,
    /// The host's, when an image arrived.
    Host,
}

impl FrameClock {
    /// All, in the order of their numbers, which count from 1.
    pub const ALL: [Self; 4] = [Self::Source, Self::Device, Self::Translated, Self::Host];

    /// The name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Source => "source",
            Self::Device => "device",
            Self::Translated => "translated",
            Self::Host => "host",
        }
    }
}

/// What a camera does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraState {
    /// Not there yet; looked for again and again.
    Waiting,
    /// Delivers frames.
    Streaming,
    /// Open but silent for too long.
    Stalled,
    /// Not connected; it is taken back when it returns.
    Unplugged,
    /// Gives errors instead of frames; it is taken back when it recovers.
    Failed,
    /// A recording that is at its end.
    Ended,
    /// Open, but its first frame has not come yet.
    Opened,
}

impl CameraState {
    /// Every state, in the order of the wire format.
    pub const ALL: [CameraState; 7] = [
        CameraState::Waiting,
        CameraState::Streaming,
        CameraState::Stalled,
        CameraState::Unplugged,
        CameraState::Failed,
        CameraState::Ended,
        CameraState::Opened,
    ];

    /// The name in output.
    pub fn name(self) -> &'static str {
        match self {
            CameraState::Waiting => "waiting",
            CameraState::Streaming => "streaming",
            CameraState::Stalled => "stalled",
            CameraState::Unplugged => "unplugged",
            CameraState::Failed => "failed",
            CameraState::Ended => "ended",
            CameraState::Opened => "opened",
        }
    }
}

/// How long one stage takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageLatency {
    /// Name of the stage, at most 32 bytes.
    pub stage: String,
    /// Half of its runs took at most this long, ns.
    pub p50_ns: u64,
    /// 99 of 100 runs took at most this long, ns.
    pub p99_ns: u64,
    /// All runs since the start together, ns.
    pub total_ns: u64,
}

/// How far apart the frames of two cameras are, since the daemon started.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PairSkew {
    /// Indices of two cameras, the first before the second.
    pub cameras: (usize, usize),
    /// Frame sets that both are in.
    pub sets: u64,
    /// Half of these were not further apart, ns.
    pub p50_ns: u64,
    /// 99 of 100 were not further apart, ns.
    pub p99_ns: u64,
    /// The largest, ns.
    pub max_ns: u64,
    /// How often the nearest frames were further apart than the limit.
    pub beyond: u64,
    /// How far apart they were the last time, ns; 0 before the first.
    pub last_beyond_ns: u64,
}
