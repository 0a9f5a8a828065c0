//! What appearance is worth for a pair of cameras: poses that its strong matches propose, and how far it is believed.
//!
//! Where views overlap, most lines that look alike are one edge, and a single pose explains them. Where they do not, look-alikes agree
//! on nothing: the share of the strong matches that the best of their poses explains tells the two apart, and the less that is, the
//! less any score counts. Nothing is excluded: the poses are starts beside those that geometry votes for.

use super::candidates::PairEvidence;
use super::line_pair::{LinePair, TargetSide};
use super::matched::rough_poses;
use crate::geometry::ScoredMatch;
use crate::geometry::motion::Motion;

/// A match is strong when its likeness is so many times likelier for one edge than for two: e, nats.
const STRONG_NATS: f64 = 1.0;
/// Strong matches that are looked at, at most; more would not change the share.
const MAX_STRONG: usize = 600;
/// A pose that fits two matches explains about one more by chance: so many say nothing.
const BY_CHANCE: usize = 3;
/// Least number of strong matches that one pose explains beyond those.
const MIN_EXPLAINED: usize = 4;
/// Up to this share of the strong matches a pose explains look-alikes of rooms without a common view ...
const NO_TRUST_SHARE: f64 = 0.15;
/// ... and from this share on of a common view.
const FULL_TRUST_SHARE: f64 = 0.4;

/// What appearance is worth.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Prior {
    /// Poses that strong matches agree on, `target_from_source`, the best first; none without trust.
    pub poses: Vec<Motion>,
    /// What scores are to be multiplied with, 0 to 1.
    pub trust: f64,
    pub told: (usize, usize),
}

impl Prior {
    /// Whether most of what looks alike is explained by the best pose.
    pub fn is_certain(&self) -> bool {
        self.trust >= 1.0
    }
}

/// Draws poses from the strong matches of all frame sets.
pub fn prior(pair: &PairEvidence<'_>) -> Prior {
    let strong = strong_matches(pair);
    let rough = rough_poses(&strong);
    let explained = rough.first().map_or(0, |(_, n_explained)| n_explained.saturating_sub(BY_CHANCE));
    if explained < MIN_EXPLAINED {
        return Prior { told: (explained, strong.len()), ..Prior::default() };
    }
    let share = explained as f64 / strong.len() as f64;
    let trust = ((share - NO_TRUST_SHARE) / (FULL_TRUST_SHARE - NO_TRUST_SHARE)).clamp(0.0, 1.0);
    if trust == 0.0 {
        return Prior { told: (explained, strong.len()), ..Prior::default() };
    }
    Prior { poses: rough.into_iter().map(|(pose, _)| pose).collect(), trust, told: (explained, strong.len()) }
}

/// The strongest matches of each set, one-to-one.
fn strong_matches(pair: &PairEvidence<'_>) -> Vec<LinePair> {
    let n_sets = pair.evidence.sets.len();
    let per_set = (MAX_STRONG / n_sets.max(1)).max(BY_CHANCE);
    let mut strong = Vec::new();
    for set in 0..n_sets {
        let Some((targets, sources)) = pair.lines(set) else { continue };
        for found in one_to_one(pair.scores(set)).into_iter().take(per_set) {
            let lines = (targets.get(found.target as usize), sources.get(found.source as usize));
            if let (Some(target), Some(source)) = lines {
                let target = TargetSide::Full(target.clone());
                strong.push(LinePair { target, source: source.clone(), set: set as u32 });
            }
        }
    }
    strong
}

/// Strong matches, the strongest first, each line once.
fn one_to_one(scores: &[ScoredMatch]) -> Vec<ScoredMatch> {
    let mut strong: Vec<ScoredMatch> =
        scores.iter().filter(|found| found.nats >= STRONG_NATS).copied().collect();
    strong.sort_by(|a, b| b.nats.total_cmp(&a.nats));
    let mut kept: Vec<ScoredMatch> = Vec::new();
    for found in strong {
        if kept.iter().all(|other| other.target != found.target && other.source != found.source) {
            kept.push(found);
        }
    }
    kept
}
