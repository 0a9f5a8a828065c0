//! Convergence voting (paper, Algorithm 1): the translation that most candidates pass within a tolerance, and which these are.
//!
//! The points that are voted on are, in this order: for every pair of lines i < j the middle of their common perpendicular (nearly
//! parallel lines have none); then for every line and every plane the point where they meet (a line in the plane has none). Without
//! planes this is Algorithm 1 to the letter. Planes alone have no points: three would be needed for each, and a rotation is
//! not found without full pairs. Every candidate, line or plane, votes for every point within its tolerance; of points with equally
//! many votes the first counts.
//!
//! The result is that of the triple loop, but the loop is not run: points are kept in a tree of boxes, and a box is opened
//! only while more candidates reach it than the best point has votes. Time grows as the number of points does, with the square of
//! the number of lines (`benches/solver.rs` measures it), the triple loop's with the third power.

mod search;

use nalgebra::Vector3;

use super::translation_candidate::{TranslationCandidate, TranslationLine, TranslationPlane};
use search::Point;

/// Lines whose directions' sine is below this are parallel as far as numbers go; the same for a line in a plane.
const MIN_SINE: f64 = 1e-6;

/// How far a candidate may be from a point to vote for it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Tolerance {
    /// The paper's: the same for all.
    Fixed {
        /// The paper's epsilon, m.
        epsilon_m: f64,
    },
    /// So many of the candidate's own standard deviations at that point, but at least the floor.
    Sigmas {
        /// Number of standard deviations.
        n: f64,
        /// For what the lines' noise does not know of: the rotation's error, m.
        floor_m: f64,
    },
}

/// Where most candidates meet.
#[derive(Debug, Clone, PartialEq)]
pub struct Vote {
    /// Indices of the candidates that pass the point within the tolerance, ascending.
    pub inliers: Vec<usize>,
    /// The point, m.
    pub point_m: Vector3<f64>,
}

impl Tolerance {
    /// The distance at which this candidate still votes for the point, m.
    fn at_m(&self, candidate: &TranslationCandidate, point_m: &Vector3<f64>) -> f64 {
        match *self {
            Self::Fixed { epsilon_m } => epsilon_m,
            Self::Sigmas { n, floor_m } => (n * candidate.sigma_m(point_m)).max(floor_m),
        }
    }

    /// A candidate's distance from a point, the distance at which it still votes for it, both m, and most that the latter changes
    /// per metre.
    fn around(&self, candidate: &TranslationCandidate, point_m: &Vector3<f64>) -> (f64, f64, f64) {
        let slope = match *self {
            Self::Fixed { .. } => 0.0,
            Self::Sigmas { n, .. } => n * candidate.sigma_slope(),
        };
        (candidate.distance_m(point_m), self.at_m(candidate, point_m), slope)
    }

    /// Whether a candidate votes for a point.
    fn holds(&self, candidate: &TranslationCandidate, point_m: &Vector3<f64>) -> bool {
        candidate.distance_m(point_m) < self.at_m(candidate, point_m)
    }
}

/// The first point with the most votes; `None` when no point has any, e.g. with fewer than two candidates.
pub fn convergence_vote(candidates: &[TranslationCandidate], tolerance: Tolerance) -> Option<Vote> {
    let point_m = search::most_voted(points(candidates), candidates, tolerance)?;
    let inliers = (0..candidates.len()).filter(|&i| tolerance.holds(&candidates[i], &point_m)).collect();
    Some(Vote { inliers, point_m })
}

/// The points that are voted on, in their order.
fn points(candidates: &[TranslationCandidate]) -> Vec<Point> {
    let (mut lines, mut planes) = (Vec::new(), Vec::new());
    for candidate in candidates {
        match candidate {
            TranslationCandidate::Line(line) => lines.push(line),
            TranslationCandidate::Plane(plane) => planes.push(plane),
        }
    }
    let mut points = Vec::with_capacity(lines.len() * (lines.len() + 2 * planes.len()) / 2);
    let mut push = |point_m: Option<Vector3<f64>>| {
        if let Some(at_m) = point_m {
            points.push(Point { at_m, place: points.len() as u32 });
        }
    };
    for (i, line) in lines.iter().enumerate() {
        lines[i + 1..].iter().for_each(|other| push(equidistant_m(line, other)));
    }
    for line in &lines {
        planes.iter().for_each(|plane| push(meeting_m(line, plane)));
    }
    points
}

/// The middle of the common perpendicular of two lines; `None` for parallel ones.
fn equidistant_m(a: &TranslationLine, b: &TranslationLine) -> Option<Vector3<f64>> {
    let cosine = a.direction.dot(&b.direction);
    let sine2 = a.direction.cross(&b.direction).norm_squared();
    if sine2 < MIN_SINE * MIN_SINE {
        return None;
    }
    let between_m = b.point_m - a.point_m;
    let (on_a_m, on_b_m) = (between_m.dot(&a.direction), between_m.dot(&b.direction));
    let foot_on_a_m = a.point_m + *a.direction * ((on_a_m - cosine * on_b_m) / sine2);
    let foot_on_b_m = b.point_m + *b.direction * ((cosine * on_a_m - on_b_m) / sine2);
    finite((foot_on_a_m + foot_on_b_m) * 0.5)
}

/// Where a line runs through a plane; `None` for a line along it.
fn meeting_m(line: &TranslationLine, plane: &TranslationPlane) -> Option<Vector3<f64>> {
    let sine = line.direction.dot(&plane.normal);
    if sine.abs() < MIN_SINE {
        return None;
    }
    let above_m = (plane.turned_m + line.point_m).dot(&plane.normal);
    finite(line.point_m - *line.direction * (above_m / sine))
}

fn finite(point_m: Vector3<f64>) -> Option<Vector3<f64>> {
    point_m.iter().all(|value| value.is_finite()).then_some(point_m)
}

#[cfg(test)]
mod tests;
