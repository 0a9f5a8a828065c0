//! The running daemon: one thread that listens to the pipeline and to the clients, and tells the one about the other.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};

use super::config::{CameraChoice, Config};
use super::error::ServiceError;
use super::state::{self, Life};
use super::stop::Stop;
use super::telling::{HealthTeller, ProgressTeller, wall_clock_ns};
use crate::capture::DeviceFactory;
use crate::ipc::{CalibrationMessage, CameraIdentity, Request, RequestKind, Response, Server, ServerError, Snapshot};
use crate::pipeline::{CameraSlot, Command, Pipeline, PipelineEvent, PipelineOptions, Solved};

/// Longest time a client's request or a signal waits for the daemon's attention; events of the pipeline wake it at once.
const POLL: Duration = Duration::from_millis(5);
/// How often health is told.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);
/// Events that wait for this thread; at 30 frame sets a second this is two seconds. Then the pipeline drops and counts them.
const EVENT_QUEUE: usize = 64;
/// Restarts of a pipeline with a bug before the daemon gives up.
const MAX_RESTARTS: u32 = 5;

/// Why the daemon ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopCause {
    /// It was asked to.
    Requested,
}

/// Everything but the server, which answers while this is borrowed.
pub struct Daemon {
    rig: Rig,
    pipeline: Pipeline,
    events: Receiver<PipelineEvent>,
    restarts: u32,
    life: Life,
    calibration_sequence: u64,
    progress: ProgressTeller,
    health: HealthTeller,
    /// Messages that could not be published since health was told last, and why the last one could not.
    unpublished: (u32, Option<ServerError>),
}

/// What the pipeline is started with, and started again after a bug.
struct Rig {
    slots: Vec<CameraSlot>,
    identities: Vec<CameraIdentity>,
    options: PipelineOptions,
}

impl Rig {
    fn new(config: &Config) -> Result<Self, ServiceError> {
        let factory: Arc<dyn DeviceFactory> = Arc::from(config.cameras.factory().map_err(super::config::RigError::from)?);
        let cameras = config.cameras.rig(factory.as_ref())?;
        let slot = |camera: &CameraChoice| CameraSlot {
            factory: Arc::clone(&factory),
            serial: camera.serial.clone(),
            name: camera.name.clone(),
        };
        let identity =
            |camera: &CameraChoice| CameraIdentity { name: camera.name.clone(), serial: camera.serial.clone() };
        Ok(Self {
            slots: cameras.iter().map(slot).collect(),
            identities: cameras.iter().map(identity).collect(),
            options: config.pipeline,
        })
    }

    fn start(&self) -> Result<(Pipeline, Receiver<PipelineEvent>), ServiceError> {
        let (sender, events) = bounded(EVENT_QUEUE);
        Ok((Pipeline::start(self.slots.clone(), &self.options, sender)?, events))
    }
}

/// Runs the daemon until it is asked to stop.
///
/// # Errors
/// When it cannot start, or when the pipeline fails again and again.
pub fn run(config: &Config, stop: &Stop) -> Result<StopCause, ServiceError> {
    // The name first: a second daemon must not even touch the cameras.
    let server = Server::start(&config.instance)?;
    let rig = Rig::new(config)?;
    let names: Vec<&str> = rig.identities.iter().map(|camera| camera.name.as_str()).collect();
    tracing::info!(instance = %config.instance, cameras = names.join(", "), "started");
    let (pipeline, events) = rig.start()?;
    let mut daemon = Daemon {
        rig,
        pipeline,
        events,
        restarts: 0,
        life: Life::new(),
        calibration_sequence: 0,
        progress: ProgressTeller::default(),
        health: HealthTeller::new(Instant::now()),
        unpublished: (0, None),
    };
    while !stop.is_set() {
        daemon.turn(&server)?;
    }
    daemon.end(&server);
    Ok(StopCause::Requested)
}

impl Daemon {
    /// Handles what has happened, waiting a little for it.
    fn turn(&mut self, server: &Server) -> Result<(), ServiceError> {
        match self.events.recv_timeout(POLL) {
            Ok(event) => {
                self.handle(event, server)?;
                while let Ok(event) = self.events.try_recv() {
                    self.handle(event, server)?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            // All threads of the pipeline are gone without a word.
            Err(RecvTimeoutError::Disconnected) => self.restart("all")?,
        }
        let polled = server.poll(Duration::ZERO, |request| self.answer(request));
        self.note(polled.map(drop));
        if self.health.is_due(HEALTH_INTERVAL) {
            self.tell_health(server);
        }
        Ok(())
    }

    fn handle(&mut self, event: PipelineEvent, server: &Server) -> Result<(), ServiceError> {
        match event {
            PipelineEvent::Progress(progress) => {
                self.life.on_frames();
                let message = self.progress.message(&progress, self.rig.slots.len(), self.life.state());
                self.note(server.publish_progress(&message));
            }
            PipelineEvent::Calibration(solved) => self.publish(*solved, server),
            PipelineEvent::Camera { camera, state, detail } => {
                let name = self.rig.identities.get(camera).map_or("?", |camera| camera.name.as_str());
                match state {
                    crate::pipeline::CameraState::Streaming => tracing::info!(camera = name, "camera streams"),
                    other => tracing::warn!(camera = name, state = other.name(), detail, "camera is away"),
                }
            }
            PipelineEvent::Bug { thread } => self.restart(&thread)?,
        }
        Ok(())
    }

    fn publish(&mut self, solved: Solved, server: &Server) {
        self.life.on_solved(&solved);
        self.progress.note(&solved.calibration);
        self.calibration_sequence += 1;
        let (state, ms) = (solved.calibration.state.name(), solved.took.as_millis());
        let sentence = solved.calibration.reason.as_ref().map_or("", |reason| reason.sentence.as_str());
        if self.life.state() == crate::solver::State::Converged {
            tracing::info!(state, ms, frame_sets = solved.calibration.frame_sets_used, "calibrated");
        } else {
            tracing::debug!(state, ms, sentence, "not yet");
        }
        let message = CalibrationMessage {
            sequence: self.calibration_sequence,
            stamp_ns: wall_clock_ns(),
            cameras: self.rig.identities.clone(),
            calibration: solved.calibration,
        };
        self.note(server.publish_calibration(&message));
    }

    fn answer(&mut self, request: Request) -> Response {
        let before = self.pipeline.snapshot();
        let outcome = self.life.answer(request.kind, &before, |command| {
            let answer = self.pipeline.command(command);
            if (command, answer) == (Command::Recalibrate, crate::pipeline::Answer::Accepted) {
                self.progress.restart(before.counts);
            }
            answer
        });
        if request.kind != RequestKind::Status {
            tracing::info!(request = ?request.kind, ?outcome, "asked");
        }
        Response { outcome, snapshot: self.snapshot() }
    }

    fn snapshot(&self) -> Snapshot {
        let pipeline = self.pipeline.snapshot();
        Snapshot {
            activity: self.life.activity(pipeline.phase),
            state: self.life.state(),
            reason: self.life.reason().cloned(),
            calibration_sequence: self.calibration_sequence,
            uptime_ns: self.health.uptime_ns(),
            frame_sets_used: self.progress.frame_sets(&pipeline.counts).used,
            cameras: pipeline.cameras.len() as u32,
            cameras_streaming: state::streaming(&pipeline) as u32,
        }
    }

    fn tell_health(&mut self, server: &Server) {
        let message = self.health.message(&self.pipeline.snapshot());
        self.note(server.publish_health(&message));
        if let (count, Some(error)) = std::mem::take(&mut self.unpublished) {
            tracing::warn!(count, %error, "messages could not be published");
        }
    }

    /// A message that was not published is no reason to end; it is told once a second.
    fn note(&mut self, published: Result<(), ServerError>) {
        if let Err(error) = published {
            self.unpublished = (self.unpublished.0 + 1, Some(error));
        }
    }

    /// Starts the pipeline again after a panic in one of its threads; the evidence is lost, the last result is not.
    fn restart(&mut self, thread: &str) -> Result<(), ServiceError> {
        if self.restarts == MAX_RESTARTS {
            return Err(ServiceError::Bug { thread: thread.to_owned(), restarts: self.restarts });
        }
        self.restarts += 1;
        tracing::error!(thread, restarts = self.restarts, "a thread panicked: this is a bug; starting the pipeline again");
        let (pipeline, events) = self.rig.start()?;
        std::mem::replace(&mut self.pipeline, pipeline).stop();
        self.events = events;
        self.life.on_restart();
        self.progress.restart(crate::pipeline::Counts::default());
        Ok(())
    }

    /// Answers what was asked meanwhile, then stops the threads.
    fn end(mut self, server: &Server) {
        self.life.on_stop();
        let polled = server.poll(Duration::ZERO, |request| self.answer(request));
        self.note(polled.map(drop));
        let report = self.pipeline.stop();
        tracing::info!(abandoned = report.abandoned.len(), "stopped");
    }
}
