//! `pelical match`: the lines of a recording's frame sets, which of them are matched, and how well where the truth is known.
//!
//! The truth judges matches; nothing that finds lines or matches sees it.

mod overlay;
mod propose;
pub mod same_edge;
pub mod score;
mod tracks;

use std::path::Path;
use std::time::{Duration, Instant};

use super::args::MatchArgs;
use super::error::CliError;
use super::output::matching::{MatchDocument, SetEntry};
use super::talk::say;
use super::{output, progress};
use crate::capture::RgbdFrame;
use crate::capture::recording::{GroundTruth, Recording};
use crate::geometry::motion::Motion;
use crate::pipeline::{FindTimes, FoundLines, Parts, PipelineOptions};
use crate::service::config;
use propose::{Proposal, Proposer};
use same_edge::{SameEdges, Sight};
use score::{Match, Tally};

/// Everything about one frame set.
#[derive(Debug)]
pub struct MatchedSet {
    /// Index of the set in the recording.
    pub set: usize,
    /// The frames, by camera.
    pub frames: Vec<RgbdFrame>,
    /// What was found in them.
    pub found: Vec<FoundLines>,
    /// Every pair of cameras.
    pub pairs: Vec<MatchedPair>,
    /// Time of finding lines, all cameras together.
    pub find: FindTimes,
    /// Time of proposing matches, all pairs together.
    pub took: Duration,
}

/// The matches between two cameras.
#[derive(Debug)]
pub struct MatchedPair {
    /// Index of the target camera.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
    /// Pairs of lines that were scored.
    pub n_candidates: usize,
    /// One-to-one.
    pub matches: Vec<Match>,
    /// What truly belongs together; `None` without ground truth.
    pub truth: Option<SameEdges>,
}

impl MatchedPair {
    /// How good the matches are; `None` without ground truth.
    pub fn tally(&self) -> Option<Tally> {
        self.truth.as_ref().map(|truth| Tally::new(&self.matches, truth))
    }
}

impl MatchedSet {
    /// What makes it worth looking at: matches, then edges that could have been matched.
    fn richness(&self) -> (usize, usize) {
        let shared = |pair: &MatchedPair| pair.tally().map_or(0, |tally| tally.shared);
        (self.pairs.iter().map(|pair| pair.matches.len()).sum(), self.pairs.iter().map(shared).sum())
    }
}

/// Matches the frame sets asked for, prints what was found, and draws one of them.
///
/// # Errors
/// When the config, the recording or an argument is not usable, or the picture cannot be written.
pub fn run(args: &MatchArgs) -> Result<(), CliError> {
    let mut options = config::load_or_default(args.config.as_deref())?.pipeline;
    if let Some(choice) = args.association {
        options.associate.association = choice.into();
    }
    let recording = args.recording.open()?;
    let sets = chosen_sets(&recording, args.set)?;
    let truth = recording.ground_truth()?;
    let mut proposer = Proposer::new(&recording, &options)?;
    // Not before: who calibrates first needs every line.
    options.detect.min_length_px = options.detect.min_length_px.max(args.min_length_px);
    let bar = progress::bar(Some(sets.len() as u64), "frame sets");
    let (mut entries, mut richest) = (Vec::new(), None::<MatchedSet>);
    for set in sets {
        let matched = match_set((&recording, set), &options, (&mut proposer, truth.as_ref()))?;
        entries.push(SetEntry::new(&recording, &matched));
        if richest.as_ref().is_none_or(|richest| matched.richness() > richest.richness()) {
            richest = Some(matched);
        }
        bar.inc(1);
    }
    bar.finish_and_clear();
    let document = MatchDocument::new(args, proposer.name(), entries);
    if let Some((file, drawn)) = args.overlay.as_ref().zip(richest) {
        draw(file, (&recording, &drawn), &document)?;
    }
    if args.output.json {
        output::print_json(&document)
    } else {
        output::print_text(&output::matching_text::text(&document))
    }
}

/// The frame sets to be shown; a rig of one camera has nothing to match.
fn chosen_sets(recording: &Recording, set: Option<usize>) -> Result<Vec<usize>, CliError> {
    let (n_cameras, n_sets) = (recording.cameras().len(), recording.frame_sets().len());
    let path = recording.path().display();
    if n_cameras < 2 {
        let what = format!("{path}: has one camera; lines are matched between two or more");
        return Err(CliError::BadInput(what));
    }
    match set {
        Some(set) if set >= n_sets => Err(CliError::BadInput(format!(
            "{path}: there is no frame set {set}; --set 0 to {} are there",
            n_sets - 1
        ))),
        Some(set) => Ok(vec![set]),
        None => Ok((0..n_sets).collect()),
    }
}

fn match_set(
    (recording, set): (&Recording, usize),
    options: &PipelineOptions,
    (proposer, truth): (&mut Proposer, Option<&GroundTruth>),
) -> Result<MatchedSet, CliError> {
    let mut finder = (Parts::new(options).line_finder)();
    let (mut frames, mut found, mut find) = (Vec::new(), Vec::new(), FindTimes::default());
    let stamps = recording.frame_sets().get(set).map_or(&[][..], Vec::as_slice);
    for (camera, (info, stamp)) in recording.cameras().iter().zip(stamps).enumerate() {
        let (mut frame, mut lines) = (RgbdFrame::default(), FoundLines::default());
        recording.read_frame(camera, *stamp, &mut frame)?;
        let times = finder.find(&frame, &info.camera, &mut lines);
        find += times;
        frames.push(frame);
        found.push(lines);
    }
    let cameras = recording.cameras().iter().zip(&found);
    let sights: Vec<Sight<'_>> =
        cameras.map(|(info, found)| Sight { camera: &info.camera, lines: &found.view.lines }).collect();
    let start = Instant::now();
    let proposals = proposer.propose(&sights, &found)?;
    let took = start.elapsed();
    let judged = |Proposal { target, source, n_candidates, matches }: Proposal| {
        let truth = truth.map(|truth| {
            let target_from_source = target_from_source(truth, (target, source));
            SameEdges::new(&sights[target], &sights[source], &target_from_source)
        });
        MatchedPair { target, source, n_candidates, matches, truth }
    };
    let pairs = proposals.into_iter().map(judged).collect();
    Ok(MatchedSet { set, frames, found, pairs, find, took })
}

/// Writes the picture of one frame set.
fn draw(
    file: &Path,
    (recording, matched): (&Recording, &MatchedSet),
    document: &MatchDocument,
) -> Result<(), CliError> {
    let title = output::matching_text::title(document, matched.set);
    let png = overlay::png(recording.cameras(), matched, &title);
    let png = png.map_err(|error| CliError::Failed(format!("{}: {error}", file.display())))?;
    std::fs::write(file, png).map_err(CliError::system(format!("cannot write {}", file.display())))?;
    say(format_args!("frame set {} is drawn in {}", matched.set, file.display()));
    Ok(())
}

fn target_from_source(truth: &GroundTruth, (target, source): (usize, usize)) -> Motion {
    truth.reference_from_camera[target].inverse() * truth.reference_from_camera[source]
}
