//! The running daemon: one thread that listens to the pipeline and to the clients, and tells the one about the other.

#[cfg(test)]
mod tests;

use std::sync::Arc;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};

use super::config::{CameraChoice, Config, OnMoved, RigError};
use super::error::ServiceError;
use super::logging::LogHandle;
use super::manager::ServiceManager;
use super::reload::Reloader;
use super::state::{self, Life};
use super::stop::Stop;
use super::supervisor::{Standing, Supervisor};
use super::telling::{HealthTeller, ProgressTeller, wall_clock_ns};
use crate::capture::DeviceFactory;
use crate::ipc::{
    CalibrationMessage, CameraIdentity, Request, RequestKind, Response, Server, ServerError, Snapshot,
};
use crate::pipeline::{
    self, Answer, CameraSlot, Command, Counts, Parts, Pipeline, PipelineEvent, PipelineOptions, Solved,
};
use crate::solver::{Moved, State, WatchReport, Who};

/// Longest time a client's request or a signal waits for the daemon's attention; events of the pipeline wake it at once.
const POLL: Duration = Duration::from_millis(5);
/// How often health is told.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);
/// Events that wait for this thread; at 30 frame sets a second this is two seconds. Then the pipeline drops and counts them.
const EVENT_QUEUE: usize = 64;
/// Restarts of a pipeline with a bug before the daemon gives up.
const MAX_RESTARTS: u32 = 5;

/// What is remembered while pipelines come and go.
struct Daemon {
    identities: Vec<CameraIdentity>,
    life: Life,
    calibration_sequence: u64,
    progress: ProgressTeller,
    health: HealthTeller,
    on_moved: OnMoved,
    /// A new calibration began without being asked for: until it converges, the old result stays published.
    keeps_result: bool,
    /// Messages that could not be published since health was told last, and why the last one could not.
    unpublished: (u32, Option<ServerError>),
    supervisor: Supervisor,
    reloader: Option<(Reloader, LogHandle)>,
}

/// What a daemon is tied to besides its config; nothing, where it runs within another program.
#[derive(Debug, Default)]
pub(super) struct Attachments {
    /// Who started it.
    pub(super) manager: ServiceManager,
    /// The config file, to be read again when asked to, and the log whose level it says.
    pub(super) reloader: Option<(Reloader, LogHandle)>,
}

/// Both sides that are listened to.
struct Live<'a> {
    pipeline: Pipeline,
    events: Receiver<PipelineEvent>,
    server: &'a Server,
}

/// Why a pipeline is no longer listened to.
enum End {
    Requested,
    /// A thread of it panicked.
    Bug {
        thread: String,
    },
}

/// What the pipeline is started with, and started again after a bug.
struct Rig {
    slots: Vec<CameraSlot>,
    identities: Vec<CameraIdentity>,
    options: PipelineOptions,
    on_moved: OnMoved,
    /// Lines and estimate; other ones in tests.
    make_parts: fn(&PipelineOptions) -> Parts,
}

impl Rig {
    fn new(config: &Config) -> Result<Self, ServiceError> {
        let factory: Arc<dyn DeviceFactory> = Arc::from(config.cameras.factory().map_err(RigError::from)?);
        let cameras = config.cameras.rig(factory.as_ref())?;
        if let [only] = cameras.as_slice() {
            return Err(RigError::OneCamera { name: only.name.clone() }.into());
        }
        let slot = |camera: &CameraChoice| CameraSlot {
            factory: Arc::clone(&factory),
            serial: camera.serial.clone(),
            name: camera.name.clone(),
        };
        let identity = |camera: &CameraChoice| CameraIdentity {
            name: camera.name.clone(),
            serial: camera.serial.clone(),
        };
        Ok(Self {
            slots: cameras.iter().map(slot).collect(),
            identities: cameras.iter().map(identity).collect(),
            options: config.pipeline,
            on_moved: config.on_moved,
            make_parts: Parts::new,
        })
    }

    fn start<'a>(&self, server: &'a Server) -> Result<Live<'a>, ServiceError> {
        let (sender, events) = bounded(EVENT_QUEUE);
        let parts = (self.make_parts)(&self.options);
        let pipeline = Pipeline::start_with(parts, self.slots.clone(), &self.options, sender)?;
        Ok(Live { pipeline, events, server })
    }
}

/// Runs the daemon until it is asked to stop.
///
/// # Errors
/// When it cannot start, or when the pipeline fails again and again.
pub fn run(config: &Config, stop: &Stop) -> Result<(), ServiceError> {
    run_attached(config, stop, Attachments::default())
}

/// The same with a service manager and a config file.
pub(super) fn run_attached(
    config: &Config,
    stop: &Stop,
    attachments: Attachments,
) -> Result<(), ServiceError> {
    let Attachments { manager, reloader } = attachments;
    let mut supervisor = Supervisor::new(manager, config.ready_when);
    supervisor.say("opening the cameras' back end");
    // The name first: a second daemon must not even touch the cameras.
    let server = Server::start_over(&config.transport, &config.instance)?;
    let Some(rig) = open_rig(config, stop)? else {
        tracing::info!("stopped before the cameras were there");
        return Ok(());
    };
    let names: Vec<&str> = rig.identities.iter().map(|camera| camera.name.as_str()).collect();
    tracing::info!(instance = %config.instance, cameras = names.join(", "), "started");
    let daemon = Daemon::new(rig.identities.clone(), rig.on_moved, (supervisor, reloader));
    run_rig(daemon, &rig, &server, stop)
}

/// Runs pipelines one after the other: a panic in one of its threads ends a pipeline, not the daemon.
fn run_rig(mut daemon: Daemon, rig: &Rig, server: &Server, stop: &Stop) -> Result<(), ServiceError> {
    for restarts in 0.. {
        let live = rig.start(server)?;
        let end = daemon.serve(&live, stop);
        daemon.say_goodbye(&live, &end);
        let report = live.pipeline.stop();
        match end {
            End::Requested => {
                tracing::info!(hanging = report.abandoned.len(), "stopped");
                break;
            }
            End::Bug { thread } if restarts == MAX_RESTARTS => {
                return Err(ServiceError::Bug { thread, restarts });
            }
            End::Bug { thread } => {
                tracing::error!(
                    thread,
                    restarts,
                    "a thread panicked, which is a bug: starting the pipeline again"
                );
            }
        }
    }
    Ok(())
}

/// Opens the back end on a thread of its own: loading a recording takes as long as it takes, and a signal must not wait for it.
/// `None` when the daemon shall stop meanwhile; the thread ends with the process.
fn open_rig(config: &Config, stop: &Stop) -> Result<Option<Rig>, ServiceError> {
    let (sender, opened) = bounded(1);
    let config = config.clone();
    let opening = std::thread::Builder::new().name("open".to_owned());
    // Nobody receives any more when the daemon has stopped.
    let spawned = opening.spawn(move || drop(sender.send(Rig::new(&config))));
    spawned.map_err(|source| ServiceError::System { what: "cannot start a thread", source })?;
    while !stop.is_set() {
        match opened.recv_timeout(POLL) {
            Ok(rig) => return rig.map(Some),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(ServiceError::Bug { thread: "open".to_owned(), restarts: 1 });
            }
        }
    }
    Ok(None)
}

impl Daemon {
    fn new(
        identities: Vec<CameraIdentity>,
        on_moved: OnMoved,
        (supervisor, reloader): (Supervisor, Option<(Reloader, LogHandle)>),
    ) -> Self {
        Self {
            identities,
            life: Life::new(),
            calibration_sequence: 0,
            progress: ProgressTeller::default(),
            health: HealthTeller::new(Instant::now()),
            on_moved,
            keeps_result: false,
            unpublished: (0, None),
            supervisor,
            reloader,
        }
    }

    /// Listens to both sides until there is a reason to end.
    fn serve(&mut self, live: &Live<'_>, stop: &Stop) -> End {
        while !stop.is_set() {
            // Waiting for the first, then taking what else has come meanwhile; no flood keeps clients waiting.
            let first = live.events.recv_timeout(POLL).ok();
            for event in first.into_iter().chain(live.events.try_iter().take(EVENT_QUEUE)) {
                match event {
                    PipelineEvent::Bug { thread } => return End::Bug { thread },
                    event => self.handle(event, live),
                }
            }
            self.answer_clients(live);
            if self.health.is_due(HEALTH_INTERVAL) {
                self.tell_health(live);
            }
            self.reload_when_asked();
            if self.supervisor.is_due() {
                self.be_looked_at(&live.pipeline);
            }
        }
        End::Requested
    }

    /// Whoever asks in the last moment gets an answer.
    fn say_goodbye(&mut self, live: &Live<'_>, end: &End) {
        match end {
            End::Requested => {
                self.life.on_stop();
                self.supervisor.stopping("stopping");
            }
            End::Bug { .. } => {
                self.keeps_result |= self.life.state() == State::Converged;
                self.life.on_restart();
                self.progress.restart(Counts::default());
            }
        }
        self.answer_clients(live);
    }

    fn be_looked_at(&mut self, pipeline: &Pipeline) {
        let snapshot = pipeline.snapshot();
        let daemon = self.snapshot(&snapshot);
        let standing = Standing { daemon: &daemon, cameras: &snapshot.cameras };
        self.supervisor.look(pipeline.vitals(), &standing);
    }

    fn reload_when_asked(&mut self) {
        let Some((reloader, log)) = &mut self.reloader else { return };
        if !reloader.take_request() {
            return;
        }
        match self.supervisor.during_reload(|| reloader.reload()) {
            Ok(taken) => {
                log.set_level(taken.config.log.level);
                self.on_moved = taken.config.on_moved;
                self.supervisor.set_ready_when(taken.config.ready_when);
                tracing::info!(changed = taken.keys.join(", "), "config read again");
            }
            Err(error) => tracing::error!("the config stays as it was: {error}"),
        }
    }

    fn answer_clients(&mut self, live: &Live<'_>) {
        let polled = live.server.poll(Duration::ZERO, |request| self.answer(request, &live.pipeline));
        self.note(polled.map(drop));
    }

    fn handle(&mut self, event: PipelineEvent, live: &Live<'_>) {
        match event {
            PipelineEvent::Progress(progress) => {
                self.life.on_frames();
                let message = self.progress.message(&progress, self.identities.len(), &self.life);
                self.note(live.server.publish_progress(&message));
            }
            // One that was under way when a client asked for a new calibration is not the answer to that.
            PipelineEvent::Calibration(solved) if solved.round != live.pipeline.round() => {}
            PipelineEvent::Calibration(solved) => self.take(*solved, live),
            PipelineEvent::Watched(watched) if watched.round != live.pipeline.round() => {}
            PipelineEvent::Watched(watched) => self.watched(watched.report, &live.pipeline),
            // The pipeline has logged it, health tells it, and a bug has ended the loop.
            PipelineEvent::Camera { .. } | PipelineEvent::Bug { .. } => {}
        }
    }

    fn take(&mut self, solved: Solved, live: &Live<'_>) {
        self.life.on_solved(&solved);
        self.progress.note(&solved.calibration);
        self.keeps_result &= self.life.state() != State::Converged;
        let (state, ms) = (solved.calibration.state.name(), solved.took.as_millis());
        let sentence = solved.calibration.reason.as_ref().map_or("", |reason| reason.sentence.as_str());
        if self.life.state() == State::Converged {
            tracing::info!(state, ms, frame_sets = solved.calibration.frame_sets_used, "calibrated");
        } else {
            tracing::debug!(state, ms, sentence, "not yet");
        }
        if !self.keeps_result {
            self.publish(solved, live);
        }
    }

    fn publish(&mut self, solved: Solved, live: &Live<'_>) {
        self.calibration_sequence += 1;
        let message = CalibrationMessage {
            sequence: self.calibration_sequence,
            stamp_ns: wall_clock_ns(),
            cameras: self.identities.clone(),
            calibration: solved.calibration,
        };
        self.note(live.server.publish_calibration(&message));
    }

    /// The newest word on how the result stands.
    fn watched(&mut self, report: WatchReport, pipeline: &Pipeline) {
        if !self.life.on_watched(report) {
            return;
        }
        let moved = self.life.watch().map(|watch| watch.moved.as_slice()).unwrap_or_default();
        if moved.is_empty() {
            tracing::info!("every camera stands again as calibrated");
            return;
        }
        moved.iter().for_each(|moved| log_moved(moved, &self.identities));
        if self.on_moved == OnMoved::Recalibrate {
            let before = pipeline.snapshot();
            if pipeline.command(Command::Recalibrate) == Answer::Accepted {
                tracing::info!(
                    "calibrating again because a camera was moved: the old result stays until then"
                );
                self.life.on_moved_restart();
                self.progress.restart(before.counts);
                self.keeps_result = true;
            }
        }
    }

    fn answer(&mut self, request: Request, pipeline: &Pipeline) -> Response {
        let before = pipeline.snapshot();
        let outcome = self.life.answer(request.kind, &before, |command| {
            let answer = pipeline.command(command);
            if (command, answer) == (Command::Recalibrate, Answer::Accepted) {
                self.progress.restart(before.counts);
                self.keeps_result = false;
            }
            answer
        });
        if request.kind != RequestKind::Status {
            tracing::info!(request = ?request.kind, ?outcome, "asked");
        }
        Response { outcome, snapshot: self.snapshot(&pipeline.snapshot()) }
    }

    fn snapshot(&self, pipeline: &pipeline::Snapshot) -> Snapshot {
        Snapshot {
            activity: self.life.activity(pipeline.phase),
            state: self.life.state(),
            reason: self.life.reason().cloned(),
            watch: self.life.watch().cloned(),
            calibration_sequence: self.calibration_sequence,
            uptime_ns: self.health.uptime_ns(),
            frame_sets_used: self.progress.frame_sets(&pipeline.counts).used,
            cameras: pipeline.cameras.len() as u32,
            cameras_streaming: state::streaming(pipeline) as u32,
        }
    }

    fn tell_health(&mut self, live: &Live<'_>) {
        let message = self.health.message(&live.pipeline.snapshot(), self.life.watch());
        self.note(live.server.publish_health(&message));
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
}

fn log_moved(moved: &Moved, identities: &[CameraIdentity]) {
    let name = |camera: usize| identities.get(camera).map_or("?", |camera| camera.name.as_str());
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    let (deg, mm) = (rounded(moved.rotation_rad.to_degrees()), rounded(1e3 * moved.translation_m));
    let (sigma_deg, sigma_mm) =
        (rounded(moved.sigma_rotation_rad.to_degrees()), rounded(1e3 * moved.sigma_translation_m));
    match moved.who {
        Who::Camera(camera) => {
            let camera = name(camera);
            tracing::warn!(
                camera,
                deg,
                mm,
                sigma_deg,
                sigma_mm,
                "camera was moved: the result no longer holds"
            );
        }
        Who::OneOf(a, b) => {
            let cameras = format!("{}, {}", name(a), name(b));
            tracing::warn!(
                cameras,
                deg,
                mm,
                sigma_deg,
                sigma_mm,
                "one of two cameras was moved: the result no longer holds"
            );
        }
    }
}
