//! How much each match of a rig counts when several pairs match the same line.
//!
//! Three cameras that see one line give three matches, but only two are independent: the third follows from the others. Counted
//! in full, a rig of n cameras would believe itself n/2 times as well informed as it is. Where all of n cameras match one line, the
//! sum over all pairs with weight 2/n is, for equal noise, the sum of squares about the common line: the maximum-likelihood cost.

use std::collections::BTreeMap;

use super::candidates::Candidate;

/// The matches of a pair.
pub struct PairMatches<'a> {
    /// Index of the target camera, then of the source.
    pub cameras: [usize; 2],
    /// All candidates of the pair.
    pub candidates: &'a [Candidate],
    /// Those that match (indices).
    pub matches: &'a [usize],
}

/// A line as one camera saw it: set, camera, line.
type Seen = (u32, usize, u16);

/// Lines that matches connect, joined to one.
#[derive(Default)]
struct Groups {
    of: BTreeMap<Seen, usize>,
    parents: Vec<usize>,
}

impl Groups {
    fn root(&self, mut group: usize) -> usize {
        while self.parents[group] != group {
            group = self.parents[group];
        }
        group
    }

    fn group(&mut self, seen: Seen) -> usize {
        let next = self.parents.len();
        let group = *self.of.entry(seen).or_insert(next);
        if group == next {
            self.parents.push(next);
        }
        self.root(group)
    }

    fn join(&mut self, [a, b]: [Seen; 2]) {
        let (a, b) = (self.group(a), self.group(b));
        self.parents[a.max(b)] = a.min(b);
    }

    /// Lines of each group.
    fn sizes(&self) -> Vec<usize> {
        let mut sizes = vec![0; self.parents.len()];
        self.of.values().for_each(|&group| sizes[self.root(group)] += 1);
        sizes
    }
}

/// Weight of every match of every pair: independent comparisons among the cameras that share its line, divided by the matches of
/// that line; at most 1.
pub fn weights(pairs: &[PairMatches<'_>]) -> Vec<Vec<f64>> {
    let ends = |pair: &PairMatches<'_>, candidate: usize| {
        let Candidate { set, target, source, .. } = pair.candidates[candidate];
        [(set, pair.cameras[0], target), (set, pair.cameras[1], source)]
    };
    let mut groups = Groups::default();
    for pair in pairs {
        pair.matches.iter().for_each(|&found| groups.join(ends(pair, found)));
    }
    let n_lines = groups.sizes();
    let roots: Vec<Vec<usize>> = pairs
        .iter()
        .map(|pair| pair.matches.iter().map(|&found| groups.group(ends(pair, found)[0])).collect())
        .collect();
    let mut n_matches = vec![0_usize; n_lines.len()];
    roots.iter().flatten().for_each(|&group| n_matches[group] += 1);
    let weight = |&group: &usize| (n_lines[group] - 1) as f64 / n_matches[group] as f64;
    roots.iter().map(|roots| roots.iter().map(weight).collect()).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    fn candidate(target: u16, source: u16) -> Candidate {
        Candidate {
            set: 0,
            target,
            source,
            weight: 1.0,
            target_direction: Vector3::x(),
            source_direction: Vector3::x(),
            target_middle_m: Vector3::z(),
            source_middle_m: Vector3::z(),
            sigma_angle_rad: 0.01,
            sigma_position_m: 0.01,
            nats: 0.0,
        }
    }

    #[test]
    fn a_line_of_three_cameras_is_two_comparisons_and_one_of_two_is_one() {
        let candidates = [candidate(4, 7), candidate(5, 8), candidate(7, 9), candidate(4, 9)];
        let pair = |cameras, matches| PairMatches { cameras, candidates: &candidates, matches };
        let found = weights(&[pair([0, 1], &[0, 1]), pair([1, 2], &[2]), pair([0, 2], &[3])]);
        let third = 2.0 / 3.0;
        assert_eq!(found, [vec![third, 1.0], vec![third], vec![third]]);
    }

    #[test]
    fn matches_in_a_chain_are_all_independent() {
        let candidates = [candidate(1, 1)];
        let pair = |cameras| PairMatches { cameras, candidates: &candidates, matches: &[0] };
        assert_eq!(weights(&[pair([0, 1]), pair([1, 2]), pair([2, 3])]), [[1.0]; 3]);
    }
}
