//! Matches of all pairs of cameras joined to edges, each seen by two or more cameras: what has one colour and one number in a picture.

use super::MatchedPair;
use super::score::most_shared;

/// What is known of an edge's matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Standing {
    /// Shared in truth, but not matched.
    Missed,
    /// Every match is right.
    Right,
    /// Nothing says whether it is right.
    Unjudged,
    /// A match is wrong.
    Wrong,
}

/// Lines that are said to be one edge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Track {
    /// Camera and line.
    pub members: Vec<(usize, usize)>,
    /// The worst of its matches.
    pub standing: Standing,
}

/// The matches as edges, in the order of the matches; after them what was missed.
pub fn tracks(pairs: &[MatchedPair]) -> Vec<Track> {
    let mut tracks: Vec<Track> = Vec::new();
    for pair in pairs {
        for found in &pair.matches {
            let is_true =
                pair.truth.as_ref().and_then(|truth| truth.of(found.target, found.source).is_true());
            let standing = match is_true {
                Some(true) => Standing::Right,
                Some(false) => Standing::Wrong,
                None => Standing::Unjudged,
            };
            join(&mut tracks, [(pair.target, found.target), (pair.source, found.source)], standing);
        }
    }
    let matched = tracks.clone();
    let is_matched = |member: &(usize, usize)| matched.iter().any(|track| track.members.contains(member));
    for pair in pairs {
        for (target, source) in pair.truth.as_ref().map_or_else(Vec::new, most_shared) {
            let members = [(pair.target, target), (pair.source, source)];
            if !members.iter().any(is_matched) {
                join(&mut tracks, members, Standing::Missed);
            }
        }
    }
    tracks
}

/// Adds a match to the edges, joining the two that it connects.
fn join(tracks: &mut Vec<Track>, members: [(usize, usize); 2], standing: Standing) {
    let place = |member| tracks.iter().position(|track| track.members.contains(&member));
    let [first, second] = members.map(place);
    match (first, second) {
        (None, None) => tracks.push(Track { members: members.to_vec(), standing }),
        (Some(at), None) => extend(&mut tracks[at], &members[1..], standing),
        (None, Some(at)) => extend(&mut tracks[at], &members[..1], standing),
        (Some(a), Some(b)) if a != b => {
            let gone = tracks.remove(a.max(b));
            extend(&mut tracks[a.min(b)], &gone.members, gone.standing.max(standing));
        }
        (Some(at), Some(_)) => extend(&mut tracks[at], &[], standing),
    }
}

fn extend(track: &mut Track, members: &[(usize, usize)], standing: Standing) {
    track.members.extend(members);
    track.standing = track.standing.max(standing);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::matching::score::Match;

    fn pair(target: usize, source: usize, lines: &[(usize, usize)]) -> MatchedPair {
        let matches = lines.iter().map(|&(target, source)| Match { target, source, nats: None }).collect();
        MatchedPair { target, source, n_candidates: lines.len(), matches, truth: None }
    }

    #[test]
    fn matches_that_share_a_line_are_one_edge() {
        let found =
            tracks(&[pair(0, 1, &[(4, 7), (5, 5)]), pair(0, 2, &[(4, 1)]), pair(1, 2, &[(5, 1), (8, 2)])]);
        let members: Vec<_> = found.iter().map(|track| track.members.as_slice()).collect();
        assert_eq!(members, [&[(0, 4), (1, 7), (2, 1), (0, 5), (1, 5)][..], &[(1, 8), (2, 2)]]);
        assert!(found.iter().all(|track| track.standing == Standing::Unjudged));
    }
}
