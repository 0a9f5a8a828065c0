//! From scores of pairs of lines to evidence in nats.

use super::scores::Scores;
use crate::geometry::ScoredMatch;

/// Pairs of lines below this score are not candidates.
const MIN_SCORE: f32 = 0.005;
/// Most nats one pair gets: appearance alone proves nothing.
const MAX_NATS: f64 = 6.0;

/// The candidates among all pairs with their evidence, by target line, then by source line.
pub(super) fn matches(scores: &Scores) -> Vec<ScoredMatch> {
    let (of_row, of_col) = scores.best();
    let mut matches = Vec::new();
    for (row, &target) in scores.target.iter().enumerate() {
        for (col, &source) in scores.source.iter().enumerate() {
            let score = scores.at(row, col);
            let is_mutual = score >= of_row[row] && score >= of_col[col];
            if score > MIN_SCORE {
                let nats =
                    f64::from(score / MIN_SCORE).ln().min(MAX_NATS) * if is_mutual { 1.0 } else { 0.5 };
                matches.push(ScoredMatch { target: target as u32, source: source as u32, nats });
            }
        }
    }
    matches
}
