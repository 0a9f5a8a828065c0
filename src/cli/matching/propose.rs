//! Who proposes matches: a source that scores how alike lines look, or pure geometry, by the pose that the estimator finds on the
//! whole recording.

use super::same_edge::{SameEdges, Sight};
use super::score::{Match, explained, mutual_best};
use crate::capture::recording::Recording;
use crate::cli::error::CliError;
use crate::cli::talk::say;
use crate::geometry::PairScores;
use crate::pipeline::associate::{self, SeenLines};
use crate::pipeline::offline::{RecordedSets, run_offline};
use crate::pipeline::{Association, FoundLines, MatchSource, PipelineOptions};
use crate::solver::{PairEstimate, State};

/// Proposes matches between the cameras of a frame set.
pub enum Proposer {
    /// Lines that a converged pose explains.
    Geometric(Vec<PairEstimate>),
    /// Lines that look alike.
    Scored(Association, Box<dyn MatchSource>),
}

/// What is proposed between two cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct Proposal {
    /// Index of the target camera.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
    /// Pairs of lines that were scored.
    pub n_candidates: usize,
    /// One-to-one.
    pub matches: Vec<Match>,
}

impl Proposer {
    /// Gets ready: models are loaded; for `geometric` the recording is calibrated.
    ///
    /// # Errors
    /// When a frame cannot be read, or the learned matcher that is asked for cannot be had.
    pub fn new(recording: &Recording, options: &PipelineOptions) -> Result<Self, CliError> {
        let association = options.associate.association;
        if association == Association::Geometric {
            return Ok(Self::Geometric(converged_pairs(recording, options)?));
        }
        let mut proposer = Self::Scored(association, associate::source(&options.associate));
        proposer.listen()?;
        Ok(proposer)
    }

    /// The name in arguments and documents.
    pub fn name(&self) -> &'static str {
        match self {
            Proposer::Geometric(_) | Proposer::Scored(Association::Geometric, _) => "geometric",
            Proposer::Scored(Association::Auto, _) => "auto",
            Proposer::Scored(Association::Descriptor, _) => "descriptor",
            Proposer::Scored(Association::Onnx, _) => "onnx",
        }
    }

    /// The matches of every pair of cameras, in ascending order.
    ///
    /// # Errors
    /// When the learned matcher that is asked for fails.
    pub fn propose(&mut self, sights: &[Sight<'_>], found: &[FoundLines]) -> Result<Vec<Proposal>, CliError> {
        let mut proposals = Vec::new();
        let seen: Vec<_> = found.iter().map(|found| Some(SeenLines::new(&found.view, found))).collect();
        let scores = match self {
            Proposer::Geometric(_) => Vec::new(),
            Proposer::Scored(_, source) => source.score(&seen, &|| true),
        };
        self.listen()?;
        for target in 0..sights.len() {
            for source in target + 1..sights.len() {
                let (n_candidates, matches) = match self {
                    Proposer::Geometric(pairs) => by_pose(pairs, (target, source), sights),
                    Proposer::Scored(_, scorer) => {
                        by_score((&scores, scorer.least_nats()), (target, source), sights)
                    }
                };
                proposals.push(Proposal { target, source, n_candidates, matches });
            }
        }
        Ok(proposals)
    }

    /// Tells what has to be done without. The learned matcher is not done without where it alone is asked for.
    fn listen(&mut self) -> Result<(), CliError> {
        let Proposer::Scored(association, source) = self else { return Ok(()) };
        match source.complaint() {
            Some(complaint) if *association == Association::Onnx => Err(CliError::Failed(complaint)),
            Some(complaint) => {
                say(format_args!("pelical: {complaint}"));
                Ok(())
            }
            None => Ok(()),
        }
    }
}

/// The pairs of cameras whose pose the estimator is sure of; says why it is not of the others.
fn converged_pairs(recording: &Recording, options: &PipelineOptions) -> Result<Vec<PairEstimate>, CliError> {
    let mut sets = RecordedSets::new(recording);
    let rig = sets.rig();
    let mut pairs = run_offline(&mut sets, &rig, options, &mut |_| {})?.calibration.pairs;
    for pair in pairs.iter().filter(|pair| pair.state != State::Converged) {
        let (target, source) = (&rig[pair.target].name, &rig[pair.source].name);
        let why = pair.reason.as_ref().map_or("", |reason| reason.sentence.as_str());
        say(format_args!("{source} from {target}: no pose to match by: {why}"));
    }
    pairs.retain(|pair| pair.state == State::Converged);
    Ok(pairs)
}

fn by_pose(
    pairs: &[PairEstimate],
    (target, source): (usize, usize),
    sights: &[Sight<'_>],
) -> (usize, Vec<Match>) {
    let pair = pairs.iter().find(|pair| (pair.target, pair.source) == (target, source));
    let Some(target_from_source) = pair.and_then(|pair| pair.target_from_source) else {
        return (0, Vec::new());
    };
    let matches = explained(&SameEdges::new(&sights[target], &sights[source], &target_from_source));
    (matches.len(), matches)
}

fn by_score(
    (scores, least_nats): (&[PairScores], f64),
    (target, source): (usize, usize),
    sights: &[Sight<'_>],
) -> (usize, Vec<Match>) {
    let of_pair = scores.iter().find(|scores| (scores.target, scores.source) == (target, source));
    let candidates = of_pair.map_or(&[][..], |scores| &scores.matches);
    let n_lines = [target, source].map(|camera| sights[camera].lines.len());
    (candidates.len(), mutual_best((candidates, least_nats), n_lines))
}
