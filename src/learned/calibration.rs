//! From scores of pairs of lines to evidence in nats.
//!
//! The constants are a logistic regression over pairs of lines of simulated and real recordings whose truth is known by geometry;
//! docs/models.md has predicted beside observed odds. Two facts shape it. The evidence of a pair grows with the logarithm of its
//! score. And where images do not overlap, networks find matches all the same, and are then wrong together (the same rack, one
//! bay further): how much any score counts therefore depends on how much was matched between the two images at all.

use super::scores::Scores;
use crate::geometry::ScoredMatch;

/// How the scores of one kind of matcher are read.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Calibration {
    /// Pairs of lines below this score are no candidates.
    pub(super) min_score: f32,
    /// Evidence of a mutual best pair with a score of 1, nats.
    pub(super) nats_at_one: f64,
    /// Evidence gained with the logarithm of the score.
    pub(super) nats_per_log_score: f64,
    /// Sum of what the mutual best pairs have above `min_score` at which evidence counts half.
    pub(super) half_overlap: f64,
}

/// Assignment summed over points, and probabilities: fitted to XFeat with LighterGlue.
pub(super) const ASSIGNED: Calibration =
    Calibration { min_score: 0.005, nats_at_one: 7.7, nats_per_log_score: 1.0, half_overlap: 2.0 };

/// Likeness of descriptors aligned along two lines: fitted to XFeat.
pub(super) const ALIGNED: Calibration =
    Calibration { min_score: 0.65, nats_at_one: 7.2, nats_per_log_score: 15.0, half_overlap: 1.5 };

/// Most nats one pair gets: appearance alone proves nothing.
const MAX_NATS: f64 = 6.0;
/// Evidence lost with the logarithm of the best score of either line over that of the pair.
const NATS_PER_LOG_RIVAL: f64 = 0.3;

/// The candidates among all pairs with their evidence, above 0, by target line, then by source line.
pub(super) fn matches(scores: &Scores, calibration: &Calibration) -> Vec<ScoredMatch> {
    let (of_row, of_col) = scores.best();
    let weight = overlap_weight(scores, (&of_row, &of_col), calibration);
    let mut matches = Vec::new();
    for (row, &target) in scores.target.iter().enumerate() {
        for (col, &source) in scores.source.iter().enumerate() {
            let score = scores.at(row, col);
            // A score that is no number is no candidate either.
            if score > calibration.min_score {
                let nats = weight * pair_nats(score, of_row[row].max(of_col[col]), calibration);
                matches.push(ScoredMatch { target: target as u32, source: source as u32, nats });
            }
        }
    }
    matches.retain(|found| found.nats > 0.0);
    matches
}

/// Evidence of one pair between images that overlap well.
fn pair_nats(score: f32, best: f32, calibration: &Calibration) -> f64 {
    let of_score = calibration.nats_per_log_score * f64::from(score).ln();
    let of_rivals = NATS_PER_LOG_RIVAL * f64::from(score / best).ln();
    (calibration.nats_at_one + of_score + of_rivals).clamp(0.0, MAX_NATS)
}

/// How much the scores of two images count, 0 to 1: by what was matched between them at all.
fn overlap_weight(scores: &Scores, (of_row, of_col): (&[f32], &[f32]), calibration: &Calibration) -> f64 {
    let mut overlap = 0.0;
    for (row, &best) in of_row.iter().enumerate() {
        for (col, &best_of_col) in of_col.iter().enumerate() {
            let score = scores.at(row, col);
            if score > calibration.min_score && score >= best && score >= best_of_col {
                overlap += f64::from(score - calibration.min_score);
            }
        }
    }
    let squared = overlap * overlap;
    squared / (squared + calibration.half_overlap * calibration.half_overlap)
}
