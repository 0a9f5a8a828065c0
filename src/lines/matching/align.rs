//! Two cameras cut an edge differently: the pieces of two lines are compared at the shift along the edge that suits best.

use super::packed::{PackedLine, gap};
use crate::lines::describe::MAX_PIECES;

/// Least common part, as a share of the shorter line.
const MIN_COMMON: f32 = 0.5;
/// Most shifts tried.
const MAX_SHIFTS: usize = 24;
/// What a missing common part counts as, per share of the shorter line.
const MISSING_WEIGHT: f32 = 0.1;

/// How two lines compare at their best shift.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Alignment {
    /// Mean over the common pieces, 0 for the same looks.
    pub(super) gap: f32,
    /// Common part as a share of the shorter line, 0 to 1.
    pub(super) common: f32,
}

/// The best of all shifts; `None` where a line has no pieces or no length. The roles may be swapped.
pub(super) fn align(a: &PackedLine, b: &PackedLine) -> Option<Alignment> {
    let key = |line: &PackedLine| (line.piece_m, line.pieces().len());
    let (fine, coarse) = if key(b) < key(a) { (b, a) } else { (a, b) };
    let gaps = piece_gaps(fine, coarse);
    let [fine_m, coarse_m] = [fine, coarse].map(PackedLine::length_m);
    let short_m = fine_m.min(coarse_m);
    // From the fine line before the coarse one to behind it, as far as the least common part allows.
    let from_m = MIN_COMMON * short_m - coarse_m;
    let range_m = fine_m + coarse_m - 2.0 * MIN_COMMON * short_m;
    if fine.piece_m.is_nan() || fine.piece_m <= 0.0 || !range_m.is_finite() {
        return None;
    }
    let n_steps = ((range_m / fine.piece_m) as usize + 1).clamp(1, MAX_SHIFTS - 1);
    (0..=n_steps)
        .filter_map(|step| {
            let shift_m = from_m + range_m * step as f32 / n_steps as f32;
            at_shift(&gaps, (fine, coarse), shift_m)
        })
        .min_by(|a, b| cost(a).total_cmp(&cost(b)))
}

fn cost(alignment: &Alignment) -> f32 {
    alignment.gap + MISSING_WEIGHT * (1.0 - alignment.common)
}

type PieceGaps = [[f32; MAX_PIECES]; MAX_PIECES];

fn piece_gaps(fine: &PackedLine, coarse: &PackedLine) -> PieceGaps {
    let mut gaps = [[0.0; MAX_PIECES]; MAX_PIECES];
    for (row, a) in gaps.iter_mut().zip(fine.pieces()) {
        for (slot, b) in row.iter_mut().zip(coarse.pieces()) {
            *slot = gap(a, b);
        }
    }
    gaps
}

/// Each fine piece against the coarse piece in which its middle lies.
fn at_shift(gaps: &PieceGaps, (fine, coarse): (&PackedLine, &PackedLine), shift_m: f32) -> Option<Alignment> {
    let (mut sum, mut n) = (0.0, 0.0);
    let (step, n_coarse) = (fine.piece_m / coarse.piece_m, coarse.pieces().len());
    let mut at = 0.5 * step - shift_m / coarse.piece_m;
    for row in &gaps[..fine.pieces().len()] {
        if at >= 0.0 && (at as usize) < n_coarse {
            sum += row[at as usize];
            n += 1.0;
        }
        at += step;
    }
    let short_m = fine.length_m().min(coarse.length_m());
    (n > 0.0).then(|| Alignment { gap: sum / n, common: (n * fine.piece_m / short_m).min(1.0) })
}
