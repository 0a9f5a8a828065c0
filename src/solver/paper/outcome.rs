//! How a solve by the paper's estimator ended, with the numbers that decided it.

use std::fmt;

use crate::geometry::motion::Motion;
use crate::solver::result::{Reason, ReasonCode, State};

/// How a solve ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PaperOutcome {
    /// Both ending conditions hold.
    Converged,
    /// Fewer usable pairs than needed.
    TooFewPairs {
        /// Pairs that can be read and were let in by the gate.
        pairs: usize,
        /// Needed.
        needed: usize,
    },
    /// The quadratic system leaves the translation open.
    NoRoot,
    /// No root made enough candidates meet.
    TooFewVoters {
        /// Most voters of any root.
        voters: usize,
        /// Needed.
        needed: usize,
    },
    /// Enough voters, but their cost stayed too high when only they were left.
    CostTooHigh {
        /// Robust cost, mean over the voters.
        mean_cost: f64,
        /// Allowed.
        limit: f64,
    },
    /// The voters leave an axis of the pose (nearly) open.
    NotObservable {
        /// Standard deviation of the translation in its worst direction, m; infinite where it is open.
        sigma_translation_m: f64,
        /// Standard deviation of the rotation about its worst axis, rad; infinite where it is open.
        sigma_rotation_rad: f64,
    },
    /// Another pose explains the same voters.
    Ambiguous {
        /// How far it is turned, rad.
        rotation_gap_rad: f64,
        /// ... and displaced, m.
        translation_gap_m: f64,
    },
}

impl PaperOutcome {
    /// Whether nothing was found that a pose could be judged by: other starts may do better.
    pub fn is_stuck(&self) -> bool {
        matches!(self, Self::NoRoot | Self::TooFewVoters { .. })
    }

    /// The same in the words of the verdict, for an end without a pose.
    fn objection(&self) -> (State, Reason) {
        let (state, code) = match self {
            Self::Converged | Self::TooFewPairs { .. } | Self::NoRoot | Self::TooFewVoters { .. } => {
                (State::Collecting, ReasonCode::NotEnoughEvidence)
            }
            Self::CostTooHigh { .. } => (State::Failed, ReasonCode::ResidualTooHigh),
            Self::NotObservable { .. } => (State::Degenerate, ReasonCode::AxisUnobservable),
            Self::Ambiguous { .. } => (State::Ambiguous, ReasonCode::RunnerUpTooClose),
        };
        (state, Reason { code, sentence: self.to_string() })
    }
}

impl fmt::Display for PaperOutcome {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Converged => write!(formatter, "converged"),
            Self::TooFewPairs { pairs, needed } => {
                write!(formatter, "{pairs} usable line pairs, needed are {needed}: show more lines")
            }
            Self::NoRoot => write!(
                formatter,
                "the lines leave the translation open: show lines in at least two more directions"
            ),
            Self::TooFewVoters { voters, needed } => write!(
                formatter,
                "{voters} pairs agree on one pose, needed are {needed}: show more lines that run through both cameras"
            ),
            Self::CostTooHigh { mean_cost, limit } => write!(
                formatter,
                "the pairs that agree leave a mean cost of {mean_cost:.2}, allowed is {limit:.2}: check the intrinsics, \
                 or the noise the lines are given"
            ),
            Self::NotObservable { sigma_translation_m, sigma_rotation_rad } => write!(
                formatter,
                "the worst axis is known to {:.1} mm and {:.2} deg only: show lines in other directions and places",
                1e3 * sigma_translation_m,
                sigma_rotation_rad.to_degrees()
            ),
            Self::Ambiguous { rotation_gap_rad, translation_gap_m } => write!(
                formatter,
                "another pose {:.1} deg and {:.0} mm away explains the same pairs: show lines in other directions and places",
                rotation_gap_rad.to_degrees(),
                1e3 * translation_gap_m
            ),
        }
    }
}

/// What came of a set of pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperSolution {
    /// How it ended.
    pub outcome: PaperOutcome,
    /// The pose, when converged.
    pub target_from_source: Option<Motion>,
    /// Indices of the pairs that voted for it, ascending; empty without a pose.
    pub inliers: Vec<usize>,
    /// Robust cost of the last voters, mean; infinite where there were none.
    pub mean_cost: f64,
    /// Rounds of the outer loop.
    pub rounds: usize,
}

impl PaperSolution {
    /// The pose.
    ///
    /// # Errors
    /// The state and the reason for the user, when there is none.
    pub fn pose(&self) -> Result<Motion, (State, Reason)> {
        self.target_from_source.ok_or_else(|| self.outcome.objection())
    }
}
