//! The running daemon: one thread that listens to the pipeline and to the clients, and tells the one about the other.

mod results;
mod start;
#[cfg(test)]
mod tests;

use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;

pub use start::run;
pub(super) use start::run_attached;

use super::Attachments;
use super::apart::ApartTeller;
use super::config::{Config, OnMoved};
use super::logging::LogHandle;
use super::plumb::PlumbTeller;
use super::reload::Reloader;
use super::state::{self, Life};
use super::stop::Stop;
use super::storing::Storing;
use super::supervisor::{Standing, Supervisor};
use super::telling::{HealthTeller, ProgressTeller};
use crate::ipc::{
    CalibrationMessage, CameraIdentity, Outcome, Request, RequestKind, Response, Server, ServerError,
    Snapshot,
};
use crate::pipeline::recovery::HangWatch;
use crate::pipeline::{self, Answer, Command, Counts, Pipeline, PipelineEvent};
use crate::solver::{RigCalibration, State};

/// Longest time a client's request or a signal waits for the daemon's attention; events of the pipeline wake it at once.
const POLL: Duration = Duration::from_millis(5);
/// How often health is told.
const HEALTH_INTERVAL: Duration = Duration::from_secs(1);

/// Events that wait for this thread; at 30 frame sets a second this is two seconds. Then the pipeline drops and counts them.
const EVENT_QUEUE: usize = 64;

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
    plumb: PlumbTeller,
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
            plumb: PlumbTeller::default(),
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
        self.life.on_apart(self.apart.look(&snapshot, Instant::now()));
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
        let pipeline = live.pipeline.snapshot();
        let served = self.published.as_ref().map(|message| &message.calibration);
        let gravity_off_deg = self.plumb.look(&pipeline, served);
        let message = self.health.message(&pipeline, self.life.watch(), &gravity_off_deg);
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
