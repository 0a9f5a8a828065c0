//! One pair under watch: the frozen pose against the best pose near it, and against any pose when the frozen one has lost its
//! support.

use nalgebra::Matrix6;

use super::shift::{Shift, mean_variances};
use super::{WatchEffort, WatchLimits};
use crate::geometry::Camera;
use crate::geometry::motion::{Motion, d_inverse_step_d_step};
use crate::solver::association::{Gate, Match, Scene};
use crate::solver::candidates::PairEvidence;
use crate::solver::consensus::{
    Hypothesis, MAX_VOTING_SIGMA_RAD, PoseGap, RankLimits, Ranked, Ranking, rank_poses, settle,
};
use crate::solver::evidence::{Evidence, EvidenceSet};
use crate::solver::joint::d_pair_step_d_steps;
use crate::solver::noise::covariance;
use crate::solver::rig::EstimateOptions;
use crate::solver::verdict::{self, VerdictLimits, judge};
use crate::solver::{CameraPose, State};

/// Another pose must explain the lines better than the frozen one by this much, nats, ...
const MIN_LEAD_NATS: f64 = 20.0;
/// ... and by this share: where many lines agree anyhow, a few odd ones prove nothing.
const MIN_LEAD_SHARE: f64 = 0.05;
/// Least number of matches, lifted on both sides, that confirm a pose near the frozen one ...
const MIN_CONFIRMING: usize = 6;
/// ... and their least share of those that the calibration had per frame set: chance does not give as many.
const MIN_USUAL_SHARE: f64 = 0.3;
/// A pose settled from the frozen one shares most matches with it within this; what strayed further is a coincidence (4 degrees and
/// 10 cm).
const NEAR: PoseGap = PoseGap { rotation_rad: 0.07, translation_m: 0.1 };
/// A suspected pose that moves more than this from one look to the next was none (0.5 degrees and 15 mm).
const SAME_SUSPECT: PoseGap = PoseGap { rotation_rad: 0.0087, translation_m: 0.015 };
/// Looks that show this, not contradicted in between, vouch for a pair.
const VOUCH_AFTER: u32 = 3;
/// Fewer lines than this in a view say nothing.
const MIN_LINES: usize = 3;
/// A search takes up to a hundred times as long as a look near the frozen pose; after one, so many sets pass before the next.
const SETS_BETWEEN_SEARCHES: u32 = 4;
/// A move need not be known as well as a calibration: its uncertainty is part of the test.
const LOOSER_SIGMA: f64 = 3.0;

/// While the alarm is on, so much of the limits is enough to keep it.
const KEPT_SHARE: f64 = 0.5;

/// What all pairs are looked at with.
pub(super) struct Bench<'a> {
    pub(super) evidence: &'a Evidence,
    pub(super) cameras: &'a [Camera],
    pub(super) options: &'a EstimateOptions,
    pub(super) limits: &'a WatchLimits,
    pub(super) effort: &'a WatchEffort<'a>,
}

/// What a look at a pair comes to.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Sight {
    /// Nothing can be said.
    Silent,
    /// The frozen pose explains the lines; the best pose near it is no move.
    Confirmed(Shift),
    /// Another pose does.
    Moved(Shift),
}

/// How the frozen pose stands, and what another one must show to be taken instead.
struct Rival {
    /// What the frozen pose scores.
    score: f64,
    /// The part of it that is of the newest view.
    newest: f64,
    /// Views in which both cameras see lines.
    n_views: usize,
    /// Least number of matches of the other one.
    min_matches: usize,
}

/// A pair under watch.
#[derive(Debug, Clone)]
pub(super) struct PairWatch {
    /// Target and source.
    pub(super) cameras: [usize; 2],
    /// `target_from_source` of the frozen result.
    pub(super) frozen: Motion,
    covariance: Matrix6<f64>,
    /// Matches lifted on both sides per frame set when the result was made.
    usual_matches: f64,
    /// The pose that explained the lines better when looked at last.
    suspect: Option<Motion>,
    /// Frame sets until the next search over all poses.
    wait: u32,
    has_searched: bool,
    /// Matches when the frozen pose was confirmed last; as many are enough to say that the pair now stands nearby.
    confirmed_matches: Option<usize>,
    /// Successive looks in which as many matches as a calibration needs showed that the pair stands where it stood.
    vouching_looks: u32,
    /// The alarm is on, and this pair sees a camera that is said to be moved.
    pub(super) is_accused: bool,
}

impl PairWatch {
    /// `None` when the frozen poses are not known to any accuracy.
    pub(super) fn new(cameras: [usize; 2], poses: [&CameraPose; 2], usual_matches: f64) -> Option<Self> {
        let [target, source] = poses.map(|pose| pose.reference_from_camera);
        let [by_target, by_source] = d_pair_step_d_steps(&target, &source);
        let covariance = by_target * poses[0].covariance * by_target.transpose()
            + by_source * poses[1].covariance * by_source.transpose();
        let frozen = target.inverse() * source;
        let is_finite = covariance.iter().all(|value| value.is_finite());
        is_finite.then_some(Self {
            cameras,
            frozen,
            covariance,
            usual_matches,
            suspect: None,
            wait: 0,
            has_searched: false,
            confirmed_matches: None,
            vouching_looks: 0,
            is_accused: false,
        })
    }

    /// Whether live lines have shown, as surely as a calibration must, that the pair stands where it stood.
    pub(super) fn is_vouched_for(&self) -> bool {
        self.vouching_looks >= VOUCH_AFTER && !self.is_accused
    }

    /// Whether the newest look was a search over all poses.
    pub(super) fn has_searched(&self) -> bool {
        self.has_searched
    }

    /// Compares the newest views with the frozen pose.
    pub(super) fn look(&mut self, bench: &Bench<'_>) -> Sight {
        let sight = self.sight(bench);
        match &sight {
            Sight::Silent => {}
            Sight::Moved(_) => self.vouching_looks = 0,
            Sight::Confirmed(shift) => {
                let is_enough =
                    self.confirmed_matches.is_some_and(|found| found >= bench.options.verdict.min_matches);
                if is_enough && shift.is_same_place(bench.limits) {
                    self.vouching_looks = self.vouching_looks.saturating_add(1);
                }
            }
        }
        sight
    }

    fn sight(&mut self, bench: &Bench<'_>) -> Sight {
        self.wait = self.wait.saturating_sub(1);
        self.has_searched = false;
        let [target, source] = self.cameras;
        let pair = PairEvidence { evidence: bench.evidence, target, source };
        let sees = |set: &EvidenceSet| self.cameras.iter().all(|&camera| n_lines(set, camera) >= MIN_LINES);
        // Only what is seen now says how the cameras stand now.
        if !bench.evidence.sets.last().is_some_and(sees) {
            return Sight::Silent;
        }
        let n_views = bench.evidence.sets.iter().filter(|set| sees(set)).count();
        let candidates = pair.candidates(MAX_VOTING_SIGMA_RAD);
        let scene = Scene { pair, candidates: &candidates };
        let near = settle(scene, &self.frozen)
            .filter(|near| !NEAR.is_exceeded(&near.refined.target_from_source, &self.frozen));
        let noise_scale = near.as_ref().map_or(1.0, |near| near.noise_scale);
        let support = self.support(&scene, noise_scale);
        let usual = near.filter(|near| self.is_usual(near.matches.len(), n_views));
        let rival = Rival {
            score: support.iter().map(|found| found.gain).sum(),
            newest: in_newest(&scene, &support).1,
            n_views,
            min_matches: self.min_matches(usual.is_some(), bench),
        };
        if let Some(shift) = self.still_suspect(scene, &rival, bench) {
            return Sight::Moved(shift);
        }
        let is_supported = self.is_usual(support.len(), n_views);
        let shift = usual.as_ref().filter(|_| is_supported).and_then(|near| self.shift_to(near));
        if let Some(shift) = shift.filter(|shift| !self.is_move(shift, bench)) {
            self.confirmed_matches = Some(support.len());
            return Sight::Confirmed(shift);
        }
        self.has_searched = self.wait == 0 && bench.effort.may_search;
        let found = if self.has_searched {
            self.wait = SETS_BETWEEN_SEARCHES;
            self.search(pair, (usual.as_ref(), &rival), bench)
        } else {
            None
        };
        self.suspect = found.as_ref().map(|shift| shift.target_from_source);
        found.map_or(Sight::Silent, Sight::Moved)
    }

    /// Whether so many matches in so many views are as many as are to be expected.
    fn is_usual(&self, n_matches: usize, n_views: usize) -> bool {
        n_matches >= MIN_CONFIRMING
            && n_matches as f64 >= MIN_USUAL_SHARE * self.usual_matches * n_views as f64
    }

    /// Least number of matches of another pose: of one nearby, as many as confirmed the frozen one when it was confirmed last.
    fn min_matches(&self, is_nearby: bool, bench: &Bench<'_>) -> usize {
        let least = bench.options.verdict.min_matches;
        let before = self.confirmed_matches.filter(|_| is_nearby).unwrap_or(least);
        before.max(MIN_CONFIRMING).min(least)
    }

    /// What the frozen pose explains, as far as it is known.
    fn support(&self, scene: &Scene<'_>, noise_scale: f64) -> Vec<Match> {
        let (m2, rad2) = mean_variances(&self.covariance);
        let gate = Gate { translation_m: m2.sqrt(), rotation_rad: rad2.sqrt(), noise_scale };
        scene.matches(&scene.near(&self.frozen), &self.frozen, &gate)
    }

    /// From the frozen pose to another one; `None` when the lines do not fix that.
    fn shift_to(&self, other: &Hypothesis) -> Option<Shift> {
        let covariance = covariance(&other.refined, other.noise_scale)?;
        let now = (&other.refined.target_from_source, &covariance);
        Some(Shift::between((&self.frozen, &self.covariance), now))
    }

    fn is_move(&self, shift: &Shift, bench: &Bench<'_>) -> bool {
        shift.is_beyond(bench.limits, if self.is_accused { KEPT_SHARE } else { 1.0 })
    }

    /// The move to the pose that was suspected before, as long as that stays what it was and is still to be trusted.
    fn still_suspect(&mut self, scene: Scene<'_>, frozen: &Rival, bench: &Bench<'_>) -> Option<Shift> {
        let suspect = self.suspect.take()?;
        let now = settle(scene, &suspect)?;
        if SAME_SUSPECT.is_exceeded(&now.refined.target_from_source, &suspect) {
            return None;
        }
        let shift = self.trusted((scene, &alone(now)), frozen, bench)?;
        self.suspect = Some(shift.target_from_source);
        Some(shift)
    }

    /// Ranks all poses, or, where many lines agree on one nearby, that and what could rival it; the move to the best when that is to
    /// be trusted.
    fn search(
        &self,
        pair: PairEvidence<'_>,
        (nearby, frozen): (Option<&Hypothesis>, &Rival),
        bench: &Bench<'_>,
    ) -> Option<Shift> {
        let limits = RankLimits {
            known: nearby.map(|pose| &pose.refined.target_from_source),
            cameras: bench.cameras,
            max_baseline_m: bench.options.max_baseline_m,
            max_free_space_violated: bench.options.verdict.max_free_space_violated,
            keep_going: bench.effort.keep_going,
        };
        let Ranked::Poses(ranking) = rank_poses(pair, &limits) else { return None };
        let scene = Scene { pair, candidates: &ranking.candidates };
        self.trusted((scene, &ranking), frozen, bench)
    }

    /// The move to the best pose of a ranking when that passes the tests of a verdict, leads before the frozen pose's score, and is
    /// what the newest view shows: older ones may be of before the move.
    fn trusted(
        &self,
        (scene, ranking): (Scene<'_>, &Ranking),
        frozen: &Rival,
        bench: &Bench<'_>,
    ) -> Option<Shift> {
        let verdict = bench.options.verdict;
        let is_single = frozen.n_views < 2;
        let limits = VerdictLimits {
            min_matches: frozen.min_matches,
            min_views: verdict.min_views.min(frozen.n_views),
            min_matches_elsewhere: if is_single { 0 } else { verdict.min_matches_elsewhere },
            max_sigma_translation_m: LOOSER_SIGMA * verdict.max_sigma_translation_m,
            max_sigma_rotation_rad: LOOSER_SIGMA * verdict.max_sigma_rotation_rad,
            ..verdict
        };
        let (state, _) = judge(&verdict::Bench { scene, ranking, limits });
        let shift = self.shift_to(&ranking.best)?;
        let (n_newest, newest) = in_newest(&scene, &ranking.best.matches);
        let is_seen_now =
            n_newest as f64 >= (MIN_USUAL_SHARE * self.usual_matches).max(1.0) && newest > frozen.newest;
        let is_trusted = state == State::Converged && is_seen_now && leads(&ranking.best, frozen.score);
        (is_trusted && self.is_move(&shift, bench)).then_some(shift)
    }

    /// The same move as the source sees the target: of the frame `source_from_target`.
    pub(super) fn seen_from_source(&self, shift: &Shift) -> Shift {
        let (frozen, now) = (self.frozen.inverse(), shift.target_from_source.inverse());
        let by_step = d_inverse_step_d_step(&shift.target_from_source);
        let covariance = by_step * shift.covariance * by_step.transpose();
        Shift::between((&frozen, &Matrix6::zeros()), (&now, &covariance))
    }
}

/// A ranking of one pose, for the verdict.
fn alone(best: Hypothesis) -> Ranking {
    Ranking {
        candidates: Vec::new(),
        best,
        neighbour: None,
        runner_up: None,
        impossible: None,
        by_lines: None,
    }
}

/// How many of these matches are of the newest view, and what they gain, nats.
fn in_newest(scene: &Scene<'_>, matches: &[Match]) -> (usize, f64) {
    let newest = scene.pair.evidence.sets.len().saturating_sub(1);
    let of_newest = matches.iter().filter(|found| scene.candidates[found.candidate].set as usize == newest);
    of_newest.fold((0, 0.0), |(n, gain), found| (n + 1, gain + found.gain))
}

/// Whether a pose explains the lines clearly better than another one with the given score.
fn leads(best: &Hypothesis, score: f64) -> bool {
    best.score - score > MIN_LEAD_NATS.max(MIN_LEAD_SHARE * best.score)
}

fn n_lines(set: &EvidenceSet, camera: usize) -> usize {
    set.views.get(camera).and_then(Option::as_ref).map_or(0, |view| view.lines.len())
}
