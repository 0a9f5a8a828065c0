//! Robust fits of surfaces beside an edge. The inverse depth of a plane is affine in the image, so each surface is
//! `(1 - along) start + along end + slope across`, whatever its tilt; at the edge itself `across` is 0.
use nalgebra::{Matrix4, Vector4};

use super::band::{Cell, Reading, ZONES};

/// Hypotheses tried per side.
const HYPOTHESES: usize = 48;
/// Trust in a cell by zone: near the edge the surface is that of the edge, far away it may be another.
const ZONE_WEIGHT: [f64; ZONES] = [1.0, 1.0, 0.8, 0.6];
/// Steepest surface beside an edge, 1/m per px: a plane seen edge-on at 0.2 m by a lens of 500 px has 0.01.
const MAX_SLOPE_PER_M_PX: f64 = 0.02;

/// How inverse depth depends on the position beside the edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// One plane under all readings.
    Plane,
    /// Two planes that meet at the edge.
    Crease,
}

/// `[at the start, at the end, slope left (or everywhere), slope right]`; 1/m and 1/m per px.
pub type Surface = Vector4<f64>;

/// Row of the design matrix.
fn row(reading: &Reading, shape: Shape) -> Vector4<f64> {
    let [left, right] = match shape {
        Shape::Plane => [reading.across_px, 0.0],
        Shape::Crease => [reading.across_px.min(0.0), reading.across_px.max(0.0)],
    };
    Vector4::new(1.0 - reading.along, reading.along, left, right)
}

/// Measured minus modelled inverse depth, 1/m.
pub fn residual(surface: &Surface, reading: &Reading, shape: Shape) -> f64 {
    reading.inverse_depth_per_m - row(reading, shape).dot(surface)
}

/// The plane that most cells of one side agree with, within `tolerance_per_m`; `None` with too few cells.
pub fn consensus(cells: &[Cell], tolerance_per_m: f64) -> Option<Surface> {
    let score = |surface: &Surface| -> f64 {
        let gain = |cell: &Cell| {
            let ratio = residual(surface, &cell.reading, Shape::Plane) / tolerance_per_m;
            ZONE_WEIGHT[cell.zone] * (1.0 - ratio * ratio).max(0.0)
        };
        cells.iter().map(gain).sum()
    };
    let mut best: Option<(f64, Surface)> = None;
    let mut random = 0x9E37_79B9_7F4A_7C15_u64;
    for _ in 0..HYPOTHESES {
        let mut pick = || {
            // A fixed linear congruential sequence: the same cells give the same plane.
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            cells.get((random >> 33) as usize % cells.len().max(1))
        };
        let Some(surface) = through([pick()?, pick()?, pick()?]) else { continue };
        let score = score(&surface);
        if best.is_none_or(|(best, _)| score > best) {
            best = Some((score, surface));
        }
    }
    let (_, surface) = best?;
    let agreeing = cells
        .iter()
        .map(|cell| &cell.reading)
        .filter(|reading| residual(&surface, reading, Shape::Plane).abs() < tolerance_per_m);
    least_squares(agreeing, Shape::Plane).map(|fit| fit.surface)
}

/// The plane through three cells; `None` where they do not fix one or it is too steep to be a surface.
fn through(cells: [&Cell; 3]) -> Option<Surface> {
    let fit = least_squares(cells.into_iter().map(|cell| &cell.reading), Shape::Plane)?;
    (fit.surface[2].abs() <= MAX_SLOPE_PER_M_PX).then_some(fit.surface)
}

/// A least-squares surface.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceFit {
    /// The surface.
    pub surface: Surface,
    /// Its covariance for independent readings of unit variance.
    pub unit_covariance: Matrix4<f64>,
}

/// Least squares over readings; `None` with fewer than three or where they do not fix the surface.
pub fn least_squares<'a>(readings: impl Iterator<Item = &'a Reading>, shape: Shape) -> Option<SurfaceFit> {
    let mut information = Matrix4::<f64>::zeros();
    let mut right_hand = Vector4::<f64>::zeros();
    let mut n = 0;
    for reading in readings {
        let row = row(reading, shape);
        information.ger(1.0, &row, &row, 1.0);
        right_hand.axpy(reading.inverse_depth_per_m, &row, 1.0);
        n += 1;
    }
    // Slopes that nothing measures stay at zero.
    let weak = 1e-6;
    information[(2, 2)] += weak;
    information[(3, 3)] += weak;
    let inverse = information.cholesky().filter(|_| n >= 3)?.inverse();
    let surface = inverse * right_hand;
    surface.iter().all(|value| value.is_finite()).then_some(SurfaceFit { surface, unit_covariance: inverse })
}
