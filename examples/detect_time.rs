//! Time of segment detection on one core, image by image: `cargo run --release --example detect_time -- [--rounds N] IMAGE...`
//!
//! Prints `IMAGE SEGMENTS GRAY_MS COLOUR_MS LSDETECT_MS`: medians of all rounds in processor time, from an image in memory to its
//! segments; of the gray image alone, with colour, and of the gray image with the crate lsdetect (set `RAYON_NUM_THREADS=1`).
//! `scripts/compare_detectors.py time` runs it beside OpenCV.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Parser;
use pelical::image::{GrayView, RgbView, gray_from_rgb};
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

/// Processor time of this process and all its threads, ms: what other programs do on the machine is not in it.
fn processor_ms() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}

fn median_ms(rounds: usize, mut work: impl FnMut()) -> f64 {
    let mut times_ms: Vec<f64> = (0..rounds.max(1))
        .map(|_| {
            let start_ms = processor_ms();
            work();
            processor_ms() - start_ms
        })
        .collect();
    times_ms.sort_by(f64::total_cmp);
    times_ms[times_ms.len() / 2]
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let (mut detector, mut segments) = (Detector::new(DetectOptions::default()), Vec::new());
    let mut pixels = Vec::new();
    for path in &arguments.images {
        let image = image::open(path).with_context(|| path.display().to_string())?.to_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        gray_from_rgb(image.as_raw(), &mut pixels);
        let gray = GrayView::try_new(&pixels, (width, height), width).context("an empty image")?;
        let rgb = RgbView::try_new(image.as_raw(), (width, height), 3 * width).context("an empty image")?;
        let gray_ms = median_ms(arguments.rounds, || detector.detect(&gray, &mut segments));
        let n_segments = segments.len();
        let colour_ms = median_ms(arguments.rounds, || detector.detect_color(&gray, &rgb, &mut segments));
        let lsdetect_ms = median_ms(arguments.rounds, || {
            drop(lsdetect::detect(&pixels, width, height, lsdetect::SCALE));
        });
        println!("{} {n_segments} {gray_ms:.3} {colour_ms:.3} {lsdetect_ms:.3}", path.display());
    }
    Ok(())
}
