//! What the pipeline tells its owner, and what it can be told.

use std::time::{Duration, Instant};

use crate::capture::StampNs;
use crate::solver::{RigCalibration, WatchReport};

use super::MAX_CAMERAS;
use super::motion::Turn;
use super::stats::Counts;

/// What can be asked of a running pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// Forget the evidence and collect anew.
    Recalibrate,
    /// Stop collecting; the last result stays.
    Cancel,
}

/// What became of a [`Command`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Answer {
    /// Done.
    Accepted,
    /// Recalibrate: it is collecting already; cancel first to start over.
    Busy,
    /// Cancel: it is not collecting.
    NotCollecting,
}

/// What the estimator is doing.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Phase {
    /// Frame sets go to the estimator.
    #[default]
    Collecting,
    /// There is a result, of this run or given by [`super::Pipeline::watch`]; it is compared with what the cameras see.
    Watching,
    /// Collecting was cancelled; frames are still watched.
    Idle,
}

/// How a camera is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraState {
    /// Not there yet; looked for again and again.
    Waiting,
    /// Delivers frames.
    Streaming,
    /// Open, but without frames for longer than the limit.
    Stalled,
    /// Was there and went away; looked for again and again.
    Unplugged,
    /// Gives errors instead of frames; opened again and again.
    Failed,
    /// The recording is at its end.
    Ended,
    /// Open, and within the limit for its first frame.
    Opened,
}

impl CameraState {
    /// Every state, in the order of its number.
    pub const ALL: [CameraState; 7] = [
        CameraState::Waiting,
        CameraState::Streaming,
        CameraState::Stalled,
        CameraState::Unplugged,
        CameraState::Failed,
        CameraState::Ended,
        CameraState::Opened,
    ];

    /// The name in messages.
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

/// One camera's part of a [`Progress`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CameraProgress {
    /// Whether the camera was part of the set.
    pub is_present: bool,
    /// Segments found.
    pub lines: u32,
    /// Of these, with depth.
    pub lifted: u32,
}

/// One frame set has gone through the line stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Number of the set; gaps are sets dropped by the line stage or events nobody read.
    pub set: u64,
    /// Stamp of the newest frame of the set.
    pub newest_stamp: StampNs,
    /// When that frame arrived at this host.
    pub newest_arrival: Instant,
    /// From that arrival to this event.
    pub latency: Duration,
    /// Distance between the oldest and newest stamp of the set.
    pub skew: Duration,
    /// How fast the rig turned, where it could be told.
    pub turn: Option<Turn>,
    /// By camera; only the first ones exist.
    pub cameras: [CameraProgress; MAX_CAMERAS],
    /// What the estimator is doing.
    pub phase: Phase,
    /// All counts.
    pub counts: Counts,
}

/// A solution.
#[derive(Debug, Clone, PartialEq)]
pub struct Solved {
    /// What the estimator answers; cameras in the pipeline's order.
    pub calibration: RigCalibration,
    /// Stamp of the newest frame that contributed.
    pub newest_stamp: StampNs,
    /// Frame sets offered to the estimator since it began collecting, repeated ones included.
    pub sets_seen: u64,
    /// Of these, the ones that brought new evidence; when no more have come since, this solution is the last word.
    pub sets_accepted: u64,
    /// Time the solution took.
    pub took: Duration,
    /// Which round of collecting it belongs to; see [`super::Pipeline::round`].
    pub round: u64,
}

/// How a converged result stands.
#[derive(Debug, Clone, PartialEq)]
pub struct Watched {
    /// What the newest frame sets say.
    pub report: WatchReport,
    /// The round whose result it is; see [`super::Pipeline::round`].
    pub round: u64,
}

/// What the pipeline tells its owner.
#[derive(Debug, Clone, PartialEq)]
// Progress is the large one and by far the most frequent: a box would allocate once per frame set.
#[allow(clippy::large_enum_variant)]
pub enum PipelineEvent {
    /// A camera changed its state. Lost when nobody reads events; the snapshot always has the state.
    Camera {
        /// Index of the camera.
        camera: usize,
        /// What it is now.
        state: CameraState,
        /// Why, in words; empty when the state says it all.
        detail: String,
    },
    /// A frame set went through the line stage.
    Progress(Progress),
    /// The estimator has solved.
    Calibration(Box<Solved>),
    /// A converged result was compared with what the cameras see.
    Watched(Box<Watched>),
    /// A thread ended by a panic: a bug; the pipeline should be stopped and started again.
    Bug {
        /// Which thread.
        thread: String,
    },
}
