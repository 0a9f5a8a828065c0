//! The live pipeline and the offline run: the only module that knows capture, lines and solver.
//!
//! ```text
//!   thread cap-<camera>   open, next_frame, reopen            one per camera, touches nothing but its device
//!        | frames         ArrayQueue per camera, newest wins
//!   thread sync           frames of one moment, stalls        newest set wins while the line stage is behind
//!        | jobs           ArrayQueue, sized for all sets in flight
//!   threads lines-<i>     gray, detect, lift, surface         any frame of any camera
//!        | done           ArrayQueue, sized for all sets in flight
//!   thread publish        joins a set, motion test ---------> PipelineEvent::Progress, Camera
//!        | sets           ArrayQueue, newest wins
//!   thread estimate       add, solve, watch (nice 10) ------> PipelineEvent::Calibration, Watched
//! ```
//!
//! Down to the event of `publish`, after the first frames nothing is allocated, no lock is taken and no reader is waited for; every queue
//! is lock-free, bounded, and counts what it drops; buffers go round. Commands and events are the control path (atomics, and a channel
//! that drops and counts what its reader is too slow for). A solution takes seconds: sets that come meanwhile are skipped and counted.
//! Once there is a result, `estimate` asks for a set when it has time for one.

pub mod apart;
pub mod associate;
mod buffers;
mod capture_loop;
mod estimate;
mod event;
mod finder;
mod frame_health;
mod line_stage;
pub mod matcher;
pub mod motion;
pub mod offline;
mod options;
mod plumb;
mod publish;
mod pulse;
mod queues;
pub mod recovery;
mod shared;
pub mod skew;
mod stage;
pub mod stats;
mod sync;
mod watching;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::Sender;

use crate::capture::DeviceFactory;
use crate::solver::{RigCalibration, RigEstimator};

pub use associate::{AssociateOptions, Association, MatchSource};
pub use buffers::FoundLines;
pub use capture_loop::FRAME_TIMEOUT;
pub use estimate::{Estimator, MakeEstimator, MakeMatchSource};
pub use event::{
    Answer, CameraProgress, CameraState, Command, Phase, PipelineEvent, Progress, Solved, Watched,
};
pub use finder::{FindTimes, LineFinder, SegmentLineFinder};
pub use frame_health::FrameHealth;
pub use motion::{MotionOptions, Turn, TurnSense};
pub use options::{PipelineOptions, SolveOptions, StartError, SyncOptions};
pub use pulse::{ThreadVitals, Vitals};
pub use recovery::RecoveryOptions;
pub use skew::PairSkew;
pub use stats::{Counts, LatencySummaries, LatencySummary};

use capture_loop::{BadFrames, CaptureLoop};
use shared::Shared;
use stage::Stage;

/// Most cameras of a rig: sets have a fixed size, so that they need no allocation.
pub const MAX_CAMERAS: usize = 8;

/// A stop takes no longer than this; a thread that hangs in a device or a solution is then left to itself.
const STOP_WITHIN: Duration = Duration::from_millis(800);

/// One camera of the rig.
#[derive(Clone)]
pub struct CameraSlot {
    /// Opens the device.
    pub factory: Arc<dyn DeviceFactory>,
    /// Which device.
    pub serial: String,
    /// Name in the rig.
    pub name: String,
}

/// The parts that tests replace.
pub struct Parts {
    /// Makes a finder for one thread.
    pub line_finder: Box<dyn Fn() -> Box<dyn LineFinder>>,
    /// Makes an estimator.
    pub estimator: Box<MakeEstimator>,
    /// Makes what scores candidate matches, in the estimator's thread: it may take its time.
    pub match_source: Box<MakeMatchSource>,
}

impl Parts {
    /// This library's own parts.
    pub fn new(options: &PipelineOptions) -> Self {
        let (estimate, associate) = (options.estimate, options.associate.clone());
        let options = options.clone();
        Self {
            line_finder: Box::new(move || Box::new(SegmentLineFinder::new(&options))),
            estimator: Box::new(move |cameras| Box::new(RigEstimator::new(cameras, estimate))),
            match_source: Box::new(move || associate::source(&associate)),
        }
    }
}

/// A running pipeline. Dropping it stops it without waiting; [`Pipeline::stop`] waits.
pub struct Pipeline {
    shared: Arc<Shared>,
    /// Name and handle in the order of their start: readers before writers.
    threads: Vec<(String, JoinHandle<()>)>,
}

/// How a pipeline ended.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct StopReport {
    /// Threads that hung in a device or a solution and were left to themselves.
    pub abandoned: Vec<String>,
}

/// One camera at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraSnapshot {
    /// Name in the rig.
    pub name: String,
    /// How it is.
    pub state: CameraState,
    /// Good frames so far.
    pub frames: u64,
    /// Of these, dropped because sync did not fetch them in time.
    pub dropped: u64,
    /// Since the last frame; `None` before the first.
    pub last_frame_age: Option<Duration>,
    /// What its frames say.
    pub frame_health: FrameHealth,
    /// What the device said of its firmware when it was opened last; `None` before, or where it does not say.
    pub firmware: Option<String>,
}

/// The pipeline at one moment; by default one that has no camera.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Snapshot {
    /// By camera.
    pub cameras: Vec<CameraSnapshot>,
    /// What the estimator is doing.
    pub phase: Phase,
    /// All counts.
    pub counts: Counts,
    /// All latencies.
    pub latencies: LatencySummaries,
    /// How far apart the frames of each two cameras are.
    pub pair_skews: Vec<PairSkew>,
}

impl Pipeline {
    /// Starts all threads and begins collecting. Cameras that are not there yet are waited for. `events` should be bounded; what nobody
    /// reads in time is dropped and counted, results excepted.
    ///
    /// # Errors
    /// No or too many cameras, or no thread to be had.
    pub fn start(
        cameras: Vec<CameraSlot>,
        options: &PipelineOptions,
        events: Sender<PipelineEvent>,
    ) -> Result<Self, StartError> {
        Self::start_with(Parts::new(options), cameras, options, events)
    }

    /// As [`Pipeline::start`], with other parts.
    ///
    /// # Errors
    /// As [`Pipeline::start`].
    pub fn start_with(
        parts: Parts,
        cameras: Vec<CameraSlot>,
        options: &PipelineOptions,
        events: Sender<PipelineEvent>,
    ) -> Result<Self, StartError> {
        match cameras.len() {
            0 => return Err(StartError::NoCameras),
            1..=MAX_CAMERAS => {}
            n => return Err(StartError::TooManyCameras(n)),
        }
        let n_line_threads = options.line_threads(cameras.len());
        let names = cameras.iter().map(|camera| camera.name.clone()).collect();
        let shared = Arc::new(Shared::new(names, n_line_threads, events));
        // If a thread cannot be started, the drop of `pipeline` stops the others.
        let mut pipeline = Self { shared: Arc::clone(&shared), threads: Vec::new() };
        let makers = (parts.estimator, parts.match_source);
        let estimate = estimate::EstimateStage::new(Arc::clone(&shared), options, makers);
        pipeline.add("estimate".to_owned(), Box::new(estimate))?;
        let publish = publish::PublishStage::new(Arc::clone(&shared), options.motion);
        pipeline.add("publish".to_owned(), Box::new(publish))?;
        for index in 0..n_line_threads {
            let (shared, finder) = (Arc::clone(&shared), (parts.line_finder)());
            let lines = line_stage::LineStage { shared, finder, index, spare: None };
            pipeline.add(format!("lines-{index}"), Box::new(lines))?;
        }
        let sync = sync::SyncStage::new(Arc::clone(&shared), &options.sync);
        pipeline.add("sync".to_owned(), Box::new(sync))?;
        for (camera, slot) in cameras.into_iter().enumerate() {
            let (shared, reopen_after) = (Arc::clone(&shared), options.sync.reopen_after);
            let recovery = options.recovery;
            // The system takes no thread name with a zero in it.
            let name = format!("cap-{}", slot.name.replace('\0', ""));
            let capture = CaptureLoop {
                shared,
                slot,
                camera,
                reopen_after,
                recovery,
                bad_frames: BadFrames::default(),
            };
            let handle = stage::spawn_body(name.clone(), &pipeline.shared, Box::new(|| capture.run()))?;
            pipeline.threads.push((name, handle));
        }
        Ok(pipeline)
    }

    fn add(&mut self, name: String, stage: Box<dyn Stage>) -> Result<(), StartError> {
        let handle = stage::spawn(name.clone(), &self.shared, stage)?;
        self.threads.push((name, handle));
        Ok(())
    }

    /// Tells the estimator what to do; takes effect at once, though a solution that is being computed is finished and thrown away.
    pub fn command(&self, command: Command) -> Answer {
        let phase = &self.shared.phase;
        match command {
            Command::Recalibrate if phase.begin() => Answer::Accepted,
            Command::Recalibrate => Answer::Busy,
            Command::Cancel if phase.end(None, Phase::Idle) => Answer::Accepted,
            Command::Cancel => Answer::NotCollecting,
        }
    }

    /// Ends collecting and takes a converged result of an earlier run for the one to watch: the cameras in the pipeline's order.
    pub fn watch(&self, calibration: RigCalibration) {
        let shared = &self.shared;
        // The queue hands the round over as well: whoever takes the result sees that its round has begun.
        let round = shared.phase.watch();
        shared.given.force_push((calibration, round));
        shared.wakers.estimate.wake();
    }

    /// The round of collecting, from 1; an accepted [`Command::Recalibrate`] and [`Pipeline::watch`] begin the next one.
    pub fn round(&self) -> u64 {
        self.shared.phase.round()
    }

    /// States, counts and latencies now.
    pub fn snapshot(&self) -> Snapshot {
        let cameras = self.shared.cameras.iter().map(|camera| CameraSnapshot {
            name: camera.name.clone(),
            state: camera.state(),
            frames: camera.frames.get(),
            dropped: camera.dropped.get(),
            last_frame_age: (camera.frames.get() > 0)
                .then(|| self.shared.since_start().saturating_sub(camera.last_frame())),
            frame_health: camera.health.read(),
            firmware: camera.firmware(),
        });
        Snapshot {
            cameras: cameras.collect(),
            phase: self.shared.phase.phase(),
            counts: self.shared.counters.counts(),
            latencies: self.shared.latencies.summaries(),
            pair_skews: self.shared.skews.pairs(),
        }
    }

    /// Signs of life of all threads now.
    pub fn vitals(&self) -> Vitals {
        // Relaxed: a number to compare with a later one.
        let sets_in_flight = self.shared.queues.in_flight.load(Ordering::Relaxed);
        self.shared.pulses.vitals(|camera| self.shared.cameras[camera].name.clone(), sets_in_flight)
    }

    /// Stops all threads within a second and joins them, writers before readers; says which of them hung.
    pub fn stop(mut self) -> StopReport {
        self.ask_to_stop();
        let deadline = Instant::now() + STOP_WITHIN;
        let mut abandoned = Vec::new();
        for (name, handle) in self.threads.drain(..).rev() {
            if !stage::join_until(handle, deadline) {
                tracing::warn!(thread = name, "thread hangs and is left to itself");
                abandoned.push(name);
            }
        }
        StopReport { abandoned }
    }

    fn ask_to_stop(&self) {
        // Relaxed: nothing is handed over through `stop`.
        self.shared.stop.store(true, Ordering::Relaxed);
        self.threads.iter().for_each(|(_, handle)| handle.thread().unpark());
    }
}

impl Drop for Pipeline {
    fn drop(&mut self) {
        self.ask_to_stop();
    }
}
