//! The consensus estimator of one pair, complete and without appearance: rotations are voted first, then translations for each
//! rotation; the best poses are scored one-to-one over all frame sets and refined. What survives is ranked, so that the
//! runner-up shows how sure the best pose is.

use super::association::{Gate, Match, Scene, coarse_score};
use super::candidates::{Candidate, PairEvidence};
use super::free_space::free_space;
use super::refine::{Refined, refine};
use super::rotation_vote::rotation_modes;
use super::translation_vote::{TranslationGrid, translation_lines};
use crate::geometry::Camera;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};

/// Lines whose direction is worse than this do not vote for rotations, rad (3 degrees).
const MAX_VOTING_SIGMA_RAD: f64 = 0.052;
/// Rotations tried.
const MAX_MODES: usize = 200;
/// Translations tried per rotation, by the rotation's rank: where lines share a room's axes, the true rotation leads, and the
/// true translation may hide among many peaks of parallel bundles.
const PEAKS_BY_RANK: [(usize, usize); 3] = [(12, 60), (60, 20), (MAX_MODES, 6)];
/// Poses refined.
const MAX_REFINED: usize = 160;
/// Poses closer than both belong together before refinement.
const SAME_START_RAD: f64 = 0.02;
/// See [`SAME_START_RAD`]; m.
const SAME_START_M: f64 = 0.06;
/// Poses further apart than either are different answers: nearer ones refine into each other. rad (4 degrees).
const DIFFERENT_RAD: f64 = 0.07;
/// See [`DIFFERENT_RAD`]; m.
const DIFFERENT_M: f64 = 0.15;
/// How wide matches are looked for while a pose settles.
const SETTLING: [(f64, f64); 4] = [(0.04, 0.02), (0.02, 0.01), (0.01, 0.005), (0.004, 0.002)];

/// A pose, settled on its matches.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// The pose and its information.
    pub refined: Refined,
    /// Matches at the final gate.
    pub matches: Vec<Match>,
    /// Sum of the gains, nats.
    pub score: f64,
    /// Factor on the lines' standard deviations that makes these matches agree as they should, at least 1.
    pub noise_scale: f64,
}

/// The ranked answers for a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranking {
    /// All candidates; matches point into it.
    pub candidates: Vec<Candidate>,
    /// The best pose.
    pub best: Hypothesis,
    /// The best pose that is really different.
    pub runner_up: Option<Hypothesis>,
}

/// What makes a pose impossible whatever lines agree with it.
#[derive(Debug, Clone, Copy)]
pub struct RankLimits<'a> {
    /// Intrinsics of the rig's cameras.
    pub cameras: &'a [Camera],
    /// Largest distance between the two cameras, m.
    pub max_baseline_m: f64,
    /// Largest share of surface samples that may contradict free space.
    pub max_free_space_violated: f64,
}

/// Ranks the poses of a pair; `None` when no candidates agree on any pose.
pub fn rank_poses(pair: PairEvidence<'_>, limits: &RankLimits<'_>) -> Option<Ranking> {
    let candidates = pair.candidates(MAX_VOTING_SIGMA_RAD);
    let starts = coarse_poses(&candidates, limits.max_baseline_m);
    let scene = Scene { pair, candidates: &candidates };
    let mut settled: Vec<Hypothesis> = starts.iter().filter_map(|(pose, _)| settle(&scene, pose)).collect();
    settled.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut possible = settled.into_iter().filter(|settled| {
        let pose = &settled.refined.target_from_source;
        pose.translation.vector.norm() <= limits.max_baseline_m
            && !free_space(&pair, limits.cameras, pose).is_violated(limits.max_free_space_violated)
    });
    let best = possible.next()?;
    let pose = best.refined.target_from_source;
    let runner_up = possible.find(|other| are_different(&other.refined.target_from_source, &pose));
    Some(Ranking { candidates, best, runner_up })
}

/// Whether two poses are different answers.
fn are_different(a: &Motion, b: &Motion) -> bool {
    rotation_gap_rad(a, b) > DIFFERENT_RAD || translation_gap_m(a, b) > DIFFERENT_M
}

/// Rotation modes, translation peaks of each, and the best of all by the coarse score.
fn coarse_poses(candidates: &[Candidate], max_baseline_m: f64) -> Vec<(Motion, f64)> {
    let mut grid = TranslationGrid::new(max_baseline_m);
    let mut poses: Vec<(Motion, f64)> = Vec::new();
    for (rank, mode) in rotation_modes(candidates, MAX_MODES).into_iter().enumerate() {
        let max_peaks = PEAKS_BY_RANK.iter().find(|(below, _)| rank < *below).map_or(0, |(_, peaks)| *peaks);
        let lines = translation_lines(candidates, &mode.target_from_source);
        for (translation_m, _) in grid.peaks(candidates, &lines, max_peaks) {
            let score = coarse_score(candidates, &lines, &translation_m);
            poses.push((Motion::from_parts(translation_m.into(), mode.target_from_source), score));
        }
    }
    poses.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut kept: Vec<(Motion, f64)> = Vec::new();
    for (pose, score) in poses {
        let is_new = kept.iter().all(|(other, _)| {
            rotation_gap_rad(other, &pose) > SAME_START_RAD || translation_gap_m(other, &pose) > SAME_START_M
        });
        if is_new {
            kept.push((pose, score));
            if kept.len() == MAX_REFINED {
                break;
            }
        }
    }
    kept
}

/// Refines a pose on its matches while the gate closes; `None` when nothing is left to refine on.
pub fn settle(scene: &Scene<'_>, start: &Motion) -> Option<Hypothesis> {
    let mut pose = *start;
    let mut noise_scale = 1.0;
    let near = scene.near(start);
    for (translation_m, rotation_rad) in SETTLING {
        let gate = Gate { translation_m, rotation_rad, noise_scale };
        let matches = scene.matches(&near, &pose, &gate);
        if matches.len() < 3 {
            return None;
        }
        pose = refine(scene, &indices(&matches), &pose, noise_scale).target_from_source;
    }
    for _ in 0..2 {
        let gate = Gate { translation_m: 0.0, rotation_rad: 0.0, noise_scale };
        let matches = scene.matches(&near, &pose, &gate);
        if matches.len() < 3 {
            return None;
        }
        noise_scale = (noise_scale * excess_noise(&matches)).clamp(1.0, MAX_NOISE_SCALE);
        pose = refine(scene, &indices(&matches), &pose, noise_scale).target_from_source;
    }
    let gate = Gate { translation_m: 0.0, rotation_rad: 0.0, noise_scale };
    let matches = scene.matches(&near, &pose, &gate);
    let score = matches.iter().map(|found| found.gain).sum();
    let refined = refine(scene, &indices(&matches), &pose, noise_scale);
    Some(Hypothesis { refined, matches, score, noise_scale })
}

/// Sensors noisier than three times the model are not explained by it.
const MAX_NOISE_SCALE: f64 = 3.0;

fn indices(matches: &[Match]) -> Vec<usize> {
    matches.iter().map(|found| found.candidate).collect()
}

/// Ratio of the matches' median distance to that of the noise model (chi-square with four degrees of freedom: 3.36).
fn excess_noise(matches: &[Match]) -> f64 {
    let mut distances2: Vec<f64> = matches.iter().map(|found| found.distance2).collect();
    distances2.sort_by(f64::total_cmp);
    (distances2[distances2.len() / 2] / 3.36).sqrt()
}
