//! The rig's estimator: collects views; on demand ranks the poses of every pair, judges them and joins the pairs.

use super::association::Scene;
use super::candidates::PairEvidence;
use super::consensus::{RankLimits, Ranked, Ranking, rank_poses};
use super::evidence::{Evidence, EvidenceLimits};
use super::joint::{Edge, JointPoses, solve_joint};
use super::noise::information_factor;
use super::pnl::Matched;
use super::result::{CameraPose, PairEstimate, Reason, ReasonCode, RigCalibration, State};
use super::verdict::{Bench, VerdictLimits, judge, residuals};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::geometry::{Camera, CameraView};

/// Limits of the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimateOptions {
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
            max_baseline_m: 1.5,
            evidence: EvidenceLimits { max_lines_per_view: 100, max_sets: 80 },
            verdict: VerdictLimits::default(),
        }
    }
}

/// A loop of pairs may miss by this much before a pair is suspected, rad: the bound of a good rig (0.3 degrees).
const MAX_LOOP_RAD: f64 = 0.0052;
/// See [`MAX_LOOP_RAD`]; m.
const MAX_LOOP_M: f64 = 0.010;

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
    /// Per camera, whether it ever saw a lifted line.
    has_lines: Vec<bool>,
}

/// A pair after ranking and verdict.
struct JudgedPair {
    estimate: PairEstimate,
    ranking: Option<Ranking>,
}

impl RigEstimator {
    /// An estimator without evidence; camera 0 is the reference.
    pub fn new(cameras: Vec<RigCamera>, options: EstimateOptions) -> Self {
        let has_lines = vec![false; cameras.len()];
        let (names, cameras) = cameras.into_iter().map(|camera| (camera.name, camera.camera)).unzip();
        Self { names, cameras, options, evidence: Evidence::new(options.evidence), has_lines }
    }

    /// Takes one frame set: a view per camera in camera order, `None` where a camera is missing. Returns whether it brought
    /// evidence that is not a repetition of an earlier set.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> bool {
        for (has_lines, view) in self.has_lines.iter_mut().zip(views) {
            *has_lines |= view.iter().flat_map(|view| &view.lines).any(|line| line.depth.is_some());
        }
        self.evidence.add(views)
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
        let joint = self.join(&pairs);
        let reason = self.rig_reason(&pairs, &joint);
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
        let mut estimate = PairEstimate {
            target,
            source,
            state: State::Collecting,
            reason: None,
            target_from_source: None,
            matches: 0,
            full: 0,
            pnl: 0,
            residual_px: 0.0,
            residual_m: 0.0,
        };
        let limits = RankLimits {
            cameras: &self.cameras,
            max_baseline_m: self.options.max_baseline_m,
            max_free_space_violated: self.options.verdict.max_free_space_violated,
            keep_going,
        };
        let ranking = match rank_poses(pair, &limits) {
            Ranked::Poses(ranking) => *ranking,
            Ranked::None(no_pose) => {
                estimate.reason = Some(no_pose.reason());
                return JudgedPair { estimate, ranking: None };
            }
        };
        let pose = ranking.best.refined.target_from_source;
        let scene = Scene { pair, candidates: &ranking.candidates };
        let bench = Bench { scene, ranking: &ranking, limits: self.options.verdict };
        (estimate.state, estimate.reason) = judge(&bench);
        let (offset, distance_m) = residuals(&scene, &ranking.best);
        estimate.target_from_source = Some(pose);
        estimate.full = ranking.best.matches.len();
        estimate.pnl = ranking.best.pnl.len();
        estimate.matches = ranking.best.n_matches();
        estimate.residual_px = offset * self.cameras[target].mean_focal_px();
        estimate.residual_m = distance_m;
        JudgedPair { estimate, ranking: Some(ranking) }
    }

    /// Joins the converged pairs.
    fn join(&self, pairs: &[JudgedPair]) -> JointPoses {
        let edges: Vec<Edge<'_>> = pairs.iter().filter_map(|pair| self.edge(pair)).collect();
        solve_joint(self.cameras.len(), 0, &edges)
    }

    fn edge<'a>(&'a self, pair: &'a JudgedPair) -> Option<Edge<'a>> {
        let PairEstimate { target, source, state, .. } = pair.estimate;
        let ranking = pair.ranking.as_ref().filter(|_| state == State::Converged)?;
        let evidence = PairEvidence { evidence: &self.evidence, target, source };
        let scene = Scene { pair: evidence, candidates: &ranking.candidates };
        let best = &ranking.best;
        let matched = Matched::new(&best.matches, &best.pnl);
        let noise_scale = best.noise_scale;
        Some(Edge {
            target,
            source,
            target_from_source: best.refined.target_from_source,
            score: best.score,
            equations: Box::new(move |pose: &Motion| {
                matched.equations(&scene, pose, noise_scale).scaled(information_factor(noise_scale))
            }),
        })
    }

    /// Why the rig as a whole is not converged; `None` when it is.
    fn rig_reason(&self, pairs: &[JudgedPair], joint: &JointPoses) -> Option<(State, Reason)> {
        let object = |state, code, sentence: String| Some((state, Reason { code, sentence }));
        if self.cameras.len() < 2 {
            let sentence =
                "a rig of one camera has nothing to calibrate: give at least two cameras".to_owned();
            return object(State::Failed, ReasonCode::OneCamera, sentence);
        }
        if let Some(blind) = self.has_lines.iter().position(|has_lines| !has_lines) {
            let sentence = format!(
                "{} saw no straight edge with depth: check its lighting, exposure, lens cover, and that depth is \
                 registered to colour",
                self.names[blind]
            );
            return object(State::Collecting, ReasonCode::NoLines, sentence);
        }
        if let Some(sentence) = self.loop_miss(pairs, joint) {
            return object(State::Failed, ReasonCode::LoopInconsistent, sentence);
        }
        // Of the pairs that could connect another camera to the reference, none of which has converged, the one with most
        // evidence tells best what is missing. There is none when every camera has its pose.
        let has_pose = |camera: usize| joint.poses[camera].is_some();
        let joining =
            pairs.iter().filter(|pair| has_pose(pair.estimate.target) != has_pose(pair.estimate.source));
        let estimate = &joining.max_by_key(|pair| pair.estimate.matches)?.estimate;
        let reason = estimate.reason.clone()?;
        let (target, source) = (&self.names[estimate.target], &self.names[estimate.source]);
        object(estimate.state, reason.code, format!("{source} from {target}: {}", reason.sentence))
    }

    /// Says which converged pair disagrees with the joint poses by more than a good rig allows.
    fn loop_miss(&self, pairs: &[JudgedPair], joint: &JointPoses) -> Option<String> {
        let converged = pairs.iter().filter(|pair| pair.estimate.state == State::Converged);
        let misses = converged.filter_map(|pair| {
            let estimate = &pair.estimate;
            let joined = joint.poses[estimate.target]?.inverse() * joint.poses[estimate.source]?;
            let own = estimate.target_from_source?;
            let (angle_rad, distance_m) = (rotation_gap_rad(&joined, &own), translation_gap_m(&joined, &own));
            (angle_rad > MAX_LOOP_RAD || distance_m > MAX_LOOP_M).then_some((estimate, angle_rad, distance_m))
        });
        let (estimate, angle_rad, distance_m) = misses.max_by(|a, b| a.2.total_cmp(&b.2))?;
        Some(format!(
            "the pairs do not close around the rig: {} and {} miss by {:.2} deg and {:.1} mm; check that all cameras are \
         fixed to each other and recalibrate",
            self.names[estimate.target],
            self.names[estimate.source],
            angle_rad.to_degrees(),
            1e3 * distance_m
        ))
    }
}
