//! Where an edge truly is, from depth without noise.
//!
//! Exact depth does not bleed, so the surfaces a few pixels beside the edge are those that meet there: a plane is fitted on each
//! side, and the nearer one owns the edge unless both have the same depth at it.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use pelical::geometry::{Camera, DepthFit, EdgeSide, Segment};
use pelical::image::DepthView;

/// Where a side is read, px from the edge: beyond what a misplaced segment reaches, then closer, for bars of few pixels.
const WINDOWS_PX: [[f64; 2]; 2] = [[1.25, 4.0], [0.75, 2.5]];
/// How far exact depth may lie from a plane: absolute, 1/m, and as a share.
const ON_PLANE: [f64; 2] = [0.0005, 0.002];
/// Least share of a side's readings on its plane, and least number of them.
const MIN_SHARE: f64 = 0.8;
const MIN_READINGS: usize = 20;
/// Two sides have the same depth at the edge within this: absolute, 1/m, and as a share.
const SAME: [f64; 2] = [0.001, 0.003];
/// Planes tried on a side.
const HYPOTHESES: usize = 100;

/// The true inverse depth of an edge at the ends of a segment, 1/m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineTruth {
    /// At start and end, 1/m.
    pub inverse_depth_per_m: [f64; 2],
    /// The surface that owns the edge.
    pub side: EdgeSide,
}

/// Position along (0 to 1), px across, 1/m.
type Reading = [f64; 3];

impl LineTruth {
    /// The truth of a segment; `None` where no side has one plane beside it.
    pub fn of(segment: &Segment, exact: &DepthView<'_>, camera: &Camera) -> Option<Self> {
        let side = |sign: f64| {
            WINDOWS_PX
                .iter()
                .find_map(|window_px| plane(&readings(segment, exact, (camera, sign, *window_px))))
        };
        let (left, right) = (side(-1.0), side(1.0));
        let (ends, side) = match (left, right) {
            (Some(left), Some(right)) => {
                let is_same =
                    |i: usize| (left[i] - right[i]).abs() <= SAME[0] + SAME[1] * left[i].max(right[i]);
                if is_same(0) && is_same(1) {
                    ([0, 1].map(|i| 0.5 * (left[i] + right[i])), EdgeSide::Both)
                } else if left[0] + left[1] > right[0] + right[1] {
                    (left, EdgeSide::Left)
                } else {
                    (right, EdgeSide::Right)
                }
            }
            // What the other side is cannot be said, nor whether it stands before this one.
            _ => return None,
        };
        Some(Self { inverse_depth_per_m: ends, side })
    }

    /// Errors of a lifted line, whitened by its covariance: two numbers of unit variance where it is honest.
    pub fn whitened(&self, fit: &DepthFit) -> Option<Vector2<f64>> {
        let error = Vector2::from(fit.inverse_depth_per_m) - Vector2::from(self.inverse_depth_per_m);
        let factor: Matrix2<f64> = fit.covariance_per_m2.cholesky()?.l();
        factor.solve_lower_triangular(&error)
    }
}

fn readings(
    segment: &Segment,
    exact: &DepthView<'_>,
    (camera, sign, window_px): (&Camera, f64, [f64; 2]),
) -> Vec<Reading> {
    let (start, end, length_px) = (segment.start, segment.end, segment.length_px());
    let (dx, dy) = ((end.x - start.x) / length_px, (end.y - start.y) / length_px);
    let [from, to] = [start, end].map(|pixel| camera.ray_from_pixel(pixel));
    let (rx, ry) = (to.x - from.x, to.y - from.y);
    let mut found = Vec::new();
    let bounds = |a: f64, b: f64| (a.min(b) - 5.0).floor() as i64..=(a.max(b) + 5.0).ceil() as i64;
    for y in bounds(start.y, end.y) {
        for x in bounds(start.x, end.x) {
            let (px, py) = (x as f64 - start.x, y as f64 - start.y);
            let along_px = px * dx + py * dy;
            let across_px = py * dx - px * dy;
            let is_in = (0.0..=length_px).contains(&along_px)
                && (window_px[0]..window_px[1]).contains(&(sign * across_px));
            if let (true, Some(depth_m)) = (is_in, exact.depth_m(x, y)) {
                let foot =
                    pelical::geometry::PixelPoint { x: start.x + along_px * dx, y: start.y + along_px * dy };
                let ray = camera.ray_from_pixel(foot);
                let along = ((ray.x - from.x) * rx + (ray.y - from.y) * ry) / (rx * rx + ry * ry);
                found.push([along, across_px, 1.0 / depth_m]);
            }
        }
    }
    found
}

/// Inverse depth at both ends of the plane under most readings; `None` where there is none.
fn plane(readings: &[Reading]) -> Option<[f64; 2]> {
    if readings.len() < MIN_READINGS {
        return None;
    }
    let mut random = 1_u64;
    let mut pick = || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        &readings[(random >> 33) as usize % readings.len()]
    };
    let hypotheses = (0..HYPOTHESES).filter_map(|_| fit([pick(), pick(), pick()].into_iter()));
    let count = |plane: &Vector3<f64>| readings.iter().filter(|reading| is_on(plane, reading)).count();
    let best = hypotheses.max_by_key(count)?;
    let refined = fit(readings.iter().filter(|reading| is_on(&best, reading)))?;
    let share = count(&refined) as f64 / readings.len() as f64;
    (share >= MIN_SHARE).then_some([refined[0], refined[1]])
}

fn is_on(plane: &Vector3<f64>, [along, across_px, inverse_depth_per_m]: &Reading) -> bool {
    let model = (1.0 - along) * plane[0] + along * plane[1] + across_px * plane[2];
    (inverse_depth_per_m - model).abs() <= ON_PLANE[0] + ON_PLANE[1] * inverse_depth_per_m
}

fn fit<'a>(readings: impl Iterator<Item = &'a Reading>) -> Option<Vector3<f64>> {
    let (mut information, mut right_hand) = (Matrix3::<f64>::zeros(), Vector3::<f64>::zeros());
    for [along, across_px, inverse_depth_per_m] in readings {
        let row = Vector3::new(1.0 - along, *along, *across_px);
        information += row * row.transpose();
        right_hand += row * *inverse_depth_per_m;
    }
    Some(information.cholesky()?.solve(&right_hand))
}
