//! The other side of the shared memory: reads what the daemon publishes, and asks it.
//!
//! A client outlives the daemon: while there is none, waiting and asking answer [`ClientError::NotRunning`]; as soon as it runs
//! again the same client works again, without connecting anew.

use std::time::{Duration, Instant};

use iceoryx2::prelude::EventId;

use super::message::{CalibrationMessage, HealthMessage, ProgressMessage};
use super::names::InstanceName;
use super::ports::{self, ClientPorts, PortError, Question};
use super::request::{Archived, Request, RequestKind, Response};
use super::services::{Failure, MAX_CLIENTS, events};
use super::transport::Transport;
use super::wire::{ArchiveRequestWire, RequestWire, WireError};

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
    /// The daemon belongs to another user, and this one is not in its group.
    #[error(
        "no permission to connect to the daemon '{instance}': run the client as the daemon's user, or as a member of its group \
         (of the installed daemon: `sudo usermod -aG pelical NAME`, then log in again)"
    )]
    Denied {
        /// The name.
        instance: InstanceName,
    },
    /// Shared memory is full: what is written there would kill the writer.
    #[error(
        "shared memory of instance '{instance}' has {} KiB left and a client needs {} KiB: remove what fills it, or make it larger",
        free / 1024, needed / 1024
    )]
    NoRoom {
        /// The name.
        instance: InstanceName,
        /// Free now, bytes.
        free: u64,
        /// Needed, bytes.
        needed: u64,
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
    ports: Box<dyn ClientPorts>,
    newest_calibration: Option<CalibrationMessage>,
    calibration_is_new: bool,
    newest_health: Option<HealthMessage>,
    last_request_id: u64,
}

impl Client {
    /// Joins the daemon of that name wherever it is: over the first of [`Transport::candidates`] that leads to it. Its newest
    /// messages are there on return, unless it is busy; then they come later.
    pub fn connect(instance: &InstanceName) -> Result<Self, ClientError> {
        let mut refused = ClientError::NotRunning { instance: instance.clone() };
        for transport in Transport::candidates() {
            match Self::connect_over(&transport, instance) {
                // A closed door says more than an empty house.
                Err(ClientError::NotRunning { .. }) => {}
                Err(error) => refused = error,
                connected => return connected,
            }
        }
        Err(refused)
    }

    /// The same over one transport.
    pub fn connect_over(transport: &Transport, instance: &InstanceName) -> Result<Self, ClientError> {
        let ports = ports::connect(transport, instance).map_err(|failure| refusal(instance, failure))?;
        let mut client = Self {
            instance: instance.clone(),
            ports,
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
        self.wait(timeout, |client| client.read(client.ports.next_progress()))
    }

    /// The newest health message that came; `None` before the first.
    pub fn latest_health(&mut self) -> Result<Option<&HealthMessage>, ClientError> {
        while let Some(message) = self.read(self.ports.next_health())? {
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
        let asked = self.ports.ask_archive(ArchiveRequestWire::new(below));
        self.answer_to(asked, timeout, |wire| wire.decode(below))
    }

    fn ask(
        &mut self,
        (kind, calibration): (RequestKind, u64),
        timeout: Duration,
    ) -> Result<Response, ClientError> {
        self.last_request_id += 1;
        let request = Request { id: self.last_request_id, kind, calibration };
        let asked = self.ports.ask(RequestWire::from(request));
        self.answer_to(asked, timeout, |wire| wire.decode(request))
    }

    /// Waits for the answer to what was asked.
    fn answer_to<W, A>(
        &mut self,
        asked: Result<Box<dyn Question<W>>, PortError>,
        timeout: Duration,
        decode: impl Fn(&W) -> Result<A, WireError>,
    ) -> Result<A, ClientError> {
        let pending = asked.map_err(|error| self.failed("sending a request", error))?;
        if !pending.has_reader() {
            return Err(self.not_running());
        }
        self.call(events::asked());
        let answer = self.wait(timeout, |client| match pending.answer() {
            Ok(Some(answer)) => Ok(Some(decode(&answer)?)),
            Ok(None) => Ok(None),
            Err(error) => Err(client.failed("receiving an answer", error)),
        })?;
        answer.ok_or_else(|| ClientError::NoAnswer { instance: self.instance.clone(), waited: timeout })
    }

    fn not_running(&self) -> ClientError {
        ClientError::NotRunning { instance: self.instance.clone() }
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
            let news = self.ports.listen(left.min(SILENCE)).unwrap_or(0);
            if news == 0 && !self.ports.has_daemon() {
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
            let waited = self.ports.listen_to(left, &mut |event| is_greeted |= event == events::greeted());
            if left.is_zero() || waited.is_err() {
                break;
            }
        }
    }

    fn call(&self, event: EventId) {
        self.ports.notify(event);
    }

    fn read_calibrations(&mut self) -> Result<(), ClientError> {
        while let Some(message) = self.read(self.ports.next_calibration())? {
            self.newest_calibration = Some(message);
            self.calibration_is_new = true;
        }
        Ok(())
    }

    fn read<M>(&self, received: Result<Option<M>, PortError>) -> Result<Option<M>, ClientError> {
        received.map_err(|error| self.failed("receiving", error))
    }

    fn failed(&self, what: &'static str, error: PortError) -> ClientError {
        match error {
            PortError::Wire(error) => ClientError::Wire(error),
            PortError::Failed(detail) => {
                ClientError::Failed { instance: self.instance.clone(), what, detail }
            }
        }
    }
}

fn refusal(instance: &InstanceName, failure: Failure) -> ClientError {
    let instance = instance.clone();
    let what = "opening the services";
    match failure {
        Failure::Missing => ClientError::NotRunning { instance },
        Failure::Crowded => ClientError::TooManyClients { instance },
        Failure::Denied => ClientError::Denied { instance },
        Failure::OtherRelease => ClientError::OtherRelease { instance },
        Failure::NoRoom { free, needed } => ClientError::NoRoom { instance, free, needed },
        Failure::Other(detail) => ClientError::Failed { instance, what, detail },
        other => ClientError::Failed { instance, what, detail: format!("{other:?}") },
    }
}
