//! Draws pairs of matches until a better pose is as good as impossible, and keeps the poses that most matches agree with.

use nalgebra::{Rotation3, UnitQuaternion};

use super::sample::{Placement, for_each_pose};
use super::score::{Score, score};
use super::sight::Sights;
use crate::geometry::motion::Motion;

/// Most draws: enough for one match in twelve being right.
const MAX_DRAWS: usize = 6000;
/// Chance of having missed every good draw at which drawing ends.
const MISS_CHANCE: f64 = 1e-6;
/// Share of the draws of two right matches that lead to the right pose: the others are nearly parallel, or too noisy.
const GOOD_SHARE: f64 = 0.25;
/// A pose is only kept while it scores this share of the best: others are no rivals.
const RIVAL_SHARE: f64 = 0.4;
/// What a pose from a draw scores at least of what it will at its minimum.
const DRAWN_SHARE: f64 = 0.4;
/// Poses kept.
const MAX_LEADERS: usize = 4;
/// Poses from draws closer than this, rad and m, are taken for the same pose.
const SAME_POSE: (f64, f64) = (0.2, 0.15);
/// Matches over which a pose from a draw is scored, at most: more would not change the ranking.
const MAX_SCORED: usize = 600;

/// splitmix64 from a fixed seed.
pub struct Generator(u64);

impl Generator {
    /// Always the same sequence.
    pub fn new() -> Self {
        Self(0x5eed)
    }

    /// Uniform in `0..n`, up to a bias of n / 2⁶⁴.
    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        ((u128::from(z) * n as u128) >> 64) as usize
    }
}

/// The poses that explain most, best first; empty when no two matches fit each other.
///
/// `least` is the least score, in perfect full matches at the minimum, that is worth finding.
pub fn leaders(sights: &Sights<'_>, least: f64) -> Vec<Motion> {
    let n = sights.placed.len();
    if n < 2 {
        return Vec::new();
    }
    let scored = &sights.sights[..sights.sights.len().min(MAX_SCORED)];
    let n_scored_full = scored.iter().filter(|sight| sight.inverse_depth_per_m.is_some()).count();
    let mut generator = Generator::new();
    let mut leaders: Vec<(Placement, Score)> = Vec::with_capacity(MAX_LEADERS + 1);
    let least_right = least / sights.highest_score();
    let least_score = (DRAWN_SHARE * least).max(1.0);
    let (mut drawn, mut needed) = (0, draws_needed(least_right));
    while drawn < needed {
        drawn += 1;
        let first = generator.below(n);
        let second = (first + 1 + generator.below(n - 1)) % n;
        for_each_pose(&sights.placed[first], &sights.placed[second], |placement| {
            let best = leaders.first().map_or(0.0, |(_, best)| best.sum);
            if let Some(found) = score(scored, placement, (RIVAL_SHARE * best).max(least_score)) {
                keep(&mut leaders, (*placement, found));
            }
        });
        if let Some((_, best)) = leaders.first() {
            needed = draws_needed(least_right.max(best.n_full as f64 / n_scored_full as f64));
        }
    }
    let kept = leaders.first().map_or(0.0, |(_, best)| RIVAL_SHARE * best.sum);
    leaders.iter().filter(|(_, score)| score.sum >= kept).map(|(placement, _)| placement.motion()).collect()
}

/// Draws after which two right matches, of a share `right` of all, were missed with less than [`MISS_CHANCE`].
fn draws_needed(right: f64) -> usize {
    let good = GOOD_SHARE * right * right;
    if good < 1e-9 {
        return MAX_DRAWS;
    }
    ((MISS_CHANCE.ln() / (-good).ln_1p()).ceil() as usize).min(MAX_DRAWS)
}

/// Puts a pose in its place; of poses that are nearly the same only the best stays.
fn keep(leaders: &mut Vec<(Placement, Score)>, (placement, score): (Placement, Score)) {
    let rank = leaders.iter().take_while(|(_, other)| other.sum >= score.sum).count();
    if leaders[..rank].iter().any(|(other, _)| other.is_close_to(&placement)) {
        return;
    }
    let mut at = 0;
    leaders.retain(|(other, _)| {
        at += 1;
        at <= rank || !other.is_close_to(&placement)
    });
    leaders.insert(rank, (placement, score));
    leaders.truncate(MAX_LEADERS);
}

impl Placement {
    fn is_close_to(&self, other: &Self) -> bool {
        // |R - R'|² = 4 (1 - cos angle), close to 2 angle² for small angles.
        let turn2 = (self.rotation - other.rotation).norm_squared();
        let gap_m = (self.translation_m - other.translation_m).norm();
        turn2 < 2.0 * SAME_POSE.0 * SAME_POSE.0 && gap_m < SAME_POSE.1
    }

    fn motion(&self) -> Motion {
        let rotation = Rotation3::from_matrix_unchecked(self.rotation);
        Motion::from_parts(self.translation_m.into(), UnitQuaternion::from_rotation_matrix(&rotation))
    }
}
