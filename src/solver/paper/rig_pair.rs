//! The paper's estimator on a pair of a rig, whose lines nobody has matched.
//!
//! The paper takes its matches from a learned matcher. Where there is none, they are what the leading poses of the consensus
//! explain, true and false ones together; which of them hold, and the pose, the paper's loop finds by itself, and the same
//! verdict judges it.

use super::estimator::solve_pairs;
use super::options::PaperOptions;
use crate::geometry::motion::Motion;
use crate::solver::association::{Match, Scene};
use crate::solver::consensus::{Hypothesis, Ranking};
use crate::solver::line_pair::{LinePair, TargetSide};
use crate::solver::noise::noise_scale;
use crate::solver::pnl::{Matched, PnlMatch, Unlifted};
use crate::solver::refine::{Refined, Stop};
use crate::solver::result::{Reason, State};

/// A match of either kind, as the ranking holds it.
#[derive(Clone, Copy)]
enum Found {
    Full(Match),
    Pnl(PnlMatch),
}

/// The pose that the paper's loop finds among the matches of the leading poses.
///
/// # Errors
/// The state and the reason for the user when the paper's loop does not end with a pose.
pub fn pose_by_paper(scene: &Scene<'_>, ranking: &Ranking) -> Result<Hypothesis, (State, Reason)> {
    let (found, pairs): (Vec<Found>, Vec<LinePair>) =
        matches(ranking).into_iter().filter_map(|found| Some((found, line_pair(scene, found)?))).unzip();
    let solution = solve_pairs(&pairs, &PaperOptions::whitened());
    let pose = solution.pose()?;
    let inliers: Vec<Found> = solution.inliers.iter().map(|&idx| found[idx]).collect();
    Ok(hypothesis(scene, &pose, &inliers))
}

/// What the leading poses explain, each match once, best pose first.
fn matches(ranking: &Ranking) -> Vec<Found> {
    let leading = [Some(&ranking.best), ranking.neighbour.as_ref(), ranking.runner_up.as_ref()];
    let (mut full, mut pnl): (Vec<Match>, Vec<PnlMatch>) = (Vec::new(), Vec::new());
    for pose in leading.into_iter().flatten() {
        for found in &pose.matches {
            if full.iter().all(|known| known.candidate != found.candidate) {
                full.push(*found);
            }
        }
        for found in &pose.pnl {
            if pnl.iter().all(|known| known.pair != found.pair) {
                pnl.push(*found);
            }
        }
    }
    full.into_iter().map(Found::Full).chain(pnl.into_iter().map(Found::Pnl)).collect()
}

/// The two lines of a match; `None` for a source without depth, which the paper has no equation for.
fn line_pair(scene: &Scene<'_>, found: Found) -> Option<LinePair> {
    match found {
        Found::Full(found) => {
            let candidate = &scene.candidates[found.candidate];
            let (target, source) = scene.pair.pair(candidate)?;
            let target = TargetSide::Full(target.clone());
            Some(LinePair { target, source: source.clone(), set: candidate.set })
        }
        Found::Pnl(PnlMatch { pair, .. }) if pair.unlifted == Unlifted::Target => {
            let (target, source) = scene.pair.views(pair.set as usize)?;
            let target = TargetSide::Pnl(*target.unlifted.get(usize::from(pair.segment))?);
            Some(LinePair {
                target,
                source: source.lines.get(usize::from(pair.lifted))?.clone(),
                set: pair.set,
            })
        }
        Found::Pnl(_) => None,
    }
}

/// The paper's pose in the form that is ranked and judged.
fn hypothesis(scene: &Scene<'_>, pose: &Motion, inliers: &[Found]) -> Hypothesis {
    let mut matches = Vec::new();
    let mut pnl = Vec::new();
    for found in inliers {
        match found {
            Found::Full(found) => matches.push(*found),
            Found::Pnl(found) => pnl.push(*found),
        }
    }
    let noise_scale = noise_scale(&matches, 1.0);
    let information = Matched::new(&matches, &pnl).equations(scene, pose, noise_scale).information;
    let refined = Refined { target_from_source: *pose, information, stop: Stop::SmallStep };
    let appearance = matches.iter().map(|found| found.nats).sum();
    let score = matches.iter().map(Match::worth).sum();
    Hypothesis { refined, matches, pnl, score, appearance, missing: Default::default(), noise_scale }
}
