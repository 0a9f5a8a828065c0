//! Whether two lines of two cameras are one physical edge, by where the cameras are and by depth: what matches are judged by.
//!
//! A lifted line is moved into the other camera and compared there with what that camera measured. Appearance is not asked, and no
//! matcher sees any of this. With the true pose it is the truth; with an estimated one it tells which lines that pose explains.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::geometry::motion::Motion;
use crate::geometry::{Camera, DepthFit, LineObservation, PixelPoint};
use crate::solver::evidence::EvidenceLine;
use crate::solver::residual::{match_residual, offset_residual};

/// A moved point lies on a segment within this distance across it, px: the noise of two segments, and of the depth that moved it.
pub const MAX_OFFSET_PX: f64 = 3.0;
/// The moved part of a line runs along the segment within this angle, deg.
pub const MAX_ANGLE_DEG: f64 = 3.0;
/// The part that both cameras see is at least this share of the shorter of what they could have in common.
pub const MIN_OVERLAP: f64 = 0.3;
/// Depths agree within so many standard deviations of their difference.
pub const MAX_SIGMAS: f64 = 3.0;
/// Lines continue each other within so many standard deviations, as the root mean square over the numbers compared.
const MAX_RMS_SIGMAS: f64 = 2.0;
/// Error of a depth or of an edge's place that no covariance tells: share of the inverse depth, and px.
const FLOOR_RELATIVE: f64 = 0.01;
const FLOOR_PX: f64 = 1.0;
/// A line continued so far that its image is known no better than this, px, agrees with too much to be told from others.
const MAX_VAGUE_PX: f64 = 10.0;
/// Between the points of a line that are moved, px.
const STEP_PX: f64 = 2.0;
/// Nearer points have no depth, m.
const NEAREST_M: f64 = 0.05;

/// How two lines belong together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SameEdge {
    /// One edge, of which both cameras see a part in common, so long in the image it was compared in, px.
    Shared {
        /// Length of the part in common.
        overlap_px: f64,
    },
    /// One straight line of space, but no part of it is seen by both (a "penetrating" line).
    Continued,
    /// Two edges.
    No,
    /// Neither has depth, or the line is continued too far to tell.
    Unknown,
}

impl SameEdge {
    /// Whether a match of the two is right; `None` where that cannot be told.
    pub fn is_true(self) -> Option<bool> {
        match self {
            SameEdge::Shared { .. } | SameEdge::Continued => Some(true),
            SameEdge::No => Some(false),
            SameEdge::Unknown => None,
        }
    }

    /// Whether both see a part in common.
    pub fn is_shared(self) -> bool {
        matches!(self, SameEdge::Shared { .. })
    }
}

/// The lines of one camera in one frame set.
#[derive(Debug, Clone, Copy)]
pub struct Sight<'a> {
    /// Its intrinsics.
    pub camera: &'a Camera,
    /// Its lines.
    pub lines: &'a [LineObservation],
}

/// How every line of a target and every line of a source belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct SameEdges {
    n_sources: usize,
    /// By target, then by source.
    table: Vec<SameEdge>,
}

impl SameEdges {
    /// Compares all with all.
    pub fn new(target: &Sight<'_>, source: &Sight<'_>, target_from_source: &Motion) -> Self {
        let source_from_target = target_from_source.inverse();
        let targets = moved_all(target, source.camera, &source_from_target);
        let sources = moved_all(source, target.camera, target_from_source);
        let mut table = Vec::with_capacity(targets.len() * sources.len());
        for target_line in &targets {
            for source_line in &sources {
                let shared = match (&target_line.path, &source_line.path) {
                    (_, Some(path)) => overlap(path, target_line.seen),
                    (Some(path), None) => overlap(path, source_line.seen),
                    (None, None) => None,
                };
                let other = || continued(target_line, source_line, (target_from_source, target.camera));
                table.push(shared.map_or_else(other, |overlap_px| SameEdge::Shared { overlap_px }));
            }
        }
        Self { n_sources: sources.len(), table }
    }

    /// By target, then by so many sources.
    #[cfg(test)]
    pub fn of_table(n_sources: usize, table: Vec<SameEdge>) -> Self {
        Self { n_sources, table }
    }

    /// How a target line and a source line belong together; not at all where there is no such line.
    pub fn of(&self, target: usize, source: usize) -> SameEdge {
        let is_line = source < self.n_sources;
        let found = is_line.then(|| self.table.get(target * self.n_sources + source)).flatten();
        found.copied().unwrap_or(SameEdge::No)
    }

    /// Every pair of lines that is not two edges: target, source, how.
    pub fn pairs(&self) -> impl Iterator<Item = (usize, usize, SameEdge)> {
        let place = |at: usize| (at / self.n_sources.max(1), at % self.n_sources.max(1));
        let all = self.table.iter().enumerate().filter(|(_, same)| **same != SameEdge::No);
        all.map(move |(at, same)| (place(at).0, place(at).1, *same))
    }
}

/// A line, and how the other camera would see it.
struct Candidate<'a> {
    seen: &'a LineObservation,
    lifted: Option<EvidenceLine>,
    /// Where the other camera should see its points; `None` without depth.
    path: Option<Vec<PathPoint>>,
}

/// A point of a line as the other camera should see it.
struct PathPoint {
    pixel: PixelPoint,
    inverse_depth_per_m: f64,
    variance_per_m2: f64,
}

fn moved_all<'a>(from: &Sight<'a>, to: &Camera, to_from_from: &Motion) -> Vec<Candidate<'a>> {
    let moved = |seen: &'a LineObservation| {
        let lifted = EvidenceLine::try_new(seen);
        let path =
            lifted.as_ref().and(seen.depth.as_ref()).map(|depth| path(seen, depth, (to, to_from_from)));
        Candidate { seen, lifted, path }
    };
    from.lines.iter().map(moved).collect()
}

/// The points of a lifted line that lie in the other camera's image.
fn path(line: &LineObservation, depth: &DepthFit, (to, to_from_from): (&Camera, &Motion)) -> Vec<PathPoint> {
    let n_steps = (line.segment.length_px() / STEP_PX).ceil().clamp(8.0, 2000.0) as usize;
    let point = |step: usize| {
        let share = step as f64 / n_steps as f64;
        let (inverse_depth_per_m, variance_per_m2) = depth_at(depth, share);
        let [start, end] = line.ends;
        let ray = nalgebra::Point3::new(
            start.x + share * (end.x - start.x),
            start.y + share * (end.y - start.y),
            1.0,
        );
        let point_in_to = to_from_from * (ray / inverse_depth_per_m);
        let pixel =
            Some(point_in_to).filter(|point| point.z > NEAREST_M).and_then(|point| to.project(&point))?;
        // 1/z of the moved point, by the inverse depth it was moved with.
        let turned_z = (to_from_from.rotation * ray.coords).z;
        let derivative = turned_z / (inverse_depth_per_m * point_in_to.z).powi(2);
        to.contains(pixel, 0.0).then(|| PathPoint {
            pixel,
            inverse_depth_per_m: 1.0 / point_in_to.z,
            variance_per_m2: derivative * derivative * variance_per_m2,
        })
    };
    (0..=n_steps).filter_map(point).collect()
}

/// Inverse depth at a share of a segment's length, 1/m, and its variance.
fn depth_at(depth: &DepthFit, share: f64) -> (f64, f64) {
    let weights = Vector2::new(1.0 - share, share);
    let inverse_depth_per_m = weights.dot(&Vector2::from(depth.inverse_depth_per_m));
    (inverse_depth_per_m, weights.dot(&(depth.covariance_per_m2 * weights)))
}

/// Length of the part of a path that runs along a segment, at its depth where it has one; `None` where that is too little.
fn overlap(path: &[PathPoint], seen: &LineObservation) -> Option<f64> {
    let (start, end) = (seen.segment.start, seen.segment.end);
    let (length_px, visible_px) = (seen.segment.length_px(), gap_px(path.first()?.pixel, path.last()?.pixel));
    let along = Vector2::new(end.x - start.x, end.y - start.y) / length_px;
    let is_on = |point: &&PathPoint| {
        let from_start = Vector2::new(point.pixel.x - start.x, point.pixel.y - start.y);
        let (at_px, offset_px) = (from_start.dot(&along), from_start.perp(&along));
        let is_beside = offset_px.abs() <= MAX_OFFSET_PX && (0.0..=length_px).contains(&at_px);
        is_beside && seen.depth.is_none_or(|depth| agrees(point, depth_at(&depth, at_px / length_px)))
    };
    let mut on = path.iter().filter(is_on);
    let first = on.next()?;
    let last = on.next_back()?;
    let run = Vector2::new(last.pixel.x - first.pixel.x, last.pixel.y - first.pixel.y);
    let angle_rad = run.perp(&along).abs().atan2(run.dot(&along).abs());
    let overlap_px = run.norm();
    let is_same =
        angle_rad <= MAX_ANGLE_DEG.to_radians() && overlap_px >= MIN_OVERLAP * length_px.min(visible_px);
    is_same.then_some(overlap_px)
}

fn agrees(point: &PathPoint, (inverse_depth_per_m, variance_per_m2): (f64, f64)) -> bool {
    let floor_per_m = FLOOR_RELATIVE * inverse_depth_per_m;
    let sigma_per_m = (point.variance_per_m2 + variance_per_m2 + floor_per_m * floor_per_m).sqrt();
    (point.inverse_depth_per_m - inverse_depth_per_m).abs() <= MAX_SIGMAS * sigma_per_m
}

fn gap_px(a: PixelPoint, b: PixelPoint) -> f64 {
    (a.x - b.x).hypot(a.y - b.y)
}

/// Whether two lines without a part in common lie on one line of space.
fn continued(
    target: &Candidate<'_>,
    source: &Candidate<'_>,
    (target_from_source, camera): (&Motion, &Camera),
) -> SameEdge {
    let focal_px = camera.mean_focal_px();
    let source_from_target = target_from_source.inverse();
    match (&target.lifted, &source.lifted) {
        (Some(target), Some(source)) => {
            let there = full_gap(target, source, (target_from_source, focal_px));
            let back = full_gap(source, target, (&source_from_target, focal_px));
            match (there, back) {
                (Some(there), Some(back)) if there.sigmas.max(back.sigmas) > MAX_RMS_SIGMAS => SameEdge::No,
                (Some(there), Some(back)) if there.vague_px.min(back.vague_px) <= MAX_VAGUE_PX => {
                    SameEdge::Continued
                }
                _ => SameEdge::Unknown,
            }
        }
        (None, Some(source)) => half_known(target.seen, source, (target_from_source, focal_px)),
        (Some(target), None) => half_known(source.seen, target, (&source_from_target, focal_px)),
        (None, None) => SameEdge::Unknown,
    }
}

/// How far two lines are apart.
struct Gap {
    /// In standard deviations, spread over the numbers compared as the root mean square.
    sigmas: f64,
    /// How well the image of the moved line is known where it is compared.
    vague_px: f64,
}

fn full_gap(to: &EvidenceLine, from: &EvidenceLine, (to_from_from, focal_px): (&Motion, f64)) -> Option<Gap> {
    let compared = match_residual(to, from, to_from_from)?;
    let ends_per_m = to.observation.depth?.inverse_depth_per_m;
    let floor_px = FLOOR_PX / focal_px;
    let floors = [floor_px, floor_px, FLOOR_RELATIVE * ends_per_m[0], FLOOR_RELATIVE * ends_per_m[1]];
    whitened(compared.residual, compared.covariance, (floors, focal_px))
}

/// One of the two has no depth: two edges, or nothing that could be told.
fn half_known(
    to: &LineObservation,
    from: &EvidenceLine,
    (to_from_from, focal_px): (&Motion, f64),
) -> SameEdge {
    let gap = offset_residual(to, from, to_from_from).and_then(|compared| {
        let covariance: Matrix2<f64> = compared.covariance;
        whitened(compared.residual, covariance, ([FLOOR_PX / focal_px; 2], focal_px))
    });
    match gap {
        Some(gap) if gap.sigmas > MAX_RMS_SIGMAS => SameEdge::No,
        _ => SameEdge::Unknown,
    }
}

fn whitened<const N: usize>(
    residual: SVector<f64, N>,
    mut covariance: SMatrix<f64, N, N>,
    (floors, focal_px): ([f64; N], f64),
) -> Option<Gap> {
    let vague_px = focal_px * covariance[(0, 0)].max(covariance[(1, 1)]).sqrt();
    for (i, floor) in floors.iter().enumerate() {
        covariance[(i, i)] += floor * floor;
    }
    let solved = covariance.cholesky()?.solve(&residual);
    Some(Gap { sigmas: (residual.dot(&solved) / N as f64).sqrt(), vague_px })
}

#[cfg(test)]
mod tests;
