//! Measures how far one edge's places in two cameras' images differ beyond what either picture says of its noise.
//!
//! `cargo run --release --example view_sigma -- RECORDING...` takes recordings with ground truth. Lines that agree with the true pose
//! are compared; the deviation that makes the offsets across as large as stated is the answer (`VIEW_SIGMA_PX` of lifting).

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Parser;
use nalgebra::{Matrix2, Matrix4, Point3, SMatrix, Vector2};
use pelical::capture::RgbdFrame;
use pelical::capture::recording::Recording;
use pelical::geometry::motion::Motion;
use pelical::geometry::{Camera, LineObservation, RayPoint};
use pelical::image::{GrayView, gray_from_rgb};
use pelical::lines::{DetectOptions, Detector, LiftOptions, Lifter};

/// Lines farther apart than this, px, are of different edges.
const SAME_EDGE_PX: f64 = 2.0;
/// Offsets less sure than this, px, say nothing of a fraction of a pixel, and the limit above would cut them.
const SURE_PX: f64 = 0.4;
/// The same for inverse depths, in standard deviations.
const SAME_DEPTH_SIGMAS: f64 = 3.0;

#[derive(Parser)]
struct Arguments {
    /// Recordings with ground truth.
    recordings: Vec<PathBuf>,
}

/// Offset of a target segment's end from the projected line, px, with its variance from pictures and depth alone, and what a
/// variance of one square pixel more in each picture adds.
struct Offset {
    offset_px: f64,
    variance_px2: f64,
    per_view: f64,
}

fn main() -> Result<()> {
    let mut all = Vec::new();
    for folder in Arguments::parse().recordings {
        let found = offsets(&folder).with_context(|| folder.display().to_string())?;
        print(&folder.display().to_string(), &found);
        all.extend(found);
    }
    print("all", &all);
    Ok(())
}

fn print(title: &str, offsets: &[Offset]) {
    let scale = |sigma_px: f64| {
        let mut sizes: Vec<f64> = offsets
            .iter()
            .map(|o| o.offset_px.abs() / (o.variance_px2 + sigma_px * sigma_px * o.per_view).sqrt())
            .collect();
        sizes.sort_unstable_by(f64::total_cmp);
        1.4826 * sizes.get(sizes.len() / 2).copied().unwrap_or(f64::NAN)
    };
    let (mut low, mut high) = (0.0, 2.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if scale(middle) > 1.0 { low = middle } else { high = middle }
    }
    println!("{title}: {} offsets, scale {:.2} without, view sigma {low:.3} px", offsets.len(), scale(0.0));
}

fn offsets(folder: &Path) -> Result<Vec<Offset>> {
    let recording = Recording::open(folder)?;
    let truth = recording.ground_truth()?.context("a recording with ground truth")?;
    let mut found = Vec::new();
    for set in recording.frame_sets() {
        let mut views = Vec::new();
        for (camera_idx, (info, stamp)) in recording.cameras().iter().zip(set).enumerate() {
            let mut frame = RgbdFrame::default();
            recording.read_frame(camera_idx, *stamp, &mut frame)?;
            views.push((lines(&frame, &info.camera)?, info.camera, truth.reference_from_camera[camera_idx]));
        }
        for (i, (target, camera, reference_from_target)) in views.iter().enumerate() {
            for (j, (source, _, reference_from_source)) in views.iter().enumerate() {
                if i != j {
                    let target_from_source = reference_from_target.inverse() * reference_from_source;
                    for a in target {
                        found.extend(
                            source
                                .iter()
                                .filter_map(|b| compare(a, b, (&target_from_source, camera)))
                                .flatten(),
                        );
                    }
                }
            }
        }
    }
    Ok(found)
}

fn lines(frame: &RgbdFrame, camera: &Camera) -> Result<Vec<LineObservation>> {
    let (mut gray, mut segments, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    gray_from_rgb(&frame.rgb, &mut gray);
    let gray = GrayView::try_new(&gray, (frame.width, frame.height), frame.width).context("a whole image")?;
    Detector::new(DetectOptions::default()).detect(&gray, &mut segments);
    let depth = frame.depth_view().context("whole depth")?;
    Lifter::new(LiftOptions::default()).lift(&segments, &depth, camera, &mut lines);
    Ok(lines)
}

/// Two offsets across (plane z = 1) and two inverse depths, 1/m, of the moved source line at the target segment's ends.
fn predicted(target: &LineObservation, ends_m: [Point3<f64>; 2]) -> Option<[f64; 4]> {
    let normal = ends_m[0].coords.cross(&ends_m[1].coords);
    let size = normal.x.hypot(normal.y);
    let [a, b] = ends_m;
    if size < 1e-9 || a.z < 0.05 || b.z < 0.05 {
        return None;
    }
    let [pa, pb] = [a, b].map(|p| RayPoint { x: p.x / p.z, y: p.y / p.z });
    let (dx, dy) = (pb.x - pa.x, pb.y - pa.y);
    let mut values = [0.0; 4];
    for (i, end) in target.ends.iter().enumerate() {
        values[i] = (normal.x * end.x + normal.y * end.y + normal.z) / size;
        let share = ((end.x - pa.x) * dx + (end.y - pa.y) * dy) / (dx * dx + dy * dy);
        values[2 + i] = (1.0 - share) / a.z + share / b.z;
    }
    Some(values)
}

/// The source's ends in the target, displaced by offsets across and inverse depths.
fn moved(source: &LineObservation, by: [f64; 4], target_from_source: &Motion) -> Option<[Point3<f64>; 2]> {
    let depth = source.depth?.inverse_depth_per_m;
    let [start, end] = source.ends;
    let (dx, dy) = (end.x - start.x, end.y - start.y);
    let length = dx.hypot(dy);
    let at = |i: usize| {
        let ray = source.ends[i];
        let ray = RayPoint { x: ray.x - by[i] * dy / length, y: ray.y + by[i] * dx / length };
        target_from_source * ray.at_inverse_depth(depth[i] + by[2 + i])
    };
    Some([at(0), at(1)])
}

fn compare(
    target: &LineObservation,
    source: &LineObservation,
    (target_from_source, camera): (&Motion, &Camera),
) -> Option<[Offset; 2]> {
    let (of_target, of_source) = (target.depth?, source.depth?);
    let focal_px = camera.mean_focal_px();
    let ends_m = moved(source, [0.0; 4], target_from_source)?;
    let values = predicted(target, ends_m)?;
    if values[0].abs().max(values[1].abs()) * focal_px > SAME_EDGE_PX {
        return None;
    }
    let mut d_values = SMatrix::<f64, 4, 4>::zeros();
    for i in 0..4 {
        let step = 1e-6;
        let mut by = [0.0; 4];
        by[i] = step;
        let changed = predicted(target, moved(source, by, target_from_source)?)?;
        (0..4).for_each(|row| d_values[(row, i)] = (changed[row] - values[row]) / step);
    }
    let d_across = d_values.fixed_columns::<2>(0).into_owned();
    let d_depth = d_values.fixed_columns::<2>(2).into_owned();
    let from_depth: Matrix4<f64> = d_depth * of_source.covariance_per_m2 * d_depth.transpose();
    let across = |line: &LineObservation| (line.segment.sigma_across_px / focal_px).powi(2);
    let from_across: Matrix4<f64> = d_across * d_across.transpose();
    let covariance = from_depth + from_across * across(source);
    // The depths have to agree.
    let gap = Vector2::from(of_target.inverse_depth_per_m) - Vector2::new(values[2], values[3]);
    let depths: Matrix2<f64> = covariance.fixed_view::<2, 2>(2, 2) + of_target.covariance_per_m2;
    if gap.dot(&(depths.try_inverse()? * gap)) > SAME_DEPTH_SIGMAS * SAME_DEPTH_SIGMAS {
        return None;
    }
    let [a, b] = ends_m.map(|p| camera.project(&p));
    let (a, b, length_px) = (a?, b?, target.segment.length_px());
    let (start, end) = (target.segment.start, target.segment.end);
    let share = |p: pelical::geometry::PixelPoint| {
        ((p.x - start.x) * (end.x - start.x) + (p.y - start.y) * (end.y - start.y)) / (length_px * length_px)
    };
    let (from, to) = (share(a), share(b));
    // Also refuses lines that run the other way: the brighter side is on the same hand.
    if to <= from {
        return None;
    }
    let offsets = [0, 1].map(|i| Offset {
        offset_px: values[i] * focal_px,
        variance_px2: (covariance[(i, i)] + across(target)) * focal_px * focal_px,
        per_view: 1.0 + from_across[(i, i)],
    });
    offsets.iter().all(|offset| offset.variance_px2 < SURE_PX * SURE_PX).then_some(offsets)
}
