//! Without an attention matcher: the descriptors along two lines are aligned in their order by dynamic programming (Needleman and
//! Wunsch, as SOLD2 does it, arXiv 2104.03362), in both directions, since the brighter side may differ between two views.

use super::model::Model;
use super::scores::Scores;
use super::{FOREIGN, LearnedError, Sampled};

/// Likeness of two points below which it costs more to align them than to skip one.
const GAP: f32 = 0.1;

/// The aligned likeness per point of the shorter line, less what a gap costs, for every pair of lines.
///
/// # Errors
/// When the features are of another matcher.
pub(super) fn score(
    dense: &Model,
    target: &Sampled<'_>,
    source: &Sampled<'_>,
) -> Result<Scores, LearnedError> {
    let (in_target, in_source) = (&target.samples, &source.samples);
    let (map, source_map) = (target.features.map(dense)?, source.features.map(dense)?);
    if map.len != source_map.len {
        return Err(dense.failure(FOREIGN.to_owned()));
    }
    let (of_target, of_source) = (in_target.descriptors(map), in_source.descriptors(source_map));
    let mut likeness = Vec::new();
    let score = |row: usize, col: usize| {
        let (points, others) = (in_target.of_line[row].clone(), in_source.of_line[col].clone());
        let (a, b) =
            (points.start * map.len..points.end * map.len, others.start * map.len..others.end * map.len);
        likeness.clear();
        for a in of_target[a].chunks_exact(map.len) {
            let products = of_source[b.clone()].chunks_exact(map.len);
            likeness.extend(products.map(|b| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>()));
        }
        let there = aligned(&likeness, others.len(), |row, col| row + col);
        let last = others.len() - 1;
        let back = aligned(&likeness, others.len(), |row, col| row + (last - col));
        there.max(back) / points.len().min(others.len()) as f32
    };
    Ok(Scores::new(in_target.lines.clone(), in_source.lines.clone(), score))
}

/// Largest sum of likenesses less [`GAP`] along a path that keeps the order; `at` tells the place of a row's start and a column.
fn aligned(likeness: &[f32], n_cols: usize, at: impl Fn(usize, usize) -> usize) -> f32 {
    let (mut above, mut best) = (vec![0.0_f32; n_cols + 1], vec![0.0_f32; n_cols + 1]);
    for start in (0..likeness.len()).step_by(n_cols) {
        for col in 0..n_cols {
            let matched = above[col] + likeness[at(start, col)] - GAP;
            best[col + 1] = matched.max(above[col + 1]).max(best[col]);
        }
        std::mem::swap(&mut above, &mut best);
    }
    above[n_cols]
}
