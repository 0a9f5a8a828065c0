//! All that the estimator keeps of one RGB-D frame: its lines and a coarse picture of the surfaces.

use super::camera::PixelPoint;
use super::observation::LineObservation;

/// One camera's part of a frame set.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CameraView {
    /// The straight edges, longest first.
    pub lines: Vec<LineObservation>,
    /// Sparse surface samples, for the test that nothing seen through is solid.
    pub surface: Vec<SurfaceSample>,
}

/// Depth at one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSample {
    /// Where, px.
    pub pixel: PixelPoint,
    /// Inverse depth, 1/m.
    pub inverse_depth_per_m: f64,
}
