//! Which lines of two images look alike, as candidates with a score: many-to-many, the best few of each line.
//!
//! The two pictures may differ in exposure and white balance: what they differ by is estimated from the lines that look
//! most alike without it, and taken out. What remains is turned into evidence: beside lines that could be mistaken for each
//! other a likeness says little, and in images that have nothing in common it says nothing.
mod align;
mod calibration;
mod likeness;
mod packed;
mod table;
mod tone;

use super::describe::LineDescriptor;
use crate::geometry::{LineObservation, ScoredMatch};
use calibration::{nats, trust};
use likeness::likenesses;
use tone::Tone;

/// From here on a pair of lines that are each other's best is more likely one edge than two, nats: of images of about a hundred
/// lines each that share half of them, one pair in two hundred is one edge.
pub const MATCH_NATS: f64 = 5.0;
/// Less is not worth listing, nats.
const MIN_NATS: f64 = 0.1;

/// The lines of one image and what they look like; parallel slices.
#[derive(Debug, Clone, Copy)]
pub struct LooksOf<'a> {
    /// The lines.
    pub lines: &'a [LineObservation],
    /// One descriptor per line.
    pub looks: &'a [LineDescriptor],
}

impl<'a> LooksOf<'a> {
    /// As many lines as there are descriptors for, or as many descriptors as there are lines.
    fn described(self) -> Self {
        let n = self.lines.len().min(self.looks.len());
        Self { lines: &self.lines[..n], looks: &self.looks[..n] }
    }
}

/// The likeliest candidates of each line with their log likelihood ratios, ordered by target and source index; a line of
/// either image has about ten. What says next to nothing is left out, so there are none where the images have nothing in common.
/// Swapped roles give the same scores. Lines without a descriptor have none.
pub fn score_lines(target: LooksOf<'_>, source: LooksOf<'_>) -> Vec<ScoredMatch> {
    let [target, source] = [target, source].map(|looks| looks.described());
    let Some(shift) = Tone::shift_between(target.looks, source.looks) else { return Vec::new() };
    let pairs = likenesses(target.looks, source.looks, &shift);
    let length_px = |looks: LooksOf<'_>, line: usize| looks.lines[line].segment.length_px();
    let nats: Vec<f64> = pairs
        .iter()
        .map(|pair| nats(pair, length_px(target, pair.target).min(length_px(source, pair.source))))
        .collect();
    let trust = trust(&nats, target.lines.len().min(source.lines.len()));
    let scored = pairs.iter().zip(nats).map(|(pair, nats)| ScoredMatch {
        target: pair.target as u32,
        source: pair.source as u32,
        nats: trust * nats,
    });
    scored.filter(|scored| scored.nats >= MIN_NATS).collect()
}
