//! Compares lifted lines with depth without noise: are their covariances honest?
//!
//! `cargo run --release --example lift_honesty -- RECORDING...` takes recordings with `debug/depth_true_quarter_mm/<camera>/<stamp>.png`
//! (uint16, 0.25 mm); without one, synthetic cameras. Errors are whitened by each line's covariance: robust scale 1 is honest.

mod report;
mod truth;

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result};
use clap::Parser;
use pelical::capture::recording::Recording;
use pelical::capture::synthetic::{Noise, SyntheticFactory, SyntheticOptions};
use pelical::capture::{CaptureError, DeviceFactory, RgbdFrame};
use pelical::geometry::Camera;
use pelical::image::{DepthView, GrayView, gray_from_rgb};
use pelical::lines::{DetectOptions, Detector, LiftOptions, Lifter};
use report::{Judged, print_report};
use truth::LineTruth;

/// Metres per count of depth without noise.
const EXACT_UNIT_M: f64 = 0.000_25;
/// Frame sets of the synthetic rig.
const SYNTHETIC_SETS: u64 = 10;

#[derive(Parser)]
struct Arguments {
    /// Recordings with depth without noise.
    recordings: Vec<PathBuf>,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let mut all = Vec::new();
    for folder in &arguments.recordings {
        let found = judge_recording(folder).with_context(|| folder.display().to_string())?;
        print_report(&folder.display().to_string(), &found);
        all.extend(found);
    }
    if arguments.recordings.is_empty() {
        all = judge_synthetic()?;
    }
    print_report("all", &all);
    Ok(())
}

fn judge_recording(folder: &Path) -> Result<Vec<Judged>> {
    let recording = Recording::open(folder)?;
    let (mut frame, mut judged) = (RgbdFrame::default(), Vec::new());
    for (camera_idx, info) in recording.cameras().iter().enumerate() {
        let exact_folder = folder.join("debug/depth_true_quarter_mm").join(&info.name);
        for set in recording.frame_sets() {
            recording.read_frame(camera_idx, set[camera_idx], &mut frame)?;
            let file = exact_folder.join(format!("{}.png", set[camera_idx].0));
            let image = image::open(&file).with_context(|| file.display().to_string())?.into_luma16();
            judge(&frame, (image.as_raw(), &info.camera), &mut judged)?;
        }
    }
    Ok(judged)
}

/// The same views with and without noise.
fn judge_synthetic() -> Result<Vec<Judged>> {
    let timeout = Duration::from_secs(10);
    let mut judged = Vec::new();
    for seed in [1, 2] {
        let noisy =
            SyntheticOptions { frame_sets: Some(SYNTHETIC_SETS), ..SyntheticOptions::pair(40.0, 0.3, seed) };
        let mut exact = SyntheticOptions { noise: Noise::Off, ..noisy.clone() };
        exact.cameras.iter_mut().for_each(|camera| camera.info.depth_unit_m = EXACT_UNIT_M);
        let (noisy, exact) = (SyntheticFactory::new(noisy), SyntheticFactory::new(exact));
        for info in noisy.list()? {
            let (mut noisy, mut exact) = (noisy.open(&info.serial)?, exact.open(&info.serial)?);
            let (mut frame, mut exact_frame) = (RgbdFrame::default(), RgbdFrame::default());
            loop {
                match noisy.next_frame(&mut frame, timeout) {
                    Err(CaptureError::EndOfStream) => break,
                    other => other?,
                }
                exact.next_frame(&mut exact_frame, timeout)?;
                judge(&frame, (&exact_frame.depth, &info.camera), &mut judged)?;
            }
        }
    }
    Ok(judged)
}

fn judge(frame: &RgbdFrame, (exact, camera): (&[u16], &Camera), judged: &mut Vec<Judged>) -> Result<()> {
    let size = (frame.width, frame.height);
    let mut gray = Vec::new();
    gray_from_rgb(&frame.rgb, &mut gray);
    let gray = GrayView::try_new(&gray, size, frame.width).context("a whole image")?;
    let depth = frame.depth_view().context("whole depth")?;
    let exact = DepthView::try_new(exact, size, frame.width, EXACT_UNIT_M).context("whole exact depth")?;
    let (mut segments, mut lines) = (Vec::new(), Vec::new());
    Detector::new(DetectOptions::default()).detect(&gray, &mut segments);
    Lifter::new(LiftOptions::default()).lift(&segments, &depth, camera, &mut lines);
    judged.extend(lines.iter().map(|line| Judged {
        length_px: line.segment.length_px(),
        fit: line.depth,
        truth: LineTruth::of(&line.segment, &exact, camera),
    }));
    Ok(())
}
