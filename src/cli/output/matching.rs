//! The document of `pelical match`.

use std::time::Duration;

use serde::Serialize;

use crate::capture::recording::Recording;
use crate::cli::args::MatchArgs;
use crate::cli::matching::score::{Match, Tally, most_shared};
use crate::cli::matching::{MatchedPair, MatchedSet};
use crate::geometry::{EdgeSide, LineObservation};
use crate::pipeline::FindTimes;

/// `pelical.match/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MatchDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// The recording's folder or first bag.
    pub recording: String,
    /// Who proposed matches.
    pub association: &'static str,
    /// Shorter segments were left out, px.
    pub min_length_px: f64,
    /// Of all sets together; null without ground truth, or without a match that can be judged.
    pub precision: Option<f64>,
    /// Of all sets together; null without ground truth, or without shared edges.
    pub recall: Option<f64>,
    /// Of all sets together.
    pub counts: Counts,
    /// Of all sets together.
    pub timing_ms: MatchTiming,
    /// One per frame set.
    pub sets: Vec<SetEntry>,
}

/// How many of what.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Counts {
    /// Images looked at.
    pub images: usize,
    /// Segments found.
    pub segments: usize,
    /// Of these, with depth.
    pub lifted: usize,
    /// Pairs of lines that were scored.
    pub candidates: usize,
    /// Matches.
    pub matches: usize,
    /// What the truth says of them; null without.
    pub truth: Option<Tally>,
}

/// Time, ms in total.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MatchTiming {
    /// Gray conversion and segments.
    pub detect: f64,
    /// Lifting and surface samples.
    pub lift: f64,
    /// Descriptors; 0 where nobody asked for them.
    pub describe: f64,
    /// From lines to matches.
    #[serde(rename = "match")]
    pub matching: f64,
}

/// One frame set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SetEntry {
    /// Index in the recording, from 0.
    pub set: usize,
    /// See [`MatchDocument::precision`].
    pub precision: Option<f64>,
    /// See [`MatchDocument::recall`].
    pub recall: Option<f64>,
    /// Of this set.
    pub counts: Counts,
    /// Of this set.
    pub timing_ms: MatchTiming,
    /// By camera.
    pub views: Vec<ViewEntry>,
    /// Every pair of cameras.
    pub pairs: Vec<PairEntry>,
}

/// What one camera saw.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ViewEntry {
    /// The camera's name.
    pub camera: String,
    /// Longest first; matches count them from 0.
    pub segments: Vec<SegmentEntry>,
}

/// One segment and its line.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SegmentEntry {
    /// x y of the start, x y of the end; the brighter side is on the right hand.
    pub px: [f64; 4],
    /// Length.
    pub length_px: f64,
    /// Standard deviation of each end across the segment.
    pub sigma_across_px: f64,
    /// The lifted line; null without depth.
    pub line: Option<LineEntry>,
}

/// A lifted line.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LineEntry {
    /// Both ends in the camera's frame.
    pub ends_m: [[f64; 3]; 2],
    /// Standard deviation of the depth z of each end.
    pub sigma_z_m: [f64; 2],
    /// Whose surface it is: left or right hand of the segment, or both.
    pub side: &'static str,
}

/// Matches between two cameras.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairEntry {
    /// Name of the target camera.
    pub target: String,
    /// Name of the source camera.
    pub source: String,
    /// See [`MatchDocument::precision`].
    pub precision: Option<f64>,
    /// See [`MatchDocument::recall`].
    pub recall: Option<f64>,
    /// Of this pair; images and segments are those of both cameras.
    pub counts: Counts,
    /// One-to-one.
    pub matches: Vec<MatchEntry>,
    /// The shared edges that were counted, as pairs of target and source segment; null without ground truth.
    pub shared: Option<Vec<[usize; 2]>>,
}

/// One match.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MatchEntry {
    /// Index of the target's segment.
    pub target: usize,
    /// Index of the source's segment.
    pub source: usize,
    /// Score; null where none was asked.
    pub nats: Option<f64>,
    /// Whether it is one edge; null without ground truth, or where that cannot be judged.
    #[serde(rename = "true")]
    pub is_true: Option<bool>,
}

impl MatchDocument {
    /// All sets together.
    pub fn new(args: &MatchArgs, association: &'static str, sets: Vec<SetEntry>) -> Self {
        let counts = sets.iter().fold(Counts::default(), |sum, set| sum.plus(&set.counts));
        let timing_ms = sets.iter().fold(MatchTiming::default(), |sum, set| MatchTiming {
            detect: sum.detect + set.timing_ms.detect,
            lift: sum.lift + set.timing_ms.lift,
            describe: sum.describe + set.timing_ms.describe,
            matching: sum.matching + set.timing_ms.matching,
        });
        Self {
            schema: "pelical.match/1",
            recording: args.recording.path().display().to_string(),
            association,
            min_length_px: args.min_length_px,
            precision: counts.precision(),
            recall: counts.recall(),
            counts,
            timing_ms,
            sets,
        }
    }
}

impl MatchTiming {
    fn new(find: &FindTimes, took: Duration) -> Self {
        let ms = |duration: Duration| duration.as_secs_f64() * 1e3;
        Self {
            detect: ms(find.gray + find.detect),
            lift: ms(find.lift),
            describe: ms(find.describe),
            matching: ms(took),
        }
    }
}

impl Counts {
    fn plus(&self, other: &Self) -> Self {
        let truths = [self.truth, other.truth].into_iter().flatten();
        Self {
            images: self.images + other.images,
            segments: self.segments + other.segments,
            lifted: self.lifted + other.lifted,
            candidates: self.candidates + other.candidates,
            matches: self.matches + other.matches,
            truth: truths.reduce(Tally::plus),
        }
    }

    /// See [`MatchDocument::precision`].
    pub fn precision(&self) -> Option<f64> {
        self.truth.and_then(|truth| truth.precision())
    }

    /// See [`MatchDocument::recall`].
    pub fn recall(&self) -> Option<f64> {
        self.truth.and_then(|truth| truth.recall())
    }
}

impl SetEntry {
    /// A set in the user's words.
    pub fn new(recording: &Recording, matched: &MatchedSet) -> Self {
        let name = |camera: usize| recording.cameras()[camera].name.clone();
        let lines = |camera: usize| matched.found[camera].view.lines.as_slice();
        let pairs: Vec<PairEntry> = matched
            .pairs
            .iter()
            .map(|pair| {
                let cameras = [pair.target, pair.source];
                pair_entry(pair, cameras.map(name), lines_of(&cameras.map(lines)))
            })
            .collect();
        let all: Vec<_> = (0..matched.found.len()).map(lines).collect();
        let none = Counts::default();
        let sum = pairs.iter().fold(none, |sum, pair| sum.plus(&pair.counts));
        let counts =
            Counts { candidates: sum.candidates, matches: sum.matches, truth: sum.truth, ..lines_of(&all) };
        Self {
            set: matched.set,
            precision: counts.precision(),
            recall: counts.recall(),
            counts,
            timing_ms: MatchTiming::new(&matched.find, matched.took),
            views: all
                .iter()
                .enumerate()
                .map(|(camera, lines)| ViewEntry {
                    camera: name(camera),
                    segments: lines.iter().map(SegmentEntry::from).collect(),
                })
                .collect(),
            pairs,
        }
    }
}

/// The counts of what single cameras saw.
fn lines_of(views: &[&[LineObservation]]) -> Counts {
    Counts {
        images: views.len(),
        segments: views.iter().map(|lines| lines.len()).sum(),
        lifted: views.iter().flat_map(|lines| lines.iter()).filter(|line| line.depth.is_some()).count(),
        ..Counts::default()
    }
}

fn pair_entry(pair: &MatchedPair, [target, source]: [String; 2], lines: Counts) -> PairEntry {
    let counts =
        Counts { candidates: pair.n_candidates, matches: pair.matches.len(), truth: pair.tally(), ..lines };
    let entry = |found: &Match| MatchEntry {
        target: found.target,
        source: found.source,
        nats: found.nats.filter(|nats| nats.is_finite()),
        is_true: pair.truth.as_ref().and_then(|truth| truth.of(found.target, found.source).is_true()),
    };
    let shared = pair.truth.as_ref().map(most_shared);
    PairEntry {
        target,
        source,
        precision: counts.precision(),
        recall: counts.recall(),
        counts,
        matches: pair.matches.iter().map(entry).collect(),
        shared: shared.map(|shared| shared.into_iter().map(|(target, source)| [target, source]).collect()),
    }
}

impl From<&LineObservation> for SegmentEntry {
    fn from(line: &LineObservation) -> Self {
        let segment = &line.segment;
        Self {
            px: [segment.start.x, segment.start.y, segment.end.x, segment.end.y],
            length_px: segment.length_px(),
            sigma_across_px: segment.sigma_across_px,
            line: line_entry(line),
        }
    }
}

fn line_entry(line: &LineObservation) -> Option<LineEntry> {
    let depth = line.depth?;
    let end_m = |end: usize| line.ends[end].at_inverse_depth(depth.inverse_depth_per_m[end]).coords.into();
    // z is 1 / inverse depth.
    let sigma_z_m =
        |end: usize| depth.covariance_per_m2[(end, end)].sqrt() / depth.inverse_depth_per_m[end].powi(2);
    let side = match depth.side {
        EdgeSide::Left => "left",
        EdgeSide::Right => "right",
        EdgeSide::Both => "both",
    };
    Some(LineEntry { ends_m: [end_m(0), end_m(1)], sigma_z_m: [sigma_z_m(0), sigma_z_m(1)], side })
}
