//! The consensus estimator of one pair, complete and without appearance: rotations are voted first, then translations for each
//! rotation; the best poses are scored one-to-one over all frame sets and refined. What survives is ranked, so that the
//! runner-up shows how sure the best pose is.

use super::association::{Gate, Match, Scene};
use super::candidates::{Candidate, PairEvidence};
use super::free_space::free_space;
use super::missing::{MissingLines, missing_lines};
use super::noise::{covariance, noise_scale};
use super::pnl::{Matched, PnlMatch, Settled};
use super::prior::{Prior, prior};
use super::refine::{Refined, Stop, TO_THE_MINIMUM, TOWARDS_THE_MINIMUM, refine};
use super::result::{Reason, ReasonCode};
use super::starts::{Search, starts};
use crate::geometry::Camera;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};

/// Lines whose direction is worse than this do not vote for rotations, rad (3 degrees).
pub const MAX_VOTING_SIGMA_RAD: f64 = 0.052;
/// Of the starts, those that are settled.
const MAX_SETTLED: usize = 60;
/// How wide matches are looked for at first: standard deviations of the start, m and rad.
const DRAWING_IN: [(f64, f64); 1] = [(0.03, 0.015)];
/// ... and while a pose settles.
const SETTLING: [(f64, f64); 3] = [(0.02, 0.01), (0.01, 0.005), (0.004, 0.002)];
/// A pose that appearance is certain of must explain so many lines for the search to be narrowed to its rivals.
const MIN_CERTAIN_MATCHES: usize = 12;
/// Three lines fix a pose.
const MIN_MATCHES: usize = 3;

/// A pose, settled on its matches.
#[derive(Debug, Clone, PartialEq)]
pub struct Hypothesis {
    /// The pose and its information.
    pub refined: Refined,
    /// Matches at the final gate, lifted on both sides.
    pub matches: Vec<Match>,
    /// Further matches, lifted on one side.
    pub pnl: Vec<PnlMatch>,
    /// Sum of what the matches count less what missing lines take, nats.
    pub score: f64,
    /// The part of it that is appearance, nats.
    pub appearance: f64,
    /// Lines that should be seen and are not, once the pose is ranked.
    pub missing: MissingLines,
    /// Factor on the lines' standard deviations that makes these matches agree as they should, at least 1.
    pub noise_scale: f64,
}

impl Hypothesis {
    /// The same pose scored by geometry alone.
    fn by_lines(&self) -> Self {
        Self { score: self.score - self.appearance, appearance: 0.0, ..self.clone() }
    }

    /// Number of matches of both kinds.
    pub fn n_matches(&self) -> usize {
        self.matches.len() + self.pnl.len()
    }

    /// The frame set of each match.
    pub fn sets<'a>(&'a self, scene: &'a Scene<'_>) -> impl Iterator<Item = u32> + 'a {
        let full = self.matches.iter().map(|found| scene.candidates[found.candidate].set);
        full.chain(self.pnl.iter().map(|found| found.pair.set))
    }
}

/// The ranked answers for a pair.
#[derive(Debug, Clone, PartialEq)]
pub struct Ranking {
    /// All candidates; matches point into it.
    pub candidates: Vec<Candidate>,
    /// The best pose.
    pub best: Hypothesis,
    /// The best pose that a user would not take for the same calibration.
    pub neighbour: Option<Hypothesis>,
    /// The best pose that shares hardly any match with the best.
    pub runner_up: Option<Hypothesis>,
    /// The best of the poses that cannot be: what its lines agree on, they agree on by coincidence.
    pub impossible: Option<Hypothesis>,
    /// The same poses ranked by geometry alone, over the same candidates; `None` where appearance says nothing.
    pub by_lines: Option<Box<Ranking>>,
}

impl Ranking {
    /// Ranks poses, those that can be and those that cannot, still without candidates; `None` where none can be.
    fn new(mut possible: Vec<Hypothesis>, mut impossible: Vec<Hypothesis>) -> Option<Self> {
        possible.sort_by(|a, b| b.score.total_cmp(&a.score));
        impossible.sort_by(|a, b| b.score.total_cmp(&a.score));
        let best = possible.first()?.clone();
        let pose = best.refined.target_from_source;
        let beyond = |gap: &PoseGap, poses: &[Hypothesis]| {
            poses.iter().find(|other| gap.is_exceeded(&other.refined.target_from_source, &pose)).cloned()
        };
        let (neighbour, runner_up) = (beyond(&SAME_ANSWER, &possible), beyond(&SAME_BASIN, &possible));
        let impossible = beyond(&SAME_BASIN, &impossible);
        Some(Self { candidates: Vec::new(), best, neighbour, runner_up, impossible, by_lines: None })
    }

    /// Whether the same pose leads where appearance is not asked.
    pub fn is_best_by_lines(&self) -> bool {
        let pose = |ranking: &Ranking| ranking.best.refined.target_from_source;
        self.by_lines.as_ref().is_none_or(|by_lines| !SAME_ANSWER.is_exceeded(&pose(by_lines), &pose(self)))
    }

    /// How many times the score of the runner-up the best pose has; `None` when no really different pose explains anything.
    pub fn lead(&self) -> Option<f64> {
        let other = self.runner_up.as_ref().filter(|other| other.score > 0.0)?;
        Some((self.best.score / other.score).max(0.0))
    }

    /// The same evidence with another best pose; its rivals are the poses ranked so far that differ from it.
    pub fn with_best(self, best: Hypothesis) -> Self {
        let Self { candidates, best: before, neighbour, runner_up, impossible, by_lines } = self;
        let by_lines = by_lines.map(|ranking| Box::new(ranking.with_best(best.by_lines())));
        let pose = best.refined.target_from_source;
        let ranked: Vec<Hypothesis> = [Some(before), neighbour, runner_up].into_iter().flatten().collect();
        let beyond = |gap: &PoseGap| {
            ranked.iter().find(|other| gap.is_exceeded(&other.refined.target_from_source, &pose)).cloned()
        };
        let (neighbour, runner_up) = (beyond(&SAME_ANSWER), beyond(&SAME_BASIN));
        Self { candidates, best, neighbour, runner_up, impossible, by_lines }
    }
}

/// What ranking the poses of a pair comes to.
#[derive(Debug, Clone, PartialEq)]
pub enum Ranked {
    /// Poses that lines agree on.
    Poses(Box<Ranking>),
    /// No pose, and why.
    None(NoPose),
}

/// Why a pair has no pose at all.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NoPose {
    /// None of so many candidate matches agree on any pose.
    NothingAgrees(usize),
    /// Lines agree on so many poses, but all contradict free space or lie beyond the largest baseline.
    Impossible(usize),
}

impl NoPose {
    /// For the user.
    pub fn reason(self) -> Reason {
        match self {
            NoPose::NothingAgrees(n) => Reason {
                code: ReasonCode::NotEnoughEvidence,
                sentence: format!(
                    "of {n} possible matches of both cameras' lines no three agree on any pose yet: show straight edges that \
                     run through both cameras, from several rig poses"
                ),
            },
            NoPose::Impossible(n) => Reason {
                code: ReasonCode::FreeSpaceViolated,
                sentence: format!(
                    "lines agree on {n} {}, but there surfaces would lie in space that the other camera saw through, or the \
                     cameras further apart than allowed: show more edges, and check max_baseline_m and that depth is \
                     registered to colour",
                    if n == 1 { "pose" } else { "poses" }
                ),
            },
        }
    }
}

/// What makes a pose impossible whatever lines agree with it.
#[derive(Clone, Copy)]
pub struct RankLimits<'a> {
    /// Intrinsics of the rig's cameras.
    pub cameras: &'a [Camera],
    /// Largest distance between the two cameras, m.
    pub max_baseline_m: f64,
    /// Largest share of surface samples that may contradict free space.
    pub max_free_space_violated: f64,
    /// A pose that is known to explain much: only what could rival it is looked for. `None` looks everywhere.
    pub known: Option<&'a Motion>,
    /// Asked often; once it says no, the ranking is given up.
    pub keep_going: &'a dyn Fn() -> bool,
}

/// Ranks the poses of a pair. A ranking that was given up is incomplete: the caller must not use it.
pub fn rank_poses(pair: PairEvidence<'_>, limits: &RankLimits<'_>) -> Ranked {
    let mut candidates = pair.candidates(MAX_VOTING_SIGMA_RAD);
    let prior = prior(&pair, limits.max_baseline_m);
    candidates.iter_mut().for_each(|candidate| candidate.nats *= prior.trust);
    let settled = settled_poses(Scene { pair, candidates: &candidates }, (&prior, limits));
    let (mut possible, mut impossible): (Vec<Hypothesis>, Vec<Hypothesis>) = (Vec::new(), Vec::new());
    for pose in settled.into_iter().take_while(|_| (limits.keep_going)()) {
        match confront(pose, &pair, limits) {
            Ok(pose) => possible.push(pose),
            Err(pose) => impossible.push(pose),
        }
    }
    let (n_impossible, n_candidates) = (impossible.len(), candidates.len());
    let by_lines = |poses: &[Hypothesis]| poses.iter().map(Hypothesis::by_lines).collect();
    let is_heard = prior.trust > 0.0;
    let by_lines = is_heard.then(|| Ranking::new(by_lines(&possible), by_lines(&impossible))).flatten();
    match Ranking::new(possible, impossible) {
        Some(ranking) => {
            let by_lines = by_lines.map(Box::new);
            Ranked::Poses(Box::new(Ranking { candidates, by_lines, ..ranking }))
        }
        None if n_impossible == 0 => Ranked::None(NoPose::NothingAgrees(n_candidates)),
        None => Ranked::None(NoPose::Impossible(n_impossible)),
    }
}

/// A pose with what else the cameras saw held against it: `Err` when it cannot be, otherwise missing lines lower its score.
///
/// # Errors
/// The same pose, when surfaces or the baseline speak against it.
// The error is the pose, as large as the answer.
#[allow(clippy::result_large_err)]
pub fn confront(
    mut pose: Hypothesis,
    pair: &PairEvidence<'_>,
    limits: &RankLimits<'_>,
) -> Result<Hypothesis, Hypothesis> {
    let target_from_source = pose.refined.target_from_source;
    if !is_possible(&target_from_source, pair, limits) {
        return Err(pose);
    }
    pose.missing = missing_lines(pair, limits.cameras, &target_from_source);
    pose.score -= pose.missing.penalty();
    Ok(pose)
}

/// Whether a pose contradicts neither free space nor the largest baseline.
fn is_possible(target_from_source: &Motion, pair: &PairEvidence<'_>, limits: &RankLimits<'_>) -> bool {
    target_from_source.translation.vector.norm() <= limits.max_baseline_m
        && !free_space(pair, limits.cameras, target_from_source).is_violated(limits.max_free_space_violated)
}

/// Every pose that settled on its matches, best score first; where one is known, or appearance is certain of one, only that and its
/// rivals.
fn settled_poses(scene: Scene<'_>, (prior, limits): (&Prior, &RankLimits<'_>)) -> Vec<Hypothesis> {
    let certain = prior.poses.first().filter(|_| prior.is_certain()).and_then(|pose| settle(scene, pose));
    let certain = certain.filter(|pose| {
        pose.matches.len() >= MIN_CERTAIN_MATCHES
            && is_possible(&pose.refined.target_from_source, &scene.pair, limits)
    });
    let known = limits.known.or(certain.as_ref().map(|pose| &pose.refined.target_from_source));
    let (max_baseline_m, keep_going) = (limits.max_baseline_m, limits.keep_going);
    let voted = starts(scene.candidates, &Search { known, max_baseline_m, keep_going });
    let going = limits.known.into_iter().chain(&prior.poses).chain(&voted).take_while(|_| keep_going());
    let mut drawn_in: Vec<Approach<'_>> = going.filter_map(|pose| Approach::start(scene, pose)).collect();
    drawn_in.sort_by(|a, b| b.score.total_cmp(&a.score));
    let going = drawn_in.into_iter().take(MAX_SETTLED).take_while(|_| keep_going());
    let mut settled: Vec<Hypothesis> = going.filter_map(Approach::settle).collect();
    settled.sort_by(|a, b| b.score.total_cmp(&a.score));
    settled
}

/// How far apart two poses are at most to count as one.
pub struct PoseGap {
    /// Between the rotations, rad.
    pub rotation_rad: f64,
    /// Between the translations, m.
    pub translation_m: f64,
}

/// What a user may take for the same calibration: 0.5 degrees and 15 mm.
const SAME_ANSWER: PoseGap = PoseGap { rotation_rad: 0.0087, translation_m: 0.015 };
/// Poses that share most matches, shifted by a few (4 degrees and 15 cm).
const SAME_BASIN: PoseGap = PoseGap { rotation_rad: 0.07, translation_m: 0.15 };
impl PoseGap {
    /// Whether two poses are further apart, in rotation or in translation.
    pub fn is_exceeded(&self, a: &Motion, b: &Motion) -> bool {
        rotation_gap_rad(a, b) > self.rotation_rad || translation_gap_m(a, b) > self.translation_m
    }
}

/// Settles a single start: draws it in, then closes the gate; `None` when too little matches near it.
pub fn settle(scene: Scene<'_>, start: &Motion) -> Option<Hypothesis> {
    Approach::start(scene, start)?.settle()
}

/// A start on its way to a settled pose.
struct Approach<'a> {
    scene: Scene<'a>,
    near: Vec<usize>,
    pose: Motion,
    score: f64,
}

impl<'a> Approach<'a> {
    /// Takes the first, wide steps; `None` when hardly anything matches.
    fn start(scene: Scene<'a>, start: &Motion) -> Option<Self> {
        let mut approach = Self { scene, near: scene.near(start), pose: *start, score: 0.0 };
        for (translation_m, rotation_rad) in DRAWING_IN {
            approach.step(&Gate { translation_m, rotation_rad, noise_scale: 1.0 }, TOWARDS_THE_MINIMUM)?;
        }
        Some(approach)
    }

    /// Closes the gate down to the lines' own noise; the noise is scaled up where the sensor is worse than its model.
    fn settle(mut self) -> Option<Hypothesis> {
        for (translation_m, rotation_rad) in SETTLING {
            self.step(&Gate { translation_m, rotation_rad, noise_scale: 1.0 }, TOWARDS_THE_MINIMUM)?;
        }
        let mut scale = 1.0;
        for _ in 0..2 {
            let gate = Gate { translation_m: 0.0, rotation_rad: 0.0, noise_scale: scale };
            scale = noise_scale(&self.step(&gate, TO_THE_MINIMUM)?, scale);
        }
        self.settle_at(scale)
    }

    /// Takes the matches at the lines' own noise, and those that only a settled pose can be trusted to choose.
    fn settle_at(mut self, noise_scale: f64) -> Option<Hypothesis> {
        let gate = Gate { translation_m: 0.0, rotation_rad: 0.0, noise_scale };
        let matches = self.step(&gate, TO_THE_MINIMUM)?;
        let limits = (noise_scale, TO_THE_MINIMUM);
        let mut matched = Matched::new(&matches, &[]);
        let mut refined = matched.fit(&self.scene, &self.pose, limits);
        let mut pnl = Vec::new();
        for _ in 0..2 {
            let Some(covariance) = covariance(&refined, noise_scale) else { break };
            let target_from_source = &refined.target_from_source;
            let settled = Settled { target_from_source, covariance: &covariance, noise_scale };
            pnl = self.scene.pnl_matches(&matches, &settled);
            matched = Matched::new(&matches, &pnl);
            refined = matched.fit(&self.scene, target_from_source, limits);
        }
        let is_settled = matches!(refined.stop, Stop::SmallStep | Stop::NoDescent);
        let (score, appearance) = (self.score, matches.iter().map(|found| found.nats).sum());
        let missing = MissingLines::default();
        is_settled.then_some(Hypothesis { refined, matches, pnl, score, appearance, missing, noise_scale })
    }

    /// Matches under the gate, and moves to the pose that fits them.
    fn step(&mut self, gate: &Gate, max_steps: usize) -> Option<Vec<Match>> {
        let matches = self.scene.matches(&self.near, &self.pose, gate);
        if matches.len() < MIN_MATCHES {
            return None;
        }
        self.score = matches.iter().map(Match::worth).sum();
        let limits = (gate.noise_scale, max_steps);
        self.pose = refine(&self.scene, &indices(&matches), &self.pose, limits).target_from_source;
        Some(matches)
    }
}

fn indices(matches: &[Match]) -> Vec<usize> {
    matches.iter().map(|found| found.candidate).collect()
}
