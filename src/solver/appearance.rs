//! What appearance says of the lines that are kept: scores by their indices, and the bounds within which they are believed.

use super::evidence::EvidenceView;
use crate::geometry::{PairScores, ScoredMatch};

/// No likeness of a single match is believed further, nats: twenty times likelier than by chance ...
const MAX_NATS: f64 = 3.0;
/// ... and no unlikeness further than this: light and viewpoint change more than any matcher was shown.
const MIN_NATS: f64 = -1.0;

/// Scores of the kept lines by their indices in `views`, sorted by source and target, each pair once; `None` where nothing is left.
/// Scores are given by the lines of the views as delivered. What is no number, or of no line, is left out.
pub fn in_kept_lines(scores: &PairScores, views: &[Option<EvidenceView>]) -> Option<PairScores> {
    let kept = |camera: usize| -> Option<Vec<Option<u32>>> {
        let lines = &views.get(camera)?.as_ref()?.lines;
        let n_in_view = lines.iter().map(|line| line.in_view as usize + 1).max()?;
        let mut places = vec![None; n_in_view];
        (0..).zip(lines).for_each(|(at, line)| places[line.in_view as usize] = Some(at));
        Some(places)
    };
    let (targets, sources) = (kept(scores.target)?, kept(scores.source)?);
    let place = |places: &[Option<u32>], in_view: u32| places.get(in_view as usize).copied().flatten();
    let mut matches: Vec<ScoredMatch> = scores
        .matches
        .iter()
        .filter(|found| found.nats.is_finite())
        .filter_map(|found| {
            Some(ScoredMatch {
                target: place(&targets, found.target)?,
                source: place(&sources, found.source)?,
                nats: found.nats,
            })
        })
        .collect();
    matches.sort_by_key(|found| (found.source, found.target));
    matches.dedup_by_key(|found| (found.source, found.target));
    (!matches.is_empty()).then_some(PairScores { target: scores.target, source: scores.source, matches })
}

/// What is said of two kept lines within its bounds, nats; 0 where nothing is.
pub fn nats_of(scores: &[ScoredMatch], (target, source): (usize, usize)) -> f64 {
    let key = (source, target);
    let place =
        scores.binary_search_by_key(&key, |found| (found.source as usize, found.target as usize)).ok();
    place.map_or(0.0, |place| scores[place].nats.clamp(MIN_NATS, MAX_NATS))
}
