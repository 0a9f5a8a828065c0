//! What the estimator answers: extrinsics with covariance where it is sure, and the reason where it is not.

use nalgebra::Matrix6;

use crate::geometry::motion::Motion;

/// The verdict on a rig or a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum State {
    /// More evidence is needed.
    Collecting,
    /// Every test passed.
    Converged,
    /// Every test was passed in an earlier run; live lines have not confirmed it yet. No estimator answers this.
    Stored,
    /// The evidence leaves a degree of freedom open.
    Degenerate,
    /// Another pose explains the evidence about as well.
    Ambiguous,
    /// The evidence contradicts itself, or there can be none (one camera only).
    Failed,
}

impl State {
    /// The name in files and on the wire.
    pub fn name(self) -> &'static str {
        match self {
            State::Collecting => "collecting",
            State::Converged => "converged",
            State::Stored => "stored",
            State::Degenerate => "degenerate",
            State::Ambiguous => "ambiguous",
            State::Failed => "failed",
        }
    }
}

/// Why a state is not `Converged`: a closed list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReasonCode {
    /// Too few independent lines agree on any pose.
    NotEnoughEvidence,
    /// The runner-up is not clearly beaten.
    RunnerUpTooClose,
    /// A direction of translation or an axis of rotation is not fixed by the lines.
    AxisUnobservable,
    /// Two independent halves of the evidence give different poses.
    HalvesDisagree,
    /// The lines agree worse than their noise explains.
    ResidualTooHigh,
    /// With this pose, surfaces would lie in space that a camera saw through.
    FreeSpaceViolated,
    /// The poses of the pairs do not close around the rig.
    LoopInconsistent,
    /// The rig has fewer than two cameras.
    OneCamera,
    /// No camera delivered a line.
    NoLines,
    /// With this pose, lines that one camera sees should be seen by the other and are not.
    MissingLines,
}

impl ReasonCode {
    /// Every code, in the order of the wire format.
    pub const ALL: [ReasonCode; 10] = [
        ReasonCode::NotEnoughEvidence,
        ReasonCode::RunnerUpTooClose,
        ReasonCode::AxisUnobservable,
        ReasonCode::HalvesDisagree,
        ReasonCode::ResidualTooHigh,
        ReasonCode::FreeSpaceViolated,
        ReasonCode::LoopInconsistent,
        ReasonCode::OneCamera,
        ReasonCode::NoLines,
        ReasonCode::MissingLines,
    ];

    /// The name in files and on the wire.
    pub fn name(self) -> &'static str {
        match self {
            ReasonCode::NotEnoughEvidence => "not_enough_evidence",
            ReasonCode::RunnerUpTooClose => "runner_up_too_close",
            ReasonCode::AxisUnobservable => "axis_unobservable",
            ReasonCode::HalvesDisagree => "halves_disagree",
            ReasonCode::ResidualTooHigh => "residual_too_high",
            ReasonCode::FreeSpaceViolated => "free_space_violated",
            ReasonCode::LoopInconsistent => "loop_inconsistent",
            ReasonCode::OneCamera => "one_camera",
            ReasonCode::NoLines => "no_lines",
            ReasonCode::MissingLines => "missing_lines",
        }
    }
}

/// A reason in numbers and words.
#[derive(Debug, Clone, PartialEq)]
pub struct Reason {
    /// Which of the closed list.
    pub code: ReasonCode,
    /// One sentence with the evidence in numbers and what to do next.
    pub sentence: String,
}

/// Where a camera sits.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraPose {
    /// The camera's frame in the reference camera's frame.
    pub reference_from_camera: Motion,
    /// Covariance of a step `t + dt`, `exp(dr) R`: both in the axes of the reference camera, ordered x y z rx ry rz (REP-103), m
    /// and rad.
    pub covariance: Matrix6<f64>,
}

/// What was found between two cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct PairEstimate {
    /// Index of the target camera.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
    /// The verdict on this pair: its own, or failed when it is part of a loop of pairs that does not close.
    pub state: State,
    /// Why it is not converged.
    pub reason: Option<Reason>,
    /// The best pose so far, converged or not; `None` without any agreeing lines.
    pub target_from_source: Option<Motion>,
    /// Independent matches that agree with the pose.
    pub matches: usize,
    /// Of these, lifted on both sides.
    pub full: usize,
    /// Of these, lifted on one side only.
    pub pnl: usize,
    /// How many times the score of the best really different pose the best one has; `None` when no other explains anything, or
    /// with no pose.
    pub lead: Option<f64>,
    /// Root mean square distance of the target segment's ends from the predicted line, px.
    pub residual_px: f64,
    /// Root mean square distance between the lines at the target segment's ends, m.
    pub residual_m: f64,
    /// The same of each match that both sides lifted. Not sent over shared memory: there it is empty.
    pub line_residuals: Vec<LineResidual>,
}

impl PairEstimate {
    /// Of two cameras between which nothing was found yet.
    pub(crate) fn collecting(target: usize, source: usize) -> Self {
        Self {
            target,
            source,
            state: State::Collecting,
            reason: None,
            target_from_source: None,
            matches: 0,
            full: 0,
            pnl: 0,
            lead: None,
            residual_px: 0.0,
            residual_m: 0.0,
            line_residuals: Vec::new(),
        }
    }
}

/// How well a pose explains one match: root mean square over the two ends of the target's segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineResidual {
    /// Distance of the ends from the predicted line, px.
    pub offset_px: f64,
    /// Distance between the lines there, m.
    pub distance_m: f64,
}

/// What was found for the whole rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCalibration {
    /// Converged only if every camera is.
    pub state: State,
    /// Why it is not converged.
    pub reason: Option<Reason>,
    /// Index of the reference camera.
    pub reference: usize,
    /// One per camera, in camera order; the reference has the identity and zero covariance; `None` where the evidence does
    /// not reach.
    pub cameras: Vec<Option<CameraPose>>,
    /// Every pair of cameras.
    pub pairs: Vec<PairEstimate>,
    /// Frame sets that were taken into account.
    pub frame_sets_used: usize,
}

impl RigCalibration {
    /// Of a camera without a pose, the pair that is nearest to giving it one: with most matches among those between the cameras
    /// that have a pose and the camera with all that converged pairs fix to it. Its reason says what is missing. `None` for a
    /// camera that has a pose.
    pub fn missing_link(&self, camera: usize) -> Option<&PairEstimate> {
        let has_pose = |camera: usize| self.cameras.get(camera).is_some_and(Option::is_some);
        if has_pose(camera) {
            return None;
        }
        let group = self.fixed_to(camera);
        let links = |pair: &&PairEstimate| {
            let [a, b] = [pair.target, pair.source];
            pair.reason.is_some()
                && ((group.contains(&a) && has_pose(b)) || (group.contains(&b) && has_pose(a)))
        };
        self.pairs.iter().filter(links).max_by_key(|pair| pair.matches)
    }

    /// A camera and all that converged pairs fix to it.
    fn fixed_to(&self, camera: usize) -> Vec<usize> {
        let mut group = vec![camera];
        let mut next = 0;
        while let Some(&here) = group.get(next) {
            for pair in self.pairs.iter().filter(|pair| pair.state == State::Converged) {
                for (from, to) in [(pair.target, pair.source), (pair.source, pair.target)] {
                    if from == here && !group.contains(&to) {
                        group.push(to);
                    }
                }
            }
            next += 1;
        }
        group
    }
}
