//! From a segment and depth to a 3D line with covariance.
//!
//! On each side of the segment a plane is fitted robustly to inverse depth and evaluated at the edge. Where both sides
//! agree the edge is a crease or a marking and both count; else the nearer side owns the edge.
mod band;
mod plane;

use nalgebra::{Matrix2, Matrix4};

use crate::geometry::{Camera, DepthFit, EdgeSide, LineObservation, Segment};
use crate::image::DepthView;
use band::{Band, MAX_BINS, Reading};
use plane::{Shape, Surface, SurfaceFit, least_squares, residual};

/// Short segments have no direction worth lifting, px.
const MIN_LENGTH_PX: f64 = 4.0;
/// Readings farther from the edge do not enter the inlier ratio, px.
const RATIO_BAND_PX: f64 = 4.75;
/// Least number of agreeing readings.
const MIN_INLIERS: usize = 20;
/// Gate of the fits, in standard deviations of a reading.
const GATE_SIGMAS: f64 = 3.0;
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

/// Lifts segments; owns its scratch memory.
#[derive(Debug)]
pub struct Lifter {
    options: LiftOptions,
    band: Band,
}

/// Which readings belong to which kind of surface.
#[derive(Debug, Clone, Copy)]
struct Model {
    side: EdgeSide,
    shape: Shape,
    surface: Surface,
}

/// A fit to all agreeing readings of a model.
#[derive(Debug, Clone, Copy)]
struct Fitted {
    model: Model,
    covariance: Matrix4<f64>,
    sigma_per_m: f64,
    n_inliers: usize,
}

impl Model {
    fn owns(&self, reading: &Reading) -> bool {
        match self.side {
            EdgeSide::Left => reading.across_px < 0.0,
            EdgeSide::Right => reading.across_px > 0.0,
            EdgeSide::Both => true,
        }
    }

    fn agrees(&self, reading: &Reading, gate_per_m: f64) -> bool {
        self.owns(reading) && residual(&self.surface, reading, self.shape).abs() <= gate_per_m
    }

    fn mean_per_m(&self) -> f64 {
        0.5 * (self.surface[0] + self.surface[1])
    }
}

impl Lifter {
    /// A lifter with the given options.
    pub fn new(options: LiftOptions) -> Self {
        Self { options, band: Band::default() }
    }

    /// Replaces `lines` by one observation per segment, in the same order; `depth` is `None` where too little depth agrees.
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
                sigma_across: segment.sigma_across_px / camera.mean_focal_px(),
                depth: self.depth_of(segment, depth, camera),
            }
        }));
    }

    fn depth_of(&mut self, segment: &Segment, depth: &DepthView<'_>, camera: &Camera) -> Option<DepthFit> {
        let length_px = segment.length_px();
        // Also refuses ends that are not numbers.
        if !(length_px >= MIN_LENGTH_PX && length_px < 1e5) {
            return None;
        }
        self.band.read(segment, depth, camera);
        let left = self.fit_side(EdgeSide::Left, length_px);
        let right = self.fit_side(EdgeSide::Right, length_px);
        let fitted = match (left, right) {
            (Some(left), Some(right)) => self.join(&left, &right, length_px),
            (one, other) => one.or(other)?,
        };
        self.accepted(&fitted)
    }

    /// Noise of a single reading at this inverse depth, 1/m, before the residuals are known.
    fn expected_sigma_per_m(&self, inverse_depth_per_m: f64) -> f64 {
        self.options.sigma_inverse_depth_per_m.hypot(self.options.relative_systematic * inverse_depth_per_m)
    }

    fn fit_side(&self, side: EdgeSide, length_px: f64) -> Option<Fitted> {
        let cells = &self.band.cells[usize::from(side == EdgeSide::Right)];
        let typical_per_m = median_inverse_depth(cells)?;
        let tolerance_per_m = GATE_SIGMAS * self.expected_sigma_per_m(typical_per_m);
        let surface = plane::consensus(cells, tolerance_per_m)?;
        self.refine(Model { side, shape: Shape::Plane, surface }, length_px)
    }

    /// Least squares over the readings that agree, repeated as the set of those settles.
    fn refine(&self, mut model: Model, length_px: f64) -> Option<Fitted> {
        let mut fit: Option<SurfaceFit> = None;
        let gate = |model: &Model| GATE_SIGMAS * self.expected_sigma_per_m(model.mean_per_m());
        for _ in 0..2 {
            let gate_per_m = gate(&model);
            let agreeing = self.band.readings.iter().filter(|reading| model.agrees(reading, gate_per_m));
            let again = least_squares(agreeing, model.shape)?;
            model.surface = again.surface;
            fit = Some(again);
        }
        let gate_per_m = gate(&model);
        let (mut n_inliers, mut sum) = (0, 0.0);
        for reading in self.band.readings.iter().filter(|reading| model.agrees(reading, gate_per_m)) {
            n_inliers += 1;
            sum += residual(&model.surface, reading, model.shape).powi(2);
        }
        if n_inliers < MIN_INLIERS {
            return None;
        }
        let sigma_per_m = (sum / n_inliers as f64).sqrt().max(self.options.sigma_inverse_depth_per_m);
        let covariance = covariance(&fit?.unit_covariance, sigma_per_m, length_px);
        Some(Fitted { model, covariance, sigma_per_m, n_inliers })
    }

    /// One fit out of two sides: both where they meet at the edge, else the nearer.
    fn join(&self, left: &Fitted, right: &Fitted, length_px: f64) -> Fitted {
        let nearer = if left.model.mean_per_m() >= right.model.mean_per_m() { left } else { right };
        let meets = |end: usize| {
            let gap = (left.model.surface[end] - right.model.surface[end]).abs();
            let variance = left.covariance[(end, end)] + right.covariance[(end, end)];
            gap <= AGREE_SIGMAS * variance.sqrt() + AGREE_RELATIVE * nearer.model.surface[end].abs()
        };
        if !(meets(0) && meets(1)) {
            return *nearer;
        }
        let (a, b) = (left.model.surface, right.model.surface);
        let surface = Surface::new(0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1]), a[2], b[2]);
        let crease = Model { side: EdgeSide::Both, shape: Shape::Crease, surface };
        let Some(crease) = self.refine(crease, length_px) else { return *nearer };
        let bend = crease.model.surface[2] - crease.model.surface[3];
        let c = &crease.covariance;
        let bend_variance = c[(2, 2)] + c[(3, 3)] - 2.0 * c[(2, 3)];
        if bend * bend > 9.0 * bend_variance {
            return crease;
        }
        // No crease to be seen: a marking on one plane, which fixes the depth at the edge better.
        let [start, end, left, right] = crease.model.surface.into();
        let surface = Surface::new(start, end, 0.5 * (left + right), 0.0);
        let flat = Model { side: EdgeSide::Both, shape: Shape::Plane, surface };
        self.refine(flat, length_px).unwrap_or(crease)
    }

    /// The fit as a result; `None` where too few readings agree or they cover too little of the segment.
    fn accepted(&self, fitted: &Fitted) -> Option<DepthFit> {
        let model = &fitted.model;
        let gate_per_m = GATE_SIGMAS * fitted.sigma_per_m.max(self.expected_sigma_per_m(model.mean_per_m()));
        let mut covered = [false; MAX_BINS];
        let (mut n_near, mut n_agreeing) = (0_u32, 0_u32);
        for reading in self.band.readings.iter().filter(|reading| model.owns(reading)) {
            if reading.across_px.abs() > RATIO_BAND_PX {
                continue;
            }
            n_near += 1;
            if model.agrees(reading, gate_per_m) {
                n_agreeing += 1;
                covered[usize::from(reading.bin)] = true;
            }
        }
        let inlier_ratio = f64::from(n_agreeing) / f64::from(n_near.max(1));
        let coverage = covered.iter().filter(|&&bin| bin).count() as f64 / self.band.n_bins as f64;
        let [start_per_m, end_per_m] = [model.surface[0], model.surface[1]];
        let usable = start_per_m > 0.0 && end_per_m > 0.0;
        if !usable || inlier_ratio < self.options.min_inlier_ratio || coverage < self.options.min_coverage {
            return None;
        }
        let systematic = Matrix2::from_diagonal(&nalgebra::Vector2::new(
            (self.options.relative_systematic * start_per_m).powi(2),
            (self.options.relative_systematic * end_per_m).powi(2),
        ));
        Some(DepthFit {
            inverse_depth_per_m: [start_per_m, end_per_m],
            covariance_per_m2: fitted.covariance.fixed_view::<2, 2>(0, 0) + systematic,
            inlier_ratio,
            n_inliers: fitted.n_inliers as u32,
            side: model.side,
        })
    }
}

fn median_inverse_depth(cells: &[band::Cell]) -> Option<f64> {
    let mut values = [0.0; band::ZONES * MAX_BINS];
    let values = &mut values[..cells.len()];
    for (value, cell) in values.iter_mut().zip(cells) {
        *value = cell.reading.inverse_depth_per_m;
    }
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Share of the noise's variance with a long correlation.
const SLOW_SHARE: f64 = 0.15;
/// Pixels per independent reading of the quick part of the noise (stereo matching windows overlap).
const QUICK_AREA_PX2: f64 = 15.0;
/// Length per independent reading of the slow part, px.
const SLOW_LENGTH_PX: f64 = 35.0;

/// Covariance of a surface from readings whose noise is correlated: a quick part over some pixels and a slow part over
/// lengths beyond the band's width, which moves the two ends.
fn covariance(unit_covariance: &Matrix4<f64>, sigma_per_m: f64, length_px: f64) -> Matrix4<f64> {
    let variance = sigma_per_m * sigma_per_m;
    let mut covariance = unit_covariance * ((1.0 - SLOW_SHARE) * variance * QUICK_AREA_PX2);
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
