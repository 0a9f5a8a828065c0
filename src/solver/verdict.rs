//! The verdict on a pair: is the best pose to be trusted, and if not, what is missing.
//!
//! Never a wrong pose called converged: every test below guards against another way of being wrong, and each failure is a
//! reason with its numbers and with what to do next.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix6, Vector6};

use super::association::{Match, Scene};
use super::axes::{in_words, worst_axis};
use super::consensus::{Hypothesis, Ranking};
use super::noise::{MAX_NOISE_SCALE, covariance};
use super::pnl::Matched;
use super::refine::{Refined, TO_THE_MINIMUM};
use super::result::{LineResidual, Reason, ReasonCode, State};
use crate::geometry::motion::{rotation_gap_rad, translation_gap_m};

/// Limits of the verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VerdictLimits {
    /// Least number of independent matches.
    pub min_matches: usize,
    /// Least number of distinct rig views that contribute.
    pub min_views: usize,
    /// Least number of matches outside the view that contributes most: repeated structure of one view is no proof.
    pub min_matches_elsewhere: usize,
    /// The best score must exceed that of any really different pose by this factor ...
    pub min_lead: f64,
    /// ... and that of poses nearby, which share many matches, by this.
    pub min_lead_nearby: f64,
    /// ... and that of poses that cannot be, by this: what coincidence reaches there it could reach here.
    pub min_lead_impossible: f64,
    /// Largest share of the lines in plain sight of the other camera that may be missing there.
    pub max_missing_lines: f64,
    /// Largest standard deviation of the translation in its worst direction, m.
    pub max_sigma_translation_m: f64,
    /// Largest standard deviation of the rotation about its worst axis, rad.
    pub max_sigma_rotation_rad: f64,
    /// Largest share of surface samples that may contradict the pose.
    pub max_free_space_violated: f64,
}

impl Default for VerdictLimits {
    fn default() -> Self {
        Self {
            min_matches: 12,
            min_views: 3,
            min_matches_elsewhere: 6,
            min_lead: 1.4,
            min_lead_nearby: 1.25,
            min_lead_impossible: 1.2,
            max_missing_lines: 0.3,
            max_sigma_translation_m: 0.003,
            max_sigma_rotation_rad: 0.0022,
            max_free_space_violated: 0.15,
        }
    }
}

/// Of the lead beyond 1 that limits ask, geometry alone must show this share where appearance shows the rest.
const LEAD_BY_LINES: f64 = 0.4;
/// Halves may differ by this many joint standard deviations (squared; 99.9 % for six degrees of freedom is 22.5).
const MAX_HALVES_DISTANCE2: f64 = 30.0;

/// What a verdict is based on.
pub struct Bench<'a> {
    /// The pair's candidates.
    pub scene: Scene<'a>,
    /// The ranked poses.
    pub ranking: &'a Ranking,
    /// Limits.
    pub limits: VerdictLimits,
}

/// Judges the best pose of a ranking: `Converged` without a reason, or another state with one.
pub fn judge(bench: &Bench<'_>) -> (State, Option<Reason>) {
    let checks = [evidence, missing, lead, residual, observability, halves];
    match checks.iter().find_map(|check| check(bench)) {
        Some((state, reason)) => (state, Some(reason)),
        None => (State::Converged, None),
    }
}

type Objection = Option<(State, Reason)>;

fn object(state: State, code: ReasonCode, sentence: String) -> Objection {
    Some((state, Reason { code, sentence }))
}

/// Number of matches per rig pose from which they were seen. Those lifted on one side only do not count: they were looked for under
/// the pose, and many agree with any.
fn matches_by_view(scene: &Scene<'_>, best: &Hypothesis) -> BTreeMap<u64, usize> {
    let mut counts = BTreeMap::new();
    for found in &best.matches {
        let set = &scene.pair.evidence.sets[scene.candidates[found.candidate].set as usize];
        *counts.entry(set.repeats).or_insert(0) += 1;
    }
    counts
}

fn evidence(bench: &Bench<'_>) -> Objection {
    let by_view = matches_by_view(&bench.scene, &bench.ranking.best);
    let (n, views) = (by_view.values().sum::<usize>(), by_view.len());
    let elsewhere = n - by_view.values().max().copied().unwrap_or(0);
    let VerdictLimits { min_matches, min_views, min_matches_elsewhere, .. } = bench.limits;
    if n >= min_matches && views >= min_views && elsewhere >= min_matches_elsewhere {
        return None;
    }
    let sentence = format!(
        "the best pose explains {n} independent lines in {views} rig views, {elsewhere} of them outside the richest view; \
         needed are {min_matches} in {min_views}, {min_matches_elsewhere} of them outside one view: move the rig and show \
         more straight edges that run through both cameras"
    );
    object(State::Collecting, ReasonCode::NotEnoughEvidence, sentence)
}

fn missing(bench: &Bench<'_>) -> Objection {
    let Hypothesis { missing, score, .. } = &bench.ranking.best;
    let limit = if missing.is_too_much(bench.limits.max_missing_lines) {
        format!("allowed are {:.0} %", 100.0 * bench.limits.max_missing_lines)
    } else if *score <= 0.0 {
        "more than those that agree outweigh".to_owned()
    } else {
        return None;
    };
    let sentence = format!(
        "with the best pose {} of {} lines in plain sight of the other camera are missing there ({:.0} %; {limit}): \
         show more edges in other directions and places, and check that both cameras are in focus and well exposed",
        missing.missing,
        missing.expected,
        100.0 * missing.share(),
    );
    object(State::Collecting, ReasonCode::MissingLines, sentence)
}

/// The lead over every rival, and what of it geometry alone must show: what looks alike may be a repetition, shifted as a whole.
fn lead(bench: &Bench<'_>) -> Objection {
    if !bench.ranking.is_best_by_lines() {
        let sentence = "the pose that lines of like appearance agree on is not the one that most lines agree on: show edges in \
                        other directions and places, and turn the rig between views"
            .to_owned();
        return object(State::Ambiguous, ReasonCode::RunnerUpTooClose, sentence);
    }
    let by_lines = bench.ranking.by_lines.as_deref();
    lead_of(bench.ranking, &bench.limits, 1.0).or_else(|| lead_of(by_lines?, &bench.limits, LEAD_BY_LINES))
}

/// The objection where a ranking's best pose does not lead by `share` of what the limits ask beyond 1.
fn lead_of(ranking: &Ranking, limits: &VerdictLimits, share: f64) -> Objection {
    let Ranking { best, neighbour, runner_up, impossible, .. } = ranking;
    let scaled = |min_lead: f64| 1.0 + share * (min_lead - 1.0);
    let limits = [
        (runner_up, scaled(limits.min_lead)),
        (neighbour, scaled(limits.min_lead_nearby)),
        (impossible, scaled(limits.min_lead_impossible)),
    ];
    let (rival, min_lead) = limits.into_iter().find_map(|(rival, min_lead)| {
        let rival = rival.as_ref()?;
        (best.score < min_lead * rival.score).then_some((rival, min_lead))
    })?;
    let (here, there) = (&best.refined.target_from_source, &rival.refined.target_from_source);
    let sentence = format!(
        "the best pose scores {:.0}, another one {:.1} deg and {:.0} mm away {:.0}; a lead of {min_lead:.2} times is \
         needed: show edges in other directions and places, and turn the rig between views",
        best.score,
        rotation_gap_rad(here, there).to_degrees(),
        1e3 * translation_gap_m(here, there),
        rival.score,
    );
    object(State::Ambiguous, ReasonCode::RunnerUpTooClose, sentence)
}

fn residual(bench: &Bench<'_>) -> Objection {
    let noise_scale = bench.ranking.best.noise_scale;
    if noise_scale < MAX_NOISE_SCALE {
        return None;
    }
    let sentence = format!(
        "the matched lines agree {noise_scale:.1} times worse than the noise model of the sensor explains (limit {MAX_NOISE_SCALE:.1}): check the \
         intrinsics, the registration of depth to colour and that frames of one set are taken at one moment"
    );
    object(State::Failed, ReasonCode::ResidualTooHigh, sentence)
}

fn observability(bench: &Bench<'_>) -> Objection {
    let best = &bench.ranking.best;
    let Some(covariance) = covariance(&best.refined, best.noise_scale) else {
        let sentence = format!(
            "the {} matched lines fix no pose: all are parallel or meet in one point; show edges in at least two directions",
            best.n_matches()
        );
        return object(State::Degenerate, ReasonCode::AxisUnobservable, sentence);
    };
    let (sigma_m, axis) = worst_axis(&covariance.fixed_view::<3, 3>(0, 0).into_owned());
    let (sigma_rad, turn_axis) = worst_axis(&covariance.fixed_view::<3, 3>(3, 3).into_owned());
    let VerdictLimits { max_sigma_translation_m, max_sigma_rotation_rad, .. } = bench.limits;
    let (translation_ok, rotation_ok) =
        (sigma_m <= max_sigma_translation_m, sigma_rad <= max_sigma_rotation_rad);
    let n = best.n_matches();
    let (what, sigma, limit) = match (translation_ok, rotation_ok) {
        (true, true) => return None,
        (false, _) => (
            format!("translation along the target's {}", in_words(&axis)),
            format!("{:.1} mm", 1e3 * sigma_m),
            format!("{:.1} mm", 1e3 * max_sigma_translation_m),
        ),
        (true, false) => (
            format!("rotation about the target's {}", in_words(&turn_axis)),
            format!("{:.2} deg", sigma_rad.to_degrees()),
            format!("{:.2} deg", max_sigma_rotation_rad.to_degrees()),
        ),
    };
    let sentence = format!(
        "{n} lines leave the {what} uncertain by {sigma} (one sigma; limit {limit}): show edges that are not parallel to \
         those seen so far, near the cameras"
    );
    // An uncertainty far above the limit means that the lines do not fix the axis at all; near it, more of the same helps.
    let state = if sigma_m > 10.0 * max_sigma_translation_m || sigma_rad > 10.0 * max_sigma_rotation_rad {
        State::Degenerate
    } else {
        State::Collecting
    };
    object(state, ReasonCode::AxisUnobservable, sentence)
}

fn halves(bench: &Bench<'_>) -> Objection {
    let best = &bench.ranking.best;
    let [first, second] = split(&bench.scene, best).map(|half| {
        half.fit(&bench.scene, &best.refined.target_from_source, (best.noise_scale, TO_THE_MINIMUM))
    });
    let gap = gap(&first, &second);
    let spread =
        covariance(&first, best.noise_scale).zip(covariance(&second, best.noise_scale)).map(|(a, b)| a + b);
    let Some(cholesky) = spread.and_then(Matrix6::cholesky) else {
        let sentence = format!(
            "half of the {} matched lines alone fix no pose: move the rig and show more edges",
            best.n_matches()
        );
        return object(State::Collecting, ReasonCode::NotEnoughEvidence, sentence);
    };
    let distance2 = gap.dot(&cholesky.solve(&gap));
    if distance2 <= MAX_HALVES_DISTANCE2 {
        return None;
    }
    let sentence = format!(
        "two independent halves of the lines differ by {:.2} deg and {:.1} mm, more than their noise explains: check that \
         the cameras are fixed to each other, that their clocks agree and that the intrinsics are right",
        gap.fixed_rows::<3>(3).norm().to_degrees(),
        1e3 * gap.fixed_rows::<3>(0).norm()
    );
    object(State::Failed, ReasonCode::HalvesDisagree, sentence)
}

/// Matches of every other contributing frame set; with a single set, every other match.
fn split(scene: &Scene<'_>, best: &Hypothesis) -> [Matched; 2] {
    let sets: Vec<u32> = best.sets(scene).collect::<BTreeSet<_>>().into_iter().collect();
    let half = |set: u32, rank: usize| match sets.len() {
        0 | 1 => rank % 2,
        _ => sets.binary_search(&set).unwrap_or(0) % 2,
    };
    let mut halves = [Matched::default(), Matched::default()];
    for (rank, found) in best.matches.iter().enumerate() {
        halves[half(scene.candidates[found.candidate].set, rank)].full.push(found.candidate);
    }
    for (rank, found) in best.pnl.iter().enumerate() {
        halves[half(found.pair.set, rank)].pnl.push(found.pair);
    }
    halves
}

/// Step from one pose to another, ordered x y z rx ry rz.
fn gap(first: &Refined, second: &Refined) -> Vector6<f64> {
    let (a, b) = (&first.target_from_source, &second.target_from_source);
    let translation = b.translation.vector - a.translation.vector;
    let rotation = (b.rotation * a.rotation.inverse()).scaled_axis();
    Vector6::new(translation.x, translation.y, translation.z, rotation.x, rotation.y, rotation.z)
}

/// How well a pose explains each match that both sides lifted; `focal_px` is that of the target.
pub fn line_residuals(scene: &Scene<'_>, best: &Hypothesis, focal_px: f64) -> Vec<LineResidual> {
    let residual = |found: &Match| {
        let (target, source) = scene.pair.pair(&scene.candidates[found.candidate])?;
        let compared = super::residual::match_residual(target, source, &best.refined.target_from_source)?;
        let (mut offsets2, mut distances2) = (0.0, 0.0);
        for (i, end_m) in target.ends_m.iter().enumerate() {
            // Offsets on z = 1 grow with depth; an error dq of the inverse depth moves the point by z² dq.
            let across_m = compared.residual[i] * end_m.z;
            let along_m = compared.residual[2 + i] * end_m.z * end_m.z;
            offsets2 += compared.residual[i] * compared.residual[i];
            distances2 += across_m * across_m + along_m * along_m;
        }
        let mean = |sum2: f64| (sum2 / target.ends_m.len() as f64).sqrt();
        Some(LineResidual { offset_px: mean(offsets2) * focal_px, distance_m: mean(distances2) })
    };
    best.matches.iter().filter_map(residual).collect()
}
