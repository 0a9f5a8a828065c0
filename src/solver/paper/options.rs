//! Settings of the paper's estimator, with the paper's own choice beside each correction.

use super::convergence_vote::Tolerance;
use super::gate::GateRule;
use super::refine::Weighting;

/// Settings of [`solve_pairs`](super::estimator::solve_pairs).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PaperOptions {
    /// Which new pairs are let in (paper, III-C.1).
    pub gate: GateRule,
    /// Units of the refinement's errors.
    pub weighting: Weighting,
    /// Width of the Cauchy loss of one pair, in these units (mm and px, or standard deviations).
    pub loss_width: f64,
    /// How near a translation candidate must be to vote (the paper's ε).
    pub tolerance: Tolerance,
    /// Least number of pairs to try at all.
    pub min_pairs: usize,
    /// Least number of voters in one point.
    pub min_voters: usize,
    /// Largest robust cost, mean over the pairs that take part.
    pub max_mean_cost: f64,
    /// Largest standard deviation of the translation in its worst direction, m.
    pub max_sigma_translation_m: f64,
    /// Largest standard deviation of the rotation about its worst axis, rad.
    pub max_sigma_rotation_rad: f64,
}

impl PaperOptions {
    /// Corrected, but otherwise as published: millimetres and pixels with equal weight. Four times the limits of the deviations are 16 mm
    /// and half a degree.
    pub fn as_published() -> Self {
        Self {
            gate: GateRule::WhenStuck { n_sigmas: 3.0 },
            weighting: Weighting::AsPublished,
            loss_width: 2.0,
            tolerance: Tolerance::Sigmas { n: 4.0, floor_m: 0.007 },
            min_pairs: 6,
            min_voters: 10,
            max_mean_cost: 8.0,
            max_sigma_translation_m: 0.004,
            max_sigma_rotation_rad: 0.0022,
        }
    }

    /// Errors divided by their covariance. The limits of the deviations are wider, since on a rig, whose lines these are, the verdict
    /// on the pose follows.
    pub fn whitened() -> Self {
        Self {
            weighting: Weighting::Whitened,
            loss_width: 3.5,
            max_mean_cost: 3.0,
            max_sigma_translation_m: 0.01,
            max_sigma_rotation_rad: 0.005,
            ..Self::as_published()
        }
    }
}

impl Default for PaperOptions {
    fn default() -> Self {
        Self::as_published()
    }
}
