//! Missing lines: a long edge that one camera measured, and that the pose puts in plain sight of the other, should be seen there.
//!
//! Only the measured part of an edge counts, only where it lies on the surface that the other camera sees (neither hidden behind
//! it nor in front of it), and any segment of the other camera will do, lifted or not. True poses miss some too: contrast
//! depends on the light and on the viewpoint.

use crate::geometry::motion::Motion;
use crate::geometry::{Camera, RayPoint};

use super::candidates::PairEvidence;
use super::evidence::{EvidenceLine, EvidenceView};
use super::free_space::NearestSurface;

/// Shorter edges are often lost, px.
const MIN_LENGTH_PX: f64 = 60.0;
/// Places looked at along an edge.
const N_PLACES: usize = 16;
/// An edge is in plain sight when so many of its places are.
const MIN_IN_SIGHT: usize = 8;
/// ... and missing when at most this share of these is covered by segments.
const MAX_COVERED: f64 = 0.25;
/// Distance of a place from the border of the image, px.
const MARGIN_PX: f64 = 12.0;
/// An edge lies on a surface within this difference of inverse depths, 1/m, ...
const ON_SURFACE_PER_M: f64 = 0.03;
/// ... and this share.
const ON_SURFACE_RATIO: f64 = 0.06;
/// A segment covers a place when both its ends lie this close to the edge, px, ...
const COVER_ACROSS_PX: f64 = 6.0;
/// ... and the place lies on it or this little beyond, px.
const COVER_BEYOND_PX: f64 = 10.0;
/// Fewer edges than this are no proof.
const MIN_EXPECTED: usize = 12;
/// So many of the edges in plain sight are lost under a true pose (measured: 1 % on rendered recordings of one light, 0 to 20 %
/// on real ones) ...
const LOST_SHARE: f64 = 0.1;
/// ... and each beyond that counts against the pose: `ln(0.6 / 0.1)`, since wrong poses miss 30 to 99 %, nats.
const PENALTY: f64 = 1.8;

/// Counts over all frame sets, both ways.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct MissingLines {
    /// Edges that should be seen.
    pub expected: usize,
    /// Of these, not seen.
    pub missing: usize,
}

/// What one camera of a frame set saw.
struct Sight<'a> {
    camera: &'a Camera,
    view: &'a EvidenceView,
    surface: NearestSurface,
}

impl MissingLines {
    /// Share of the edges that should be seen and are not.
    pub fn share(&self) -> f64 {
        if self.expected == 0 { 0.0 } else { self.missing as f64 / self.expected as f64 }
    }

    /// Whether enough edges should be seen and more than the given share of them is not.
    pub fn is_too_much(&self, max_share: f64) -> bool {
        self.expected >= MIN_EXPECTED && self.share() > max_share
    }

    /// What they take from a pose's score, nats.
    pub fn penalty(&self) -> f64 {
        (self.missing as f64 - LOST_SHARE * self.expected as f64).max(0.0) * PENALTY
    }
}

/// Looks for edges of one camera that the other should see, under a pose.
pub fn missing_lines(
    pair: &PairEvidence<'_>,
    cameras: &[Camera],
    target_from_source: &Motion,
) -> MissingLines {
    let mut total = MissingLines::default();
    let (Some(target_camera), Some(source_camera)) = (cameras.get(pair.target), cameras.get(pair.source))
    else {
        return total;
    };
    let source_from_target = target_from_source.inverse();
    for set in 0..pair.evidence.sets.len() {
        let Some((target, source)) = pair.views(set) else { continue };
        let ways = [
            (source, target_from_source, target, target_camera),
            (target, &source_from_target, source, source_camera),
        ];
        for (from, to_from_from, to, camera) in ways {
            let sight = Sight { camera, view: to, surface: NearestSurface::new(camera, &to.surface) };
            for line in &from.lines {
                if let Some(is_seen) = sight.sees(line, to_from_from) {
                    total.expected += 1;
                    total.missing += usize::from(!is_seen);
                }
            }
        }
    }
    total
}

impl Sight<'_> {
    /// Whether an edge of the other camera is seen; `None` where it need not be.
    fn sees(&self, line: &EvidenceLine, to_from_from: &Motion) -> Option<bool> {
        if line.observation.segment.length_px() < MIN_LENGTH_PX {
            return None;
        }
        let places: Vec<RayPoint> = (0..N_PLACES)
            .filter_map(|i| self.place(line, (i as f64 + 0.5) / N_PLACES as f64, to_from_from))
            .collect();
        let (first, last) = (places.first()?, places.last()?);
        let (dx, dy) = (last.x - first.x, last.y - first.y);
        let length = dx.hypot(dy);
        if places.len() < MIN_IN_SIGHT || length * self.camera.mean_focal_px() < MIN_LENGTH_PX {
            return None;
        }
        let beside = self.segments_beside(first, (dx / length, dy / length));
        let covered =
            places.iter().filter(|place| beside.iter().any(|beside| self.reaches(beside, place))).count();
        Some(covered as f64 > MAX_COVERED * places.len() as f64)
    }

    /// Segments that run along the line through a place in the given direction.
    fn segments_beside(&self, place: &RayPoint, along: (f64, f64)) -> Vec<&[RayPoint; 2]> {
        let max_across = COVER_ACROSS_PX / self.camera.mean_focal_px();
        let across = |end: &RayPoint| ((end.x - place.x) * along.1 - (end.y - place.y) * along.0).abs();
        self.view.outlines.iter().filter(|ends| ends.iter().all(|end| across(end) < max_across)).collect()
    }

    /// Whether a segment beside the line reaches a place of it.
    fn reaches(&self, [start, end]: &[RayPoint; 2], place: &RayPoint) -> bool {
        let beyond = COVER_BEYOND_PX / self.camera.mean_focal_px();
        let (dx, dy) = (end.x - start.x, end.y - start.y);
        let length = dx.hypot(dy);
        let position = ((place.x - start.x) * dx + (place.y - start.y) * dy) / length;
        (-beyond..length + beyond).contains(&position)
    }

    /// A place of an edge in this camera, at a share of its length; `None` where it is not in plain sight.
    fn place(&self, line: &EvidenceLine, share: f64, to_from_from: &Motion) -> Option<RayPoint> {
        let point = to_from_from * (line.ends_m[0] + (line.ends_m[1] - line.ends_m[0]) * share);
        let pixel = self.camera.project(&point)?;
        if !self.camera.contains(pixel, MARGIN_PX) {
            return None;
        }
        let nearest_per_m = self.surface.around(pixel)?;
        let tolerance_per_m = ON_SURFACE_PER_M + ON_SURFACE_RATIO * nearest_per_m;
        let is_on_surface = (1.0 / point.z - nearest_per_m).abs() < tolerance_per_m;
        is_on_surface.then_some(RayPoint { x: point.x / point.z, y: point.y / point.z })
    }
}

#[cfg(test)]
mod tests;
