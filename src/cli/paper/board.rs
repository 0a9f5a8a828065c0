//! The checkerboard as one camera measures it: corners in the noisy picture, the plane in the noisy depth.
//!
//! Where to look is told in whole pixels, as a board detector would; everything else comes from the frame.

use nalgebra::{Matrix2, Matrix3, Point3, Unit, Vector2, Vector3};

use crate::capture::RgbdFrame;
use crate::geometry::{Camera, PixelPoint};

/// Half the side of the window around a corner, px: a quarter of a square.
const WINDOW_PX: i64 = 9;
/// Rounds of the corner's place.
const ROUNDS: usize = 12;
/// A corner that wanders this far from where it was looked for is none, px.
const MAX_WAY_PX: f64 = 4.0;
/// Rounds of the plane: a fit, then fits without the readings that the last one contradicts.
const PLANE_ROUNDS: usize = 4;
/// Readings further off than this many robust standard deviations are left out.
const PLANE_GATE: f64 = 3.0;
/// Least number of depth readings on the board.
const MIN_READINGS: usize = 500;

/// A plane that does not run through the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// Away from the origin.
    pub normal: Unit<Vector3<f64>>,
    /// From the origin, above 0, m.
    pub distance_m: f64,
}

impl Plane {
    /// The plane `n · X = 1`; `None` where `n` is no finite vector.
    fn from_scaled_normal(scaled_per_m: Vector3<f64>) -> Option<Self> {
        let length_per_m = scaled_per_m.norm();
        let usable = length_per_m.is_finite() && length_per_m > 1e-9;
        usable.then(|| Self {
            normal: Unit::new_unchecked(scaled_per_m / length_per_m),
            distance_m: 1.0 / length_per_m,
        })
    }
}

/// The board in the frame of the camera that saw it.
#[derive(Debug, Clone, PartialEq)]
pub struct SeenBoard {
    /// Inner corners on the plane, in the order they were looked for, m.
    pub corners_m: Vec<Point3<f64>>,
    /// The board's plane.
    pub plane: Plane,
}

impl SeenBoard {
    /// Finds corners near the given pixels and the plane in the depth between them; `None` where a corner or the depth is missing.
    pub fn find(frame: &RgbdFrame, camera: &Camera, near: &[PixelPoint]) -> Option<Self> {
        let corners = near.iter().map(|&near| refined_corner(frame, near)).collect::<Option<Vec<_>>>()?;
        let plane = fitted_plane(frame, camera, &corners)?;
        let on_plane = |&corner: &PixelPoint| {
            let ray = camera.ray_from_pixel(corner);
            // X = z ray and normal · X = distance.
            let per_m = plane.normal.dot(&Vector3::new(ray.x, ray.y, 1.0)) / plane.distance_m;
            ray.at_inverse_depth(per_m)
        };
        Some(Self { corners_m: corners.iter().map(on_plane).collect(), plane })
    }
}

/// Brightness of a pixel; 0 outside the picture.
fn gray(frame: &RgbdFrame, x: i64, y: i64) -> f64 {
    let (width, height) = (frame.width as i64, frame.height as i64);
    if !(0..width).contains(&x) || !(0..height).contains(&y) {
        return 0.0;
    }
    let at = 3 * (y * width + x) as usize;
    frame.rgb.get(at..at + 3).map_or(0.0, |rgb| rgb.iter().map(|&value| f64::from(value)).sum::<f64>() / 3.0)
}

/// The point that every gradient around looks past at a right angle (Förstner): at each pixel `g · (q - p) = 0`.
fn refined_corner(frame: &RgbdFrame, near: PixelPoint) -> Option<PixelPoint> {
    let start = Vector2::new(near.x, near.y);
    let mut corner = start;
    for _ in 0..ROUNDS {
        let (column, row) = (corner.x.round() as i64, corner.y.round() as i64);
        let (mut sum, mut moment) = (Matrix2::zeros(), Vector2::zeros());
        for y in row - WINDOW_PX..=row + WINDOW_PX {
            for x in column - WINDOW_PX..=column + WINDOW_PX {
                let place = Vector2::new(x as f64, y as f64);
                let gradient = Vector2::new(
                    gray(frame, x + 1, y) - gray(frame, x - 1, y),
                    gray(frame, x, y + 1) - gray(frame, x, y - 1),
                );
                // Pixels near the corner count more, those at the rim of the window hardly.
                let away = (place - corner).norm_squared() / (WINDOW_PX * WINDOW_PX) as f64;
                let weighted = gradient * gradient.transpose() * (-2.0 * away).exp();
                sum += weighted;
                moment += weighted * place;
            }
        }
        corner = sum.try_inverse()? * moment;
    }
    ((corner - start).norm() < MAX_WAY_PX).then_some(PixelPoint { x: corner.x, y: corner.y })
}

/// The plane through the depth inside the corners' bounds. On a plane `n · X = 1` inverse depth is `n · ray`, linear in `n`, and
/// stereo noise is uniform in it: least squares, then without outliers.
fn fitted_plane(frame: &RgbdFrame, camera: &Camera, corners: &[PixelPoint]) -> Option<Plane> {
    let readings = readings_within(frame, camera, corners);
    if readings.len() < MIN_READINGS {
        return None;
    }
    let mut gate_per_m = f64::INFINITY;
    let mut scaled_per_m = Vector3::zeros();
    for _ in 0..PLANE_ROUNDS {
        let off = |(ray, per_m): &(Vector3<f64>, f64)| (per_m - scaled_per_m.dot(ray)).abs();
        let (mut sum, mut moment) = (Matrix3::zeros(), Vector3::zeros());
        for reading in readings.iter().filter(|reading| off(reading) <= gate_per_m) {
            sum += reading.0 * reading.0.transpose();
            moment += reading.0 * reading.1;
        }
        scaled_per_m = sum.cholesky()?.solve(&moment);
        let mut offs: Vec<f64> =
            readings.iter().map(|(ray, per_m)| (per_m - scaled_per_m.dot(ray)).abs()).collect();
        offs.sort_by(f64::total_cmp);
        gate_per_m = PLANE_GATE * 1.4826 * offs.get(offs.len() / 2)?;
    }
    Plane::from_scaled_normal(scaled_per_m)
}

/// Rays with their inverse depth (1/m) inside the quadrilateral of the board's outer corners.
fn readings_within(frame: &RgbdFrame, camera: &Camera, corners: &[PixelPoint]) -> Vec<(Vector3<f64>, f64)> {
    let Some(depth) = frame.depth_view() else { return Vec::new() };
    let outline = convex_outline(corners);
    let mut readings = Vec::new();
    for y in 0..frame.height as i64 {
        for x in 0..frame.width as i64 {
            let pixel = PixelPoint { x: x as f64, y: y as f64 };
            if !is_inside(&outline, pixel) {
                continue;
            }
            if let Some(depth_m) = depth.depth_m(x, y) {
                let ray = camera.ray_from_pixel(pixel);
                readings.push((Vector3::new(ray.x, ray.y, 1.0), 1.0 / depth_m));
            }
        }
    }
    readings
}

fn turn(a: PixelPoint, b: PixelPoint, c: PixelPoint) -> f64 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// Andrew's monotone chain.
fn convex_outline(points: &[PixelPoint]) -> Vec<PixelPoint> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    let chain = |points: &mut dyn Iterator<Item = &PixelPoint>| {
        let mut chain: Vec<PixelPoint> = Vec::new();
        for &point in points {
            while chain.len() > 1 && turn(chain[chain.len() - 2], chain[chain.len() - 1], point) <= 0.0 {
                chain.pop();
            }
            chain.push(point);
        }
        // The last point of a chain is the first of the other.
        chain.pop();
        chain
    };
    let mut outline = chain(&mut sorted.iter());
    outline.extend(chain(&mut sorted.iter().rev()));
    outline
}

fn is_inside(outline: &[PixelPoint], point: PixelPoint) -> bool {
    let next = outline.iter().cycle().skip(1);
    outline.len() > 2 && outline.iter().zip(next).all(|(&a, &b)| turn(a, b, point) >= 0.0)
}
