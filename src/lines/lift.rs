//! From a segment and depth to a 3D line with covariance.
//!
//! On each side of the segment a plane is fitted robustly to inverse depth and evaluated at the edge. Where both sides
//! agree the edge is a crease or a marking and both count; else the nearer side owns the edge.
mod band;
mod fit;
mod plane;

use nalgebra::{Matrix2, Matrix4, Vector4};

use crate::geometry::{Camera, DepthFit, EdgeSide, LineObservation, Segment};
use crate::image::DepthView;
use band::{Band, MAX_BINS, Reading};
use fit::{Agreement, Gate, Shape, least_squares};
use plane::Plane;

/// Short segments have no direction worth lifting, px.
const MIN_LENGTH_PX: f64 = 4.0;
/// Least number of agreeing readings.
const MIN_INLIERS: f64 = 12.0;
/// Gate of the fits, in standard deviations of a reading.
const GATE_SIGMAS: f64 = 3.0;
/// The same for the median of a cell, which has about half the deviation of a reading.
const CELL_GATE_SIGMAS: f64 = 2.0;
/// Two sides agree within so many standard deviations of their difference ...
const AGREE_SIGMAS: f64 = 3.0;
/// ... and this share of the inverse depth (depth bends by about this much beside an edge).
const AGREE_RELATIVE: f64 = 0.01;

/// Noise model and limits of lifting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LiftOptions {
    /// Standard deviation of a single inverse-depth reading, 1/m (D435i at 640 x 480: 0.1 px / (385 px * 0.05 m)).
    pub sigma_inverse_depth_per_m: f64,
    /// Systematic error of inverse depth, as a share of it.
    pub relative_systematic: f64,
    /// Least share of agreeing samples for a lifted line (the paper's full/PnL test).
    pub min_inlier_ratio: f64,
    /// Least share of the segment's length beside which depth agrees.
    pub min_coverage: f64,
}

impl Default for LiftOptions {
    fn default() -> Self {
        Self {
            sigma_inverse_depth_per_m: 0.0052,
            relative_systematic: 0.003,
            min_inlier_ratio: 0.5,
            min_coverage: 0.5,
        }
    }
}

/// What an edge's place in the image differs by from camera to camera beyond the noise of one picture, px: light and background
/// change with the viewpoint, and no edge is perfectly sharp.
const VIEW_SIGMA_PX: f64 = 0.21;

/// Lifts segments; owns its scratch memory.
#[derive(Debug)]
pub struct Lifter {
    options: LiftOptions,
    /// Left and right of the segment in work.
    bands: [Band; 2],
}

/// The surface on one side of an edge.
#[derive(Debug, Clone, Copy)]
struct Side {
    plane: Plane,
    covariance: Matrix4<f64>,
    agreement: Agreement,
}

/// A surface that owns the edge.
#[derive(Debug, Clone, Copy)]
struct Owner {
    side: EdgeSide,
    ends_per_m: [f64; 2],
    covariance: Matrix4<f64>,
}

impl Lifter {
    /// A lifter with the given options.
    pub fn new(options: LiftOptions) -> Self {
        Self { options, bands: Default::default() }
    }

    /// Replaces `lines` by one observation per segment, in the same order; `depth` is `None` where too little depth agrees.
    #[allow(
        clippy::too_many_arguments,
        reason = "three inputs of different kinds and the output that is reused"
    )]
    pub fn lift(
        &mut self,
        segments: &[Segment],
        depth: &DepthView<'_>,
        camera: &Camera,
        lines: &mut Vec<LineObservation>,
    ) {
        lines.clear();
        lines.extend(segments.iter().map(|segment| {
            let ends = [segment.start, segment.end].map(|pixel| camera.ray_from_pixel(pixel));
            LineObservation {
                segment: *segment,
                ends,
                sigma_across: segment.sigma_across_px.hypot(VIEW_SIGMA_PX) / camera.mean_focal_px(),
                depth: self.depth_of(segment, depth, camera),
            }
        }));
    }

    fn depth_of(&mut self, segment: &Segment, depth: &DepthView<'_>, camera: &Camera) -> Option<DepthFit> {
        let length_px = segment.length_px();
        // Also refuses ends that are not numbers.
        if !(MIN_LENGTH_PX..1e5).contains(&length_px) {
            return None;
        }
        band::read(&mut self.bands, segment, depth, camera);
        let [left, right] = [0, 1].map(|side| self.fit_side(&self.bands[side], length_px));
        match (&left, &right) {
            (Some(left), Some(right)) => match self.meeting(left, right, length_px) {
                Some(both) => self.accepted(&both, &[&left.agreement, &right.agreement]),
                // At an occluding edge the nearer surface ends.
                None if left.plane.mean_per_m() >= right.plane.mean_per_m() => {
                    self.alone(EdgeSide::Left, left)
                }
                None => self.alone(EdgeSide::Right, right),
            },
            (Some(left), None) => self.alone(EdgeSide::Left, left),
            (None, Some(right)) => self.alone(EdgeSide::Right, right),
            (None, None) => None,
        }
    }

    /// Noise of a single reading at this inverse depth, 1/m, before the residuals are known.
    fn expected_sigma_per_m(&self, inverse_depth_per_m: f64) -> f64 {
        self.options.sigma_inverse_depth_per_m.hypot(self.options.relative_systematic * inverse_depth_per_m)
    }

    /// The plane beside the edge that most readings agree with; `None` where too few do.
    fn fit_side(&self, band: &Band, length_px: f64) -> Option<Side> {
        let typical_per_m = median_inverse_depth(&band.cells)?;
        let sigma_per_m = self.expected_sigma_per_m(typical_per_m);
        let gate =
            Gate { reading_per_m: GATE_SIGMAS * sigma_per_m, cell_per_m: CELL_GATE_SIGMAS * sigma_per_m };
        let plane = plane::consensus(&band.cells, gate.cell_per_m)?;
        // Twice: the first plane goes through three cells only.
        let rough = Agreement::with(&plane, band, gate);
        let plane = plane_of(&least_squares([&rough].into_iter(), Shape::Plane)?.surface);
        let agreement = Agreement::with(&plane, band, gate);
        if agreement.n < MIN_INLIERS {
            return None;
        }
        let fit = least_squares([&agreement].into_iter(), Shape::Plane)?;
        let covariance = covariance(&fit.unit_covariance, self.sigma_per_m(&[&agreement]), length_px);
        Some(Side { plane: plane_of(&fit.surface), covariance, agreement })
    }

    /// Standard deviation of a reading: what the residuals say, but not less than the sensor's.
    fn sigma_per_m(&self, sides: &[&Agreement]) -> f64 {
        let sum: f64 = sides.iter().map(|side| side.sum_per_m2).sum();
        let n: f64 = sides.iter().map(|side| side.n).sum();
        (sum / n).sqrt().max(self.options.sigma_inverse_depth_per_m)
    }

    /// The edge where two sides meet, as a crease or a marking; `None` where one lies behind the other.
    fn meeting(&self, left: &Side, right: &Side, length_px: f64) -> Option<Owner> {
        let meets = |end: usize| {
            let (a, b) = (left.plane.ends_per_m[end], right.plane.ends_per_m[end]);
            let variance = left.covariance[(end, end)] + right.covariance[(end, end)];
            (a - b).abs() <= AGREE_SIGMAS * variance.sqrt() + AGREE_RELATIVE * a.max(b)
        };
        if !(meets(0) && meets(1)) {
            return None;
        }
        let sides = [&left.agreement, &right.agreement];
        let bend = left.plane.slope_per_m_px - right.plane.slope_per_m_px;
        let bend_variance = left.covariance[(2, 2)] + right.covariance[(2, 2)];
        // Without a crease to be seen it is a marking on one plane, which fixes the depth at the edge better.
        let shape = if bend * bend > 9.0 * bend_variance { Shape::Crease } else { Shape::Plane };
        let fit = least_squares(sides.into_iter(), shape)?;
        let covariance = covariance(&fit.unit_covariance, self.sigma_per_m(&sides), length_px);
        Some(Owner { side: EdgeSide::Both, ends_per_m: plane_of(&fit.surface).ends_per_m, covariance })
    }

    fn alone(&self, side: EdgeSide, fit: &Side) -> Option<DepthFit> {
        let owner = Owner { side, ends_per_m: fit.plane.ends_per_m, covariance: fit.covariance };
        self.accepted(&owner, &[&fit.agreement])
    }

    /// The owner's depth as a result; `None` where too few readings agree or they cover too little of the segment.
    fn accepted(&self, owner: &Owner, sides: &[&Agreement]) -> Option<DepthFit> {
        let near = [0, 1].map(|i| sides.iter().map(|side| side.n_near[i]).sum::<f64>());
        let inlier_ratio = near[1] / near[0].max(1.0);
        let covered = sides.iter().fold(0, |bins, side| bins | side.covered).count_ones();
        let coverage = f64::from(covered) / self.bands[0].n_bins as f64;
        let [start_per_m, end_per_m] = owner.ends_per_m;
        let usable = start_per_m > 0.0 && end_per_m > 0.0;
        if !usable || inlier_ratio < self.options.min_inlier_ratio || coverage < self.options.min_coverage {
            return None;
        }
        let systematic = owner.ends_per_m.map(|end| (self.options.relative_systematic * end).powi(2));
        Some(DepthFit {
            inverse_depth_per_m: owner.ends_per_m,
            covariance_per_m2: owner.covariance.fixed_view::<2, 2>(0, 0)
                + Matrix2::from_diagonal(&systematic.into()),
            inlier_ratio,
            n_inliers: sides.iter().map(|side| side.n as u32).sum(),
            side: owner.side,
        })
    }
}

fn plane_of(surface: &Vector4<f64>) -> Plane {
    Plane { ends_per_m: [surface[0], surface[1]], slope_per_m_px: surface[2] }
}

fn median_inverse_depth(cells: &[Reading]) -> Option<f64> {
    let mut values = [0.0; band::ZONES * MAX_BINS];
    let values = &mut values[..cells.len()];
    for (value, cell) in values.iter_mut().zip(cells) {
        *value = cell.inverse_depth_per_m;
    }
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Share of the noise's variance with a long correlation.
const SLOW_SHARE: f64 = 0.15;
/// Pixels per independent reading of the quick part of the noise (stereo matching windows overlap).
const QUICK_AREA_PX2: f64 = 24.0;
/// Length per independent reading of the slow part, px.
const SLOW_LENGTH_PX: f64 = 55.0;

/// Covariance of a surface from readings whose noise is correlated: a quick part over some pixels and a slow part over
/// lengths beyond the band's width, which moves the two ends.
fn covariance(unit_covariance: &Matrix4<f64>, sigma_per_m: f64, length_px: f64) -> Matrix4<f64> {
    let variance = sigma_per_m * sigma_per_m;
    let readings_per_independent = QUICK_AREA_PX2 / band::pixels_per_reading(length_px);
    let mut covariance = unit_covariance * ((1.0 - SLOW_SHARE) * variance * readings_per_independent);
    // A mean and a tilt from n independent pieces: the tilt moves each end by 3/n, and cannot be told with one piece.
    let n = 1.0 + length_px / SLOW_LENGTH_PX;
    let (mean, tilt) = (1.0 / n, 3.0 / n * (1.0 - 1.0 / n));
    let slow = SLOW_SHARE * variance;
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        covariance[(i, j)] += slow * if i == j { mean + tilt } else { mean - tilt };
    }
    covariance
}

#[cfg(test)]
mod tests;
