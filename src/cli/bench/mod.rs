//! `pelical bench`: how long each stage takes, on one core and in the live pipeline, and what is dropped.
//!
//! Frames are decoded before the clocks start and then played round and round, so that reading them is no part of any figure.

mod lockstep;

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::args::BenchArgs;
use super::error::CliError;
use super::exit::Exit;
use super::gate::{self, Gate};
use super::interrupt::Interrupt;
use super::output;
use super::output::bench::{BenchDocument, LineCounts, OneCoreEntry, PipelineEntry, StageEntry};
use super::talk::say;
use crate::capture::recording::Recording;
use crate::capture::{CameraInfo, RgbdFrame};
use crate::pipeline::associate::{self, SeenLines};
use crate::pipeline::{
    CameraSlot, Command, FindTimes, FoundLines, MotionOptions, Parts, Pipeline, PipelineEvent,
    PipelineOptions,
};
use crate::service::config;
use lockstep::Lockstep;

/// Frame sets kept in memory, the first ones; 1.5 MB for each image of 640 x 480.
const MAX_SETS: usize = 40;
/// Longest wait for an event before the next set is released whatever became of the last one.
const PATIENCE: Duration = Duration::from_secs(1);

/// Measures and prints.
///
/// # Errors
/// When the config or the recording is not usable, or the pipeline does not start.
pub fn run(args: &BenchArgs) -> Result<Exit, CliError> {
    let mut options = config::load_or_default(args.config.as_deref())?.pipeline;
    // The views jump from frame to frame here; that must not keep the estimator idle.
    options.motion = MotionOptions { max_turn_rad_per_s: f64::INFINITY };
    if let Some(choice) = args.association {
        options.associate.association = choice.into();
    }
    let interrupt = Interrupt::register()?;
    let recording = args.recording.open()?;
    let frames = read_ahead(&recording)?;
    say(format_args!("one core, {:.0} s", args.seconds.as_secs_f64()));
    let one_core = one_core((&recording, &frames), &options, (args.seconds, &interrupt));
    say(format_args!("pipeline, {:.0} s", args.seconds.as_secs_f64()));
    let gate = Arc::new(Gate::new(args.rate_hz));
    if args.rate_hz.is_none() {
        gate::wait_for_held_cameras(&mut options);
    }
    let cameras = cameras((&recording, frames), &gate);
    let pipeline = live((cameras, &gate), &options, (args.seconds, &interrupt))?;
    let document = BenchDocument::new(&recording, one_core, pipeline);
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::bench::text(&document))?;
    }
    Ok(Exit::Done)
}

/// The first frame sets, by camera.
fn read_ahead(recording: &Recording) -> Result<Vec<Arc<[RgbdFrame]>>, CliError> {
    let of_camera = |camera: usize| {
        let read = |stamps: &Vec<_>| {
            let mut frame = RgbdFrame::default();
            let stamp = stamps.get(camera).copied().unwrap_or_default();
            recording.read_frame(camera, stamp, &mut frame).map(|()| frame)
        };
        recording.frame_sets().iter().take(MAX_SETS).map(read).collect::<Result<Arc<[_]>, _>>()
    };
    Ok((0..recording.cameras().len()).map(of_camera).collect::<Result<_, _>>()?)
}

/// The stages one after the other on this thread: the time of an image without any other thread in the way.
fn one_core(
    (recording, frames): (&Recording, &[Arc<[RgbdFrame]>]),
    options: &PipelineOptions,
    (duration, interrupt): (Duration, &Interrupt),
) -> OneCoreEntry {
    let mut finder = (Parts::new(options).line_finder)();
    let mut source = associate::source(&options.associate);
    let mut found: Vec<FoundLines> = frames.iter().map(|_| FoundLines::default()).collect();
    let (mut times, mut scoring, mut lines) = (Vec::new(), Vec::new(), LineCounts::default());
    let n_sets = frames.iter().map(|frames| frames.len()).min().unwrap_or(0);
    let start = Instant::now();
    for set in (0..n_sets).cycle() {
        if start.elapsed() >= duration || interrupt.is_set() {
            break;
        }
        for ((info, frames), found) in recording.cameras().iter().zip(frames).zip(&mut found) {
            times.push(finder.find(&frames[set], &info.camera, found));
            lines.count(&found.view.lines);
        }
        let seen: Vec<_> = found.iter().map(|found| Some(SeenLines::new(&found.view, found))).collect();
        let before = Instant::now();
        source.score(&seen, &|| true);
        scoring.push(before.elapsed());
    }
    if let Some(complaint) = source.complaint() {
        say(format_args!("pelical: {complaint}"));
    }
    let of_images = |part: fn(&FindTimes) -> Duration| times.iter().map(part).collect();
    let stages = vec![
        StageEntry::exact("gray", of_images(|times| times.gray)),
        StageEntry::exact("detect", of_images(|times| times.detect)),
        StageEntry::exact("lift", of_images(|times| times.lift)),
        StageEntry::exact("describe", of_images(|times| times.describe)),
        StageEntry::exact("match", scoring),
    ];
    OneCoreEntry::new(start.elapsed(), lines, stages)
}

fn cameras((recording, frames): (&Recording, Vec<Arc<[RgbdFrame]>>), gate: &Arc<Gate>) -> Vec<CameraSlot> {
    let slot = |(info, frames): (&CameraInfo, Arc<[RgbdFrame]>)| CameraSlot {
        serial: info.serial.clone(),
        name: info.name.clone(),
        factory: Arc::new(Lockstep { info: info.clone(), frames, gate: Arc::clone(gate) }),
    };
    recording.cameras().iter().zip(frames).map(slot).collect()
}

/// The live pipeline with all its threads.
fn live(
    (cameras, gate): (Vec<CameraSlot>, &Gate),
    options: &PipelineOptions,
    (duration, interrupt): (Duration, &Interrupt),
) -> Result<PipelineEntry, CliError> {
    let failed = |what: &dyn std::fmt::Display| CliError::Failed(what.to_string());
    let (sender, events) = crossbeam_channel::bounded(256);
    let pipeline = Pipeline::start(cameras, options, sender).map_err(|error| failed(&error))?;
    let (mut lines, mut n_lost) = (LineCounts::default(), 0);
    let start = Instant::now();
    while start.elapsed() < duration && !interrupt.is_set() {
        match events.recv_timeout(PATIENCE) {
            Ok(PipelineEvent::Progress(progress)) => {
                for camera in progress.cameras.iter().filter(|camera| camera.is_present) {
                    lines.add(camera.lines as usize, camera.lifted as usize);
                }
            }
            // Always busy: a result would end the collecting.
            Ok(PipelineEvent::Calibration(_)) => drop(pipeline.command(Command::Recalibrate)),
            Ok(PipelineEvent::Bug { thread }) => {
                return Err(failed(&format!("thread {thread} ended by a bug")));
            }
            Ok(_) => {}
            Err(_) => n_lost += 1,
        }
        let counts = pipeline.snapshot().counts;
        gate.release_after(counts.sets_done + counts.dropped_sets + counts.refused_skew + n_lost);
    }
    let (elapsed, snapshot) = (start.elapsed(), pipeline.snapshot());
    pipeline.stop();
    Ok(PipelineEntry::new(elapsed, lines, &snapshot))
}
