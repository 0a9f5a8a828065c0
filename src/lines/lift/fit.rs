//! Least squares over the readings that agree with a plane, gathered per cell; one side alone or both that meet.
use nalgebra::{Matrix4, Vector4};

use super::band::{Band, MAX_BINS, Reading, ZONES};
use super::plane::Plane;

/// Readings farther from the edge do not enter the inlier ratio, px: most of that surface may be another's.
const RATIO_BAND_PX: f64 = 4.75;

/// How the two sides are tied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// One plane under all readings.
    Plane,
    /// Two planes that meet at the edge.
    Crease,
}

/// How far from a plane depth may lie to agree with it, 1/m.
#[derive(Debug, Clone, Copy)]
pub struct Gate {
    /// A single reading.
    pub reading_per_m: f64,
    /// The median of a cell: less noisy, so it tells surfaces apart whose readings overlap.
    pub cell_per_m: f64,
}

/// Sums over the agreeing readings of a cell.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    n: f64,
    along: f64,
    across_px: f64,
    inverse_depth_per_m: f64,
}

/// The readings of one side that agree with its plane.
#[derive(Debug, Clone, Copy)]
pub struct Agreement {
    sums: [Sums; ZONES * MAX_BINS],
    /// Sum of squared residuals, 1/m².
    pub sum_per_m2: f64,
    /// Number of readings that agree.
    pub n: f64,
    /// Readings beside the edge, and those of them that agree.
    pub n_near: [f64; 2],
    /// Bins with agreeing readings beside the edge, one bit each.
    pub covered: u16,
}

impl Agreement {
    /// The readings within the gate of `plane`, in cells whose median is.
    pub fn with(plane: &Plane, band: &Band, gate: Gate) -> Self {
        let sums = [Sums::default(); ZONES * MAX_BINS];
        let mut found = Self { sums, sum_per_m2: 0.0, n: 0.0, n_near: [0.0; 2], covered: 0 };
        let mut is_open = [false; ZONES * MAX_BINS];
        for cell in &band.cells {
            is_open[usize::from(cell.cell)] = plane.residual(cell).abs() <= gate.cell_per_m;
        }
        for reading in &band.readings {
            let is_near = reading.across_px.abs() <= RATIO_BAND_PX;
            found.n_near[0] += f64::from(u8::from(is_near));
            let residual_per_m = plane.residual(reading);
            if is_open[usize::from(reading.cell)] && residual_per_m.abs() <= gate.reading_per_m {
                found.add(reading, residual_per_m);
                if is_near {
                    found.n_near[1] += 1.0;
                    found.covered |= 1 << reading.bin();
                }
            }
        }
        found
    }

    fn add(&mut self, reading: &Reading, residual_per_m: f64) {
        let sums = &mut self.sums[usize::from(reading.cell)];
        sums.n += 1.0;
        sums.along += reading.along;
        sums.across_px += reading.across_px;
        sums.inverse_depth_per_m += reading.inverse_depth_per_m;
        self.sum_per_m2 += residual_per_m * residual_per_m;
        self.n += 1.0;
    }
}

/// A least-squares surface: `[at the start, at the end, slope left (or everywhere), slope right]`.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceFit {
    /// 1/m and 1/m per px.
    pub surface: Vector4<f64>,
    /// Its covariance for independent readings of unit variance.
    pub unit_covariance: Matrix4<f64>,
}

/// Least squares over one or two sides; `None` where the readings do not fix the surface.
pub fn least_squares<'a>(sides: impl Iterator<Item = &'a Agreement>, shape: Shape) -> Option<SurfaceFit> {
    let mut information = Matrix4::<f64>::zeros();
    let mut right_hand = Vector4::<f64>::zeros();
    for sums in sides.flat_map(|side| &side.sums).filter(|sums| sums.n > 0.0) {
        let (along, across_px) = (sums.along / sums.n, sums.across_px / sums.n);
        let [left, right] = match shape {
            Shape::Plane => [across_px, 0.0],
            Shape::Crease => [across_px.min(0.0), across_px.max(0.0)],
        };
        let row = Vector4::new(1.0 - along, along, left, right);
        information.ger(sums.n, &row, &row, 1.0);
        right_hand.axpy(sums.inverse_depth_per_m, &row, 1.0);
    }
    // Slopes that nothing measures stay at zero.
    let weak = 1e-6;
    information[(2, 2)] += weak;
    information[(3, 3)] += weak;
    let unit_covariance = information.cholesky()?.inverse();
    let surface = unit_covariance * right_hand;
    surface.iter().all(|value| value.is_finite()).then_some(SurfaceFit { surface, unit_covariance })
}
