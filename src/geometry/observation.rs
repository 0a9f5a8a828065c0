//! What one camera knows of one straight edge: the image segment and, where depth allows, the lifted line.
//!
//! The four numbers of a lifted line are those that are measured: the offsets of the two ends across the segment and the
//! inverse depths at the two ends. Stereo noise is uniform in inverse depth, so their covariance is simple and honest.

use nalgebra::Matrix2;

use super::camera::{PixelPoint, RayPoint};
use super::line3::Line3;

/// A straight edge in an image; the brighter side is on the right hand from start to end (x right, y down).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// Sub-pixel start, px, in the image as delivered (with its distortion).
    pub start: PixelPoint,
    /// Sub-pixel end, px.
    pub end: PixelPoint,
    /// Standard deviation of each end across the segment, px.
    pub sigma_across_px: f64,
}

impl Segment {
    /// Length, px.
    pub fn length_px(&self) -> f64 {
        (self.end.x - self.start.x).hypot(self.end.y - self.start.y)
    }
}

/// On which side of a segment the surface lies that owns the edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeSide {
    /// Left hand from start to end: the darker side.
    Left,
    /// Right hand: the brighter side.
    Right,
    /// Both sides meet at the edge (a crease or a marking).
    Both,
}

/// Depth along a segment: inverse depth is affine in the position on the segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthFit {
    /// Inverse depth at the start and at the end, 1/m.
    pub inverse_depth_per_m: [f64; 2],
    /// Their covariance, 1/m².
    pub covariance_per_m2: Matrix2<f64>,
    /// Share of the depth samples that agree with the fit, 0 to 1.
    pub inlier_ratio: f64,
    /// Number of samples that agree.
    pub n_inliers: u32,
    /// The surface that owns the edge.
    pub side: EdgeSide,
}

/// One straight edge as one camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineObservation {
    /// The segment in the image.
    pub segment: Segment,
    /// Rays through the segment's start and end, free of distortion.
    pub ends: [RayPoint; 2],
    /// Standard deviation of each end across the segment on the plane z = 1.
    pub sigma_across: f64,
    /// Depth of the edge; `None` where too little depth agrees ("PnL" side of a match).
    pub depth: Option<DepthFit>,
}

impl LineObservation {
    /// The lifted line in the camera's frame; `None` without depth or with its ends closer than 1 mm.
    pub fn line(&self) -> Option<Line3> {
        let depth = self.depth?;
        let [start, end] = self.ends;
        let [start_per_m, end_per_m] = depth.inverse_depth_per_m;
        Line3::through(&start.at_inverse_depth(start_per_m), &end.at_inverse_depth(end_per_m), 1e-3)
    }
}
