//! What can be chosen about the pipeline, and what is refused.

use std::time::Duration;

use crate::lines::{DetectOptions, LiftOptions};
use crate::solver::{EstimateOptions, WatchLimits};

use super::MAX_CAMERAS;
use super::associate::AssociateOptions;
use super::motion::MotionOptions;
use super::recovery::RecoveryOptions;

/// Everything that can be chosen about the pipeline.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PipelineOptions {
    /// Segment detection.
    pub detect: DetectOptions,
    /// Lifting.
    pub lift: LiftOptions,
    /// What scores candidate matches.
    pub associate: AssociateOptions,
    /// The estimator.
    pub estimate: EstimateOptions,
    /// The motion test.
    pub motion: MotionOptions,
    /// Frames into sets, and when a camera counts as stalled.
    pub sync: SyncOptions,
    /// When to solve.
    pub solve: SolveOptions,
    /// From when on a camera counts as moved after a converged result.
    pub watch: WatchLimits,
    /// Threads of the line stage; 0 takes one per camera, at most one per core.
    pub n_line_threads: usize,
    /// How a camera that fails is brought back.
    pub recovery: RecoveryOptions,
}

impl PipelineOptions {
    /// Threads of the line stage for so many cameras, at least one.
    pub(super) fn line_threads(&self, n_cameras: usize) -> usize {
        if self.n_line_threads > 0 {
            return self.n_line_threads;
        }
        let n_cores = std::thread::available_parallelism().map_or(1, usize::from);
        n_cameras.clamp(1, n_cores)
    }
}

/// How frames become sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyncOptions {
    /// Largest distance between the stamps of one set.
    pub max_skew: Duration,
    /// How long a frame waits for the other living cameras.
    pub wait: Duration,
    /// A camera without a frame for this long is stalled: the others go on without it.
    pub stalled_after: Duration,
    /// A camera that is stalled for this long is closed and opened again.
    pub reopen_after: Duration,
}

impl Default for SyncOptions {
    fn default() -> Self {
        Self {
            // A quarter of the 33 ms between frames: nearest partners are unique, and free-running cameras still meet.
            max_skew: Duration::from_millis(8),
            wait: Duration::from_millis(100),
            stalled_after: Duration::from_millis(500),
            reopen_after: Duration::from_secs(5),
        }
    }
}

/// When the estimator solves: a solution costs seconds, so new evidence is collected first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolveOptions {
    /// Solve when so many sets with new evidence have come since the last solution ...
    pub min_new_sets: u32,
    /// ... and the evidence has grown by this share ...
    pub min_growth: f64,
    /// ... or when there is any new evidence and no more has come for this long.
    pub after_quiet: Duration,
}

impl Default for SolveOptions {
    fn default() -> Self {
        Self { min_new_sets: 3, min_growth: 0.25, after_quiet: Duration::from_secs(2) }
    }
}

/// Why a pipeline did not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    /// There is nothing to run.
    #[error("no cameras given: at least 1 is needed, 2 to calibrate")]
    NoCameras,
    /// More cameras than a set has room for.
    #[error("{0} cameras given: at most {MAX_CAMERAS} are supported")]
    TooManyCameras(usize),
    /// The operating system gave no thread.
    #[error("thread \"{name}\" could not be started: {source}")]
    Thread {
        /// Which.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
}
