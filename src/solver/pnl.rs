//! Matches of a lifted line with a segment that has no depth (the paper's PnL case), either way round.
//!
//! Two numbers agree by chance far more easily than four, so these matches are not voted for: they are looked for once a pose
//! has settled on its lifted lines, among the lines that it leaves over, and then help to fix it.

use std::collections::BTreeSet;

use nalgebra::{Matrix2, Matrix6};

use super::association::{Match, STRUCTURE_PENALTY, Scene};
use super::candidates::PairEvidence;
use super::evidence::EvidenceLine;
use super::refine::{NormalEquations, Refined, Whitened, descend};
use super::residual::{OffsetResidual, offset_residual, reversed_offset_residual};
use super::sides::brightness_gain;
use crate::geometry::LineObservation;
use crate::geometry::motion::Motion;

/// Agreement worse than this is none: 99.9 % of true matches (chi-square, two degrees of freedom).
const MAX_DISTANCE2: f64 = 13.8;
/// Chance: offsets within ±0.6 of the image plane at both ends, uniformly.
const LOG_CHANCE_VOLUME: f64 = 0.365;
/// No single match counts more, nats: a third of a lifted one.
const MAX_GAIN: f64 = 4.0;
/// First look: both ends this close to the predicted line on the plane z = 1 (25 px).
const NEAR_OFFSET: f64 = 0.04;
/// Width of the Cauchy loss in standard deviations: as for lifted matches, per number compared.
const LOSS_WIDTH: f64 = 2.5;

/// Which camera measured no depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Unlifted {
    /// The target: the source's line is compared in the target's image.
    Target,
    /// The source: the target's line is compared in the source's image.
    Source,
}

/// A lifted line of one camera and a segment of the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PnlPair {
    /// Index of the frame set.
    pub set: u32,
    /// Index of the lifted line in its view.
    pub lifted: u16,
    /// Index of the segment among those without depth in its view.
    pub segment: u16,
    /// Whose the segment is.
    pub unlifted: Unlifted,
}

/// A pair that a pose explains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PnlMatch {
    /// The two.
    pub pair: PnlPair,
    /// Squared Mahalanobis distance, two degrees of freedom.
    pub distance2: f64,
    /// Evidence for the pose, nats, above 0.
    pub gain: f64,
}

/// A settled pose, for which further matches are looked for.
#[derive(Debug, Clone, Copy)]
pub struct Settled<'a> {
    /// The pose.
    pub target_from_source: &'a Motion,
    /// Its covariance (x y z rx ry rz).
    pub covariance: &'a Matrix6<f64>,
    /// Factor on the lines' standard deviations.
    pub noise_scale: f64,
}

impl PnlPair {
    /// What is compared; `None` where the line predicts nothing, or nothing in front of the camera.
    fn residual(&self, pair: &PairEvidence<'_>, target_from_source: &Motion) -> Option<OffsetResidual> {
        let (target, source) = pair.views(self.set as usize)?;
        let (lifted, segment) = (usize::from(self.lifted), usize::from(self.segment));
        match self.unlifted {
            Unlifted::Target => {
                offset_residual(target.unlifted.get(segment)?, source.lines.get(lifted)?, target_from_source)
            }
            Unlifted::Source => reversed_offset_residual(
                target.lines.get(lifted)?,
                source.unlifted.get(segment)?,
                target_from_source,
            ),
        }
    }

    /// Adds the pair to the normal equations at a pose.
    fn add_to(
        &self,
        sum: &mut NormalEquations,
        (pair, pose, noise_scale): (&PairEvidence<'_>, &Motion, f64),
    ) {
        let found = self.residual(pair, pose);
        sum.add(found.and_then(|found| Whitened::of_offsets(&found, noise_scale)), LOSS_WIDTH);
    }
}

/// Everything that a pose is fitted to.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Matched {
    /// Lifted on both sides: indices of candidates.
    pub full: Vec<usize>,
    /// Lifted on one side.
    pub pnl: Vec<PnlPair>,
}

impl Matched {
    /// Those of a pose's matches.
    pub fn new(full: &[Match], pnl: &[PnlMatch]) -> Self {
        Self {
            full: full.iter().map(|found| found.candidate).collect(),
            pnl: pnl.iter().map(|found| found.pair).collect(),
        }
    }

    /// The robust normal equations at a pose.
    pub fn equations(&self, scene: &Scene<'_>, pose: &Motion, noise_scale: f64) -> NormalEquations {
        let mut sum = NormalEquations::at(scene, &self.full, pose, noise_scale);
        self.pnl.iter().for_each(|pair| pair.add_to(&mut sum, (&scene.pair, pose, noise_scale)));
        sum
    }

    /// Minimises the robust cost from a start, in at most `max_steps`.
    pub fn fit(&self, scene: &Scene<'_>, start: &Motion, (noise_scale, max_steps): (f64, usize)) -> Refined {
        descend(start, max_steps, |pose| self.equations(scene, pose, noise_scale))
    }
}

impl Scene<'_> {
    /// What a settled pose explains beside its lifted matches: one-to-one, best first, and without the lines in `full`.
    pub fn pnl_matches(&self, full: &[Match], settled: &Settled<'_>) -> Vec<PnlMatch> {
        let mut used: BTreeSet<(u32, Unlifted, u16)> = BTreeSet::new();
        for found in full {
            let candidate = &self.candidates[found.candidate];
            // With the target unlifted, the lifted line is the source's.
            used.insert((candidate.set, Unlifted::Target, candidate.source));
            used.insert((candidate.set, Unlifted::Source, candidate.target));
        }
        let mut found = Vec::new();
        for set in 0..self.pair.evidence.sets.len() as u32 {
            for unlifted in [Unlifted::Target, Unlifted::Source] {
                let of_set = self.pnl_matches_of_set((set, unlifted), settled);
                found.extend(
                    of_set.into_iter().filter(|found| !used.contains(&(set, unlifted, found.pair.lifted))),
                );
            }
        }
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut used_segments = BTreeSet::new();
        found.retain(|found| {
            let PnlPair { set, lifted, segment, unlifted } = found.pair;
            if used.contains(&(set, unlifted, lifted)) || used_segments.contains(&(set, unlifted, segment)) {
                return false;
            }
            used.insert((set, unlifted, lifted));
            used_segments.insert((set, unlifted, segment))
        });
        found
    }

    /// Every pair of a lifted line and a segment that the pose explains.
    fn pnl_matches_of_set(&self, (set, unlifted): (u32, Unlifted), settled: &Settled<'_>) -> Vec<PnlMatch> {
        let Some((target, source)) = self.pair.views(set as usize) else { return Vec::new() };
        let (lines, segments, to_from_from) = match unlifted {
            Unlifted::Target => (&source.lines, &target.unlifted, *settled.target_from_source),
            Unlifted::Source => (&target.lines, &source.unlifted, settled.target_from_source.inverse()),
        };
        let log_n_segments = (segments.len().max(1) as f64).ln();
        let pairs = lines.iter().enumerate().flat_map(|(lifted, line)| {
            let near = near(line, segments, &to_from_from);
            near.map(move |segment| PnlPair { set, lifted: lifted as u16, segment, unlifted })
        });
        pairs.filter_map(|pair| self.explained_pnl(pair, settled, log_n_segments)).collect()
    }

    fn explained_pnl(&self, pair: PnlPair, settled: &Settled<'_>, log_n_segments: f64) -> Option<PnlMatch> {
        let compared = pair.residual(&self.pair, settled.target_from_source)?;
        if compared.inverse_depth_per_m.iter().any(|inverse_depth_per_m| *inverse_depth_per_m <= 0.0) {
            return None;
        }
        let by_pose = compared.d_residual_d_pose;
        let spread: Matrix2<f64> = compared.covariance * (settled.noise_scale * settled.noise_scale)
            + by_pose * settled.covariance * by_pose.transpose();
        let cholesky = spread.cholesky()?;
        let distance2 = compared.residual.dot(&cholesky.solve(&compared.residual));
        if distance2 > MAX_DISTANCE2 {
            return None;
        }
        let log_volume = (2.0 * std::f64::consts::PI).ln() + 0.5 * cholesky.determinant().ln();
        let gain = LOG_CHANCE_VOLUME - log_volume - 0.5 * distance2 - log_n_segments - STRUCTURE_PENALTY
            + brightness_gain(compared.is_same_way);
        (gain > 0.0).then_some(PnlMatch { pair, distance2, gain: gain.min(MAX_GAIN) })
    }
}

/// Indices of the segments whose ends both lie near the image of a moved line.
fn near<'a>(
    line: &EvidenceLine,
    segments: &'a [LineObservation],
    to_from_from: &Motion,
) -> impl Iterator<Item = u16> + 'a {
    let [a, b] = line.ends_m.map(|end_m| (to_from_from * end_m).coords);
    let moment = a.cross(&b);
    let limit = NEAR_OFFSET * moment.xy().norm();
    let is_near = move |segment: &LineObservation| {
        segment.ends.iter().all(|end| (moment.x * end.x + moment.y * end.y + moment.z).abs() < limit)
    };
    (0..segments.len()).filter(move |&segment| is_near(&segments[segment])).map(|segment| segment as u16)
}

#[cfg(test)]
mod tests;
