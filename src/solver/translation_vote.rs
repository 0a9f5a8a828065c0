//! Convergence voting for a given rotation (paper, Algorithm 1, eq. 14 corrected).
//!
//! With the rotation known, a match leaves a line of translations `t = (p_t - R p_s) + k a`, `a = R d_s`. The point where most
//! lines meet is searched in a grid instead of over all pairs of lines: linear in the candidates, whatever their number.

use nalgebra::{UnitQuaternion, Vector3};

use super::candidates::Candidate;

/// Widest angle between both directions after rotation, rad.
const MAX_ANGLE_RAD: f64 = 0.06;
/// Matches whose observed parts lie further apart along the line than this are left out, m.
const MAX_GAP_M: f64 = 4.0;

/// How exactly translations are looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blur {
    /// Edge of a cell of the grid, m.
    pub cell_m: f64,
    /// Tolerance of the quick score, m: the cell, and the rotation's error at arm's length ...
    pub translation_m: f64,
    /// ... growing with the distance along the line, rad.
    pub rotation_rad: f64,
}

/// For rotations that may be off by 1.5 degrees: 5 cm at 2 m.
pub const COARSE: Blur = Blur { cell_m: 0.05, translation_m: 0.035, rotation_rad: 0.015 };
/// For the leading rotations, which many directions fix to a few tenths of a degree.
pub const FINE: Blur = Blur { cell_m: 0.025, translation_m: 0.018, rotation_rad: 0.004 };

/// A match under a given rotation: the line of translations it allows.
#[derive(Debug, Clone, Copy)]
pub struct TranslationLine {
    /// Index into the candidates.
    pub candidate: usize,
    /// A translation on the line: the one that brings both middles together, m.
    pub point_m: Vector3<f64>,
    /// Unit direction of the line.
    pub direction: Vector3<f64>,
    /// Whether both lines run the same way, each with its brighter side on the right.
    pub is_same_way: bool,
    /// Standard deviation across the line at `point_m`, m.
    pub sigma_position_m: f64,
    /// Growth of that deviation per metre along the line.
    pub sigma_angle_rad: f64,
}

impl TranslationLine {
    /// Distance of a translation from the line, and the distance along it from `point_m`, both m.
    pub fn distance_and_gap_m(&self, translation_m: &Vector3<f64>) -> (f64, f64) {
        let offset = translation_m - self.point_m;
        let gap = offset.dot(&self.direction);
        ((offset - self.direction * gap).norm(), gap.abs())
    }

    /// Standard deviation across the line at a distance along it, m.
    pub fn sigma_m(&self, gap_m: f64) -> f64 {
        // Not `hypot`: this is the innermost loop, and nothing here can overflow.
        let growth_m = self.sigma_angle_rad * gap_m;
        (self.sigma_position_m * self.sigma_position_m + growth_m * growth_m).sqrt()
    }
}

/// The translation lines of all candidates whose directions the rotation aligns.
pub fn translation_lines(
    candidates: &[Candidate],
    target_from_source: &UnitQuaternion<f64>,
) -> Vec<TranslationLine> {
    let rotation = target_from_source.to_rotation_matrix();
    let mut lines = Vec::new();
    for (idx, candidate) in candidates.iter().enumerate() {
        let direction = rotation * candidate.source_direction;
        let sine = direction.cross(&candidate.target_direction).norm();
        if sine > MAX_ANGLE_RAD.min(0.02 + 3.0 * candidate.sigma_angle_rad) {
            continue;
        }
        lines.push(TranslationLine {
            candidate: idx,
            point_m: candidate.target_middle_m - rotation * candidate.source_middle_m,
            direction,
            is_same_way: direction.dot(&candidate.target_direction) > 0.0,
            sigma_position_m: candidate.sigma_position_m,
            sigma_angle_rad: candidate.sigma_angle_rad,
        });
    }
    lines
}

/// The grid over translations, reused from rotation to rotation.
#[derive(Debug)]
pub struct TranslationGrid {
    cell_m: f64,
    half_cells: i64,
    votes: Vec<f32>,
    /// The last source line that voted for a cell, so that each votes once.
    last_voter: Vec<u32>,
}

impl TranslationGrid {
    /// A grid of cells of `cell_m` for baselines up to `max_baseline_m`.
    pub fn new(max_baseline_m: f64, cell_m: f64) -> Self {
        let half_cells = (max_baseline_m / cell_m).ceil() as i64;
        let n_cells = (2 * half_cells + 1).pow(3) as usize;
        Self { cell_m, half_cells, votes: vec![0.0; n_cells], last_voter: vec![u32::MAX; n_cells] }
    }

    /// The translations with most votes, m, best first, at most `max_peaks`.
    pub fn peaks(
        &mut self,
        candidates: &[Candidate],
        lines: &[TranslationLine],
        max_peaks: usize,
    ) -> Vec<Vector3<f64>> {
        self.votes.fill(0.0);
        self.last_voter.fill(u32::MAX);
        let mut voter = 0;
        let mut last = None;
        for line in lines {
            let candidate = &candidates[line.candidate];
            let source = (candidate.set, candidate.source);
            if last.is_some_and(|last| last != source) {
                voter += 1;
            }
            last = Some(source);
            self.draw(line, voter);
        }
        self.strongest(max_peaks)
    }

    /// Adds a line's vote to the cells along it, and to their neighbours across it.
    fn draw(&mut self, line: &TranslationLine, voter: u32) {
        let axis = line.direction.iamax();
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let slope = line.direction / line.direction[axis];
        for i in -self.half_cells..=self.half_cells {
            let along_m = i as f64 * self.cell_m - line.point_m[axis];
            let gap_m = along_m * slope.norm();
            if gap_m.abs() > MAX_GAP_M {
                continue;
            }
            // A line known to 1 cm says more than one known to 10 cm.
            let weight = (self.cell_m / (0.4 * self.cell_m + line.sigma_m(gap_m))) as f32;
            let place_u = (line.point_m[u] + along_m * slope[u]) / self.cell_m;
            let place_v = (line.point_m[v] + along_m * slope[v]) / self.cell_m;
            let (floor_u, floor_v) = (place_u.floor(), place_v.floor());
            for (du, dv) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let mut cell = [0_i64; 3];
                cell[axis] = i;
                cell[u] = (floor_u + du) as i64;
                cell[v] = (floor_v + dv) as i64;
                self.vote(cell, weight.min(2.0), voter);
            }
        }
    }

    fn vote(&mut self, cell: [i64; 3], weight: f32, voter: u32) {
        let Some(index) = self.index(cell) else { return };
        if self.last_voter[index] != voter {
            self.last_voter[index] = voter;
            self.votes[index] += weight;
        }
    }

    fn index(&self, cell: [i64; 3]) -> Option<usize> {
        let side = 2 * self.half_cells + 1;
        let mut index = 0;
        for place in cell {
            if place.abs() > self.half_cells {
                return None;
            }
            index = index * side + place + self.half_cells;
        }
        Some(index as usize)
    }

    fn cell(&self, index: usize) -> [i64; 3] {
        let side = 2 * self.half_cells + 1;
        let index = index as i64;
        [index / (side * side), index / side % side, index % side].map(|place| place - self.half_cells)
    }

    /// Cells with more votes than their neighbours, strongest first.
    fn strongest(&self, max_peaks: usize) -> Vec<Vector3<f64>> {
        let least = 0.3 * self.votes.iter().copied().fold(0.0_f32, f32::max);
        let steps = self.steps_to_neighbours();
        let mut peaks: Vec<usize> =
            (0..self.votes.len()).filter(|&i| self.votes[i] > least && self.is_peak(i, &steps)).collect();
        peaks.sort_by(|&a, &b| self.votes[b].total_cmp(&self.votes[a]).then(a.cmp(&b)));
        peaks.truncate(max_peaks);
        let place_m = |index: usize| Vector3::from(self.cell(index).map(|place| place as f64 * self.cell_m));
        peaks.into_iter().map(place_m).collect()
    }

    /// Steps of the index to the 13 neighbours that come later; the earlier ones lie as far the other way.
    fn steps_to_neighbours(&self) -> Vec<usize> {
        let side = 2 * self.half_cells + 1;
        let steps = (0..27).map(|k| (k / 9 - 1) * side * side + (k / 3 % 3 - 1) * side + k % 3 - 1);
        steps.filter(|&step| step > 0).map(|step| step as usize).collect()
    }

    /// Whether no neighbour has more votes; of equal neighbours the first counts. At the border of the grid the neighbours are
    /// those across it, which is as good there: no camera stands at the largest baseline by chance.
    fn is_peak(&self, index: usize, steps: &[usize]) -> bool {
        let votes = self.votes[index];
        steps.iter().all(|step| {
            let before = index.checked_sub(*step).map_or(0.0, |before| self.votes[before]);
            let after = self.votes.get(index + step).copied().unwrap_or(0.0);
            before < votes && after <= votes
        })
    }
}
