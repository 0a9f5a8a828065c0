//! The pose that fits the matches best, by robust least squares with the measurement weights of both lines, and which matches
//! agree with it.

use nalgebra::Matrix6;

use super::sight::Sights;
use crate::geometry::motion::{Motion, updated};
use crate::solver::line_pair::{LinePair, TargetSide};
use crate::solver::refine::{NormalEquations, Whitened, descend};
use crate::solver::residual::{match_residual, offset_residual};

/// Widths of the Cauchy loss for the steps from far off to near the minimum, in standard deviations of a match.
const ROUGH_WIDTHS: [f64; 5] = [30.0, 30.0, 10.0, 10.0, 5.0];
/// The same at the minimum: true matches lie near 2.
const FINE_WIDTH: f64 = 4.0;
/// Most steps at the minimum (4 to 8 are needed).
const FINE_STEPS: usize = 20;
/// Squared whitened distances within which a match agrees: 99.9 % of chi-square for the four numbers of a full match ...
const GATE_FULL: f64 = 18.5;
/// ... and for the two of a PnL match.
const GATE_PNL: f64 = 13.8;
/// Poses that are only compared are gated this much wider (squared): they are not at their minimum yet.
const ROUGH_GATE: f64 = 4.0;
/// The noise is estimated between that of the noise model and this many times as much.
pub const MAX_NOISE_SCALE: f64 = 2.5;

/// A pose and what it explains.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Target from source.
    pub pose: Motion,
    /// Positions in [`Sights::pairs`] of the matches that agree.
    pub inliers: Vec<usize>,
    /// Sum over these of how well they agree, a perfect full match counting 1.
    pub score: f64,
    /// How many times noisier than their noise model the agreeing matches are, at least 1.
    pub noise_scale: f64,
    /// Information of the agreeing matches on a step (x y z rx ry rz), 1/m², 1/rad² and mixed, with that noise.
    pub information: Matrix6<f64>,
}

/// Takes a pose from a draw near its minimum.
pub fn roughly(sights: &Sights<'_>, start: &Motion) -> Fit {
    let step_from = |pose: Motion, &loss_width: &f64| match system(sights, &pose, loss_width).step(0.0) {
        Some(step) => updated(&pose, &step),
        None => pose,
    };
    Fit::at(sights, &ROUGH_WIDTHS.iter().fold(*start, step_from), ROUGH_GATE)
}

/// The pose of maximum likelihood, but for a robust loss, from near it.
pub fn finely(sights: &Sights<'_>, rough: &Fit) -> Fit {
    let refined = descend(&rough.pose, FINE_STEPS, |pose| system(sights, pose, FINE_WIDTH));
    Fit::at(sights, &refined.target_from_source, 1.0)
}

fn system(sights: &Sights<'_>, pose: &Motion, loss_width: f64) -> NormalEquations {
    let mut sum = NormalEquations::zero();
    for pair in &sights.pairs {
        sum.add(whitened(pair, pose, 1.0), loss_width);
    }
    sum
}

/// One match's part of the normal equations; `None` where the source line predicts nothing.
pub fn whitened(pair: &LinePair, pose: &Motion, noise_scale: f64) -> Option<Whitened> {
    match &pair.target {
        TargetSide::Full(target) => Whitened::new(&match_residual(target, &pair.source, pose)?, noise_scale),
        TargetSide::Pnl(target) => {
            Whitened::of_offsets(&offset_residual(target, &pair.source, pose)?, noise_scale)
        }
    }
}

impl Fit {
    fn at(sights: &Sights<'_>, pose: &Motion, gate_factor: f64) -> Self {
        let all: Vec<Option<Whitened>> = sights.pairs.iter().map(|pair| whitened(pair, pose, 1.0)).collect();
        // Numbers a match measures, and its gate.
        let kind = |at: usize| {
            if sights.pairs[at].full_target().is_some() { (4.0, GATE_FULL) } else { (2.0, GATE_PNL) }
        };
        let distance2 = |at: usize| all[at].as_ref().map_or(f64::INFINITY, |found| found.distance2);
        let mut noise_scale2 = 1.0;
        let mut inliers = Vec::with_capacity(all.len());
        // The gate widens with the noise and the noise is that of what it lets in: three rounds settle.
        for _ in 0..3 {
            inliers.clear();
            inliers
                .extend((0..all.len()).filter(|&at| distance2(at) < kind(at).1 * noise_scale2 * gate_factor));
            let sum2: f64 = inliers.iter().map(|&at| distance2(at)).sum();
            let freedom = inliers.iter().map(|&at| kind(at).0).sum::<f64>() - 6.0;
            if freedom > 0.0 {
                noise_scale2 = (sum2 / freedom).clamp(1.0, MAX_NOISE_SCALE * MAX_NOISE_SCALE);
            }
        }
        let mut fit = Self {
            pose: *pose,
            inliers,
            score: 0.0,
            noise_scale: noise_scale2.sqrt(),
            information: Matrix6::zeros(),
        };
        for &at in &fit.inliers {
            let (n_numbers, gate) = kind(at);
            fit.score += 0.25 * n_numbers * (1.0 - distance2(at) / (gate * noise_scale2 * gate_factor));
            if let Some(found) = &all[at] {
                fit.information += found.information / noise_scale2;
            }
        }
        fit
    }
}
