//! Which candidates count as matches, and how good they are: precision and recall.
//!
//! Matches are one-to-one, so what could have been found is counted one-to-one as well: an edge that one camera sees whole and the
//! other in two fragments can be matched once.

use serde::Serialize;

use super::same_edge::{SameEdge, SameEdges};
use crate::geometry::ScoredMatch;

/// One line of the target and one of the source that are said to be one edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// Index of the target line.
    pub target: usize,
    /// Index of the source line.
    pub source: usize,
    /// The score it was chosen by; `None` where no score was asked.
    pub nats: Option<f64>,
}

/// The matches among scored candidates: pairs of lines of which each is the other's best and that are likelier one edge than two.
///
/// A line could be any of the n lines of the other image, so that by chance alone the odds are 1 : n at best, and a score has to
/// make up for that: more than ln n nats, n being the larger number of lines, and no less than the source of the scores asks for. Of
/// equal scores the first in the list is the better.
pub fn mutual_best((candidates, least_nats): (&[ScoredMatch], f64), n_lines: [usize; 2]) -> Vec<Match> {
    let least_nats = (n_lines[0].max(n_lines[1]).max(1) as f64).ln().max(least_nats);
    let best = |is_rival: &dyn Fn(&ScoredMatch) -> bool| {
        let rivals = candidates.iter().enumerate().filter(|(_, rival)| is_rival(rival));
        rivals.reduce(|best, rival| if rival.1.nats > best.1.nats { rival } else { best }).map(|(at, _)| at)
    };
    let is_best = |at: usize, candidate: &ScoredMatch| {
        candidate.nats > least_nats
            && best(&|rival| rival.target == candidate.target) == Some(at)
            && best(&|rival| rival.source == candidate.source) == Some(at)
    };
    let chosen = candidates.iter().enumerate().filter(|(at, candidate)| is_best(*at, candidate));
    chosen
        .map(|(_, candidate)| Match {
            target: candidate.target as usize,
            source: candidate.source as usize,
            nats: Some(candidate.nats),
        })
        .collect()
}

/// The lines that a pose explains, one-to-one: those with the longest part in common first, then those that continue each other.
pub fn explained(same: &SameEdges) -> Vec<Match> {
    let length = |same: SameEdge| match same {
        SameEdge::Shared { overlap_px } => Some(overlap_px),
        SameEdge::Continued => Some(0.0),
        SameEdge::No | SameEdge::Unknown => None,
    };
    let mut pairs: Vec<_> =
        same.pairs().filter_map(|(target, source, same)| Some((length(same)?, target, source))).collect();
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut matches: Vec<Match> = Vec::new();
    for (_, target, source) in pairs {
        if matches.iter().all(|other| other.target != target && other.source != source) {
            matches.push(Match { target, source, nats: None });
        }
    }
    matches
}

/// What there was to find and what was found; sums over frame sets and pairs of cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Tally {
    /// Most pairs of lines, one-to-one, of which both cameras see a part of one edge.
    pub shared: usize,
    /// Matches of such pairs.
    pub shared_found: usize,
    /// Matches of one edge.
    pub right: usize,
    /// Matches of two edges.
    pub wrong: usize,
    /// Matches that geometry cannot judge: too little depth.
    pub unjudged: usize,
}

impl Tally {
    /// Judges one-to-one matches by geometry.
    pub fn new(matches: &[Match], same: &SameEdges) -> Self {
        let judged = || matches.iter().map(|found| same.of(found.target, found.source));
        let count = |is: Option<bool>| judged().filter(|same| same.is_true() == is).count();
        Self {
            shared: most_shared(same).len(),
            shared_found: judged().filter(|same| same.is_shared()).count(),
            right: count(Some(true)),
            wrong: count(Some(false)),
            unjudged: count(None),
        }
    }

    /// Both together.
    pub fn plus(self, other: Self) -> Self {
        Self {
            shared: self.shared + other.shared,
            shared_found: self.shared_found + other.shared_found,
            right: self.right + other.right,
            wrong: self.wrong + other.wrong,
            unjudged: self.unjudged + other.unjudged,
        }
    }

    /// Share of the matches that are right, of those that can be judged; `None` without any.
    pub fn precision(&self) -> Option<f64> {
        ratio(self.right, self.right + self.wrong)
    }

    /// Share of the shared edges that were found; `None` without any.
    pub fn recall(&self) -> Option<f64> {
        ratio(self.shared_found, self.shared)
    }
}

fn ratio(part: usize, whole: usize) -> Option<f64> {
    (whole > 0).then(|| part as f64 / whole as f64)
}

/// A largest set of shared pairs in which every line stands at most once, as target and source: augmenting paths.
pub fn most_shared(same: &SameEdges) -> Vec<(usize, usize)> {
    let mut sources_of: Vec<Vec<usize>> = Vec::new();
    let mut n_sources = 0;
    for (target, source, _) in same.pairs().filter(|(.., same)| same.is_shared()) {
        sources_of.resize_with(sources_of.len().max(target + 1), Vec::new);
        sources_of[target].push(source);
        n_sources = n_sources.max(source + 1);
    }
    let mut target_of = vec![None; n_sources];
    for target in 0..sources_of.len() {
        place(target, &sources_of, (&mut target_of, &mut vec![false; n_sources]));
    }
    let placed = target_of.iter().enumerate();
    placed.filter_map(|(source, target)| target.map(|target| (target, source))).collect()
}

/// Finds a source for a target, moving others to their other sources; each source is asked once. As deep as there are fragments.
fn place(
    target: usize,
    sources_of: &[Vec<usize>],
    (target_of, is_asked): (&mut Vec<Option<usize>>, &mut Vec<bool>),
) -> bool {
    for &source in &sources_of[target] {
        if std::mem::replace(&mut is_asked[source], true) {
            continue;
        }
        let is_free = target_of[source].is_none_or(|other| place(other, sources_of, (target_of, is_asked)));
        if is_free {
            target_of[source] = Some(target);
            return true;
        }
    }
    false
}

#[cfg(test)]
mod tests;
