//! What stays when the memory is full: the lines and frame sets that cover most directions and places, not the newest.
//!
//! What a camera can see is cut into cells of direction and place. Lines of one cell tell much the same, so the weight of a cell
//! counts by its logarithm, and a frame set is worth what the sum over all cells would lose without it. What costs most for its
//! worth goes first. All is decided by the lines' own directions, places and standard deviations: an answer of the estimator would
//! make the memory depend on when it was asked.

use std::collections::BTreeMap;

use super::evidence::{EvidenceLimits, EvidenceLine, EvidenceSet};

/// A direction known to this, rad, counts half of a perfect one (1 degree: what a short line has).
const HALF_WEIGHT_SIGMA_RAD: f64 = 0.0175;
/// A place known to this, m, counts half of a perfect one.
const HALF_WEIGHT_SIGMA_M: f64 = 0.01;
/// A coordinate of a direction, divided by the largest, falls into one of three cells at these bounds, a third of the range each.
const DIRECTION_BOUND: f64 = 1.0 / 3.0;
/// Image columns and rows fall into three cells at these bounds on the plane z = 1: a third of a usual image each.
const PLACE_BOUND: f64 = 0.2;
/// Nearer lines and farther ones are cells of their own, m.
const NEAR_M: f64 = 1.5;
/// The candidates of a pair, with which the time of a solution grows, may be as many as in so many frame sets that are full of lines.
const MAX_FULL_SETS: usize = 20;

/// The weight that a frame set brings to each cell of each camera.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Coverage(BTreeMap<(usize, u32), f64>);

impl Coverage {
    /// Of the lines per camera.
    pub fn of<'a>(lines_by_camera: impl Iterator<Item = &'a [EvidenceLine]>) -> Self {
        let mut weights = BTreeMap::new();
        for (camera, lines) in lines_by_camera.enumerate() {
            for line in lines {
                *weights.entry((camera, cell(line))).or_insert(0.0) += weight(line);
            }
        }
        Self(weights)
    }

    /// What the sum over the logarithms of all cells loses without this part of it.
    fn worth_in(&self, total: &Coverage) -> f64 {
        let lost = self.0.iter().map(|(key, part)| {
            let whole = total.0.get(key).copied().unwrap_or(0.0).max(*part);
            ((1.0 + whole) / (1.0 + whole - part)).ln()
        });
        lost.sum()
    }

    fn add(&mut self, other: &Coverage) {
        for (key, part) in &other.0 {
            *self.0.entry(*key).or_insert(0.0) += part;
        }
    }
}

/// At most `max_lines` of a view, in their order: of each cell the most precise first, and of crowded cells fewer.
pub fn keep_best_lines(lines: &mut Vec<EvidenceLine>, max_lines: usize) {
    if lines.len() <= max_lines {
        return;
    }
    let mut order: Vec<(usize, u32, f64)> =
        lines.iter().enumerate().map(|(idx, line)| (idx, cell(line), weight(line))).collect();
    order.sort_by(|a, b| b.2.total_cmp(&a.2));
    let mut crowd: BTreeMap<u32, f64> = BTreeMap::new();
    for (_, cell, weight) in &mut order {
        let before = crowd.entry(*cell).or_insert(0.0);
        let gain = ((1.0 + *before + *weight) / (1.0 + *before)).ln();
        *before += *weight;
        *weight = gain;
    }
    order.sort_by(|a, b| b.2.total_cmp(&a.2));
    let mut is_kept = vec![false; lines.len()];
    order.iter().take(max_lines).for_each(|(idx, ..)| is_kept[*idx] = true);
    let mut is_kept = is_kept.into_iter();
    lines.retain(|_| is_kept.next() == Some(true));
}

/// Indices of the sets that must go so that the limits hold, in any order. A set goes only after those that repeat it: without it
/// they would not be known as repetitions.
pub fn superfluous(sets: &[EvidenceSet], limits: &EvidenceLimits) -> Vec<usize> {
    let mut kept: Vec<usize> = (0..sets.len()).collect();
    let mut gone = Vec::new();
    while let Some(excess) = excess(sets, &kept, limits) {
        let mut total = Coverage::default();
        kept.iter().for_each(|&idx| total.add(&sets[idx].coverage));
        let worth_of_its_cost = |idx: usize| sets[idx].coverage.worth_in(&total) / excess.cost(&sets[idx]);
        let is_free =
            |idx: usize| kept.iter().all(|&other| other == idx || !sets[other].is_repeat_of(&sets[idx]));
        let free = (0..kept.len()).filter(|&place| is_free(kept[place]));
        let costs: Vec<(usize, f64)> = free.map(|place| (place, worth_of_its_cost(kept[place]))).collect();
        let Some((place, _)) = costs.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)) else { break };
        gone.push(kept.remove(place));
    }
    gone
}

/// A limit that is exceeded.
enum Excess {
    Sets,
    /// Candidates of these two cameras.
    Candidates(usize, usize),
}

impl Excess {
    /// What a set takes of the limit.
    fn cost(&self, set: &EvidenceSet) -> f64 {
        match self {
            Excess::Sets => 1.0,
            Excess::Candidates(target, source) => (set.n_lines(*target) * set.n_lines(*source)) as f64,
        }
    }
}

fn excess(sets: &[EvidenceSet], kept: &[usize], limits: &EvidenceLimits) -> Option<Excess> {
    if kept.len() > limits.max_sets {
        return Some(Excess::Sets);
    }
    let max_candidates = MAX_FULL_SETS * limits.max_lines_per_view.pow(2);
    let n_cameras = sets.first().map_or(0, |set| set.views.len());
    let pairs = (0..n_cameras).flat_map(|target| (target + 1..n_cameras).map(move |source| (target, source)));
    let n_candidates = |target: usize, source: usize| -> usize {
        kept.iter().map(|&idx| sets[idx].n_lines(target) * sets[idx].n_lines(source)).sum()
    };
    pairs
        .map(|(target, source)| (n_candidates(target, source), Excess::Candidates(target, source)))
        .filter(|(n, _)| *n > max_candidates)
        .max_by_key(|(n, _)| *n)
        .map(|(_, excess)| excess)
}

/// What a line tells, at most 1: less when its direction or place is not well known.
fn weight(line: &EvidenceLine) -> f64 {
    let share = |ratio: f64| 1.0 / (1.0 + ratio * ratio);
    share(line.sigma_direction_rad / HALF_WEIGHT_SIGMA_RAD)
        * share(line.sigma_position_m / HALF_WEIGHT_SIGMA_M)
}

/// The cell of a line: 27 of direction (a line has no sense, so half a sphere), 9 of the image, 2 of depth.
fn cell(line: &EvidenceLine) -> u32 {
    let thirds = |value: f64, bound: f64| u32::from(value > -bound) + u32::from(value > bound);
    let direction = line.direction.into_inner();
    let axis = direction.iamax();
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let across = |other: usize| thirds(direction[other] / direction[axis], DIRECTION_BOUND);
    let middle_m = line.middle_m();
    let image = |coordinate_m: f64| thirds(coordinate_m / middle_m.z, PLACE_BOUND);
    let parts = [
        (axis as u32, 3),
        (across(u), 3),
        (across(v), 3),
        (image(middle_m.x), 3),
        (image(middle_m.y), 3),
        (u32::from(middle_m.z > NEAR_M), 2),
    ];
    parts.iter().fold(0, |cell, (part, size)| cell * size + part)
}
