//! The most voted point of many, exactly, without counting the votes of each: branch and bound over boxes of points.
//!
//! A candidate that does not reach the ball around a box votes for none of its points, one that reaches over all of the ball votes for
//! each: only the rest must be asked again further down. Boxes are opened in the order of what they can promise.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::ops::Range;

use nalgebra::Vector3;

use super::Tolerance;
use crate::solver::paper::translation_candidate::TranslationCandidate;

/// Boxes whose points times undecided candidates are fewer are counted out: dividing costs as much.
const MAX_COUNTED_OUT: usize = 1000;
/// Bounds are widened by this share of the lengths they are made of: far more than their rounding.
const ROUNDING: f64 = 1e-9;
/// The middle of so many coordinates is where a box is divided.
const N_SAMPLES: usize = 15;

/// A point that is voted on.
#[derive(Debug, Clone, Copy)]
pub struct Point {
    /// The point, m.
    pub at_m: Vector3<f64>,
    /// Its place in the order of all.
    pub place: u32,
}

/// Votes for a point; more is better, and among equals the earlier place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Promise {
    n_votes: usize,
    place: u32,
}

impl Ord for Promise {
    fn cmp(&self, other: &Self) -> Ordering {
        self.n_votes.cmp(&other.n_votes).then(other.place.cmp(&self.place))
    }
}

impl PartialOrd for Promise {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// Some of the points, next to each other in the list, and who may vote for them.
struct Node {
    /// No point of it can be better.
    promise: Promise,
    range: Range<usize>,
    low_m: Vector3<f64>,
    high_m: Vector3<f64>,
    /// Candidates that vote for every point.
    n_certain: usize,
    /// Candidates that vote for some, perhaps.
    undecided: Vec<u32>,
}

impl PartialEq for Node {
    fn eq(&self, other: &Self) -> bool {
        self.promise == other.promise
    }
}

impl Eq for Node {}

impl Ord for Node {
    fn cmp(&self, other: &Self) -> Ordering {
        self.promise.cmp(&other.promise)
    }
}

impl PartialOrd for Node {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// The first of the points with the most votes; `None` when none has any.
pub fn most_voted(
    points: Vec<Point>,
    candidates: &[TranslationCandidate],
    tolerance: Tolerance,
) -> Option<Vector3<f64>> {
    let mut search = Search { points, candidates, tolerance };
    let everyone: Vec<u32> = (0..candidates.len() as u32).collect();
    let mut best = Promise { n_votes: 0, place: u32::MAX };
    let mut open = BinaryHeap::new();
    open.extend(search.node(0..search.points.len(), 0, &everyone));
    while let Some(node) = open.pop() {
        if node.promise <= best {
            break;
        }
        let size = node.range.len();
        let halves =
            if size * node.undecided.len() <= MAX_COUNTED_OUT { None } else { search.divided(&node) };
        match halves {
            None => best = best.max(search.counted_out(&node)),
            Some(halves) => {
                for half in halves {
                    let half = search.node(half, node.n_certain, &node.undecided);
                    open.extend(half.filter(|half| half.promise > best));
                }
            }
        }
    }
    let point = search.points.iter().find(|point| best.n_votes > 0 && point.place == best.place);
    point.map(|point| point.at_m)
}

struct Search<'a> {
    points: Vec<Point>,
    candidates: &'a [TranslationCandidate],
    tolerance: Tolerance,
}

impl Search<'_> {
    /// The box around some points and what it promises; `None` without points.
    fn node(&self, range: Range<usize>, n_certain: usize, undecided: &[u32]) -> Option<Node> {
        let points = &self.points[range.clone()];
        let first = points.first()?;
        let (mut low_m, mut high_m, mut place) = (first.at_m, first.at_m, first.place);
        for point in points {
            for axis in 0..3 {
                // Comparisons, since `min` and `max` take three times as long to be right with NaN.
                let at_m = point.at_m[axis];
                low_m[axis] = if at_m < low_m[axis] { at_m } else { low_m[axis] };
                high_m[axis] = if at_m > high_m[axis] { at_m } else { high_m[axis] };
            }
            place = place.min(point.place);
        }
        let centre_m = (low_m + high_m) * 0.5;
        let radius_m = (high_m - low_m).norm() * 0.5;
        let mut node = Node {
            promise: Promise { n_votes: 0, place },
            range,
            low_m,
            high_m,
            n_certain,
            undecided: vec![0; undecided.len()],
        };
        let rounding_m = ROUNDING * (1.0 + centre_m.norm() + radius_m);
        let mut n_undecided = 0;
        for &index in undecided {
            let candidate = &self.candidates[index as usize];
            let (distance_m, reach_m, slope) = self.tolerance.around(candidate, &centre_m);
            let slack_m = radius_m * (1.0 + slope) + rounding_m;
            let is_certain = distance_m + slack_m < reach_m;
            let is_possible = distance_m - slack_m < reach_m;
            // Without branches, which would be mispredicted as often as not.
            node.n_certain += usize::from(is_certain);
            node.undecided[n_undecided] = index;
            n_undecided += usize::from(is_possible && !is_certain);
        }
        node.undecided.truncate(n_undecided);
        node.promise.n_votes = node.n_certain + node.undecided.len();
        Some(node)
    }

    /// Sorts the points of a box into two halves along its longest side; `None` where they cannot be told apart.
    fn divided(&mut self, node: &Node) -> Option<[Range<usize>; 2]> {
        let axis = (node.high_m - node.low_m).imax();
        let Range { start, end } = node.range;
        let mut samples: [f64; N_SAMPLES] =
            std::array::from_fn(|i| self.points[start + (end - start - 1) * i / (N_SAMPLES - 1)].at_m[axis]);
        samples.sort_by(f64::total_cmp);
        let mut middle = samples[N_SAMPLES / 2];
        if middle <= node.low_m[axis] {
            middle = 0.5 * (node.low_m[axis] + node.high_m[axis]);
        }
        let mut end_of_low = start;
        for i in start..end {
            // Without a branch, which would be mispredicted half the time.
            let is_low = self.points[i].at_m[axis] < middle;
            self.points.swap(i, end_of_low);
            end_of_low += usize::from(is_low);
        }
        (end_of_low > start && end_of_low < end).then_some([start..end_of_low, end_of_low..end])
    }

    /// The best point of a box.
    fn counted_out(&self, node: &Node) -> Promise {
        if node.undecided.is_empty() {
            return node.promise;
        }
        let count = |point: &Point| {
            let votes = |index: &&u32| self.tolerance.holds(&self.candidates[**index as usize], &point.at_m);
            let n_votes = node.n_certain + node.undecided.iter().filter(votes).count();
            Promise { n_votes, place: point.place }
        };
        self.points[node.range.clone()].iter().map(count).max().unwrap_or(node.promise)
    }
}
