//! Scores by the descriptors that the line stage made.

use super::{MatchSource, SeenLines, pairs};
use crate::geometry::PairScores;
use crate::lines::matching::MATCH_NATS;
use crate::lines::{LooksOf, score_lines};

/// Compares descriptors.
#[derive(Debug, Clone, Copy, Default)]
pub struct Descriptors;

impl MatchSource for Descriptors {
    fn score(&mut self, seen: &[Option<SeenLines<'_>>], keep_going: &dyn Fn() -> bool) -> Vec<PairScores> {
        let looks = |seen: &SeenLines<'_>| (seen.lines.len() == seen.looks.len()).then_some(());
        let scores = pairs(seen).take_while(|_| keep_going()).filter_map(|((target, a), (source, b))| {
            looks(a).and(looks(b))?;
            let [a, b] = [a, b].map(|seen| LooksOf { lines: seen.lines, looks: seen.looks });
            Some(PairScores { target, source, matches: score_lines(a, b) })
        });
        scores.collect()
    }

    fn least_nats(&self) -> f64 {
        MATCH_NATS
    }
}
