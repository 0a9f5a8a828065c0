//! The other side of the shared memory: reads what the daemon publishes, and asks it.
//!
//! A client outlives the daemon: while there is none, waiting and asking answer [`ClientError::NotRunning`]; as soon as it runs
//! again the same client works again, without connecting anew.

use std::fmt::Debug;
use std::time::{Duration, Instant};

use iceoryx2::port::listener::Listener;
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::prelude::{EventId, ZeroCopySend};

use super::message::{CalibrationMessage, HealthMessage, ProgressMessage};
use super::names::{InstanceName, IpcService, Topic};
use super::request::{Archived, Request, RequestKind, Response};
use super::services::{
    Failure, MAX_CLIENTS, Participant, Published, Side, events, has_living_publisher, listen,
};
use super::wire::{
    ArchiveRequestWire, ArchiveResponseWire, CalibrationWire, HealthWire, ProgressWire, RequestWire,
    ResponseWire, WireError,
};

type ControlPort = iceoryx2::port::client::Client<IpcService, RequestWire, (), ResponseWire, ()>;
type ArchivePort =
    iceoryx2::port::client::Client<IpcService, ArchiveRequestWire, (), ArchiveResponseWire, ()>;

/// How long the daemon may be silent before the client looks whether it still lives.
const SILENCE: Duration = Duration::from_millis(100);
/// How long a new client waits for the daemon to hand it the newest messages; a busy daemon does so later.
const GREETING: Duration = Duration::from_millis(300);
/// Any wait that is asked for to be longer ends after this.
const LONGEST_WAIT: Duration = Duration::from_secs(86_400);

/// Why the client got nothing.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No daemon of that name lives.
    #[error(
        "no daemon with the instance name '{instance}' is running: start pelicald, or name the right instance"
    )]
    NotRunning {
        /// The name.
        instance: InstanceName,
    },
    /// The daemon lives but did not answer in time.
    #[error("the daemon '{instance}' did not answer within {} ms: it is busy or hangs", waited.as_millis())]
    NoAnswer {
        /// The name.
        instance: InstanceName,
        /// How long the client waited.
        waited: Duration,
    },
    /// The daemon has all the clients it can have.
    #[error("the daemon '{instance}' already has {MAX_CLIENTS} clients: end one of them")]
    TooManyClients {
        /// The name.
        instance: InstanceName,
    },
    /// The daemon belongs to another user.
    #[error(
        "no permission for the shared memory of the daemon '{instance}': run the client as the daemon's user"
    )]
    Denied {
        /// The name.
        instance: InstanceName,
    },
    /// The daemon is of another release.
    #[error("the daemon '{instance}' is of another release: use client and daemon of the same release")]
    OtherRelease {
        /// The name.
        instance: InstanceName,
    },
    /// What the daemon sent cannot be read.
    #[error("unreadable message from the daemon: {0}")]
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

/// A client of one daemon. It stays on the thread that connected it (the compiler insists).
#[derive(Debug)]
pub struct Client {
    instance: InstanceName,
    calibration_topic: Published<CalibrationWire>,
    calibration: Subscriber<IpcService, CalibrationWire, ()>,
    progress: Subscriber<IpcService, ProgressWire, ()>,
    health: Subscriber<IpcService, HealthWire, ()>,
    control: ControlPort,
    archive: ArchivePort,
    news: Listener<IpcService>,
    calls: Notifier<IpcService>,
    newest_calibration: Option<CalibrationMessage>,
    calibration_is_new: bool,
    newest_health: Option<HealthMessage>,
    last_request_id: u64,
}

impl Client {
    /// Joins the daemon of that name. Its newest messages are there on return, unless it is busy; then they come later.
    pub fn connect(instance: &InstanceName) -> Result<Self, ClientError> {
        let refused = |failure| refusal(instance, failure);
        let participant = Participant::join(instance, Side::Client).map_err(refused)?;
        let calibration_topic = participant.published(Topic::Calibration).map_err(refused)?;
        if !has_living_publisher(&calibration_topic) {
            return Err(ClientError::NotRunning { instance: instance.clone() });
        }
        let progress = participant.published(Topic::Progress).map_err(refused)?;
        let health = participant.published(Topic::Health).map_err(refused)?;
        let control = participant.control().map_err(refused)?.client_builder().create();
        let archive = participant.archive().map_err(refused)?.client_builder().create();
        let news = participant.event(Topic::News).map_err(refused)?.listener_builder().create();
        let calls = participant.event(Topic::Calls).map_err(refused)?.notifier_builder().create();
        // The services are open, so that only their numbers of ports are left to be exceeded.
        let full = || ClientError::TooManyClients { instance: instance.clone() };
        let mut client = Self {
            instance: instance.clone(),
            calibration: subscriber(&calibration_topic).ok_or_else(full)?,
            calibration_topic,
            progress: subscriber(&progress).ok_or_else(full)?,
            health: subscriber(&health).ok_or_else(full)?,
            control: control.map_err(|_| full())?,
            archive: archive.map_err(|_| full())?,
            news: news.map_err(|_| full())?,
            calls: calls.map_err(|_| full())?,
            newest_calibration: None,
            calibration_is_new: false,
            newest_health: None,
            last_request_id: 0,
        };
        client.await_greeting();
        Ok(client)
    }

    /// The newest calibration that came; `None` before the first. It may be from a daemon that has ended since.
    pub fn latest_calibration(&mut self) -> Result<Option<&CalibrationMessage>, ClientError> {
        self.read_calibrations()?;
        Ok(self.newest_calibration.as_ref())
    }

    /// The newest calibration that no earlier call of this function returned; waits for one. `None` when none came in time.
    pub fn wait_calibration(&mut self, timeout: Duration) -> Result<Option<CalibrationMessage>, ClientError> {
        self.wait(timeout, |client| {
            client.read_calibrations()?;
            let is_new = std::mem::take(&mut client.calibration_is_new);
            Ok(client.newest_calibration.as_ref().filter(|_| is_new).cloned())
        })
    }

    /// The next progress message; waits for one. `None` when none came in time.
    pub fn next_progress(&mut self, timeout: Duration) -> Result<Option<ProgressMessage>, ClientError> {
        self.wait(timeout, |client| client.read(&client.progress))
    }

    /// The newest health message that came; `None` before the first.
    pub fn latest_health(&mut self) -> Result<Option<&HealthMessage>, ClientError> {
        while let Some(message) = self.read(&self.health)? {
            self.newest_health = Some(message);
        }
        Ok(self.newest_health.as_ref())
    }

    /// Asks how the daemon is.
    pub fn status(&mut self, timeout: Duration) -> Result<Response, ClientError> {
        self.ask((RequestKind::Status, 0), timeout)
    }

    /// Asks for a new calibration; the answer comes at once, the calibration later.
    pub fn recalibrate(&mut self, timeout: Duration) -> Result<Response, ClientError> {
        self.ask((RequestKind::Recalibrate, 0), timeout)
    }

    /// Asks to stop the running calibration.
    pub fn cancel(&mut self, timeout: Duration) -> Result<Response, ClientError> {
        self.ask((RequestKind::Cancel, 0), timeout)
    }

    /// Asks to go back to the calibration with this number in the history.
    pub fn rollback(&mut self, calibration: u64, timeout: Duration) -> Result<Response, ClientError> {
        self.ask((RequestKind::Rollback, calibration), timeout)
    }

    /// The newest calibration of the history with a number below this; beginning with the largest number and going on below each
    /// answer gives all of them, newest first.
    pub fn archived_below(&mut self, below: u64, timeout: Duration) -> Result<Archived, ClientError> {
        let sent = self.archive.send_copy(ArchiveRequestWire::new(below));
        let pending = sent.map_err(|error| self.failed("sending a question", &error))?;
        if pending.number_of_server_connections() == 0 {
            return Err(self.not_running());
        }
        self.call(events::asked());
        let answer = self.wait(timeout, |client| match pending.receive() {
            Ok(Some(answer)) => Ok(Some(answer.payload().decode(below)?)),
            Ok(None) => Ok(None),
            Err(error) => Err(client.failed("receiving an answer", &error)),
        })?;
        answer.ok_or_else(|| self.no_answer(timeout))
    }

    fn ask(
        &mut self,
        (kind, calibration): (RequestKind, u64),
        timeout: Duration,
    ) -> Result<Response, ClientError> {
        self.last_request_id += 1;
        let request = Request { id: self.last_request_id, kind, calibration };
        let sent = self.control.send_copy(RequestWire::from(request));
        let pending = sent.map_err(|error| self.failed("sending a request", &error))?;
        if pending.number_of_server_connections() == 0 {
            return Err(self.not_running());
        }
        self.call(events::asked());
        let answer = self.wait(timeout, |client| match pending.receive() {
            Ok(Some(answer)) => Ok(Some(answer.payload().decode(request)?)),
            Ok(None) => Ok(None),
            Err(error) => Err(client.failed("receiving an answer", &error)),
        })?;
        answer.ok_or_else(|| self.no_answer(timeout))
    }

    fn not_running(&self) -> ClientError {
        ClientError::NotRunning { instance: self.instance.clone() }
    }

    fn no_answer(&self, waited: Duration) -> ClientError {
        ClientError::NoAnswer { instance: self.instance.clone(), waited }
    }

    /// Tries `take` whenever the daemon has news, until it gives something, the time is up (`None`) or the daemon is gone.
    fn wait<T>(
        &mut self,
        timeout: Duration,
        mut take: impl FnMut(&mut Self) -> Result<Option<T>, ClientError>,
    ) -> Result<Option<T>, ClientError> {
        let deadline = Instant::now() + timeout.min(LONGEST_WAIT);
        loop {
            if let Some(taken) = take(self)? {
                return Ok(Some(taken));
            }
            let left = deadline.saturating_duration_since(Instant::now());
            // A signal or a failure of the event only makes this a poll.
            let news = listen(&self.news, left.min(SILENCE), |_| {}).unwrap_or(0);
            if news == 0 && !has_living_publisher(&self.calibration_topic) {
                return Err(self.not_running());
            }
            if left.is_zero() {
                return take(self);
            }
        }
    }

    fn await_greeting(&mut self) {
        self.call(events::joined());
        let deadline = Instant::now() + GREETING;
        let mut is_greeted = false;
        while !is_greeted {
            let left = deadline.saturating_duration_since(Instant::now());
            let waited = listen(&self.news, left, |event| is_greeted |= event == events::greeted());
            if left.is_zero() || waited.is_err() {
                break;
            }
        }
    }

    /// Wakes the daemon. It also looks by itself now and then, so that a failure only costs time.
    fn call(&self, event: EventId) {
        let _ = self.calls.notify_with_custom_event_id(event);
    }

    fn read_calibrations(&mut self) -> Result<(), ClientError> {
        while let Some(message) = self.read(&self.calibration)? {
            self.newest_calibration = Some(message);
            self.calibration_is_new = true;
        }
        Ok(())
    }

    fn read<W, M>(&self, subscriber: &Subscriber<IpcService, W, ()>) -> Result<Option<M>, ClientError>
    where
        W: Debug + ZeroCopySend,
        M: for<'a> TryFrom<&'a W, Error = WireError>,
    {
        let received = subscriber.receive().map_err(|error| self.failed("receiving", &error))?;
        Ok(received.map(|sample| M::try_from(sample.payload())).transpose()?)
    }

    fn failed(&self, what: &'static str, error: &dyn Debug) -> ClientError {
        ClientError::Failed { instance: self.instance.clone(), what, detail: format!("{error:?}") }
    }
}

fn subscriber<W>(topic: &Published<W>) -> Option<Subscriber<IpcService, W, ()>>
where
    W: Debug + ZeroCopySend + 'static,
{
    topic.subscriber_builder().create().ok()
}

fn refusal(instance: &InstanceName, failure: Failure) -> ClientError {
    let instance = instance.clone();
    match failure {
        Failure::Missing => ClientError::NotRunning { instance },
        Failure::Crowded => ClientError::TooManyClients { instance },
        Failure::Denied => ClientError::Denied { instance },
        Failure::OtherRelease => ClientError::OtherRelease { instance },
        Failure::Other(detail) => ClientError::Failed { instance, what: "opening the services", detail },
    }
}
