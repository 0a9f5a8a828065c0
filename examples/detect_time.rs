//! Time of segment detection on one core, image by image: `cargo run --release --example detect_time -- [--rounds N] IMAGE...`
//!
//! Prints `IMAGE SEGMENTS MILLISECONDS`, the median of all rounds in processor time, from RGB in memory to segments; reading is not counted.
//! `scripts/compare_detectors.py time` runs it beside OpenCV.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use pelical::image::{GrayView, gray_from_rgb};
use pelical::lines::{DetectOptions, Detector};

#[derive(Parser)]
struct Arguments {
    /// PNG or JPEG images.
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// How often each image is looked at.
    #[arg(long, default_value_t = 20)]
    rounds: usize,
}

/// Processor time of this thread, ms: what other programs do on the machine is not in it.
fn processor_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let (mut detector, mut segments) = (Detector::new(DetectOptions::default()), Vec::new());
    let mut gray = Vec::new();
    for path in &arguments.images {
        let image = image::open(path).with_context(|| path.display().to_string())?.to_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let mut times_ms = Vec::new();
        for _ in 0..arguments.rounds.max(1) {
            let start_ms = processor_ms();
            gray_from_rgb(image.as_raw(), &mut gray);
            let view = GrayView::try_new(&gray, (width, height), width).context("an empty image")?;
            detector.detect(&view, &mut segments);
            times_ms.push(processor_ms() - start_ms);
        }
        times_ms.sort_by(f64::total_cmp);
        println!("{} {} {:.3}", path.display(), segments.len(), times_ms[times_ms.len() / 2]);
    }
    Ok(())
}
