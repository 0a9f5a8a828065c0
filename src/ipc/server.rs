//! The daemon's side of the shared memory: publishes, answers requests, wakes its clients.
//!
//! Publishing never waits for a reader: a slow one loses its oldest message. One daemon per instance: the single publisher of the
//! calibration is the lock, and it dies with its process.

use std::fmt::Debug;
use std::time::Duration;

use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{BackpressureStrategy, EventId, ZeroCopySend};

use super::message::{CalibrationMessage, HealthMessage, ProgressMessage};
use super::names::{InstanceName, IpcService, Topic};
use super::request::{Archived, Outcome, RefusalCode, Request, RequestKind, Response};
use super::services::{Failure, MAX_CLIENTS, Participant, Side, events, listen};
use super::wire::{
    ArchiveRequestWire, ArchiveResponseWire, CalibrationWire, HealthWire, ProgressWire, RequestWire,
    ResponseWire, WireError,
};

type ControlPort = iceoryx2::port::server::Server<IpcService, RequestWire, (), ResponseWire, ()>;
type ArchivePort =
    iceoryx2::port::server::Server<IpcService, ArchiveRequestWire, (), ArchiveResponseWire, ()>;

/// Most requests answered in one go, so that a flood of them does not keep the daemon from its work.
const MAX_ANSWERS: usize = 4 * MAX_CLIENTS;

/// Why the daemon's side does not work.
#[derive(Debug, thiserror::Error)]
pub enum ServerError {
    /// Another daemon of this name lives.
    #[error(
        "a daemon with the instance name '{instance}' is already running: stop it, or choose another name"
    )]
    AlreadyRunning {
        /// The name.
        instance: InstanceName,
    },
    /// The shared memory of this name belongs to another user.
    #[error("no permission for the shared memory of instance '{instance}': another user's processes hold it")]
    Denied {
        /// The name.
        instance: InstanceName,
    },
    /// A client of another release holds the services of this name.
    #[error(
        "clients of another release hold the services of instance '{instance}': stop them, then start again"
    )]
    OtherRelease {
        /// The name.
        instance: InstanceName,
    },
    /// A message does not fit the wire format.
    #[error("message cannot be sent: {0}")]
    Wire(#[from] WireError),
    /// The shared memory failed.
    #[error("shared memory of instance '{instance}': {what} failed ({detail})")]
    Failed {
        /// The name.
        instance: InstanceName,
        /// What was tried.
        what: &'static str,
        /// iceoryx2's word for it.
        detail: String,
    },
}

/// The daemon's side. It stays on the thread that started it (the compiler insists); its end is dropping it.
#[derive(Debug)]
pub struct Server {
    instance: InstanceName,
    calibration: Publisher<IpcService, CalibrationWire, ()>,
    progress: Publisher<IpcService, ProgressWire, ()>,
    health: Publisher<IpcService, HealthWire, ()>,
    control: ControlPort,
    archive: ArchivePort,
    news: Notifier<IpcService>,
    calls: Listener<IpcService>,
}

impl Server {
    /// Takes the instance name. What a killed daemon of that name left behind is cleaned up; its clients go on with this one.
    pub fn start(instance: &InstanceName) -> Result<Self, ServerError> {
        let refused = |failure| refusal(instance, failure);
        let failed = |what, error: &dyn Debug| failure(instance, what, error);
        let daemon = Participant::join(instance, Side::Daemon).map_err(refused)?;
        // First, because it is the lock: a second daemon ends here and touches nothing else.
        let calibration = publisher(&daemon, instance, Topic::Calibration)?;
        let control = daemon.control().map_err(refused)?;
        let control =
            control.server_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create();
        let archive = daemon.archive().map_err(refused)?;
        let archive =
            archive.server_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create();
        let news = daemon.event(Topic::News).map_err(refused)?.notifier_builder().create();
        let calls = daemon.event(Topic::Calls).map_err(refused)?.listener_builder().create();
        Ok(Self {
            calibration,
            progress: publisher(&daemon, instance, Topic::Progress)?,
            health: publisher(&daemon, instance, Topic::Health)?,
            control: control.map_err(|error| failed("opening the request channel", &error))?,
            archive: archive.map_err(|error| failed("opening the channel of the history", &error))?,
            news: news.map_err(|error| failed("opening the news event", &error))?,
            calls: calls.map_err(|error| failed("opening the calls event", &error))?,
            instance: instance.clone(),
        })
    }

    /// Publishes a calibration; it stays for clients that come later.
    pub fn publish_calibration(&self, message: &CalibrationMessage) -> Result<(), ServerError> {
        self.publish(&self.calibration, CalibrationWire::try_from(message)?)
    }

    /// Publishes how collecting goes.
    pub fn publish_progress(&self, message: &ProgressMessage) -> Result<(), ServerError> {
        self.publish(&self.progress, ProgressWire::try_from(message)?)
    }

    /// Publishes how the daemon and its cameras are.
    pub fn publish_health(&self, message: &HealthMessage) -> Result<(), ServerError> {
        self.publish(&self.health, HealthWire::try_from(message)?)
    }

    /// Waits up to `timeout` for a client, lets `answer` answer what is asked, and gives the newest messages to those who joined.
    /// Returns early with the number of answers when there was something to do or a signal came. Call it often: clients wait
    /// for it.
    pub fn poll(
        &self,
        timeout: Duration,
        mut answer: impl FnMut(Request) -> Response,
    ) -> Result<usize, ServerError> {
        let answered = self.answer_all(&mut answer)?;
        if answered > 0 {
            return Ok(answered);
        }
        let mut joined = false;
        match listen(&self.calls, timeout, |event| joined |= event == events::joined()) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
            Err(error) => return Err(self.failed("waiting for clients", &error)),
        }
        self.update_connections()?;
        if joined {
            self.notify(events::greeted());
        }
        self.answer_all(&mut answer)
    }

    /// Lets `answer` answer questions for the newest calibration below a number; the number of answers. Call it as often as
    /// [`Server::poll`].
    pub fn poll_archive(&self, mut answer: impl FnMut(u64) -> Archived) -> Result<usize, ServerError> {
        let mut answered = 0;
        while answered < MAX_ANSWERS {
            let received = self.archive.receive();
            let received = received.map_err(|error| self.failed("receiving a question", &error))?;
            let Some(active) = received else { break };
            let archived = match active.payload().below() {
                Ok(below) => answer(below),
                Err(error) => Archived::NotKept { sentence: error.to_string() },
            };
            let wire = ArchiveResponseWire::encode(active.payload(), &archived)?;
            // An error here says that the client went away before its answer came.
            let _ = active.send_copy(wire);
            answered += 1;
        }
        if answered > 0 {
            self.notify(events::published());
        }
        Ok(answered)
    }

    fn publish<W: Debug + ZeroCopySend>(
        &self,
        publisher: &Publisher<IpcService, W, ()>,
        wire: W,
    ) -> Result<(), ServerError> {
        publisher.send_copy(wire).map_err(|error| self.failed("publishing", &error))?;
        self.notify(events::published());
        Ok(())
    }

    fn answer_all(&self, answer: &mut impl FnMut(Request) -> Response) -> Result<usize, ServerError> {
        let mut answered = 0;
        while answered < MAX_ANSWERS {
            let received =
                self.control.receive().map_err(|error| self.failed("receiving a request", &error))?;
            let Some(active) = received else { break };
            let wire = ResponseWire::encode(active.payload(), &response_to(active.payload(), answer))?;
            // An error here says that the client went away before its answer came.
            let _ = active.send_copy(wire);
            answered += 1;
        }
        if answered > 0 {
            self.notify(events::published());
        }
        Ok(answered)
    }

    fn update_connections(&self) -> Result<(), ServerError> {
        let updated = self
            .calibration
            .update_connections()
            .and_then(|()| self.progress.update_connections())
            .and_then(|()| self.health.update_connections());
        updated.map_err(|error| self.failed("connecting to clients", &error))
    }

    /// Wakes the clients. That this fails for one of them (it was killed, or does not listen) is no concern of the daemon.
    fn notify(&self, event: EventId) {
        let _ = self.news.notify_with_custom_event_id(event);
    }

    fn failed(&self, what: &'static str, error: &dyn Debug) -> ServerError {
        failure(&self.instance, what, error)
    }
}

/// The answer to a request that may be unreadable.
fn response_to(wire: &RequestWire, answer: &mut impl FnMut(Request) -> Response) -> Response {
    match Request::try_from(wire) {
        Ok(request) => answer(request),
        Err(error) => {
            let status = answer(Request { id: wire.id, kind: RequestKind::Status, calibration: 0 });
            let outcome = Outcome::Refused { code: RefusalCode::Unreadable, sentence: error.to_string() };
            Response { outcome, snapshot: status.snapshot }
        }
    }
}

fn publisher<W: Debug + ZeroCopySend + 'static>(
    daemon: &Participant,
    instance: &InstanceName,
    topic: Topic,
) -> Result<Publisher<IpcService, W, ()>, ServerError> {
    let service = daemon.published::<W>(topic).map_err(|failure| refusal(instance, failure))?;
    let created =
        service.publisher_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create();
    created.map_err(|error| match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => {
            ServerError::AlreadyRunning { instance: instance.clone() }
        }
        other => failure(instance, "opening a topic", &other),
    })
}

fn refusal(instance: &InstanceName, failure: Failure) -> ServerError {
    let instance = instance.clone();
    match failure {
        Failure::Denied => ServerError::Denied { instance },
        Failure::OtherRelease => ServerError::OtherRelease { instance },
        other => ServerError::Failed { instance, what: "opening the services", detail: format!("{other:?}") },
    }
}

fn failure(instance: &InstanceName, what: &'static str, error: &dyn Debug) -> ServerError {
    ServerError::Failed { instance: instance.clone(), what, detail: format!("{error:?}") }
}
