//! Who proposes matches: pure geometry, by the pose that the estimator finds on the whole recording.

use super::same_edge::{SameEdges, Sight};
use super::score::{Match, explained};
use crate::capture::recording::Recording;
use crate::cli::error::CliError;
use crate::cli::talk::say;
use crate::pipeline::PipelineOptions;
use crate::pipeline::offline::{RecordedSets, run_offline};
use crate::solver::{PairEstimate, State};

/// Proposes matches between two cameras.
#[derive(Debug)]
pub enum Proposer {
    /// Lines that a converged pose explains.
    Geometric(Vec<PairEstimate>),
}

impl Proposer {
    /// Gets ready; for `geometric` the recording is calibrated.
    ///
    /// # Errors
    /// When a frame cannot be read.
    pub fn new(recording: &Recording, options: &PipelineOptions) -> Result<Self, CliError> {
        let mut sets = RecordedSets::new(recording);
        let rig = sets.rig();
        let run = run_offline(&mut sets, &rig, options, &mut |_| {})?;
        let pairs = run.calibration.pairs;
        for pair in pairs.iter().filter(|pair| pair.state != State::Converged) {
            let (target, source) = (&rig[pair.target].name, &rig[pair.source].name);
            let why = pair.reason.as_ref().map_or("", |reason| reason.sentence.as_str());
            say(format_args!("{source} from {target}: no pose to match by: {why}"));
        }
        Ok(Self::Geometric(pairs))
    }

    /// The name in arguments and documents.
    pub fn name(&self) -> &'static str {
        match self {
            Proposer::Geometric(_) => "geometric",
        }
    }

    /// How many pairs of lines were scored, and the matches among them.
    pub fn propose(
        &mut self,
        (target, source): (usize, usize),
        [target_sight, source_sight]: &[Sight<'_>; 2],
    ) -> (usize, Vec<Match>) {
        match self {
            Proposer::Geometric(pairs) => {
                let is_pair = |pair: &&PairEstimate| (pair.target, pair.source) == (target, source);
                let converged = pairs.iter().find(is_pair).filter(|pair| pair.state == State::Converged);
                let target_from_source = converged.and_then(|pair| pair.target_from_source);
                let same = target_from_source.map(|pose| SameEdges::new(target_sight, source_sight, &pose));
                let matches = same.map_or_else(Vec::new, |same| explained(&same));
                (matches.len(), matches)
            }
        }
    }
}
