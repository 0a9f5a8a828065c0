//! `pelical replay`: a recording through the live pipeline, with the threads, queues and limits of the daemon, but no shared memory
//! and no store. Ends with the first converged result, or with the recording.

mod held;

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender};
use indicatif::ProgressBar;

use super::args::ReplayArgs;
use super::error::CliError;
use super::exit::Exit;
use super::gate::{self, Gate};
use super::interrupt::Interrupt;
use super::output::document::{CalibrationDocument, Findings, FrameSets, TimingMs};
use super::output::intake::RefusedFor;
use super::talk::say;
use super::{output, progress};
use crate::capture::recording::Recording;
use crate::capture::replay::{Pace, ReplayFactory, ReplayOptions};
use crate::capture::{CaptureError, DeviceFactory};
use crate::ipc::CameraIdentity;
use crate::pipeline::apart::Skews;
use crate::pipeline::{
    CameraSlot, CameraState, Counts, LatencySummary, Pipeline, PipelineEvent, PipelineOptions, Progress,
    Snapshot, Solved,
};
use crate::service::config;
use crate::solver::{RigCalibration, RigCamera, RigEstimator, State};
use held::Held;

/// Between two looks at what has become of the sets.
const GLANCE: Duration = Duration::from_millis(20);
/// When all is over, so long without another event there is none.
const LAST_WORDS: Duration = Duration::from_millis(100);
/// Without a change for so long, sets that are missing in the counts are given up.
const PATIENCE: Duration = Duration::from_secs(5);

/// Plays and prints the result.
///
/// # Errors
/// When the config or the recording is not usable, or the pipeline does not start.
pub fn run(args: &ReplayArgs) -> Result<Exit, CliError> {
    let mut options = config::load_or_default(args.config.as_deref())?.pipeline;
    let interrupt = Interrupt::register()?;
    let recording = args.recording.open()?;
    let truth = recording.ground_truth()?;
    let gate = args.fast.then(|| Arc::new(Gate::new(None)));
    if args.fast {
        gate::wait_for_held_cameras(&mut options);
    }
    let start = Instant::now();
    let (sender, events) = crossbeam_channel::bounded(256);
    let (fault_sender, faults) = crossbeam_channel::bounded(1);
    let pipeline = Pipeline::start(cameras(&recording, (gate.as_ref(), &fault_sender))?, &options, sender)
        .map_err(|error| CliError::Failed(error.to_string()))?;
    let mut playing = Playing {
        recording: &recording,
        bar: progress::bar(Some(recording.frame_sets().len() as u64), "frame sets"),
        newest: None,
        faults,
        last: (Counts::default(), Instant::now()),
        n_lost: 0,
    };
    let played = playing.listen((&pipeline, &events), gate.as_deref(), &interrupt);
    let snapshot = pipeline.snapshot();
    pipeline.stop();
    playing.bar.finish_and_clear();
    played?;
    let mut calibration = match playing.newest {
        Some(solved) => solved.calibration,
        None => without_evidence(&recording, &options),
    };
    let names: Vec<String> = recording.cameras().iter().map(|info| info.name.clone()).collect();
    Skews { pairs: &snapshot.pair_skews, names: &names, max_skew: options.sync.max_skew }
        .explain(&mut calibration);
    let document = CalibrationDocument::new(&Findings {
        cameras: &identities(&recording),
        calibration: &calibration,
        frame_sets: frame_sets(&snapshot.counts),
        pair_skews: &snapshot.pair_skews,
        timing_ms: timing_ms(&snapshot, start.elapsed()),
        truth: truth.as_ref().map(|truth| truth.reference_from_camera.as_slice()),
        provenance: None,
    });
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::text::calibration(&document))?;
    }
    Ok(if document.is_converged() { Exit::Done } else { Exit::NoResult })
}

/// A recording that is being played.
struct Playing<'a> {
    recording: &'a Recording,
    bar: ProgressBar,
    newest: Option<Box<Solved>>,
    /// The first frame that cannot be read.
    faults: Receiver<CaptureError>,
    /// The counts, and since when they have been so.
    last: (Counts, Instant),
    /// Sets that were given up.
    n_lost: u64,
}

impl Playing<'_> {
    /// Until there is a converged result, nothing more can come, or Ctrl-C.
    fn listen(
        &mut self,
        (pipeline, events): (&Pipeline, &Receiver<PipelineEvent>),
        gate: Option<&Gate>,
        interrupt: &Interrupt,
    ) -> Result<(), CliError> {
        while !interrupt.is_set() {
            match events.recv_timeout(GLANCE) {
                Ok(PipelineEvent::Calibration(solved)) => {
                    let is_converged = solved.calibration.state == State::Converged;
                    self.newest = Some(solved);
                    if is_converged {
                        return Ok(());
                    }
                }
                Ok(PipelineEvent::Progress(progress)) => self.show(&progress),
                Ok(PipelineEvent::Camera { camera, state, detail }) => self.tell(camera, state, &detail),
                Ok(PipelineEvent::Bug { thread }) => {
                    return Err(CliError::Failed(format!("thread {thread} ended by a bug")));
                }
                Ok(PipelineEvent::Watched(_)) | Err(_) => {}
            }
            let snapshot = pipeline.snapshot();
            // After the snapshot: a camera that a fault has ended told the fault first.
            if let Ok(fault) = self.faults.try_recv() {
                return Err(fault.into());
            }
            self.notice(&snapshot.counts);
            if let Some(gate) = gate {
                gate.release_after(through(&snapshot.counts) + self.n_lost);
            }
            if self.is_over(&snapshot) {
                self.hear_out(events);
                return Ok(());
            }
        }
        Ok(())
    }

    /// Tells what cameras said last: a state changes a moment before its event comes.
    fn hear_out(&self, events: &Receiver<PipelineEvent>) {
        while let Ok(event) = events.recv_timeout(LAST_WORDS) {
            if let PipelineEvent::Camera { camera, state, detail } = event {
                self.tell(camera, state, &detail);
            }
        }
    }

    fn notice(&mut self, counts: &Counts) {
        let (last, since) = &self.last;
        if counts != last {
            self.last = (*counts, Instant::now());
        } else if since.elapsed() > PATIENCE && !self.is_solution_due(counts) {
            // Frames without a partner: the next ones have to be released all the same.
            self.n_lost += 1;
            self.last.1 = Instant::now();
        }
    }

    /// Whether there is evidence that no solution has seen.
    fn is_solution_due(&self, counts: &Counts) -> bool {
        counts.accepted_sets > self.newest.as_ref().map_or(0, |solved| solved.sets_accepted)
    }

    /// Whether all frames have come, and the last solution has seen all of them.
    fn is_over(&self, snapshot: &Snapshot) -> bool {
        let counts = &snapshot.counts;
        let has_ended = snapshot.cameras.iter().all(|camera| camera.state == CameraState::Ended);
        let is_settled = through(counts) >= counts.sets_formed + counts.refused_skew || self.n_lost > 0;
        has_ended && is_settled && !self.is_solution_due(counts)
    }

    fn show(&self, progress: &Progress) {
        let lines: Vec<String> = progress.cameras
            [..self.recording.cameras().len().min(progress.cameras.len())]
            .iter()
            .map(|camera| camera.lines.to_string())
            .collect();
        let newest = self.newest.as_ref().map(|solved| &solved.calibration);
        let state = newest.map_or(State::Collecting, |calibration| calibration.state);
        self.bar.set_position(progress.counts.sets_formed);
        self.bar.set_message(format!(
            "{}: {} used, lines {}",
            state.name(),
            progress.counts.accepted_sets,
            lines.join("/")
        ));
    }

    fn tell(&self, camera: usize, state: CameraState, detail: &str) {
        let name = self.recording.cameras().get(camera).map_or("?", |info| info.name.as_str());
        let detail = if detail.is_empty() { String::new() } else { format!(": {detail}") };
        self.bar.suspend(|| say(format_args!("camera {name}: {}{detail}", state.name())));
    }
}

fn cameras(
    recording: &Recording,
    (gate, faults): (Option<&Arc<Gate>>, &Sender<CaptureError>),
) -> Result<Vec<CameraSlot>, CliError> {
    let pace = if gate.is_some() { Pace::Unpaced } else { Pace::RealTime };
    let options = ReplayOptions { pace, ..ReplayOptions::default() };
    let backend: Arc<dyn DeviceFactory> = Arc::new(ReplayFactory::new(recording.clone(), options)?);
    let factory = Arc::new(Held { backend, gate: gate.cloned(), faults: faults.clone() });
    let slot = |info: &crate::capture::CameraInfo| CameraSlot {
        factory: Arc::<Held>::clone(&factory),
        serial: info.serial.clone(),
        name: info.name.clone(),
    };
    Ok(recording.cameras().iter().map(slot).collect())
}

/// Frame sets of which nothing more will be heard.
fn through(counts: &Counts) -> u64 {
    counts.accepted_sets + counts.skipped_sets + refused(counts).total() + counts.dropped_sets
}

/// As the daemon counts them.
fn frame_sets(counts: &Counts) -> FrameSets {
    let refused = refused(counts);
    FrameSets {
        seen: counts.sets_formed,
        used: counts.accepted_sets,
        refused: refused.total(),
        refused_for: Some(refused),
    }
}

fn refused(counts: &Counts) -> RefusedFor {
    let Counts { refused_skew, refused_gyro, refused_image, repeated_sets, .. } = *counts;
    RefusedFor {
        incomplete: 0,
        skew: refused_skew,
        gyro: refused_gyro,
        image: refused_image,
        nothing_new: repeated_sets,
    }
}

fn timing_ms(snapshot: &Snapshot, total: Duration) -> TimingMs {
    let sum = |summary: LatencySummary| Some(summary.mean_ms * summary.count as f64);
    let latencies = &snapshot.latencies;
    TimingMs {
        detect: sum(latencies.detect),
        lift: sum(latencies.lift),
        associate: sum(latencies.associate),
        estimate: sum(latencies.solve),
        total: Some(total.as_secs_f64() * 1e3),
    }
}

fn identities(recording: &Recording) -> Vec<CameraIdentity> {
    let identity = |info: &crate::capture::CameraInfo| CameraIdentity {
        name: info.name.clone(),
        serial: info.serial.clone(),
        firmware: info.firmware.clone(),
    };
    recording.cameras().iter().map(identity).collect()
}

/// What an estimator says that has seen nothing.
fn without_evidence(recording: &Recording, options: &PipelineOptions) -> RigCalibration {
    let cameras = recording.cameras().iter();
    let cameras = cameras.map(|info| RigCamera { name: info.name.clone(), camera: info.camera });
    RigEstimator::new(cameras.collect(), options.estimate).solve()
}
