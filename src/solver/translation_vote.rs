//! Convergence voting for a given rotation (paper, Algorithm 1, eq. 14 corrected).
//!
//! With the rotation known, a match leaves a line of translations `t = (p_t - R p_s) + k a`, `a = R d_s`. The point where most
//! lines meet is searched in a grid instead of over all pairs of lines: linear in the candidates, whatever their number.

use nalgebra::{UnitQuaternion, Vector3};

use super::candidates::Candidate;

/// Edge of a cell, m: about the blur that a rotation off by 1.5 degrees leaves at 2 m.
const CELL_M: f64 = 0.05;
/// Widest angle between both directions after rotation, rad.
const MAX_ANGLE_RAD: f64 = 0.06;
/// Matches whose observed parts lie further apart along the line than this are left out, m.
const MAX_GAP_M: f64 = 4.0;
/// Peaks closer than this many cells are one.
const PEAK_GAP_CELLS: i64 = 3;

/// A match under a given rotation: the line of translations it allows.
#[derive(Debug, Clone, Copy)]
pub struct TranslationLine {
    /// Index into the candidates.
    pub candidate: usize,
    /// A translation on the line: the one that brings both middles together, m.
    pub point_m: Vector3<f64>,
    /// Unit direction of the line.
    pub direction: Vector3<f64>,
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
        self.sigma_position_m.hypot(self.sigma_angle_rad * gap_m)
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
            sigma_position_m: candidate.sigma_position_m,
            sigma_angle_rad: candidate.sigma_angle_rad,
        });
    }
    lines
}

/// The grid over translations, reused from rotation to rotation.
#[derive(Debug)]
pub struct TranslationGrid {
    half_cells: i64,
    votes: Vec<f32>,
    /// The last source line that voted for a cell, so that each votes once.
    last_voter: Vec<u32>,
}

impl TranslationGrid {
    /// A grid for baselines up to `max_baseline_m`.
    pub fn new(max_baseline_m: f64) -> Self {
        let half_cells = (max_baseline_m / CELL_M).ceil() as i64;
        let n_cells = (2 * half_cells + 1).pow(3) as usize;
        Self { half_cells, votes: vec![0.0; n_cells], last_voter: vec![u32::MAX; n_cells] }
    }

    /// The translations with most votes, m, best first, at most `max_peaks`.
    pub fn peaks(
        &mut self,
        candidates: &[Candidate],
        lines: &[TranslationLine],
        max_peaks: usize,
    ) -> Vec<(Vector3<f64>, f32)> {
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
            let along_m = i as f64 * CELL_M - line.point_m[axis];
            let gap_m = along_m * slope.norm();
            if gap_m.abs() > MAX_GAP_M {
                continue;
            }
            // A line known to 1 cm says more than one known to 10 cm.
            let weight = (0.05 / (0.02 + line.sigma_m(gap_m))) as f32;
            let place_u = (line.point_m[u] + along_m * slope[u]) / CELL_M;
            let place_v = (line.point_m[v] + along_m * slope[v]) / CELL_M;
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

    fn strongest(&self, max_peaks: usize) -> Vec<(Vector3<f64>, f32)> {
        let best = self.votes.iter().copied().fold(0.0_f32, f32::max);
        let mut order: Vec<usize> = (0..self.votes.len()).filter(|&i| self.votes[i] > 0.5 * best).collect();
        order.sort_by(|&a, &b| self.votes[b].total_cmp(&self.votes[a]).then(a.cmp(&b)));
        let mut peaks: Vec<[i64; 3]> = Vec::new();
        let mut strongest = Vec::new();
        for index in order {
            let cell = self.cell(index);
            let is_new =
                peaks.iter().all(|peak| (0..3).any(|axis| (peak[axis] - cell[axis]).abs() >= PEAK_GAP_CELLS));
            if is_new {
                peaks.push(cell);
                let translation_m = Vector3::from(cell.map(|place| place as f64 * CELL_M));
                strongest.push((translation_m, self.votes[index]));
                if peaks.len() == max_peaks {
                    break;
                }
            }
        }
        strongest
    }
}
