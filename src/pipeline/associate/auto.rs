//! Two sources at once.

use std::collections::BTreeMap;

use super::{MatchSource, SeenLines};
use crate::geometry::{PairScores, ScoredMatch};

/// Takes of each candidate match what the source says that says more: both look at the same pixels, so that their sum would count
/// them twice.
pub struct Auto {
    sources: [Box<dyn MatchSource>; 2],
}

impl Auto {
    /// Of both.
    pub fn new(first: Box<dyn MatchSource>, second: Box<dyn MatchSource>) -> Self {
        Self { sources: [first, second] }
    }
}

impl MatchSource for Auto {
    fn score(&mut self, seen: &[Option<SeenLines<'_>>], keep_going: &dyn Fn() -> bool) -> Vec<PairScores> {
        let mut said: BTreeMap<(usize, usize), BTreeMap<(u32, u32), f64>> = BTreeMap::new();
        for source in &mut self.sources {
            for scores in source.score(seen, keep_going) {
                let of_pair = said.entry((scores.target, scores.source)).or_default();
                for found in scores.matches {
                    let nats = of_pair.entry((found.target, found.source)).or_insert(0.0);
                    if found.nats.abs() > nats.abs() {
                        *nats = found.nats;
                    }
                }
            }
        }
        let matches = |of_pair: BTreeMap<(u32, u32), f64>| {
            let entries = of_pair.into_iter();
            entries.map(|((target, source), nats)| ScoredMatch { target, source, nats }).collect()
        };
        said.into_iter()
            .map(|((target, source), of_pair)| PairScores { target, source, matches: matches(of_pair) })
            .collect()
    }

    fn complaint(&mut self) -> Option<String> {
        self.sources.iter_mut().find_map(|source| source.complaint())
    }
}
