//! Which candidates a pose explains: one-to-one within every frame set.
//!
//! A match gains the logarithm of how much better the pose explains it than chance does: precise agreement of precise lines
//! counts most, loose agreement of far or extrapolated lines hardly. The sum over all matches is the score of the pose.

use std::collections::BTreeSet;

use nalgebra::{Matrix4, Matrix6, Rotation3, Vector3, Vector6};

use super::candidates::{Candidate, PairEvidence};
use super::residual::{MatchResidual, match_residual};
use super::sides::{brightness_gain, owners_contradict};
use super::translation_vote::{Blur, TranslationLine};
use crate::geometry::motion::Motion;

/// Agreement worse than this is none: 99.9 % of true matches (chi-square, four degrees of freedom).
pub const MAX_DISTANCE2: f64 = 18.5;
/// Chance: offsets within ±0.6 of the image plane at both ends and inverse depths within 1/m, uniformly.
const LOG_CHANCE_VOLUME: f64 = 0.365;
/// Rooms repeat themselves (parallel edges, equal spacings): chance is likelier than uniform by this much, nats.
pub const STRUCTURE_PENALTY: f64 = 4.0;
/// No single match counts more, nats: one lucky coincidence of precise lines must not outvote several honest ones.
const MAX_GAIN: f64 = 12.0;
/// First look, before any covariance: directions within this angle, rad ...
const NEAR_ANGLE_RAD: f64 = 0.15;
/// ... and lines within this distance of each other, m, beyond what their noise explains.
const NEAR_DISTANCE_M: f64 = 0.4;

/// How far a pose may still be off when matches are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gate {
    /// Standard deviation of the translation per axis, m.
    pub translation_m: f64,
    /// Standard deviation of the rotation per axis, rad.
    pub rotation_rad: f64,
    /// Factor on the lines' standard deviations (1 when the noise model fits the sensor).
    pub noise_scale: f64,
}

impl Gate {
    fn pose_covariance(&self) -> Matrix6<f64> {
        let (t2, r2) = (self.translation_m * self.translation_m, self.rotation_rad * self.rotation_rad);
        Matrix6::from_diagonal(&Vector6::new(t2, t2, t2, r2, r2, r2))
    }
}

/// A candidate that a pose explains.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Index into the candidates.
    pub candidate: usize,
    /// Squared Mahalanobis distance under the gate.
    pub distance2: f64,
    /// Evidence for the pose, nats, above 0.
    pub gain: f64,
    /// What appearance adds, nats; it takes no more than there is.
    pub nats: f64,
}

impl Match {
    /// What the match counts, nats.
    pub fn worth(&self) -> f64 {
        self.gain + self.nats
    }
}

/// A pose with the candidates near it.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The pair.
    pub pair: PairEvidence<'a>,
    /// All candidates of the pair.
    pub candidates: &'a [Candidate],
}

impl Scene<'_> {
    /// Candidates that could match under poses near this one.
    pub fn near(&self, target_from_source: &Motion) -> Vec<usize> {
        let look = Look::new(target_from_source);
        let is_near = |candidate: &Candidate| {
            let (angle_rad, distance_m, gap_m) = look.apart(candidate);
            let sigma_m = candidate.sigma_position_m + candidate.sigma_angle_rad * gap_m;
            angle_rad < NEAR_ANGLE_RAD
                && distance_m < NEAR_DISTANCE_M + NEAR_ANGLE_RAD * gap_m + 5.0 * sigma_m
        };
        (0..self.candidates.len()).filter(|&idx| is_near(&self.candidates[idx])).collect()
    }

    /// One-to-one matches under a pose, best first within a set, in candidate order over the sets.
    pub fn matches(&self, near: &[usize], target_from_source: &Motion, gate: &Gate) -> Vec<Match> {
        let pose_covariance = gate.pose_covariance();
        let look = Look::new(target_from_source);
        let mut found: Vec<Match> = near
            .iter()
            .filter(|&&idx| look.is_possible(&self.candidates[idx], gate))
            .filter_map(|&idx| self.explained(idx, target_from_source, (gate, &pose_covariance)))
            .collect();
        found.sort_by(|a, b| b.worth().total_cmp(&a.worth()).then(a.candidate.cmp(&b.candidate)));
        let mut used_lines = BTreeSet::new();
        found.retain(|found| {
            let candidate = &self.candidates[found.candidate];
            let (target_key, source_key) =
                ((candidate.set, false, candidate.target), (candidate.set, true, candidate.source));
            if used_lines.contains(&target_key) || used_lines.contains(&source_key) {
                return false;
            }
            used_lines.insert(target_key);
            used_lines.insert(source_key)
        });
        found
    }

    /// Whether and how well a pose explains one candidate.
    fn explained(
        &self,
        idx: usize,
        target_from_source: &Motion,
        (gate, pose_covariance): (&Gate, &Matrix6<f64>),
    ) -> Option<Match> {
        let candidate = &self.candidates[idx];
        let (target, source) = self.pair.pair(candidate)?;
        let turned = target_from_source.rotation * candidate.source_direction;
        let is_same_way = turned.dot(&candidate.target_direction) > 0.0;
        if owners_contradict(target, source, is_same_way) {
            return None;
        }
        let MatchResidual { residual, d_residual_d_pose, covariance } =
            match_residual(target, source, target_from_source)?;
        let spread: Matrix4<f64> = covariance * (gate.noise_scale * gate.noise_scale)
            + d_residual_d_pose * pose_covariance * d_residual_d_pose.transpose();
        let cholesky = spread.cholesky()?;
        let distance2 = residual.dot(&cholesky.solve(&residual));
        if distance2 > MAX_DISTANCE2 {
            return None;
        }
        let (targets, _) = self.pair.lines(candidate.set as usize)?;
        let log_volume = 2.0 * (2.0 * std::f64::consts::PI).ln()
            + cholesky.l_dirty().diagonal().iter().map(|diagonal| diagonal.ln()).sum::<f64>();
        let gain = LOG_CHANCE_VOLUME
            - log_volume
            - 0.5 * distance2
            - (targets.len() as f64).ln()
            - STRUCTURE_PENALTY
            + brightness_gain(is_same_way);
        // Geometry alone decides what is a match; appearance only what it counts.
        let gain = gain.min(MAX_GAIN);
        (gain > 0.0).then_some(Match { candidate: idx, distance2, gain, nats: candidate.nats.max(-gain) })
    }
}

/// A quick look at a candidate under a pose, without derivatives.
struct Look {
    rotation: Rotation3<f64>,
    translation_m: Vector3<f64>,
}

impl Look {
    fn new(target_from_source: &Motion) -> Self {
        Self {
            rotation: target_from_source.rotation.to_rotation_matrix(),
            translation_m: target_from_source.translation.vector,
        }
    }

    /// Angle between the directions, rad; distance of the target's middle from the moved source line, m; and how far along
    /// that line the two middles are apart, m.
    fn apart(&self, candidate: &Candidate) -> (f64, f64, f64) {
        let direction = self.rotation * candidate.source_direction;
        let sine = direction.cross(&candidate.target_direction).norm();
        let offset =
            candidate.target_middle_m - self.rotation * candidate.source_middle_m - self.translation_m;
        let gap_m = offset.dot(&direction);
        (sine, (offset - direction * gap_m).norm(), gap_m.abs())
    }

    /// Whether the full residual could pass: a bound at 4.5 standard deviations, added up.
    fn is_possible(&self, candidate: &Candidate, gate: &Gate) -> bool {
        let (angle_rad, distance_m, gap_m) = self.apart(candidate);
        let sigma_rad = gate.rotation_rad + gate.noise_scale * candidate.sigma_angle_rad;
        let lever_m = gap_m + candidate.source_middle_m.norm();
        let sigma_m = gate.translation_m
            + gate.rotation_rad * lever_m
            + gate.noise_scale * (candidate.sigma_position_m + candidate.sigma_angle_rad * gap_m);
        angle_rad < 4.5 * sigma_rad && distance_m < 4.5 * sigma_m
    }
}

/// Score of a translation on the lines of one rotation: quick, tolerant, one-to-one within a set.
pub fn coarse_score(
    candidates: &[Candidate],
    lines: &[TranslationLine],
    (translation_m, blur): (&Vector3<f64>, &Blur),
) -> f64 {
    let mut best_of_source: Vec<(f64, u32, u16, u16)> = Vec::new();
    for line in lines {
        let (distance_m, gap_m) = line.distance_and_gap_m(translation_m);
        if distance_m > 0.3 {
            continue;
        }
        let sigma_m = line.sigma_m(gap_m) + blur.translation_m + blur.rotation_rad * gap_m;
        // Two degrees of freedom, chance uniform over 2 m by 2 m.
        let gain = (4.0 / (2.0 * std::f64::consts::PI * sigma_m * sigma_m)).ln()
            - 0.5 * (distance_m / sigma_m).powi(2)
            - 2.0
            + brightness_gain(line.is_same_way);
        if gain <= 0.0 {
            continue;
        }
        let Candidate { set, target, source, .. } = candidates[line.candidate];
        match best_of_source.last_mut() {
            Some(last) if (last.1, last.3) == (set, source) => {
                if gain > last.0 {
                    *last = (gain, set, target, source);
                }
            }
            _ => best_of_source.push((gain, set, target, source)),
        }
    }
    // Of several sources that prefer one target, the best stays.
    best_of_source.sort_by(|a, b| (a.1, a.2).cmp(&(b.1, b.2)).then(b.0.total_cmp(&a.0)));
    best_of_source.dedup_by_key(|found| (found.1, found.2));
    best_of_source.iter().map(|found| found.0).sum()
}
