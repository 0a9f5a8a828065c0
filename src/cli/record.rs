//! `pelical record`: writes what the cameras of a config file show, set by set.

use std::time::{Duration, Instant};

use serde::Serialize;

use super::args::RecordArgs;
use super::error::CliError;
use super::interrupt::Interrupt;
use super::{output, progress};
use crate::capture::writer::RecordingWriter;
use crate::capture::{CameraInfo, CaptureError, FrameSource, RgbdFrame};
use crate::service::config;

/// How long one wait for a frame may take before signals are looked at again.
const POLL: Duration = Duration::from_millis(100);
/// A camera that is silent for this long ends the recording.
const PATIENCE: Duration = Duration::from_secs(10);

#[derive(Serialize)]
struct RecordDocument {
    schema: &'static str,
    path: String,
    frame_sets: u64,
}

/// Records until the number of sets, the duration, the end of the stream or a signal.
///
/// # Errors
/// When the config, the cameras or the folder are not usable; what was written before stays readable.
pub fn run(args: &RecordArgs) -> Result<(), CliError> {
    let (_, config) = config::load(&args.config)?;
    let factory = config.cameras.factory()?;
    let chosen = config.cameras.rig(factory.as_ref())?;
    let sources = chosen.iter().map(|camera| factory.open(&camera.serial)).collect::<Result<Vec<_>, _>>()?;
    let rig: Vec<CameraInfo> = (sources.iter().zip(&chosen))
        .map(|(source, camera)| CameraInfo { name: camera.name.clone(), ..source.info().clone() })
        .collect();
    let source = format!("pelical record, back end {}", factory.name());
    // Exit code 65 is for input; this folder is output.
    let mut writer = RecordingWriter::create(&args.folder, &rig, "", &source)
        .map_err(|error| CliError::Failed(error.to_string()))?;
    if let Some(reference_from_camera) = config.cameras.truth(&chosen) {
        writer.write_ground_truth(&reference_from_camera)?;
    }
    let mut recorder = Recorder::new(sources, &rig, config.pipeline.sync.max_skew);
    let written = recorder.write_all(&mut writer, args);
    // Whatever ended it, what was written shall be readable.
    writer.finish()?;
    let frame_sets = written?;
    if frame_sets == 0 {
        let what =
            "nothing was recorded: no frame set with frames of all cameras within sync.max_skew_ms came";
        return Err(CliError::Failed(what.to_owned()));
    }
    let path = args.folder.display().to_string();
    if args.output.json {
        output::print_json(&RecordDocument { schema: "pelical.recording/1", path, frame_sets })
    } else {
        output::print_text(&format!("{frame_sets} frame sets of {} cameras in {path}\n", rig.len()))
    }
}

/// Open cameras and their newest frames.
struct Recorder<'a> {
    sources: Vec<Box<dyn FrameSource>>,
    rig: &'a [CameraInfo],
    frames: Vec<RgbdFrame>,
    max_skew: Duration,
}

/// Whether there is a frame.
enum Turn {
    Frame,
    End,
}

impl<'a> Recorder<'a> {
    fn new(sources: Vec<Box<dyn FrameSource>>, rig: &'a [CameraInfo], max_skew: Duration) -> Self {
        let frames = vec![RgbdFrame::default(); sources.len()];
        Self { sources, rig, frames, max_skew }
    }

    /// The number of sets written.
    fn write_all(&mut self, writer: &mut RecordingWriter, args: &RecordArgs) -> Result<u64, CliError> {
        let interrupt = Interrupt::register()?;
        let bar = progress::bar(args.sets, "frame sets");
        let start = Instant::now();
        let mut written = 0;
        let is_over = |written| {
            interrupt.is_set()
                || args.sets.is_some_and(|sets| written >= sets)
                || args.duration.is_some_and(|duration| start.elapsed() >= duration)
        };
        while !is_over(written) {
            match self.next_set(&interrupt, &|| is_over(written))? {
                Turn::Frame => writer.write_set(&self.frames)?,
                Turn::End => break,
            }
            written += 1;
            bar.set_position(written);
        }
        bar.finish_and_clear();
        Ok(written)
    }

    /// A frame of each camera, none further from another than the limit.
    fn next_set(&mut self, interrupt: &Interrupt, is_over: &dyn Fn() -> bool) -> Result<Turn, CliError> {
        let start = Instant::now();
        for index in 0..self.sources.len() {
            if let Turn::End = self.next_frame(index, interrupt)? {
                return Ok(Turn::End);
            }
        }
        // Cameras whose clocks differ never come together, however many frames they give.
        while let Some(oldest) = self.behind() {
            if is_over() {
                return Ok(Turn::End);
            }
            if start.elapsed() >= PATIENCE {
                let (s, ms) = (PATIENCE.as_secs(), self.max_skew.as_secs_f64() * 1e3);
                let what = format!(
                    "no frames of all cameras within {ms} ms of each other for {s} s: check the clocks, or raise \
                     sync.max_skew_ms"
                );
                return Err(CliError::Failed(what));
            }
            if let Turn::End = self.next_frame(oldest, interrupt)? {
                return Ok(Turn::End);
            }
        }
        Ok(Turn::Frame)
    }

    /// The camera with the oldest frame, if that is too old for the newest.
    fn behind(&self) -> Option<usize> {
        let newest = self.frames.iter().map(|frame| frame.stamp).max()?;
        let (oldest, frame) = self.frames.iter().enumerate().min_by_key(|(_, frame)| frame.stamp)?;
        let skew_ns = u64::try_from(newest.0.saturating_sub(frame.stamp.0)).unwrap_or(u64::MAX);
        (Duration::from_nanos(skew_ns) > self.max_skew).then_some(oldest)
    }

    fn next_frame(&mut self, index: usize, interrupt: &Interrupt) -> Result<Turn, CliError> {
        let (Some(source), Some(frame)) = (self.sources.get_mut(index), self.frames.get_mut(index)) else {
            return Ok(Turn::End);
        };
        let start = Instant::now();
        loop {
            match source.next_frame(frame, POLL) {
                // Stamps of two such clocks may be close by chance, however far apart the images are.
                Ok(()) if self.rig.len() > 1 && frame.timing.is_of_own_clock() => {
                    if interrupt.is_set() {
                        return Ok(Turn::End);
                    }
                    if start.elapsed() >= PATIENCE {
                        let name = self.rig.get(index).map_or("?", |info| info.name.as_str());
                        let what = format!(
                            "camera {name} stamps its frames by a clock of its own, which tells nothing of the others': set \
                             cameras.realsense.global_time to true"
                        );
                        return Err(CliError::Failed(what));
                    }
                }
                Ok(()) => return Ok(Turn::Frame),
                Err(CaptureError::EndOfStream) => return Ok(Turn::End),
                Err(CaptureError::Timeout(_)) if interrupt.is_set() => return Ok(Turn::End),
                Err(CaptureError::Timeout(_)) if start.elapsed() < PATIENCE => {}
                Err(CaptureError::Timeout(_)) => {
                    let name = self.rig.get(index).map_or("?", |info| info.name.as_str());
                    let what = format!("camera {name} gave no frame for {} s", PATIENCE.as_secs());
                    return Err(CliError::Failed(what));
                }
                Err(error) => return Err(error.into()),
            }
        }
    }
}
