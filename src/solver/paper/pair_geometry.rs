//! A matched pair of lines as the paper's equations read it: points, directions, moments and image rays, without covariance.

use nalgebra::Vector3;

use crate::geometry::{LineObservation, RayPoint};
use crate::solver::{LinePair, TargetSide};

/// Image segments shorter than this on the plane z = 1 have no direction (a tenth of a pixel of common cameras).
const MIN_EXTENT: f64 = 1e-4;

/// Both sides of a matched pair, each in its own camera's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairGeometry {
    /// The source line's observed ends, m.
    pub source_ends_m: [Vector3<f64>; 2],
    /// Unit direction of the source line.
    pub source_direction: Vector3<f64>,
    /// What the target saw.
    pub target: TargetGeometry,
}

/// The target's side in the paper's two cases.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TargetGeometry {
    /// Full 3D case: a line of space.
    Full(TargetLine),
    /// PnL case: a line of the image.
    Pnl(TargetSegment),
}

/// A lifted target line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetLine {
    /// A point of the line, m: the middle of what was observed.
    pub point_m: Vector3<f64>,
    /// Unit direction; its sign carries no meaning.
    pub direction: Vector3<f64>,
}

/// A target segment without depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetSegment {
    /// Rays through its two ends, third coordinate 1.
    pub end_rays: [Vector3<f64>; 2],
    /// Unit normal of the plane through the camera's centre and the segment (the paper's `K^T l`, normalised).
    pub plane_normal: Vector3<f64>,
    /// Pixels per unit of the plane z = 1, along this segment.
    pub focal_px: f64,
}

impl PairGeometry {
    /// Reads a pair; `None` where a number is not finite or the target's segment has no extent.
    pub fn try_new(pair: &LinePair) -> Option<Self> {
        let target = match &pair.target {
            TargetSide::Full(line) => TargetGeometry::Full(TargetLine {
                point_m: line.middle_m().coords,
                direction: line.direction.into_inner(),
            }),
            TargetSide::Pnl(observation) => TargetGeometry::Pnl(TargetSegment::try_new(observation)?),
        };
        let geometry = Self {
            source_ends_m: pair.source.ends_m.map(|end_m| end_m.coords),
            source_direction: pair.source.direction.into_inner(),
            target,
        };
        geometry.is_finite().then_some(geometry)
    }

    fn is_finite(&self) -> bool {
        let target = match &self.target {
            TargetGeometry::Full(line) => line.point_m.sum() + line.direction.sum(),
            TargetGeometry::Pnl(segment) => segment.plane_normal.sum() + segment.focal_px,
        };
        let source = self.source_ends_m[0].sum() + self.source_ends_m[1].sum() + self.source_direction.sum();
        (source + target).is_finite()
    }
}

impl TargetSegment {
    /// `None` where the segment has no extent.
    fn try_new(observation: &LineObservation) -> Option<Self> {
        let end_rays = observation.ends.map(|RayPoint { x, y }| Vector3::new(x, y, 1.0));
        let extent = (end_rays[1] - end_rays[0]).norm();
        let plane_normal = end_rays[0].cross(&end_rays[1]).try_normalize(0.0)?;
        let focal_px = observation.segment.length_px() / extent;
        (extent > MIN_EXTENT).then_some(Self { end_rays, plane_normal, focal_px })
    }
}
