//! The open ports of both sides, written once for every kind of iceoryx2 service: the server and the client above them do not know
//! which kind carries their messages.

use std::fmt::Debug;
use std::time::Duration;

use iceoryx2::pending_response::PendingResponse;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::port::notifier::Notifier;
use iceoryx2::port::publisher::{Publisher, PublisherCreateError};
use iceoryx2::port::subscriber::Subscriber;
use iceoryx2::port::update_connections::UpdateConnections;
use iceoryx2::prelude::{BackpressureStrategy, Config, EventId, Service, ZeroCopySend, ipc};

use super::file_service::FileService;
use super::message::{CalibrationMessage, HealthMessage, ProgressMessage};
use super::names::{InstanceName, Topic};
use super::room;
use super::services::{Failure, Participant, Published, Side, has_living_publisher, listen};
use super::transport::Transport;
use super::wire::{
    ArchiveRequestWire, ArchiveResponseWire, CalibrationWire, HealthWire, ProgressWire, RequestWire,
    ResponseWire, WireError,
};

/// What went wrong in an open port.
#[derive(Debug)]
pub(super) enum PortError {
    /// The other side sent, or this side should send, what has no place in the wire format.
    Wire(WireError),
    /// iceoryx2's word for it.
    Failed(String),
}

impl PortError {
    fn from_debug(error: impl Debug) -> Self {
        Self::Failed(format!("{error:?}"))
    }
}

/// Answers one request as it came.
pub(super) type Answering<'a, Q, A> = dyn FnMut(&Q) -> Result<A, WireError> + 'a;

type Asking<S, Q, A> = iceoryx2::port::client::Client<S, Q, (), A, ()>;
type Replying<S, Q, A> = iceoryx2::port::server::Server<S, Q, (), A, ()>;

/// The daemon's ports.
pub(super) trait ServerPorts: Debug {
    /// Publishes; the newest one stays for late subscribers.
    fn publish_calibration(&self, wire: CalibrationWire) -> Result<(), PortError>;
    /// As above.
    fn publish_progress(&self, wire: ProgressWire) -> Result<(), PortError>;
    /// As above.
    fn publish_health(&self, wire: HealthWire) -> Result<(), PortError>;
    /// Answers the next request, if there is one; whether there was.
    fn answer(&self, answer: &mut Answering<'_, RequestWire, ResponseWire>) -> Result<bool, PortError>;
    /// As above, of the questions for older calibrations.
    fn answer_archive(
        &self,
        answer: &mut Answering<'_, ArchiveRequestWire, ArchiveResponseWire>,
    ) -> Result<bool, PortError>;
    /// Gives the newest messages to those who joined.
    fn update_connections(&self) -> Result<(), PortError>;
    /// Waits for calls of the clients.
    fn listen(&self, timeout: Duration, on_event: &mut dyn FnMut(EventId)) -> Result<u64, ListenerWaitError>;
    /// Wakes the clients. That this fails for one of them (it was killed, or does not listen) is no concern of the daemon.
    fn notify(&self, event: EventId);
}

/// A client's ports.
pub(super) trait ClientPorts: Debug {
    /// The next calibration that has come.
    fn next_calibration(&self) -> Result<Option<CalibrationMessage>, PortError>;
    /// As above.
    fn next_progress(&self) -> Result<Option<ProgressMessage>, PortError>;
    /// As above.
    fn next_health(&self) -> Result<Option<HealthMessage>, PortError>;
    /// Sends a request.
    fn ask(&self, wire: RequestWire) -> Result<Box<dyn Question<ResponseWire>>, PortError>;
    /// Asks for an older calibration.
    fn ask_archive(
        &self,
        wire: ArchiveRequestWire,
    ) -> Result<Box<dyn Question<ArchiveResponseWire>>, PortError>;
    /// Waits for news of the daemon.
    fn listen(&self, timeout: Duration) -> Result<u64, ListenerWaitError>;
    /// As above; tells which news.
    fn listen_to(
        &self,
        timeout: Duration,
        on_event: &mut dyn FnMut(EventId),
    ) -> Result<u64, ListenerWaitError>;
    /// Wakes the daemon. It also looks by itself now and then, so that a failure only costs time.
    fn notify(&self, event: EventId);
    /// Whether the daemon lives.
    fn has_daemon(&self) -> bool;
}

/// A request under way.
pub(super) trait Question<A> {
    /// Whether a daemon is there to answer it.
    fn has_reader(&self) -> bool;
    /// The answer, if it has come.
    fn answer(&self) -> Result<Option<A>, PortError>;
}

/// Opens the daemon's ports over a transport.
pub(super) fn serve(transport: &Transport, instance: &InstanceName) -> Result<Box<dyn ServerPorts>, Failure> {
    let ports: Box<dyn ServerPorts> = match transport {
        Transport::SharedMemory => Box::new(Serving::<ipc::Service>::open(transport, instance)?),
        Transport::Files { .. } => Box::new(Serving::<FileService>::open(transport, instance)?),
    };
    room::take(&transport.place())?;
    Ok(ports)
}

/// Opens a client's ports over a transport.
pub(super) fn connect(
    transport: &Transport,
    instance: &InstanceName,
) -> Result<Box<dyn ClientPorts>, Failure> {
    let ports: Box<dyn ClientPorts> = match transport {
        Transport::SharedMemory => Box::new(Connected::<ipc::Service>::open(transport, instance)?),
        Transport::Files { .. } => Box::new(Connected::<FileService>::open(transport, instance)?),
    };
    room::take(&transport.place())?;
    Ok(ports)
}

#[derive(Debug)]
struct Serving<S: Service> {
    calibration: Publisher<S, CalibrationWire, ()>,
    progress: Publisher<S, ProgressWire, ()>,
    health: Publisher<S, HealthWire, ()>,
    control: Replying<S, RequestWire, ResponseWire>,
    archive: Replying<S, ArchiveRequestWire, ArchiveResponseWire>,
    news: Notifier<S>,
    calls: Listener<S>,
}

impl<S: Service> Serving<S> {
    fn open(transport: &Transport, instance: &InstanceName) -> Result<Self, Failure> {
        let daemon = Participant::<S>::join(transport, instance, Side::Daemon)?;
        // First, because it is the lock: a second daemon ends here and touches nothing else.
        let calibration = publisher(&daemon, Topic::Calibration)?;
        let control = daemon.control()?;
        let control =
            control.server_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create();
        let archive = daemon.archive()?;
        let archive =
            archive.server_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create();
        let news = daemon.event(Topic::News)?.notifier_builder().create();
        let calls = daemon.event(Topic::Calls)?.listener_builder().create();
        Ok(Self {
            calibration,
            progress: publisher(&daemon, Topic::Progress)?,
            health: publisher(&daemon, Topic::Health)?,
            control: control.map_err(other)?,
            archive: archive.map_err(other)?,
            news: news.map_err(other)?,
            calls: calls.map_err(other)?,
        })
    }
}

impl<S: Service> ServerPorts for Serving<S> {
    fn publish_calibration(&self, wire: CalibrationWire) -> Result<(), PortError> {
        self.calibration.send_copy(wire).map(drop).map_err(PortError::from_debug)
    }

    fn publish_progress(&self, wire: ProgressWire) -> Result<(), PortError> {
        self.progress.send_copy(wire).map(drop).map_err(PortError::from_debug)
    }

    fn publish_health(&self, wire: HealthWire) -> Result<(), PortError> {
        self.health.send_copy(wire).map(drop).map_err(PortError::from_debug)
    }

    fn answer(&self, answer: &mut Answering<'_, RequestWire, ResponseWire>) -> Result<bool, PortError> {
        answer_next(&self.control, answer)
    }

    fn answer_archive(
        &self,
        answer: &mut Answering<'_, ArchiveRequestWire, ArchiveResponseWire>,
    ) -> Result<bool, PortError> {
        answer_next(&self.archive, answer)
    }

    fn update_connections(&self) -> Result<(), PortError> {
        let updated = self
            .calibration
            .update_connections()
            .and_then(|()| self.progress.update_connections())
            .and_then(|()| self.health.update_connections());
        updated.map_err(PortError::from_debug)
    }

    fn listen(&self, timeout: Duration, on_event: &mut dyn FnMut(EventId)) -> Result<u64, ListenerWaitError> {
        listen(&self.calls, timeout, on_event)
    }

    fn notify(&self, event: EventId) {
        let _ = self.news.notify_with_custom_event_id(event);
    }
}

#[derive(Debug)]
struct Connected<S: Service> {
    config: Config,
    calibration_topic: Published<S, CalibrationWire>,
    calibration: Subscriber<S, CalibrationWire, ()>,
    progress: Subscriber<S, ProgressWire, ()>,
    health: Subscriber<S, HealthWire, ()>,
    control: Asking<S, RequestWire, ResponseWire>,
    archive: Asking<S, ArchiveRequestWire, ArchiveResponseWire>,
    news: Listener<S>,
    calls: Notifier<S>,
}

impl<S: Service> Connected<S> {
    fn open(transport: &Transport, instance: &InstanceName) -> Result<Self, Failure> {
        let participant = Participant::<S>::join(transport, instance, Side::Client)?;
        let config = transport.config()?;
        let calibration_topic = participant.published(Topic::Calibration)?;
        if !has_living_publisher(&config, &calibration_topic) {
            return Err(Failure::Missing);
        }
        let progress = participant.published(Topic::Progress)?;
        let health = participant.published(Topic::Health)?;
        let control = participant.control()?.client_builder().create();
        let archive = participant.archive()?.client_builder().create();
        let news = participant.event(Topic::News)?.listener_builder().create();
        let calls = participant.event(Topic::Calls)?.notifier_builder().create();
        // The services are open, so that only their numbers of ports are left to be exceeded.
        Ok(Self {
            calibration: subscriber(&calibration_topic).ok_or(Failure::Crowded)?,
            calibration_topic,
            progress: subscriber(&progress).ok_or(Failure::Crowded)?,
            health: subscriber(&health).ok_or(Failure::Crowded)?,
            control: control.map_err(|_| Failure::Crowded)?,
            archive: archive.map_err(|_| Failure::Crowded)?,
            news: news.map_err(|_| Failure::Crowded)?,
            calls: calls.map_err(|_| Failure::Crowded)?,
            config,
        })
    }
}

impl<S: Service + 'static> ClientPorts for Connected<S> {
    fn next_calibration(&self) -> Result<Option<CalibrationMessage>, PortError> {
        next(&self.calibration)
    }

    fn next_progress(&self) -> Result<Option<ProgressMessage>, PortError> {
        next(&self.progress)
    }

    fn next_health(&self) -> Result<Option<HealthMessage>, PortError> {
        next(&self.health)
    }

    fn ask(&self, wire: RequestWire) -> Result<Box<dyn Question<ResponseWire>>, PortError> {
        let pending = self.control.send_copy(wire).map_err(PortError::from_debug)?;
        Ok(Box::new(pending))
    }

    fn ask_archive(
        &self,
        wire: ArchiveRequestWire,
    ) -> Result<Box<dyn Question<ArchiveResponseWire>>, PortError> {
        let pending = self.archive.send_copy(wire).map_err(PortError::from_debug)?;
        Ok(Box::new(pending))
    }

    fn listen(&self, timeout: Duration) -> Result<u64, ListenerWaitError> {
        self.listen_to(timeout, &mut |_| {})
    }

    fn listen_to(
        &self,
        timeout: Duration,
        on_event: &mut dyn FnMut(EventId),
    ) -> Result<u64, ListenerWaitError> {
        listen(&self.news, timeout, on_event)
    }

    fn notify(&self, event: EventId) {
        let _ = self.calls.notify_with_custom_event_id(event);
    }

    fn has_daemon(&self) -> bool {
        has_living_publisher(&self.config, &self.calibration_topic)
    }
}

impl<S, Q, A> Question<A> for PendingResponse<S, Q, (), A, ()>
where
    S: Service,
    Q: Debug + ZeroCopySend + 'static,
    A: Debug + ZeroCopySend + Copy + 'static,
{
    fn has_reader(&self) -> bool {
        self.number_of_server_connections() > 0
    }

    fn answer(&self) -> Result<Option<A>, PortError> {
        let received = self.receive().map_err(PortError::from_debug)?;
        Ok(received.map(|answer| *answer.payload()))
    }
}

fn answer_next<S, Q, A>(port: &Replying<S, Q, A>, answer: &mut Answering<'_, Q, A>) -> Result<bool, PortError>
where
    S: Service,
    Q: Debug + ZeroCopySend + 'static,
    A: Debug + ZeroCopySend + Copy + 'static,
{
    let Some(active) = port.receive().map_err(PortError::from_debug)? else { return Ok(false) };
    let wire = answer(active.payload()).map_err(PortError::Wire)?;
    // An error here says that the client went away before its answer came.
    let _ = active.send_copy(wire);
    Ok(true)
}

fn publisher<S: Service, W: Debug + ZeroCopySend + 'static>(
    daemon: &Participant<'_, S>,
    topic: Topic,
) -> Result<Publisher<S, W, ()>, Failure> {
    let topic = daemon.published::<W>(topic)?;
    let created = topic.publisher_builder().backpressure_strategy(BackpressureStrategy::DiscardData).create();
    created.map_err(|error| match error {
        PublisherCreateError::ExceedsMaxSupportedPublishers => Failure::Taken,
        error => other(error),
    })
}

fn subscriber<S: Service, W>(topic: &Published<S, W>) -> Option<Subscriber<S, W, ()>>
where
    W: Debug + ZeroCopySend + 'static,
{
    topic.subscriber_builder().create().ok()
}

fn next<S: Service, W, M>(subscriber: &Subscriber<S, W, ()>) -> Result<Option<M>, PortError>
where
    W: Debug + ZeroCopySend + 'static,
    M: for<'a> TryFrom<&'a W, Error = WireError>,
{
    let received = subscriber.receive().map_err(PortError::from_debug)?;
    received.map(|sample| M::try_from(sample.payload())).transpose().map_err(PortError::Wire)
}

fn other(error: impl Debug) -> Failure {
    Failure::Other(format!("{error:?}"))
}
