//! Measures the live pipeline at 30 frames per second: drops, time per image, latency, resident memory.
//!
//! `cargo run --release --example realtime -- [--seconds N] [--view-frames N] [RECORDING]`. Without a recording two synthetic cameras are
//! used. Frames are rendered or decoded before the clock starts and then played round and round, so that the camera's cost is not
//! the pipeline's. `--view-frames` shows each frame that often in a row. Collecting begins anew whenever it has converged.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Parser;
use pelical::capture::recording::Recording;
use pelical::capture::replay::{Pace, ReplayFactory, ReplayOptions};
use pelical::capture::synthetic::{SyntheticFactory, SyntheticOptions};
use pelical::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame, StampNs};
use pelical::pipeline::{
    CameraSlot, Command, LatencySummary, MotionOptions, Pipeline, PipelineEvent, PipelineOptions, Snapshot,
};

/// Time between frames, ns.
const PERIOD_NS: u64 = 33_333_333;
/// Different frames per camera that are kept in memory, 1.5 MB each.
const FRAMES_AHEAD: usize = 40;
/// Time between two lines of output.
const REPORT_EVERY: Duration = Duration::from_secs(10);

#[derive(Parser)]
struct Arguments {
    /// A recording; its first two cameras are played.
    recording: Option<PathBuf>,
    /// How long.
    #[arg(long, default_value_t = 60)]
    seconds: u64,
    /// How many times each frame is shown in a row.
    #[arg(long, default_value_t = 1)]
    view_frames: u64,
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let source = source(arguments.recording.as_deref())?;
    let infos = source.list()?;
    ensure!(infos.len() >= 2, "at least two cameras are needed, there is {}", infos.len());
    let clock = Arc::new(OnceLock::new());
    let mut cameras = Vec::new();
    for info in infos.into_iter().take(2) {
        let frames = read_ahead(source.as_ref(), &info)?;
        let (serial, name) = (info.serial.clone(), info.name.clone());
        let looped = Looped { info, frames, clock: Arc::clone(&clock), view_frames: arguments.view_frames };
        cameras.push(CameraSlot { factory: Arc::new(looped), serial, name });
    }
    run(cameras, Duration::from_secs(arguments.seconds))
}

fn source(recording: Option<&Path>) -> Result<Box<dyn DeviceFactory>> {
    let Some(folder) = recording else {
        return Ok(Box::new(SyntheticFactory::new(SyntheticOptions::pair(40.0, 0.3, 7))));
    };
    let options = ReplayOptions { pace: Pace::Unpaced, ..ReplayOptions::default() };
    Ok(Box::new(ReplayFactory::new(Recording::open(folder)?, options)?))
}

fn read_ahead(factory: &dyn DeviceFactory, info: &CameraInfo) -> Result<Arc<[RgbdFrame]>> {
    let mut source = factory.open(&info.serial)?;
    let mut frames = Vec::new();
    while frames.len() < FRAMES_AHEAD {
        let mut frame = RgbdFrame::default();
        match source.next_frame(&mut frame, Duration::from_secs(10)) {
            Ok(()) => frames.push(frame),
            Err(CaptureError::EndOfStream) => break,
            Err(error) => return Err(error).with_context(|| format!("camera {}", info.name)),
        }
    }
    ensure!(!frames.is_empty(), "camera {} has no frames", info.name);
    Ok(frames.into())
}

fn run(cameras: Vec<CameraSlot>, duration: Duration) -> Result<()> {
    let (sender, events) = crossbeam_channel::bounded(64);
    // The views jump from frame to frame here; that must not keep the estimator idle.
    let motion = MotionOptions { max_turn_rad_per_s: f64::INFINITY };
    let options = PipelineOptions { motion, ..PipelineOptions::default() };
    let pipeline = Pipeline::start(cameras, &options, sender)?;
    let start = Instant::now();
    let mut next_report = REPORT_EVERY;
    let (mut n_progress, mut n_lines) = (0u64, 0u64);
    while start.elapsed() < duration {
        match events.recv_timeout(Duration::from_millis(100)) {
            Ok(PipelineEvent::Progress(progress)) => {
                n_progress += 1;
                n_lines += progress.cameras.iter().map(|camera| u64::from(camera.lines)).sum::<u64>();
            }
            Ok(PipelineEvent::Calibration(solved)) => {
                let state = solved.calibration.state.name();
                println!("  solved in {:.0} ms: {state}", solved.took.as_secs_f64() * 1e3);
                // Busy unless it has converged.
                pipeline.command(Command::Recalibrate);
            }
            Ok(other) => println!("  {other:?}"),
            Err(_) => {}
        }
        if start.elapsed() >= next_report {
            next_report += REPORT_EVERY;
            report(start.elapsed(), &pipeline.snapshot());
        }
    }
    let snapshot = pipeline.snapshot();
    println!("lines per image: {:.0}", n_lines as f64 / (2 * n_progress).max(1) as f64);
    print_latencies(&snapshot);
    println!("{:#?}", snapshot.counts);
    println!("stop: {:?}", pipeline.stop());
    Ok(())
}

fn report(elapsed: Duration, snapshot: &Snapshot) {
    let counts = &snapshot.counts;
    println!(
        "{:4} s: {} sets, dropped {} sets {} frames, skipped by the estimator {}, resident {:.1} MB",
        elapsed.as_secs(),
        counts.sets_done,
        counts.dropped_sets,
        counts.dropped_frames,
        counts.skipped_sets,
        resident_mb().unwrap_or(f64::NAN)
    );
}

/// Resident memory of this process: the second number of `statm`, in pages of 4 KiB on the machines this is measured on.
fn resident_mb() -> Option<f64> {
    let statm = fs::read_to_string("/proc/self/statm").ok()?;
    let pages: f64 = statm.split_whitespace().nth(1)?.parse().ok()?;
    Some(pages * 4096.0 / 1e6)
}

fn print_latencies(snapshot: &Snapshot) {
    let latencies = &snapshot.latencies;
    let print = |name: &str, of: &LatencySummary| {
        let LatencySummary { count, mean_ms, p50_ms, p95_ms, p99_ms, max_ms } = of;
        println!(
            "{name:28} n {count:6}  mean {mean_ms:7.2}  p50 {p50_ms:7.2}  p95 {p95_ms:7.2}  p99 {p99_ms:7.2}  max {max_ms:7.2} ms"
        );
    };
    print("detection per image", &latencies.detect);
    print("lifting per image", &latencies.lift);
    print("newest frame to set", &latencies.frame_to_set);
    print("newest frame to progress", &latencies.frame_to_progress);
    print("solution", &latencies.solve);
}

/// A camera that plays frames from memory, over and over, in real time.
struct Looped {
    info: CameraInfo,
    frames: Arc<[RgbdFrame]>,
    /// When frame 0 is due, for all cameras.
    clock: Arc<OnceLock<Instant>>,
    view_frames: u64,
}

impl DeviceFactory for Looped {
    fn name(&self) -> &'static str {
        "looped"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        Ok(vec![self.info.clone()])
    }

    fn open(&self, _serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        let start = *self.clock.get_or_init(Instant::now);
        let (info, frames) = (self.info.clone(), Arc::clone(&self.frames));
        Ok(Box::new(LoopedSource { info, frames, start, view_frames: self.view_frames, number: 0 }))
    }
}

struct LoopedSource {
    info: CameraInfo,
    frames: Arc<[RgbdFrame]>,
    start: Instant,
    view_frames: u64,
    number: u64,
}

impl FrameSource for LoopedSource {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, _timeout: Duration) -> Result<(), CaptureError> {
        let due_ns = PERIOD_NS * self.number;
        let due = self.start + Duration::from_nanos(due_ns);
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        let from = &self.frames[(self.number / self.view_frames.max(1)) as usize % self.frames.len()];
        frame.rgb.clone_from(&from.rgb);
        frame.depth.clone_from(&from.depth);
        (frame.width, frame.height, frame.depth_unit_m) = (from.width, from.height, from.depth_unit_m);
        frame.depth_camera = from.depth_camera;
        (frame.stamp, frame.sequence) = (StampNs(due_ns as i64), self.number);
        self.number += 1;
        Ok(())
    }
}
