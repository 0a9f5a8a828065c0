//! From a segment and depth to a 3D line with covariance.
//!
//! On each side of the segment a plane is fitted robustly to inverse depth and evaluated at the edge. Where both sides
//! agree the edge is a crease or a marking and both count; else the nearer side owns the edge. How much depth scatters is taken
//! from the readings themselves, per line and over the image.
mod band;
mod fit;
mod noise;
mod owner;
mod plane;
mod sweep;

use nalgebra::Matrix2;

use crate::geometry::{Camera, DepthFit, EdgeSide, LineObservation, Segment};
use crate::image::DepthView;
use band::{Band, MAX_BINS, Reading};
use fit::{Agreement, Gate, Moments, Reach, Shape, SurfaceFit, least_squares, open_cells};
use noise::Scatter;
use owner::Owner;
use plane::Plane;
use sweep::Sweep;

/// Short segments have no direction worth lifting, px.
const MIN_LENGTH_PX: f64 = 4.0;
/// Least number of agreeing readings.
const MIN_INLIERS: f64 = 12.0;
/// Gate of the fits, in standard deviations of a reading.
const GATE_SIGMAS: f64 = 3.0;
/// The same for the median of a cell, which has less deviation than a reading.
const CELL_GATE_SIGMAS: f64 = 2.0;
/// Zones over which depth bleeds; they are looked at again where what most of a side shows does not reach the edge.
const INNER_ZONES: usize = 2;
/// Least share of the zones beyond for another surface there.
const MIN_BEYOND: f64 = 0.7;
/// How far the noise of a surface may lie from the sensor's model, as a factor.
const SIGMA_RANGE: [f64; 2] = [0.4, 1.8];
/// A median of absolute values times this is the deviation of normal errors.
const DEVIATION_PER_MEDIAN: f64 = 1.4826;

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
            relative_systematic: 0.0005,
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
    sweep: Sweep,
    /// Sizes of residuals, for their median.
    sizes: Vec<f64>,
    /// Those in work on one side.
    cells: Vec<Reading>,
    /// Of each segment of the image.
    scatters: Vec<Scatter>,
}

/// A surface on one side of an edge.
#[derive(Debug, Clone, Copy)]
struct Surface {
    fit: SurfaceFit,
    moments: Moments,
    agreement: Agreement,
    /// The edge, were it this side's.
    owner: Owner,
    scatter: Scatter,
}

/// The surface at the edge on one side.
#[derive(Debug, Clone, Copy)]
struct AtEdge {
    surface: Surface,
    beyond: Beyond,
    /// Whether there is depth enough at the edge to say that it reaches it.
    is_sure: bool,
}

/// What follows on the surface at an edge a few pixels farther out on its side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Beyond {
    /// The same surface.
    Same,
    /// Something nearer.
    Nearer,
    /// Something farther: what is at the edge is narrow, or has bled over from the other side.
    Farther,
}

impl Lifter {
    /// A lifter with the given options.
    pub fn new(options: LiftOptions) -> Self {
        let (bands, sweep, sizes, scatters) = Default::default();
        Self { options, bands, sweep, sizes, cells: Vec::with_capacity(band::ZONES * MAX_BINS), scatters }
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
        self.scatters.clear();
        self.scatters.reserve(segments.len());
        lines.extend(segments.iter().map(|segment| {
            let ends = [segment.start, segment.end].map(|pixel| camera.ray_from_pixel(pixel));
            let (depth, scatter) = self.depth_of(segment, depth, camera).unzip();
            self.scatters.push(scatter.unwrap_or_default());
            let sigma_across = segment.sigma_across_px.hypot(VIEW_SIGMA_PX) / camera.mean_focal_px();
            LineObservation { segment: *segment, ends, sigma_across, depth }
        }));
        self.widen(lines);
    }

    /// Brings the covariances to the scatter of depth along the lines, and adds what no scatter shows.
    fn widen(&self, lines: &mut [LineObservation]) {
        let common = noise::common_variance_factor(self.scatters.iter().copied());
        for (line, scatter) in lines.iter_mut().zip(&self.scatters) {
            if let Some(depth) = &mut line.depth {
                let systematic = depth.inverse_depth_per_m.map(|inverse_depth_per_m| {
                    (self.options.relative_systematic * inverse_depth_per_m).powi(2)
                });
                depth.covariance_per_m2 *= scatter.variance_factor(common);
                depth.covariance_per_m2 += Matrix2::from_diagonal(&systematic.into());
            }
        }
    }

    fn depth_of(
        &mut self,
        segment: &Segment,
        depth: &DepthView<'_>,
        camera: &Camera,
    ) -> Option<(DepthFit, Scatter)> {
        let length_px = segment.length_px();
        // Also refuses ends that are not numbers.
        if !(MIN_LENGTH_PX..1e5).contains(&length_px) {
            return None;
        }
        band::read((&mut self.bands, &mut self.sweep), segment, depth, camera);
        let left = self.at_edge(EdgeSide::Left, length_px);
        let right = self.at_edge(EdgeSide::Right, length_px);
        let model_per_m = self.options.sigma_inverse_depth_per_m;
        let owner = owner::decide([left.as_ref(), right.as_ref()], (model_per_m, length_px))?;
        let sides = [(EdgeSide::Left, &left), (EdgeSide::Right, &right)];
        let owning =
            sides.into_iter().filter(|(side, _)| owner.owns(*side)).filter_map(|(_, side)| side.as_ref());
        let scatter = owning.clone().map(|side| side.surface.scatter).fold(Scatter::default(), Scatter::and);
        Some((self.accepted(&owner, owning.map(|side| &side.surface.agreement))?, scatter))
    }

    /// The surface at the edge on one side.
    fn at_edge(&mut self, side: EdgeSide, length_px: f64) -> Option<AtEdge> {
        let band = &self.bands[usize::from(side == EdgeSide::Right)];
        self.cells.clear();
        self.cells.extend(&band.cells);
        let surface = self.fit_side(side, length_px)?;
        let reach = surface.agreement.reach(self.bands[0].n_bins);
        if reach != Reach::Short {
            let beyond = self.beyond(&surface.fit.plane());
            return Some(AtEdge { surface, beyond, is_sure: reach == Reach::Edge });
        }
        // What most of the side shows lies farther out: look again, beside the edge.
        let outer = surface.fit.plane();
        let tolerance_per_m = CELL_GATE_SIGMAS * self.model_per_m(outer.mean_per_m());
        let is_other =
            |cell: &Reading| cell.zone() < INNER_ZONES && outer.residual(cell).abs() > tolerance_per_m;
        self.cells.retain(is_other);
        let surface = self.fit_side(side, length_px)?;
        let reach = surface.agreement.reach(self.bands[0].n_bins);
        let is_nearer = outer.mean_per_m() > surface.fit.plane().mean_per_m();
        let beyond = if is_nearer { Beyond::Nearer } else { Beyond::Farther };
        (reach != Reach::Short).then_some(AtEdge { surface, beyond, is_sure: reach == Reach::Edge })
    }

    /// What the cells in work show beyond the zones where depth bleeds.
    fn beyond(&self, plane: &Plane) -> Beyond {
        let tolerance_per_m = CELL_GATE_SIGMAS * self.model_per_m(plane.mean_per_m());
        let outer =
            || self.cells.iter().filter(|cell| cell.zone() >= INNER_ZONES).map(|cell| plane.residual(cell));
        let least = MIN_BEYOND * outer().count() as f64;
        let is_most = |n: usize| n > 0 && n as f64 >= least;
        if is_most(outer().filter(|residual_per_m| *residual_per_m < -tolerance_per_m).count()) {
            Beyond::Farther
        } else if is_most(outer().filter(|residual_per_m| *residual_per_m > tolerance_per_m).count()) {
            Beyond::Nearer
        } else {
            Beyond::Same
        }
    }

    /// Standard deviation of a reading before the residuals are known, 1/m.
    fn model_per_m(&self, inverse_depth_per_m: f64) -> f64 {
        let LiftOptions { sigma_inverse_depth_per_m, relative_systematic, .. } = self.options;
        sigma_inverse_depth_per_m.hypot(relative_systematic * inverse_depth_per_m)
    }

    /// The plane under most of the cells in work; `None` where too few readings agree.
    fn fit_side(&mut self, side: EdgeSide, length_px: f64) -> Option<Surface> {
        let band = &self.bands[usize::from(side == EdgeSide::Right)];
        let model_per_m = self.model_per_m(median_inverse_depth(&self.cells)?);
        let plane = plane::consensus(&self.cells, CELL_GATE_SIGMAS * model_per_m)?;
        let sigma_per_m = spread_per_m(&plane, band, (&mut self.sizes, model_per_m))?;
        let gate =
            Gate { reading_per_m: GATE_SIGMAS * sigma_per_m, cell_per_m: CELL_GATE_SIGMAS * sigma_per_m };
        // Twice: the first plane goes through three cells only.
        let rough = Agreement::with(&plane, band, gate).moments();
        let plane = least_squares([&rough, &Moments::default()], Shape::Plane)?.plane();
        let agreement = Agreement::with(&plane, band, gate);
        if agreement.n < MIN_INLIERS {
            return None;
        }
        let moments = agreement.moments();
        let fit = least_squares([&moments, &Moments::default()], Shape::Plane)?;
        let model_per_m = self.options.sigma_inverse_depth_per_m;
        let sigma_per_m = noise::reading_sigma_per_m(&[&agreement], length_px, model_per_m);
        let owner = Owner::on(&fit, side, (sigma_per_m, length_px));
        let scatter = Scatter::of(&agreement, &fit.plane(), (sigma_per_m, length_px));
        Some(Surface { fit, moments, agreement, owner, scatter })
    }

    /// The owner's depth as a result; `None` where too few readings agree or they cover too little of the segment.
    fn accepted<'a>(
        &self,
        owner: &Owner,
        sides: impl Iterator<Item = &'a Agreement> + Clone,
    ) -> Option<DepthFit> {
        let near = [0, 1].map(|i| sides.clone().map(|side| side.n_near[i]).sum::<f64>());
        let inlier_ratio = near[1] / near[0].max(1.0);
        let covered = sides.clone().fold(0, |bins, side| bins | side.covered).count_ones();
        let coverage = f64::from(covered) / self.bands[0].n_bins as f64;
        let usable = owner.ends_per_m.min() > 0.0;
        if !usable || inlier_ratio < self.options.min_inlier_ratio || coverage < self.options.min_coverage {
            return None;
        }
        Some(DepthFit {
            inverse_depth_per_m: owner.ends_per_m.into(),
            covariance_per_m2: owner.covariance_per_m2,
            inlier_ratio,
            n_inliers: sides.map(|side| side.n as u32).sum(),
            side: owner.side,
        })
    }
}

/// Robust deviation of the readings about a plane, within bounds about the sensor's; `None` where no cell agrees with it.
fn spread_per_m(plane: &Plane, band: &Band, (sizes, model_per_m): (&mut Vec<f64>, f64)) -> Option<f64> {
    let is_open = open_cells(plane, band, CELL_GATE_SIGMAS * model_per_m);
    let open = band.readings.iter().filter(|reading| is_open[usize::from(reading.cell)]);
    sizes.clear();
    sizes.reserve(band::MAX_READINGS);
    sizes.extend(open.map(|reading| plane.residual(reading).abs()));
    let middle = sizes.len() / 2;
    let median = (!sizes.is_empty()).then(|| *sizes.select_nth_unstable_by(middle, f64::total_cmp).1)?;
    let [least, most] = SIGMA_RANGE.map(|factor| factor * model_per_m);
    Some((DEVIATION_PER_MEDIAN * median).clamp(least, most))
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

#[cfg(test)]
mod tests;
