//! The daemon's side of the shared memory: publishes, answers requests, wakes its clients.
//!
//! Publishing never waits for a reader: a slow one loses its oldest message. One daemon per instance: the single publisher of the
//! calibration is the lock, and it dies with its process.

use std::path::PathBuf;
use std::time::Duration;

use iceoryx2::port::listener::ListenerWaitError;
use iceoryx2::prelude::EventId;

use super::message::{CalibrationMessage, HealthMessage, ProgressMessage};
use super::names::InstanceName;
use super::ports::{self, PortError, ServerPorts};
use super::request::{Archived, Outcome, RefusalCode, Request, RequestKind, Response};
use super::services::{Failure, MAX_CLIENTS, events};
use super::transport::Transport;
use super::wire::{
    ArchiveRequestWire, ArchiveResponseWire, CalibrationWire, HealthWire, ProgressWire, RequestWire,
    ResponseWire, WireError,
};

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
    #[error(
        "no permission for the shared memory of instance '{instance}': another user's processes hold it, or this user may \
         not write to the folder in ipc.directory"
    )]
    Denied {
        /// The name.
        instance: InstanceName,
    },
    /// The folder where clients would meet the daemon cannot be used.
    #[error(
        "ipc.directory: cannot make or write to {}: {detail}; make it with mode 0750 for the daemon's user (of a service: \
         RuntimeDirectory=), or name another folder",
        folder.display()
    )]
    Folder {
        /// Which.
        folder: PathBuf,
        /// What the system said.
        detail: String,
    },
    /// Shared memory is full: what is written there would kill the writer.
    #[error(
        "shared memory of instance '{instance}' has {} KiB left and {} KiB are needed: remove what fills it, or make it \
         larger",
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
    ports: Box<dyn ServerPorts>,
}

impl Server {
    /// As [`Server::start_over`] iceoryx2's shared memory.
    pub fn start(instance: &InstanceName) -> Result<Self, ServerError> {
        Self::start_over(&Transport::SharedMemory, instance)
    }

    /// Takes the instance name. What a killed daemon of that name left behind is cleaned up; its clients go on with this one.
    pub fn start_over(transport: &Transport, instance: &InstanceName) -> Result<Self, ServerError> {
        let ports = ports::serve(transport, instance).map_err(|failure| refusal(instance, failure))?;
        Ok(Self { instance: instance.clone(), ports })
    }

    /// Publishes a calibration; it stays for clients that come later.
    pub fn publish_calibration(&self, message: &CalibrationMessage) -> Result<(), ServerError> {
        self.published(self.ports.publish_calibration(CalibrationWire::try_from(message)?))
    }

    /// Publishes how collecting goes.
    pub fn publish_progress(&self, message: &ProgressMessage) -> Result<(), ServerError> {
        self.published(self.ports.publish_progress(ProgressWire::try_from(message)?))
    }

    /// Publishes how the daemon and its cameras are.
    pub fn publish_health(&self, message: &HealthMessage) -> Result<(), ServerError> {
        self.published(self.ports.publish_health(HealthWire::try_from(message)?))
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
        match self.ports.listen(timeout, &mut |event| joined |= event == events::joined()) {
            Ok(_) | Err(ListenerWaitError::InterruptSignal) => {}
            Err(error) => {
                return Err(self.failed("waiting for clients", PortError::Failed(format!("{error:?}"))));
            }
        }
        let updated = self.ports.update_connections();
        updated.map_err(|error| self.failed("connecting to clients", error))?;
        if joined {
            self.notify(events::greeted());
        }
        self.answer_all(&mut answer)
    }

    /// Lets `answer` answer questions for the newest calibration below a number; the number of answers. Call it as often as
    /// [`Server::poll`].
    pub fn poll_archive(&self, mut answer: impl FnMut(u64) -> Archived) -> Result<usize, ServerError> {
        let mut reply = |wire: &ArchiveRequestWire| {
            let archived = match wire.below() {
                Ok(below) => answer(below),
                Err(error) => Archived::NotKept { sentence: error.to_string() },
            };
            ArchiveResponseWire::encode(wire, &archived)
        };
        self.answer_while(|| self.ports.answer_archive(&mut reply))
    }

    fn published(&self, sent: Result<(), PortError>) -> Result<(), ServerError> {
        sent.map_err(|error| self.failed("publishing", error))?;
        self.notify(events::published());
        Ok(())
    }

    fn answer_all(&self, answer: &mut impl FnMut(Request) -> Response) -> Result<usize, ServerError> {
        // Who asks has joined, perhaps this very moment. With the newest messages given before the answer, an answer and no
        // message say that there is none.
        let mut refused = None;
        let mut reply = |wire: &RequestWire| {
            refused = self.ports.update_connections().err().or(refused.take());
            ResponseWire::encode(wire, &response_to(wire, answer))
        };
        let answered = self.answer_while(|| self.ports.answer(&mut reply))?;
        match refused {
            Some(error) => Err(self.failed("connecting to clients", error)),
            None => Ok(answered),
        }
    }

    /// Answers one after the other while there is something to answer, up to a number that nobody can send by right.
    fn answer_while(
        &self,
        mut answer_next: impl FnMut() -> Result<bool, PortError>,
    ) -> Result<usize, ServerError> {
        let mut answered = 0;
        while answered < MAX_ANSWERS
            && answer_next().map_err(|error| self.failed("receiving a request", error))?
        {
            answered += 1;
        }
        if answered > 0 {
            self.notify(events::published());
        }
        Ok(answered)
    }

    fn notify(&self, event: EventId) {
        self.ports.notify(event);
    }

    fn failed(&self, what: &'static str, error: PortError) -> ServerError {
        match error {
            PortError::Wire(error) => ServerError::Wire(error),
            PortError::Failed(detail) => {
                ServerError::Failed { instance: self.instance.clone(), what, detail }
            }
        }
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

fn refusal(instance: &InstanceName, failure: Failure) -> ServerError {
    let instance = instance.clone();
    let what = "opening the services";
    match failure {
        Failure::Taken => ServerError::AlreadyRunning { instance },
        Failure::Denied => ServerError::Denied { instance },
        Failure::Folder { folder, detail } => ServerError::Folder { folder, detail },
        Failure::OtherRelease => ServerError::OtherRelease { instance },
        Failure::NoRoom { free, needed } => ServerError::NoRoom { instance, free, needed },
        Failure::Other(detail) => ServerError::Failed { instance, what, detail },
        other => ServerError::Failed { instance, what, detail: format!("{other:?}") },
    }
}
