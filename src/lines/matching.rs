//! Which lines of two images look alike, as candidates with a score: many-to-many, the best few of each line.
//!
//! The two pictures may differ in exposure and white balance: what they differ by is estimated from the lines that look
//! most alike without it, and taken out. How narrowly these agree on it also says whether the images overlap at all.
mod likeness;
mod tone;

use super::describe::LineDescriptor;
use crate::geometry::{LineObservation, ScoredMatch};
use likeness::unlikeness;
use tone::ToneShift;

/// Candidates kept per line, the best of each line of either image.
const CANDIDATES_PER_LINE: usize = 5;

/// The lines of one image and what they look like; parallel slices.
#[derive(Debug, Clone, Copy)]
pub struct LooksOf<'a> {
    /// The lines.
    pub lines: &'a [LineObservation],
    /// One descriptor per line.
    pub looks: &'a [LineDescriptor],
}

/// The likeliest candidates of each line with their log likelihood ratios, ordered by target and source index. Lines that
/// cannot be described have none. Swapped roles give the same scores.
pub fn score_lines(target: LooksOf<'_>, source: LooksOf<'_>) -> Vec<ScoredMatch> {
    let size = (target.looks.len(), source.looks.len());
    let Some(shift) = ToneShift::between(target.looks, source.looks) else { return Vec::new() };
    let table: Vec<f32> = target
        .looks
        .iter()
        .flat_map(|a| source.looks.iter().map(move |b| unlikeness(a, b, &shift)))
        .collect();
    let kept = best_of_each(&table, size);
    let mut matches = Vec::new();
    for (idx, unlikeness) in table.iter().enumerate().filter(|(idx, _)| kept[*idx]) {
        let nats = (6.0 - 18.0 * f64::from(*unlikeness)).clamp(-2.0, 4.0) * shift.trust();
        matches.push(ScoredMatch { target: (idx / size.1) as u32, source: (idx % size.1) as u32, nats });
    }
    matches
}

/// Marks the most alike of each row and each column.
fn best_of_each(table: &[f32], (rows, columns): (usize, usize)) -> Vec<bool> {
    let mut kept = vec![false; table.len()];
    let mut order: Vec<usize> = Vec::new();
    let mut mark = |entries: &mut dyn Iterator<Item = usize>| {
        order.clear();
        order.extend(entries.filter(|idx| table[*idx].is_finite()));
        order.sort_unstable_by(|a, b| table[*a].total_cmp(&table[*b]).then(a.cmp(b)));
        order.iter().take(CANDIDATES_PER_LINE).for_each(|idx| kept[*idx] = true);
    };
    (0..rows).for_each(|row| mark(&mut (row * columns..(row + 1) * columns)));
    (0..columns).for_each(|column| mark(&mut (column..rows * columns).step_by(columns)));
    kept
}
