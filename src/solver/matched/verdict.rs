//! The verdict on a pose from given matches: is it to be trusted, and if not, what is missing.
//!
//! Never a wrong pose called converged: each test guards against another way of being wrong, and each objection has its numbers
//! and what to do next.

use nalgebra::{Matrix6, Vector3, Vector4, Vector6};

use super::MatchedLimits;
use super::draw::Generator;
use super::fit::{Fit, MAX_NOISE_SCALE, whitened};
use super::sample::MAX_COSINE;
use super::sight::{PlacedPair, Sights, places_px};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::axes::{in_words, worst_axis};
use crate::solver::evidence::EvidenceLine;
use crate::solver::line_pair::LinePair;
use crate::solver::result::{Reason, ReasonCode, State};

/// Poses further apart than this, rad or m, are really different; closer ones refine into each other.
const DIFFERENT: (f64, f64) = (0.035, 0.05);
/// Chance that a wrong match agrees with a given pose, on the safe side: even one that is parallel to the right line, on a segment
/// as wide as the gate is in an image.
const AGREES_BY_CHANCE: f64 = 0.02;
/// Two matches are the same one seen again when their ends fall into the same cells of this size, px.
const CELL_PX: f64 = 16.0;
/// Halves may differ by this many joint standard deviations (squared; 99.9 % for six degrees of freedom is 22.5).
const MAX_HALVES_DISTANCE2: f64 = 30.0;
/// Half of the matches may leave the pose this many times as uncertain as all may.
const HALF_SIGMA: f64 = 3.0;
/// How many times the information that noise alone makes up is taken off before the pose counts as observed.
const NOISE_MADE: f64 = 2.0;

/// Why a pose is not trusted.
pub type Objection = (State, Reason);

/// What a verdict is based on.
pub struct Bench<'a> {
    /// The matches.
    pub sights: &'a Sights<'a>,
    /// The best pose.
    pub best: &'a Fit,
    /// The best of the really different poses.
    pub rival: Option<&'a Fit>,
    /// Limits.
    pub limits: &'a MatchedLimits,
}

/// Whether two poses are more than two minima of the same one.
pub fn really_differ(a: &Motion, b: &Motion) -> bool {
    rotation_gap_rad(a, b) > DIFFERENT.0 || translation_gap_m(a, b) > DIFFERENT.1
}

/// Covariance of the pose if it is to be trusted, else the objection.
///
/// # Errors
/// The first objection.
pub fn judge(bench: &Bench<'_>) -> Result<Matrix6<f64>, Objection> {
    let checks = [evidence, lead, residual];
    if let Some(objection) = checks.iter().find_map(|check| check(bench)) {
        return Err(objection);
    }
    let parts = parts(bench);
    let checks = [observability, halves];
    match checks.iter().find_map(|check| check(bench, &parts)) {
        Some(objection) => Err(objection),
        None => covariance(&bench.best.information).ok_or_else(no_pose),
    }
}

/// The objection where no two matches fit each other.
pub fn without_pose(sights: &Sights<'_>) -> Objection {
    let (n, n_full) = (sights.pairs.len(), sights.placed.len());
    if n == 0 {
        let sentence = "there is no matched line: show straight edges that run through both cameras";
        return object(State::Collecting, ReasonCode::NoLines, sentence.to_owned());
    }
    if are_parallel(sights) {
        let sentence = format!(
            "all {n_full} matches with depth in both cameras are parallel within 14 deg, which fixes no pose: show edges in other \
             directions too"
        );
        return object(State::Degenerate, ReasonCode::AxisUnobservable, sentence);
    }
    let sentence = if n_full < 2 {
        format!(
            "{n_full} of {n} matches have depth in both cameras, needed are 2: show edges where both cameras measure depth"
        )
    } else {
        format!(
            "no two of {n_full} matches with depth in both cameras lie to each other alike in both: show more edges in several \
             directions, and check the matches"
        )
    };
    object(State::Collecting, ReasonCode::NotEnoughEvidence, sentence)
}

fn are_parallel(sights: &Sights<'_>) -> bool {
    let is_parallel = |a: &Vector3<f64>, b: &Vector3<f64>| a.dot(b).abs() > MAX_COSINE;
    let along = |first: &PlacedPair, other: &PlacedPair| {
        is_parallel(&first.source.direction, &other.source.direction)
            || is_parallel(&first.target.direction, &other.target.direction)
    };
    match sights.placed.as_slice() {
        [first, others @ ..] => !others.is_empty() && others.iter().all(|other| along(first, other)),
        [] => false,
    }
}

fn object(state: State, code: ReasonCode, sentence: String) -> Objection {
    (state, Reason { code, sentence })
}

fn no_pose() -> Objection {
    let sentence =
        "the matched lines fix no pose: all are parallel or the same; show edges in at least two directions";
    object(State::Degenerate, ReasonCode::AxisUnobservable, sentence.to_owned())
}

fn evidence(bench: &Bench<'_>) -> Option<Objection> {
    let pairs = &bench.sights.pairs;
    let n = n_distinct(pairs.iter().copied());
    let k = n_distinct(bench.best.inliers.iter().map(|&at| pairs[at]));
    let MatchedLimits { min_matches, max_chance, .. } = *bench.limits;
    let chance = log_chance(n, k).exp();
    if k >= min_matches && chance <= max_chance {
        return None;
    }
    let chance = if chance < 0.1 { format!("{chance:.0e}") } else { format!("{chance:.1}") };
    let sentence = format!(
        "the best pose explains {k} of {n} different matches; by chance alone {chance} poses would explain as many \
         (limit {max_chance:.0e}, and {min_matches} matches): show more straight edges that run through both cameras"
    );
    Some(object(State::Collecting, ReasonCode::NotEnoughEvidence, sentence))
}

/// Number of matches, one seen again at the same place in both images counted once.
fn n_distinct<'a>(pairs: impl Iterator<Item = &'a LinePair>) -> usize {
    let cell = |px: f64| (px / CELL_PX).round() as i64;
    let mut places: Vec<[i64; 8]> = pairs.map(|pair| places_px(pair).map(cell)).collect();
    places.sort_unstable();
    places.dedup();
    places.len()
}

/// Logarithm of the expected number of poses from two of `n` wrong matches with which `k` agree: two make the pose, in two
/// ways; the others agree by chance.
fn log_chance(n: usize, k: usize) -> f64 {
    let (n, k) = (n as f64, k as f64);
    if k < 3.0 {
        return 2.0 * n.ln();
    }
    // C(n - 2, k - 2) p^(k - 2), which bounds the tail of the binomial distribution.
    let others = (1..=(k as usize - 2)).map(|i| ((n - k + i as f64) / i as f64 * AGREES_BY_CHANCE).ln());
    (n * (n - 1.0)).ln() + others.sum::<f64>()
}

fn lead(bench: &Bench<'_>) -> Option<Objection> {
    let rival = bench.rival?;
    let min_lead = bench.limits.min_lead;
    if bench.best.score >= min_lead * rival.score {
        return None;
    }
    let sentence = format!(
        "the best pose explains as much as {:.1} perfect matches, another one {:.1} deg and {:.0} mm away {:.1}; a lead of \
         {min_lead:.2} times is needed: show edges in other directions and places",
        bench.best.score,
        rotation_gap_rad(&bench.best.pose, &rival.pose).to_degrees(),
        1e3 * translation_gap_m(&bench.best.pose, &rival.pose),
        rival.score,
    );
    Some(object(State::Ambiguous, ReasonCode::RunnerUpTooClose, sentence))
}

fn residual(bench: &Bench<'_>) -> Option<Objection> {
    let noise_scale = bench.best.noise_scale;
    if noise_scale < MAX_NOISE_SCALE {
        return None;
    }
    let sentence = format!(
        "the matched lines agree {noise_scale:.1} times worse than their noise explains: check the noise given with them, the \
         intrinsics, and that both cameras saw them at one moment"
    );
    Some(object(State::Failed, ReasonCode::ResidualTooHigh, sentence))
}

/// What one agreeing match says of the pose.
struct Part {
    set: u32,
    /// Of a step, with the noise found.
    information: Matrix6<f64>,
    /// The same without what noise makes up.
    observed: Matrix6<f64>,
    gradient: Vector6<f64>,
}

/// Noisy parallel lines are not parallel: each seems to fix a little of what none of them does, and many of them much. Noise as
/// large once more, added to the source line, makes up as much once more; so it is known and taken off.
fn parts(bench: &Bench<'_>) -> Vec<Part> {
    let Fit { pose, inliers, noise_scale, .. } = bench.best;
    let mut signs = Generator::new();
    let part = |&at: &usize| {
        let pair = bench.sights.pairs[at];
        let shaken = LinePair { source: shaken(&pair.source, &mut signs, *noise_scale), ..pair.clone() };
        let found = whitened(pair, pose, *noise_scale)?;
        let noisier = whitened(&shaken, pose, *noise_scale)?.information;
        let observed = found.information - (noisier - found.information) * NOISE_MADE;
        Some(Part { set: pair.set, information: found.information, observed, gradient: found.gradient })
    };
    inliers.iter().filter_map(part).collect()
}

/// The line with one more standard deviation on each of its measurements, up or down.
fn shaken(line: &EvidenceLine, signs: &mut Generator, noise_scale: f64) -> EvidenceLine {
    let mut shaken = line.clone();
    let Some(cholesky) = line.covariance.cholesky() else { return shaken };
    let signs = Vector4::from_fn(|_, _| if signs.below(2) == 0 { -1.0 } else { 1.0 });
    let noise = cholesky.l() * signs * noise_scale;
    for (end_m, derivative) in shaken.ends_m.iter_mut().zip(line.d_ends_d_measurement()) {
        *end_m += derivative * noise;
    }
    shaken
}

fn observability(bench: &Bench<'_>, parts: &[Part]) -> Option<Objection> {
    let observed: Matrix6<f64> = parts.iter().map(|part| part.observed).sum();
    let Some(covariance) = covariance(&observed) else { return Some(no_pose()) };
    let doubt = doubt(&covariance, bench.limits)?;
    let sentence = format!(
        "{} matches leave the {}: show edges that are not parallel to these, near the cameras",
        parts.len(),
        doubt.what
    );
    Some(object(doubt.state, ReasonCode::AxisUnobservable, sentence))
}

/// What is too uncertain.
struct Doubt {
    state: State,
    what: String,
}

fn doubt(covariance: &Matrix6<f64>, limits: &MatchedLimits) -> Option<Doubt> {
    let (sigma_m, axis) = worst_axis(&covariance.fixed_view::<3, 3>(0, 0).into_owned());
    let (sigma_rad, turn_axis) = worst_axis(&covariance.fixed_view::<3, 3>(3, 3).into_owned());
    let MatchedLimits { max_sigma_translation_m, max_sigma_rotation_rad, .. } = *limits;
    let what = if sigma_m > max_sigma_translation_m {
        let (sigma_mm, limit_mm) = (1e3 * sigma_m, 1e3 * max_sigma_translation_m);
        let axis = in_words(&axis);
        format!(
            "translation along the target's {axis} uncertain by {sigma_mm:.1} mm (one sigma; limit {limit_mm:.1} mm)"
        )
    } else if sigma_rad > max_sigma_rotation_rad {
        let (sigma_deg, limit_deg) = (sigma_rad.to_degrees(), max_sigma_rotation_rad.to_degrees());
        let axis = in_words(&turn_axis);
        format!(
            "rotation about the target's {axis} uncertain by {sigma_deg:.2} deg (one sigma; limit {limit_deg:.2} deg)"
        )
    } else {
        return None;
    };
    // Far above the limit the lines do not fix the axis at all; near it, more of the same helps.
    let is_open = sigma_m > 10.0 * max_sigma_translation_m || sigma_rad > 10.0 * max_sigma_rotation_rad;
    Some(Doubt { state: if is_open { State::Degenerate } else { State::Collecting }, what })
}

/// Each half must fix the pose by itself, so that no axis rests on a match or two, and both must agree.
fn halves(bench: &Bench<'_>, parts: &[Part]) -> Option<Objection> {
    let half_limits = MatchedLimits {
        max_sigma_translation_m: HALF_SIGMA * bench.limits.max_sigma_translation_m,
        max_sigma_rotation_rad: HALF_SIGMA * bench.limits.max_sigma_rotation_rad,
        ..*bench.limits
    };
    let (mut gap, mut spread) = (Vector6::zeros(), Matrix6::zeros());
    for (half, sign) in split(parts).iter().zip([1.0, -1.0]) {
        let observed: Matrix6<f64> = half.iter().map(|part| part.observed).sum();
        let doubt = match covariance(&observed) {
            Some(covariance) => doubt(&covariance, &half_limits).map(|doubt| doubt.what),
            None => Some("pose open".to_owned()),
        };
        if let Some(what) = doubt {
            let sentence = format!(
                "{} matches, half of those that agree, leave the {what}: too much rests on the others; show more edges in \
                 several directions",
                half.len()
            );
            return Some(object(State::Collecting, ReasonCode::AxisUnobservable, sentence));
        }
        // The step from the common minimum to that of this half.
        let covariance = covariance(&half.iter().map(|part| part.information).sum())?;
        gap += covariance * half.iter().map(|part| part.gradient).sum::<Vector6<f64>>() * sign;
        spread += covariance;
    }
    let distance2 = spread.cholesky()?.solve(&gap).dot(&gap);
    if distance2 <= MAX_HALVES_DISTANCE2 {
        return None;
    }
    let sentence = format!(
        "two independent halves of the matches differ by {:.2} deg and {:.1} mm, more than their noise explains: check that the \
         cameras are fixed to each other and that the matches are of one moment each",
        gap.fixed_rows::<3>(3).norm().to_degrees(),
        1e3 * gap.fixed_rows::<3>(0).norm()
    );
    Some(object(State::Failed, ReasonCode::HalvesDisagree, sentence))
}

/// The matches of every other frame set; with a single set, every other match.
fn split(parts: &[Part]) -> [Vec<&Part>; 2] {
    let mut sets: Vec<u32> = parts.iter().map(|part| part.set).collect();
    sets.sort_unstable();
    sets.dedup();
    let mut halves = [Vec::new(), Vec::new()];
    for (rank, part) in parts.iter().enumerate() {
        let turn = if sets.len() > 1 { sets.binary_search(&part.set).unwrap_or(0) } else { rank };
        halves[turn % 2].push(part);
    }
    halves
}

/// The inverse of an information matrix; `None` when it fixes no pose.
fn covariance(information: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    let covariance = information.cholesky()?.inverse();
    covariance.iter().all(|value| value.is_finite()).then_some(covariance)
}
