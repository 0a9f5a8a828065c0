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
            theta_deg: target.plane.normal.cross(&normal).norm().atan2(target.plane.normal.dot(&normal)).to_degrees(),
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
        let seen = sources.iter_mut().enumerate().map(|(camera, source)| {
            see(source.as_mut(), &factory.board_corners_in_camera_m(camera, set))
        });
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
