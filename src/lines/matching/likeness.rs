//! How unlike the lines of two images are, in itself and beside the lines that could be mistaken for them.

use super::align::align;
use super::packed::{PackedLine, gap};
use super::table::{LeastTwo, Table};
use super::tone::Tone;
use crate::lines::describe::LineDescriptor;

/// Pairs of a line that are compared piece by piece.
const SHORTLISTED_PER_LINE: usize = 6;
/// Weights of the looks over the whole length, of the pieces at the best shift, and of the shorter line's part that has no
/// counterpart. From a logistic fit over synthetic rooms (116 k pairs, 4 % of them shared edges).
const WHOLE_WEIGHT: f32 = 0.56;
const PIECES_WEIGHT: f32 = 0.44;
const MISSING_WEIGHT: f32 = 0.19;

/// One pair of lines.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Likeness {
    pub(super) target: usize,
    pub(super) source: usize,
    /// How unlike they are; 0 for the same looks, about 0.5 for two lines taken at random.
    pub(super) gap: f32,
    /// The least of the same between each of the two and another line of the other image.
    pub(super) rival_gap: f32,
    /// The least between each of the two and another line of its own image.
    pub(super) own_gap: f32,
}

/// The most alike pairs of two images whose tones differ by `shift`.
pub(super) fn likenesses(
    target: &[LineDescriptor],
    source: &[LineDescriptor],
    shift: &Tone,
) -> Vec<Likeness> {
    // Half each, so that swapped roles do the same sums.
    let target: Vec<_> = target.iter().map(|look| PackedLine::of(look, &shift.scaled(0.5))).collect();
    let source: Vec<_> = source.iter().map(|look| PackedLine::of(look, &shift.scaled(-0.5))).collect();
    let whole = whole_gaps(&target, &source);
    let pairs = whole.shortlist(SHORTLISTED_PER_LINE);
    let gaps: Vec<f32> =
        pairs.iter().map(|&(t, s)| full_gap(whole.at(t, s), &target[t], &source[s])).collect();
    let rows = leasts(target.len(), pairs.iter().map(|pair| pair.0).zip(gaps.iter().copied()));
    let columns = leasts(source.len(), pairs.iter().map(|pair| pair.1).zip(gaps.iter().copied()));
    let [own_target, own_source] = [&target, &source].map(|lines| own_gaps(lines));
    let listed = pairs.iter().zip(gaps).enumerate();
    listed
        .map(|(idx, (&(target, source), gap))| Likeness {
            target,
            source,
            gap,
            rival_gap: rows[target].other_than(idx).min(columns[source].other_than(idx)),
            own_gap: own_target[target].min(own_source[source]),
        })
        .collect()
}

fn whole_gaps(a: &[PackedLine], b: &[PackedLine]) -> Table {
    Table::new((a.len(), b.len()), |i, j| whole_gap(&a[i], &b[j]))
}

fn whole_gap(a: &PackedLine, b: &PackedLine) -> f32 {
    let are_described = !a.pieces().is_empty() && !b.pieces().is_empty();
    if are_described { gap(&a.whole, &b.whole) } else { f32::INFINITY }
}

fn full_gap(whole: f32, a: &PackedLine, b: &PackedLine) -> f32 {
    align(a, b).map_or(f32::INFINITY, |pieces| {
        WHOLE_WEIGHT * whole + PIECES_WEIGHT * pieces.gap + MISSING_WEIGHT * (1.0 - pieces.common)
    })
}

/// The least two entries per line; their place is the number of the entry.
fn leasts(n_lines: usize, entries: impl Iterator<Item = (usize, f32)>) -> Vec<LeastTwo> {
    let mut leasts = vec![LeastTwo::default(); n_lines];
    for (at, (line, gap)) in entries.enumerate() {
        leasts[line].take(at, gap);
    }
    leasts
}

/// For each line the least gap to another line of its image.
fn own_gaps(lines: &[PackedLine]) -> Vec<f32> {
    let mut leasts = vec![f32::INFINITY; lines.len()];
    for (i, a) in lines.iter().enumerate() {
        for (j, b) in lines.iter().enumerate().take(i) {
            let gap = whole_gap(a, b);
            leasts[i] = leasts[i].min(gap);
            leasts[j] = leasts[j].min(gap);
        }
    }
    leasts
}
