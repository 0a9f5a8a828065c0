//! The rig's estimator: collects views; on demand ranks the poses of every pair, judges them and joins the pairs.

use super::association::Scene;
use super::candidates::PairEvidence;
use super::consensus::{Hypothesis, NoPose, RankLimits, Ranked, Ranking, confront, rank_poses};
use super::evidence::{Evidence, EvidenceLimits};
use super::joint::JointPoses;
use super::pair_graph::{JudgedPair, distrust_open_loops, join};
use super::paper::rig_pair::pose_by_paper;
use super::result::{CameraPose, LineResidual, PairEstimate, Reason, ReasonCode, RigCalibration, State};
use super::verdict::{Bench, VerdictLimits, judge, line_residuals};
use crate::geometry::{Camera, CameraView, PairScores};

/// Which estimator finds the pose of a pair; the verdict is the same.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Estimator {
    /// Consensus over all lines.
    #[default]
    Consensus,
    /// The paper's own loop, over the matches that leading poses of the consensus explain.
    Pelical,
}

/// Limits of the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimateOptions {
    /// Who finds the poses.
    pub estimator: Estimator,
    /// Largest distance between two cameras that is considered, m.
    pub max_baseline_m: f64,
    /// What is kept.
    pub evidence: EvidenceLimits,
    /// What is trusted.
    pub verdict: VerdictLimits,
}

impl Default for EstimateOptions {
    fn default() -> Self {
        Self {
            estimator: Estimator::default(),
            max_baseline_m: 1.5,
            evidence: EvidenceLimits { max_lines_per_view: 100, max_sets: 80 },
            verdict: VerdictLimits::default(),
        }
    }
}

/// One camera of the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Its name, for reasons.
    pub name: String,
    /// Its intrinsics.
    pub camera: Camera,
}

/// Collects what the cameras of a rig saw, and solves for the rig when asked. Bounded memory.
#[derive(Debug, Clone)]
pub struct RigEstimator {
    names: Vec<String>,
    cameras: Vec<Camera>,
    options: EstimateOptions,
    evidence: Evidence,
    /// Frame sets taken.
    n_sets: u64,
    /// Per camera, what it ever delivered.
    delivered: Vec<Delivered>,
}

/// What a camera ever delivered.
#[derive(Debug, Clone, Copy, Default)]
struct Delivered {
    n_views: u64,
    has_lifted_lines: bool,
}

impl RigEstimator {
    /// An estimator without evidence; camera 0 is the reference.
    pub fn new(cameras: Vec<RigCamera>, options: EstimateOptions) -> Self {
        let delivered = vec![Delivered::default(); cameras.len()];
        let (names, cameras) = cameras.into_iter().map(|camera| (camera.name, camera.camera)).unzip();
        Self { names, cameras, options, evidence: Evidence::new(options.evidence), n_sets: 0, delivered }
    }

    /// Takes one frame set: a view per camera in camera order, `None` where a camera is missing, and what appearance says of their
    /// lines. Returns whether it brought evidence that is not a repetition of an earlier set.
    pub fn add(&mut self, views: &[Option<CameraView>], scores: &[PairScores]) -> bool {
        self.add_and_score(views, &mut || scores.to_vec())
    }

    /// The same; `score` compares the lines by appearance, and is asked only where the set brought evidence.
    pub fn add_and_score(
        &mut self,
        views: &[Option<CameraView>],
        score: &mut dyn FnMut() -> Vec<PairScores>,
    ) -> bool {
        self.n_sets += 1;
        for (delivered, view) in self.delivered.iter_mut().zip(views) {
            let Some(view) = view else { continue };
            delivered.n_views += 1;
            delivered.has_lifted_lines |= view.lines.iter().any(|line| line.depth.is_some());
        }
        let is_new = self.evidence.add(views);
        if is_new {
            self.evidence.score_newest(&score());
        }
        is_new
    }

    /// The best estimate from everything added so far; the same sets give the same bits.
    pub fn solve(&self) -> RigCalibration {
        self.solve_all(&|| true)
    }

    /// The same, but given up (`None`) soon after `keep_going` says no; it is asked every few milliseconds.
    pub fn solve_while(&self, keep_going: &dyn Fn() -> bool) -> Option<RigCalibration> {
        let calibration = self.solve_all(keep_going);
        keep_going().then_some(calibration)
    }

    fn solve_all(&self, keep_going: &dyn Fn() -> bool) -> RigCalibration {
        let n_cameras = self.cameras.len();
        let mut pairs = Vec::new();
        for target in 0..n_cameras {
            for source in target + 1..n_cameras {
                pairs.push(self.judge_pair((target, source), keep_going));
            }
        }
        let open_loops = distrust_open_loops(&mut pairs, &self.names);
        let joint = join(&self.evidence, n_cameras, &pairs);
        let reason = self.rig_reason(&pairs, (&joint, open_loops));
        let state = reason.as_ref().map_or(State::Converged, |(state, _)| *state);
        let cameras = joint
            .poses
            .into_iter()
            .zip(joint.covariances)
            .map(|(pose, covariance)| {
                pose.map(|reference_from_camera| CameraPose { reference_from_camera, covariance })
            })
            .collect();
        RigCalibration {
            state,
            reason: reason.map(|(_, reason)| reason),
            reference: 0,
            cameras,
            pairs: pairs.into_iter().map(|pair| pair.estimate).collect(),
            frame_sets_used: self.evidence.sets.len(),
        }
    }

    /// Ranks the poses of one pair and judges the best.
    fn judge_pair(&self, (target, source): (usize, usize), keep_going: &dyn Fn() -> bool) -> JudgedPair {
        let pair = PairEvidence { evidence: &self.evidence, target, source };
        let mut estimate = PairEstimate::collecting(target, source);
        let limits = RankLimits {
            known: None,
            cameras: &self.cameras,
            max_baseline_m: self.options.max_baseline_m,
            max_free_space_violated: self.options.verdict.max_free_space_violated,
            keep_going,
        };
        let mut ranking = match rank_poses(pair, &limits) {
            Ranked::Poses(ranking) => *ranking,
            Ranked::None(no_pose) => {
                let blind = self.blindness(target).or_else(|| self.blindness(source));
                estimate.reason = Some(blind.unwrap_or_else(|| no_pose.reason()));
                return JudgedPair { estimate, ranking: None };
            }
        };
        if self.options.estimator == Estimator::Pelical {
            let scene = Scene { pair, candidates: &ranking.candidates };
            match pose_by_paper(&scene, &ranking).and_then(|best| confronted(best, &pair, &limits)) {
                Ok(best) => ranking = ranking.with_best(best),
                Err((state, reason)) => {
                    // Where the consensus lacks evidence too, that is the better advice.
                    let bench = Bench { scene, ranking: &ranking, limits: self.options.verdict };
                    let objection = judge(&bench);
                    (estimate.state, estimate.reason) =
                        if objection.1.is_some() { objection } else { (state, Some(reason)) };
                    return JudgedPair { estimate, ranking: None };
                }
            }
        }
        let (verdict, ranking) = trusted(&pair, ranking, self.options.verdict);
        (estimate.state, estimate.reason) = verdict;
        let pose = ranking.best.refined.target_from_source;
        let scene = Scene { pair, candidates: &ranking.candidates };
        estimate.target_from_source = Some(pose);
        estimate.full = ranking.best.matches.len();
        estimate.pnl = ranking.best.pnl.len();
        estimate.matches = ranking.best.n_matches();
        estimate.lead = ranking.lead();
        let lines = line_residuals(&scene, &ranking.best, self.cameras[target].mean_focal_px());
        estimate.residual_px = root_mean_square(&lines, |line| line.offset_px);
        estimate.residual_m = root_mean_square(&lines, |line| line.distance_m);
        estimate.line_residuals = lines;
        JudgedPair { estimate, ranking: Some(ranking) }
    }

    /// Why the rig as a whole is not converged; `None` when it is.
    fn rig_reason(
        &self,
        pairs: &[JudgedPair],
        (joint, open_loops): (&JointPoses, Option<Reason>),
    ) -> Option<(State, Reason)> {
        if self.names.len() < 2 {
            let sentence =
                "a rig of one camera has nothing to calibrate: give at least two cameras".to_owned();
            return Some((State::Failed, Reason { code: ReasonCode::OneCamera, sentence }));
        }
        if let Some(blind) = (0..self.names.len()).find_map(|camera| self.blindness(camera)) {
            return Some((State::Collecting, blind));
        }
        if let Some(reason) = open_loops {
            return Some((State::Failed, reason));
        }
        let missing = joint.poses.iter().position(Option::is_none)?;
        // Of the pairs that could connect another camera to the reference, none of which is trusted, the one with most evidence
        // tells best what is missing.
        let has_pose = |camera: usize| joint.poses[camera].is_some();
        let told =
            pairs.iter().map(|pair| &pair.estimate).filter_map(|pair| Some((pair, pair.reason.as_ref()?)));
        let joining = told.filter(|(pair, _)| has_pose(pair.target) != has_pose(pair.source));
        let Some((pair, reason)) = joining.max_by_key(|(pair, _)| pair.matches) else {
            let sentence = format!(
                "the lines of all {} pairs together do not fix {}: show edges in other directions",
                pairs.len(),
                self.names[missing]
            );
            return Some((State::Degenerate, Reason { code: ReasonCode::AxisUnobservable, sentence }));
        };
        let (target, source) = (&self.names[pair.target], &self.names[pair.source]);
        Some((
            pair.state,
            Reason { code: reason.code, sentence: format!("{source} from {target}: {}", reason.sentence) },
        ))
    }

    /// Why a camera never can have a place with what it saw so far.
    fn blindness(&self, camera: usize) -> Option<Reason> {
        let Delivered { n_views, has_lifted_lines } = self.delivered[camera];
        let sentence = format!(
            "{} saw no straight edge with depth in its {n_views} views of {} frame sets: check its connection, lighting, \
             exposure, lens cover, and that depth is registered to colour",
            self.names[camera], self.n_sets
        );
        (!has_lifted_lines).then_some(Reason { code: ReasonCode::NoLines, sentence })
    }
}

/// The verdict on the best pose of a ranking; what geometry alone is sure of, appearance does not take away.
fn trusted(
    pair: &PairEvidence<'_>,
    mut ranking: Ranking,
    limits: VerdictLimits,
) -> ((State, Option<Reason>), Ranking) {
    let scene = Scene { pair: *pair, candidates: &ranking.candidates };
    let verdict = judge(&Bench { scene, ranking: &ranking, limits });
    if verdict.0 == State::Converged {
        return (verdict, ranking);
    }
    let Some(by_lines) = ranking.by_lines.take() else { return (verdict, ranking) };
    match judge(&Bench {
        scene: Scene { pair: *pair, candidates: &ranking.candidates },
        ranking: &by_lines,
        limits,
    }) {
        sure @ (State::Converged, _) => (sure, Ranking { candidates: ranking.candidates, ..*by_lines }),
        _ => (verdict, ranking),
    }
}

/// Over all lines; 0 without any.
fn root_mean_square(lines: &[LineResidual], of: fn(&LineResidual) -> f64) -> f64 {
    let sum2: f64 = lines.iter().map(|line| of(line) * of(line)).sum();
    (sum2 / lines.len().max(1) as f64).sqrt()
}

/// The paper's pose, confronted with surfaces and missing lines as those of the consensus are.
fn confronted(
    best: Hypothesis,
    pair: &PairEvidence<'_>,
    limits: &RankLimits<'_>,
) -> Result<Hypothesis, (State, Reason)> {
    confront(best, pair, limits).map_err(|_| (State::Collecting, NoPose::Impossible(1).reason()))
}
