//! The pose of a pair of cameras from given matches of lines, with wrong ones among them.
//!
//! Consensus: two matches lifted on both sides fix a pose; the pose most matches agree with is refined over all of them with the
//! measurement weights of both lines, and judged. No initial guess, any rotation, and the order of the matches does not
//! matter. Matches lifted in the source only ("PnL") take part in everything but the draws.

mod draw;
mod fit;
mod sample;
mod score;
mod sight;
mod verdict;

#[cfg(test)]
mod tests;

use nalgebra::Matrix6;

use super::line_pair::LinePair;
use super::result::{Reason, State};
use crate::geometry::motion::Motion;
use fit::Fit;
use sight::Sights;

/// What was found.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchedSolution {
    /// The verdict.
    pub state: State,
    /// Why it is not converged.
    pub reason: Option<Reason>,
    /// The pose; `None` unless converged: nobody shall use a pose that is not trusted.
    pub target_from_source: Option<Motion>,
    /// Covariance of a step `t + dt`, `exp(dr) R`, ordered x y z rx ry rz, m and rad; `None` unless converged.
    pub covariance: Option<Matrix6<f64>>,
    /// The pairs that agree with the best pose, ascending, converged or not.
    pub inliers: Vec<usize>,
}

/// Limits of the verdict on given matches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchedLimits {
    /// Least number of agreeing matches, repeated ones counted once.
    pub min_matches: usize,
    /// Largest expected number of poses on which as many wrong matches agree by chance.
    pub max_chance: f64,
    /// The best pose must explain this many times as much as any really different one.
    pub min_lead: f64,
    /// Largest standard deviation of the translation in its worst direction, m.
    pub max_sigma_translation_m: f64,
    /// Largest standard deviation of the rotation about its worst axis, rad.
    pub max_sigma_rotation_rad: f64,
}

impl Default for MatchedLimits {
    fn default() -> Self {
        Self {
            min_matches: 6,
            max_chance: 1e-3,
            min_lead: 2.0,
            max_sigma_translation_m: 0.004,
            max_sigma_rotation_rad: 0.0022,
        }
    }
}

/// Finds the pose that the matches agree on, and judges it.
pub fn solve_matches(pairs: &[LinePair], limits: &MatchedLimits) -> MatchedSolution {
    let sights = Sights::new(pairs);
    let fits = rough_fits(&sights, 0.0);
    let Some(best) = fits.first().map(|rough| fit::finely(&sights, rough)) else {
        return unsolved(verdict::without_pose(&sights));
    };
    // A rival either explains the same matches in another way, or is what the other matches agree on.
    let mirrored = fits.into_iter().find(|other| verdict::really_differ(&best.pose, &other.pose));
    let rivals = [mirrored, elsewhere(&sights, &best, limits)];
    let rival = rivals.iter().flatten().max_by(|a, b| a.score.total_cmp(&b.score));
    let verdict = verdict::judge(&verdict::Bench { sights: &sights, best: &best, rival, limits });
    let mut inliers: Vec<usize> = best.inliers.iter().map(|&at| sights.order[at]).collect();
    inliers.sort_unstable();
    match verdict {
        Ok(covariance) => MatchedSolution {
            state: State::Converged,
            reason: None,
            target_from_source: Some(best.pose),
            covariance: Some(covariance),
            inliers,
        },
        Err(objection) => MatchedSolution { inliers, ..unsolved(objection) },
    }
}

/// Poses that the matches agree on, near their minimum, each with how many it explains, best first; empty where no two agree.
pub fn rough_poses(pairs: &[LinePair]) -> Vec<(Motion, usize)> {
    let fits = rough_fits(&Sights::new(pairs), 0.0);
    fits.into_iter().map(|fit| (fit.pose, fit.inliers.len())).collect()
}

/// Poses near their minimum that explain `least` or more, the one that explains most first.
fn rough_fits(sights: &Sights<'_>, least: f64) -> Vec<Fit> {
    let leaders = draw::leaders(sights, least);
    let mut fits: Vec<Fit> = leaders.iter().map(|pose| fit::roughly(sights, pose)).collect();
    // Stable: of equals the first drawn stays first, so that the answer is always the same.
    fits.sort_by(|a, b| b.score.total_cmp(&a.score));
    fits
}

/// What the matches that do not agree with the best pose agree on; `None` when they are too few to matter.
fn elsewhere(sights: &Sights<'_>, best: &Fit, limits: &MatchedLimits) -> Option<Fit> {
    let others = sights.without(&best.inliers);
    let least = best.score / limits.min_lead;
    if least > others.highest_score() { None } else { rough_fits(&others, least).into_iter().next() }
}

fn unsolved((state, reason): (State, Reason)) -> MatchedSolution {
    MatchedSolution {
        state,
        reason: Some(reason),
        target_from_source: None,
        covariance: None,
        inliers: Vec::new(),
    }
}
