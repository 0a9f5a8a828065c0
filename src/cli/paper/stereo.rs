//! The paper's stereo experiment: a board seen by both cameras, merged by the estimated extrinsics (paper, section IV-A2).

use std::time::Duration;

use nalgebra::Point3;

use super::board::SeenBoard;
use super::configuration::Configuration;
use crate::capture::synthetic::{Checkerboard, SyntheticFactory, SyntheticOptions};
use crate::capture::{CaptureError, DeviceFactory, FrameSource, RgbdFrame};
use crate::geometry::PixelPoint;
use crate::geometry::motion::Motion;

/// Distances between the two parallel cameras, cm: the paper's near and far.
pub const BASELINES_CM: [u32; 2] = [30, 45];
/// Squares of 108 mm as in the paper's figure; seven by nine of them give its six rows of corners.
pub const BOARD: Checkerboard = Checkerboard { squares: [9, 7], square_m: 0.108 };
/// Snapshots of the board per room.
pub const SNAPSHOTS: u64 = 10;
/// Longest wait for a rendered frame: it is there at once.
const FRAME_WITHIN: Duration = Duration::from_secs(60);

/// The paper's three metrics.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Metrics {
    /// How far the mean side of a square, from the most distant corners of each merged row, is from the true one, mm.
    pub l_mm: f64,
    /// Difference of the two planes' distances from the origin, mm.
    pub d_mm: f64,
    /// Angle between the two planes, deg.
    pub theta_deg: f64,
}

impl Metrics {
    /// Merges the source camera's board into the target camera's frame.
    pub fn of(target: &SeenBoard, source: &SeenBoard, target_from_source: &Motion) -> Self {
        let moved: Vec<Point3<f64>> =
            source.corners_m.iter().map(|corner| target_from_source * corner).collect();
        let normal = target_from_source * source.plane.normal;
        // n · (R' (X - t)) = d for points X of the moved plane.
        let distance_m = source.plane.distance_m + normal.dot(&target_from_source.translation.vector);
        Self {
            l_mm: 1e3 * (mean_square_m(&target.corners_m, &moved) - BOARD.square_m).abs(),
            d_mm: 1e3 * (target.plane.distance_m - distance_m).abs(),
            theta_deg: target
                .plane
                .normal
                .cross(&normal)
                .norm()
                .atan2(target.plane.normal.dot(&normal))
                .to_degrees(),
        }
    }

    /// The mean of several snapshots; `None` of none.
    fn mean(all: &[Self]) -> Option<Self> {
        let mean = |of: fn(&Self) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        let mean_of_all =
            Self { l_mm: mean(|m| m.l_mm), d_mm: mean(|m| m.d_mm), theta_deg: mean(|m| m.theta_deg) };
        (!all.is_empty()).then_some(mean_of_all)
    }
}

/// Over the rows: distance of the two corners that are furthest apart, whichever camera saw them, over the squares between.
fn mean_square_m(target: &[Point3<f64>], source: &[Point3<f64>]) -> f64 {
    let per_row = BOARD.squares[0] as usize - 1;
    let rows = target.chunks(per_row).zip(source.chunks(per_row));
    let spans_m: Vec<f64> = rows
        .map(|(target, source)| {
            let merged = || target.iter().chain(source);
            let span = |a: &Point3<f64>| merged().map(|b| (b - a).norm()).fold(0.0, f64::max);
            merged().map(span).fold(0.0, f64::max)
        })
        .collect();
    spans_m.iter().sum::<f64>() / (spans_m.len().max(1) * (per_row - 1)) as f64
}

/// One room at one baseline.
#[derive(Debug, Clone, Copy)]
pub struct StereoTask {
    /// Distance between the cameras, cm.
    pub baseline_cm: u32,
    /// The room.
    pub seed: u64,
    /// What the calibration from the room without board came to.
    pub target_from_source: Motion,
}

/// What came of it, mean over the snapshots.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StereoTrial {
    /// Distance between the cameras, cm.
    pub baseline_cm: u32,
    /// The room.
    pub seed: u64,
    /// With the estimated extrinsics.
    pub estimated: Metrics,
    /// With the true extrinsics: what noise of depth and corners alone leaves.
    pub exact: Metrics,
}

/// Looks at the board and merges; `None` where no snapshot shows it.
///
/// # Errors
/// When a camera gives no frame, which synthetic cameras do not do.
pub fn run(task: &StereoTask) -> Result<Option<StereoTrial>, CaptureError> {
    let configuration = Configuration { angle_deg: 0, distance_cm: task.baseline_cm };
    let options = configuration.options(task.seed);
    // Noise of its own: the calibration had other frames.
    let noise_seed = options.noise_seed.map(|seed| seed + (1 << 19));
    let factory = SyntheticFactory::new(SyntheticOptions { board: Some(BOARD), noise_seed, ..options });
    let mut sources =
        factory.list()?.iter().map(|info| factory.open(&info.serial)).collect::<Result<Vec<_>, _>>()?;
    let truth = factory.truth();
    let [target, source] = [0, 1].map(|camera| truth.get(camera).copied().unwrap_or_default());
    let truth = target.inv_mul(&source);
    let (mut estimated, mut exact) = (Vec::new(), Vec::new());
    for set in 0..SNAPSHOTS {
        let seen = sources
            .iter_mut()
            .enumerate()
            .map(|(camera, source)| see(source.as_mut(), &factory.board_corners_in_camera_m(camera, set)));
        let seen = seen.collect::<Result<Vec<_>, _>>()?;
        if let [Some(target), Some(source)] = seen.as_slice() {
            estimated.push(Metrics::of(target, source, &task.target_from_source));
            exact.push(Metrics::of(target, source, &truth));
        }
    }
    let both = Metrics::mean(&estimated).zip(Metrics::mean(&exact));
    let StereoTask { baseline_cm, seed, .. } = *task;
    Ok(both.map(|(estimated, exact)| StereoTrial { baseline_cm, seed, estimated, exact }))
}

/// The board in the next frame. The true corners tell where to look, to the pixel, and nothing else.
fn see(source: &mut dyn FrameSource, corners_m: &[Point3<f64>]) -> Result<Option<SeenBoard>, CaptureError> {
    let mut frame = RgbdFrame::default();
    source.next_frame(&mut frame, FRAME_WITHIN)?;
    let camera = source.info().camera;
    let look_at = |corner: &Point3<f64>| {
        let pixel = camera.project(corner)?;
        Some(PixelPoint { x: pixel.x.round(), y: pixel.y.round() })
    };
    let near = corners_m.iter().map(look_at).collect::<Option<Vec<_>>>();
    Ok(near.filter(|near| !near.is_empty()).and_then(|near| SeenBoard::find(&frame, &camera, &near)))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Translation3, Unit, UnitQuaternion, Vector3};

    use super::*;
    use crate::capture::synthetic::Noise;
    use crate::cli::paper::board::Plane;

    const DISTANCE_M: f64 = 1.5;

    /// A board that stands square before a camera.
    fn board() -> SeenBoard {
        let [columns, rows] = BOARD.squares.map(|count| i64::from(count) - 1);
        let corner = |i: i64| {
            let (row, column) = ((i / columns) as f64, (i % columns) as f64);
            Point3::new((column - 3.5) * BOARD.square_m, (row - 2.5) * BOARD.square_m, DISTANCE_M)
        };
        let plane = Plane { normal: Unit::new_unchecked(Vector3::z()), distance_m: DISTANCE_M };
        SeenBoard { corners_m: (0..rows * columns).map(corner).collect(), plane }
    }

    #[track_caller]
    fn check_metrics(target_from_source: &Motion, [l_mm, d_mm, theta_deg]: [f64; 3]) {
        let found = Metrics::of(&board(), &board(), target_from_source);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-6;
        let all_near = near(found.l_mm, l_mm) && near(found.d_mm, d_mm) && near(found.theta_deg, theta_deg);
        assert!(all_near, "{found:?} instead of {:?}", [l_mm, d_mm, theta_deg]);
    }

    #[test]
    fn exact_extrinsics_merge_the_boards_without_error() {
        check_metrics(&Motion::identity(), [0.0; 3]);
    }

    #[test]
    fn a_shift_along_the_rows_lengthens_them() {
        // 14 mm more over seven squares.
        check_metrics(&Motion::translation(0.014, 0.0, 0.0), [2.0, 0.0, 0.0]);
    }

    #[test]
    fn a_shift_away_sets_the_planes_apart() {
        let span_m = 7.0 * BOARD.square_m;
        let l_mm = 1e3 * (span_m.hypot(0.010) - span_m) / 7.0;
        check_metrics(&Motion::translation(0.0, 0.0, 0.010), [l_mm, 10.0, 0.0]);
    }

    #[test]
    fn a_turn_shows_as_the_angle_between_the_planes() {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1f64.to_radians());
        let found = Metrics::of(&board(), &board(), &Motion::from_parts(Translation3::identity(), turn));
        assert!((found.theta_deg - 1.0).abs() < 1e-9 && found.d_mm.abs() < 1e-9, "{found:?}");
    }

    /// Both cameras look at the rendered board: how far corners and plane are from the truth, mm.
    fn measured(noise: Noise) -> (f64, f64) {
        let options = Configuration { angle_deg: 0, distance_cm: 45 }.options(3);
        let factory = SyntheticFactory::new(SyntheticOptions { board: Some(BOARD), noise, ..options });
        let (mut corners_mm, mut plane_mm): (f64, f64) = (0.0, 0.0);
        for (camera, info) in factory.list().unwrap().iter().enumerate() {
            let corners_m = factory.board_corners_in_camera_m(camera, 0);
            assert_eq!(corners_m.len(), 48, "camera {camera} does not see the whole board");
            let mut source = factory.open(&info.serial).unwrap();
            let seen = see(source.as_mut(), &corners_m).unwrap().expect("the board is in view");
            for (found, truth) in seen.corners_m.iter().zip(&corners_m) {
                // Across the ray, so that noise of depth does not count.
                let off = (found - truth).cross(&truth.coords.normalize()).norm();
                corners_mm = corners_mm.max(1e3 * off);
                plane_mm =
                    plane_mm.max(1e3 * (seen.plane.normal.dot(&truth.coords) - seen.plane.distance_m).abs());
            }
        }
        (corners_mm, plane_mm)
    }

    #[test]
    fn without_noise_the_board_is_found_where_it_is() {
        let (corners_mm, plane_mm) = measured(Noise::Off);
        // A pixel is 2.5 mm there, the unit of depth 1 mm. A picture without any blur leaves a fifth of a pixel to guessing.
        assert!(corners_mm < 0.5 && plane_mm < 0.3, "corners {corners_mm} mm, plane {plane_mm} mm");
    }

    #[test]
    fn with_noise_the_board_is_found_nearly_where_it_is() {
        let (corners_mm, plane_mm) = measured(Noise::D435i { disparity_sigma_px: 0.1 });
        assert!(corners_mm < 0.6 && plane_mm < 8.0, "corners {corners_mm} mm, plane {plane_mm} mm");
    }
}
