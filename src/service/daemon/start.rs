//! From the start of the daemon to its end: the cameras' back end is opened, and pipelines run one after the other.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crossbeam_channel::{RecvTimeoutError, bounded};

use super::{Attachments, Daemon, EVENT_QUEUE, End, Live, POLL};
use crate::ipc::{Outcome, RefusalCode, Request, RequestKind, Response, Server};
use crate::pipeline;
use crate::service::config::Config;
use crate::service::error::ServiceError;
use crate::service::rig::{Rig, identities};
use crate::service::stop::Stop;
use crate::service::storing::Storing;
use crate::service::supervisor::{Opening, Supervisor};

/// Restarts of a pipeline with a bug before the daemon gives up.
pub(super) const MAX_RESTARTS: u32 = 5;

/// What the thread that looks for cameras says of itself.
#[derive(Debug, Default)]
struct Search {
    /// Turns of its loop. Relaxed: nothing is handed over.
    turns: AtomicU64,
    /// What is missing, in words; `None` before the first look is over.
    missing: Mutex<Option<String>>,
}

impl Search {
    fn turn(&self, missing: Option<String>) {
        self.turns.fetch_add(1, Ordering::Relaxed);
        *self.missing.lock().unwrap_or_else(PoisonError::into_inner) = missing;
    }

    fn missing(&self) -> Option<String> {
        self.missing.lock().unwrap_or_else(PoisonError::into_inner).clone()
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
pub(in crate::service) fn run_attached(
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
pub(super) fn run_rig(
    rig: &Rig,
    server: &Server,
    (daemon, stop): (&mut Daemon, &Stop),
) -> Result<(), ServiceError> {
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

/// Opens the back end on a thread of its own: loading a recording takes as long as it takes, cameras come when they come, and neither
/// a signal nor a client must wait for that. `None` when the daemon shall stop; the thread ends with the process.
fn open_rig(
    config: &Config,
    stop: &Stop,
    (daemon, server): (&mut Daemon, &Server),
) -> Result<Option<Rig>, ServiceError> {
    let (sender, opened) = bounded(1);
    let search = Arc::new(Search::default());
    let opening = std::thread::Builder::new().name("open".to_owned());
    let spawned = opening.spawn({
        let (config, search) = (config.clone(), Arc::clone(&search));
        // Nobody receives any more when the daemon has stopped.
        move || drop(sender.send(Rig::awaited(&config, &mut |missing| search.turn(missing))))
    });
    spawned.map_err(|source| ServiceError::System { what: "cannot start a thread", source })?;
    let search = config.cameras.is_live().then_some(search);
    while !stop.is_set() {
        match opened.recv_timeout(POLL) {
            Ok(rig) => return rig.map(Some),
            Err(RecvTimeoutError::Timeout) => daemon.attend_early(server, search.as_deref()),
            Err(RecvTimeoutError::Disconnected) => {
                return Err(ServiceError::Bug { thread: "open".to_owned(), restarts: 1 });
            }
        }
    }
    daemon.life.on_stop();
    daemon.supervisor.stopping("stopping");
    daemon.attend_early(server, search.as_deref());
    Ok(None)
}

impl Daemon {
    /// Looks after everybody else while there is no pipeline; `search` where cameras are looked for.
    fn attend_early(&mut self, server: &Server, search: Option<&Search>) {
        let missing = search.and_then(Search::missing);
        self.answer_early_clients(server, missing.as_deref());
        self.reload_when_asked();
        if self.supervisor.is_due() && !self.life.is_stopping() {
            self.supervisor.look_at_opening(&match search {
                Some(search) => Opening::Looking {
                    turns: search.turns.load(Ordering::Relaxed),
                    missing: missing.as_deref(),
                },
                None => Opening::Loading,
            });
        }
    }

    /// Before there is a pipeline, clients can look and nothing else.
    fn answer_early_clients(&mut self, server: &Server, missing: Option<&str>) {
        let sentence = || match missing {
            Some(missing) => format!("the daemon waits for its cameras: {missing}"),
            None => "the daemon is opening its cameras: ask again in a moment".to_owned(),
        };
        let answer = |request: Request| {
            let outcome = match request.kind {
                RequestKind::Status => Outcome::Accepted,
                _ => Outcome::Refused { code: RefusalCode::Starting, sentence: sentence() },
            };
            Response { outcome, snapshot: self.snapshot(&pipeline::Snapshot::default()) }
        };
        let polled = server.poll(Duration::ZERO, answer);
        self.note(polled.map(drop));
        self.answer_archive(server);
    }
}
