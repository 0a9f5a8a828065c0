//! The running daemon: one thread that listens to the pipeline and to the clients, and tells the one about the other.

#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, bounded};

use super::Attachments;
use super::apart::ApartTeller;
use super::config::{Config, OnMoved};
use super::error::ServiceError;
use super::logging::LogHandle;
use super::reload::Reloader;
use super::rig::{Rig, identities, with_firmware};
use super::state::{self, Life};
use super::stop::Stop;
use super::storing::{self, Storing};
use super::supervisor::{Standing, Supervisor};
use super::telling::{HealthTeller, ProgressTeller, log_moved, wall_clock_ns};
use crate::ipc::{
    CalibrationMessage, CameraIdentity, Outcome, Provenance, RefusalCode, Request, RequestKind, Response,
    Server, ServerError, Snapshot,
};
use crate::pipeline::recovery::HangWatch;
use crate::pipeline::{self, Answer, Command, Counts, Pipeline, PipelineEvent, Solved};
use crate::solver::{RigCalibration, State, WatchReport};
use crate::store::StoredCalibration;

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
    /// The cameras of the rig; empty before they are known.
    identities: Vec<CameraIdentity>,
    life: Life,
    storing: Storing,
    /// The newest published calibration.
    published: Option<CalibrationMessage>,
    /// The result of an earlier run that is served: what a new pipeline begins with instead of collecting.
    served: Option<RigCalibration>,
    config_hash: String,
    progress: ProgressTeller,
    health: HealthTeller,
    apart: ApartTeller,
    on_moved: OnMoved,
    /// A new calibration began without being asked for: until it converges, the old result stays published.
    keeps_result: bool,
    /// Messages that could not be published since health was told last, and why the last one could not.
    unpublished: (u32, Option<ServerError>),
    supervisor: Supervisor,
    hangs: HangWatch,
    reloader: Option<(Reloader, LogHandle)>,
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
    /// A camera's thread does not come back from its driver.
    Hang {
        thread: String,
    },
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
    let storing = Storing::open(&config.store, &config.instance);
    let mut daemon = Daemon::new(config, storing, (supervisor, reloader));
    // Listed cameras are known before they are there: nobody waits for a back end to get the last good calibration.
    if let Some(listed) = config.cameras.listed() {
        daemon.serve_newest(identities(&listed?), &server);
    }
    let Some(rig) = open_rig(config, stop, (&mut daemon, &server))? else {
        tracing::info!("stopped before the cameras were there");
        return Ok(());
    };
    let names: Vec<&str> = rig.identities.iter().map(|camera| camera.name.as_str()).collect();
    tracing::info!(instance = %config.instance, cameras = names.join(", "), "started");
    if daemon.identities.is_empty() {
        daemon.serve_newest(rig.identities.clone(), &server);
    }
    let ended = run_rig(&rig, &server, (&mut daemon, stop));
    daemon.storing.finish();
    ended
}

/// Runs pipelines one after the other: a panic in one of its threads ends a pipeline, not the daemon.
fn run_rig(rig: &Rig, server: &Server, (daemon, stop): (&mut Daemon, &Stop)) -> Result<(), ServiceError> {
    for restarts in 0.. {
        let (sender, events) = bounded(EVENT_QUEUE);
        let live = Live { pipeline: rig.start(sender)?, events, server };
        if let Some(served) = &daemon.served {
            live.pipeline.watch(served.clone());
        }
        let end = daemon.serve(&live, stop);
        daemon.say_goodbye(&live, &end);
        let report = live.pipeline.stop();
        match end {
            End::Requested => {
                tracing::info!(hanging = report.abandoned.len(), "stopped");
                break;
            }
            End::Hang { thread } => return Err(ServiceError::CameraHangs { thread }),
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
/// Clients are answered meanwhile. `None` when the daemon shall stop; the thread ends with the process.
fn open_rig(
    config: &Config,
    stop: &Stop,
    (daemon, server): (&mut Daemon, &Server),
) -> Result<Option<Rig>, ServiceError> {
    let (sender, opened) = bounded(1);
    let config = config.clone();
    let opening = std::thread::Builder::new().name("open".to_owned());
    // Nobody receives any more when the daemon has stopped.
    let spawned = opening.spawn(move || drop(sender.send(Rig::awaited(&config))));
    spawned.map_err(|source| ServiceError::System { what: "cannot start a thread", source })?;
    while !stop.is_set() {
        match opened.recv_timeout(POLL) {
            Ok(rig) => return rig.map(Some),
            Err(RecvTimeoutError::Timeout) => daemon.answer_early_clients(server),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(ServiceError::Bug { thread: "open".to_owned(), restarts: 1 });
            }
        }
    }
    Ok(None)
}

impl Daemon {
    fn new(
        config: &Config,
        storing: Storing,
        (supervisor, reloader): (Supervisor, Option<(Reloader, LogHandle)>),
    ) -> Self {
        Self {
            identities: Vec::new(),
            life: Life::new(),
            storing,
            published: None,
            served: None,
            config_hash: config.hash.clone(),
            progress: ProgressTeller::default(),
            health: HealthTeller::new(Instant::now()),
            apart: ApartTeller::new(config.pipeline.sync.max_skew),
            on_moved: config.on_moved,
            keeps_result: false,
            unpublished: (0, None),
            supervisor,
            hangs: HangWatch::new(config.pipeline.recovery.leave_after),
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
                if let Some(thread) = self.hangs.look(&live.pipeline.vitals(), Instant::now()) {
                    return End::Hang { thread };
                }
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
            End::Hang { thread } => {
                self.life.on_stop();
                self.supervisor.stopping(&format!("leaving: {thread} hangs in a driver"));
            }
            End::Bug { .. } => {
                // What is served the next pipeline goes on watching.
                if self.served.is_none() {
                    self.keeps_result |= self.life.state() == State::Converged;
                    self.life.on_restart();
                }
                self.progress.restart(Counts::default());
            }
        }
        self.answer_clients(live);
    }

    fn be_looked_at(&mut self, pipeline: &Pipeline) {
        let snapshot = pipeline.snapshot();
        self.life.on_apart(self.apart.look(&snapshot));
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
                self.config_hash = taken.config.hash;
                tracing::info!(changed = taken.keys.join(", "), "config read again");
            }
            Err(error) => tracing::error!("the config stays as it was: {error}"),
        }
    }

    fn answer_clients(&mut self, live: &Live<'_>) {
        let polled = live.server.poll(Duration::ZERO, |request| self.answer(request, live));
        self.note(polled.map(drop));
        self.answer_archive(live.server);
        self.storing.poll();
    }

    fn answer_archive(&mut self, server: &Server) {
        let polled = server.poll_archive(|below| self.storing.archived_below(below));
        self.note(polled.map(drop));
    }

    /// Before there is a pipeline, clients can look and nothing else.
    fn answer_early_clients(&mut self, server: &Server) {
        let answer = |request: Request| {
            let outcome = match request.kind {
                RequestKind::Status => Outcome::Accepted,
                _ => Outcome::Refused {
                    code: RefusalCode::Starting,
                    sentence: "the daemon is opening its cameras: ask again in a moment".to_owned(),
                },
            };
            Response { outcome, snapshot: self.snapshot(&pipeline::Snapshot::default()) }
        };
        let polled = server.poll(Duration::ZERO, answer);
        self.note(polled.map(drop));
        self.answer_archive(server);
    }

    /// The cameras are known: serves their newest calibration of earlier runs, if there is one.
    fn serve_newest(&mut self, identities: Vec<CameraIdentity>, server: &Server) {
        self.identities = identities;
        if let Some(newest) = self.storing.newest_for(&self.identities) {
            let age_s = wall_clock_ns().saturating_sub(newest.made_ns) / 1_000_000_000;
            tracing::info!(
                id = newest.id,
                age_s,
                "serving the stored calibration until live lines confirm it"
            );
            self.publish_stored(&newest, server);
        }
    }

    /// Publishes a calibration of an earlier time, which is not verified.
    fn publish_stored(&mut self, stored: &StoredCalibration, server: &Server) {
        self.life.on_stored();
        self.served = Some(stored.calibration.clone());
        self.progress.note(&stored.calibration);
        self.publish(storing::message(stored, State::Stored), server);
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
            PipelineEvent::Watched(watched) => self.watched(watched.report, live),
            // The pipeline has logged it, health tells it, and a bug has ended the loop.
            PipelineEvent::Camera { .. } | PipelineEvent::Bug { .. } => {}
        }
    }

    fn take(&mut self, mut solved: Solved, live: &Live<'_>) {
        self.apart.explain(&mut solved.calibration, &live.pipeline.snapshot());
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
            self.publish_solved(solved.calibration, live);
        }
    }

    fn publish_solved(&mut self, calibration: RigCalibration, live: &Live<'_>) {
        let mut message = CalibrationMessage {
            sequence: 0,
            stamp_ns: wall_clock_ns(),
            provenance: Provenance {
                version: env!("CARGO_PKG_VERSION").to_owned(),
                config_hash: self.config_hash.clone(),
                ..Provenance::default()
            },
            cameras: with_firmware(&self.identities, &live.pipeline.snapshot()),
            calibration,
        };
        if message.calibration.state == State::Converged {
            let counts = self.progress.frame_sets(&live.pipeline.snapshot().counts);
            message.provenance.id = self.storing.add(&message, counts.into());
        }
        self.publish(message, live.server);
    }

    fn publish(&mut self, mut message: CalibrationMessage, server: &Server) {
        message.sequence = self.published.as_ref().map_or(0, |before| before.sequence) + 1;
        self.note(server.publish_calibration(&message));
        self.published = Some(message);
    }

    /// Live lines agree with the result of an earlier run: it is published again, as one of this run.
    fn publish_verified(&mut self, server: &Server) {
        let Some(mut message) = self.published.clone() else { return };
        tracing::info!(id = message.provenance.id, "the stored calibration is verified");
        message.calibration.state = State::Converged;
        self.publish(message, server);
    }

    /// The newest word on how the result stands.
    fn watched(&mut self, report: WatchReport, live: &Live<'_>) {
        let pipeline = &live.pipeline;
        let is_news = self.life.on_watched(report);
        if self.life.on_verified() {
            self.publish_verified(live.server);
        }
        if !is_news {
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
                self.served = None;
            }
        }
    }

    fn answer(&mut self, request: Request, live: &Live<'_>) -> Response {
        let pipeline = &live.pipeline;
        let before = pipeline.snapshot();
        let mut outcome = self.life.answer(request.kind, &before, |command| {
            let answer = pipeline.command(command);
            if (command, answer) == (Command::Recalibrate, Answer::Accepted) {
                self.progress.restart(before.counts);
                self.keeps_result = false;
                self.served = None;
            }
            answer
        });
        if (request.kind, &outcome) == (RequestKind::Rollback, &Outcome::Accepted) {
            outcome = self.go_back(request.calibration, live);
        }
        if request.kind != RequestKind::Status {
            tracing::info!(request = ?request.kind, ?outcome, "asked");
        }
        Response { outcome, snapshot: self.snapshot(&pipeline.snapshot()) }
    }

    /// Publishes an older calibration and watches it like one of an earlier run.
    fn go_back(&mut self, id: u64, live: &Live<'_>) -> Outcome {
        let stored = match self.storing.go_back(id, &self.identities, wall_clock_ns()) {
            Ok(stored) => stored,
            Err((code, sentence)) => return Outcome::Refused { code, sentence },
        };
        tracing::info!(id, new_id = stored.id, "going back to an older calibration");
        self.keeps_result = false;
        self.progress.restart(live.pipeline.snapshot().counts);
        self.publish_stored(&stored, live.server);
        live.pipeline.watch(stored.calibration);
        Outcome::Accepted
    }

    fn snapshot(&self, pipeline: &pipeline::Snapshot) -> Snapshot {
        Snapshot {
            activity: self.life.activity(pipeline.phase),
            state: self.life.state(),
            reason: self.life.reason().cloned(),
            watch: self.life.watch().cloned(),
            calibration_sequence: self.published.as_ref().map_or(0, |message| message.sequence),
            calibration_id: self.published.as_ref().and_then(|message| message.provenance.id),
            calibration_stamp_ns: self.published.as_ref().map(|message| message.stamp_ns),
            store_fault: self.storing.fault().map(str::to_owned),
            uptime_ns: self.health.uptime_ns(),
            frame_sets: self.progress.frame_sets(&pipeline.counts),
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
