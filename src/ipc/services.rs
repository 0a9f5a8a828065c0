//! How the services are set up, for both sides and every transport alike: limits, buffers, and what a failure to open means.

use std::fmt::Debug;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use iceoryx2::node::NodeCreationFailure;
use iceoryx2::port::listener::{Listener, ListenerWaitError};
use iceoryx2::prelude::{
    CallbackProgression, Config, EventActivation, EventId, LogLevel, NodeBuilder, NodeState, PortFactory,
    Service, ServiceName, SignalHandlingMode, ZeroCopySend, set_log_level_from_env_or,
};
use iceoryx2::service::builder::{ServiceCreateError, ServiceOpenError};
use iceoryx2::service::messaging_pattern::MessagingPattern;
use iceoryx2::service::port_factory;

use super::names::{InstanceName, Topic};
use super::remains;
use super::room;
use super::transport::{MIN_CLIENT_ROOM_BYTES, MIN_ROOM_BYTES, Transport};
use super::wire::{ArchiveRequestWire, ArchiveResponseWire, RequestWire, ResponseWire};

/// Most clients of one daemon at a time.
pub(super) const MAX_CLIENTS: usize = 16;
/// Messages that wait for a slow reader, per topic; then the oldest is lost.
const BUFFERED: usize = 8;
/// How long another process may take to finish creating or removing a service.
const SETTLE: Duration = Duration::from_secs(1);
/// Pause between two looks at what another process does.
const RETRY: Duration = Duration::from_millis(10);

/// Events of [`Topic::News`] and [`Topic::Calls`].
pub(super) mod events {
    use iceoryx2::prelude::EventId;

    /// News: something was published or answered.
    pub(in crate::ipc) fn published() -> EventId {
        EventId::new(0)
    }

    /// News: whoever joined before this has the newest messages now.
    pub(in crate::ipc) fn greeted() -> EventId {
        EventId::new(1)
    }

    /// Calls: a client asked something.
    pub(in crate::ipc) fn asked() -> EventId {
        EventId::new(0)
    }

    /// Calls: a client joined.
    pub(in crate::ipc) fn joined() -> EventId {
        EventId::new(1)
    }

    pub(super) const MAX_ID: usize = 1;
}

/// An open topic.
pub(super) type Published<S, W> = port_factory::publish_subscribe::PortFactory<S, W, ()>;
/// The open request-response service.
pub(super) type Control<S> =
    port_factory::request_response::PortFactory<S, RequestWire, (), ResponseWire, ()>;
/// The open request-response service of the history.
pub(super) type Archive<S> =
    port_factory::request_response::PortFactory<S, ArchiveRequestWire, (), ArchiveResponseWire, ()>;
/// An open event.
pub(super) type Event<S> = port_factory::event::PortFactory<S>;

/// Why a service could not be opened or made, by what follows from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Failure {
    /// There is no such service.
    Missing,
    /// No room for another participant.
    Crowded,
    /// It belongs to another user, or to a group that this user is not in.
    Denied,
    /// Another daemon has the name.
    Taken,
    /// The memory or file system that it would live in has too little room left, bytes.
    NoRoom {
        /// Free now.
        free: u64,
        /// Needed.
        needed: u64,
    },
    /// The folder of the daemon's files cannot be made or written; in the system's words.
    Folder {
        /// Which.
        folder: PathBuf,
        /// Why.
        detail: String,
    },
    /// It has another layout: another release of the program uses it.
    OtherRelease,
    /// Described, but not there: another process is just making or removing it, or was killed while it did.
    Unfinished,
    /// Another process is at it, or the system is at fault.
    Other(String),
}

impl From<ServiceOpenError> for Failure {
    fn from(error: ServiceOpenError) -> Self {
        match error {
            ServiceOpenError::DoesNotExist | ServiceOpenError::IsMarkedForDestruction => Failure::Missing,
            ServiceOpenError::ExceedsMaxNumberOfNodes => Failure::Crowded,
            ServiceOpenError::InsufficientPermissions => Failure::Denied,
            ServiceOpenError::IncompatiblePayload
            | ServiceOpenError::IncompatibleMessagingPattern
            | ServiceOpenError::VersionMismatch => Failure::OtherRelease,
            ServiceOpenError::HangsInCreation | ServiceOpenError::ServiceInCorruptedState => {
                Failure::Unfinished
            }
            other => Failure::Other(format!("{other:?}")),
        }
    }
}

impl From<ServiceCreateError> for Failure {
    fn from(error: ServiceCreateError) -> Self {
        match error {
            ServiceCreateError::InsufficientPermissions => Failure::Denied,
            ServiceCreateError::ServiceInCorruptedState
            | ServiceCreateError::IsBeingCreatedByAnotherInstance => Failure::Unfinished,
            other => Failure::Other(format!("{other:?}")),
        }
    }
}

/// Who opens the services.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    /// Makes them, or takes over those that clients of an earlier daemon still hold.
    Daemon,
    /// Takes them as they are.
    Client,
}

/// One process' part in the services of an instance.
pub(super) struct Participant<'a, S: Service> {
    node: iceoryx2::prelude::Node<S>,
    instance: &'a InstanceName,
    side: Side,
}

impl<'a, S: Service> Participant<'a, S> {
    /// Joins; what dead participants left behind is cleaned up first.
    pub(super) fn join(
        transport: &Transport,
        instance: &'a InstanceName,
        side: Side,
    ) -> Result<Self, Failure> {
        match side {
            Side::Daemon => transport.prepare()?,
            Side::Client => transport.look()?,
        }
        let place = transport.place();
        room::check(&place, MIN_CLIENT_ROOM_BYTES)?;
        // What iceoryx2 warns about becomes a typed error of ours.
        set_log_level_from_env_or(LogLevel::Error);
        let built = NodeBuilder::new()
            .config(&transport.config()?)
            // The daemon has its own handlers for SIGTERM and SIGINT.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<S>();
        let node = built.map_err(|error| match error {
            NodeCreationFailure::InsufficientPermissions => Failure::Denied,
            other => Failure::Other(format!("{other:?}")),
        })?;
        node.blocking_cleanup_dead_nodes(SETTLE);
        if side == Side::Daemon {
            // Only now: what a killed daemon held is free again.
            room::check(&place, MIN_ROOM_BYTES)?;
        }
        Ok(Self { node, instance, side })
    }

    /// A topic with one publisher, whose newest message reaches a late subscriber.
    pub(super) fn published<W>(&self, topic: Topic) -> Result<Published<S, W>, Failure>
    where
        W: Debug + ZeroCopySend + 'static,
    {
        let name = self.service_name(topic)?;
        let builder = || {
            self.node
                .service_builder(&name)
                .publish_subscribe::<W>()
                .max_publishers(1)
                .max_subscribers(MAX_CLIENTS)
                .max_nodes(MAX_CLIENTS + 1)
                .history_size(1)
                .subscriber_max_buffer_size(BUFFERED)
                .enable_safe_overflow(true)
        };
        self.open((&name, MessagingPattern::PublishSubscribe), || builder().open(), || builder().create())
    }

    /// Requests and answers.
    pub(super) fn control(&self) -> Result<Control<S>, Failure> {
        let name = self.service_name(Topic::Control)?;
        let builder = || {
            self.node
                .service_builder(&name)
                .request_response::<RequestWire, ResponseWire>()
                .max_servers(1)
                .max_clients(MAX_CLIENTS)
                .max_nodes(MAX_CLIENTS + 1)
        };
        self.open((&name, MessagingPattern::RequestResponse), || builder().open(), || builder().create())
    }

    /// Questions for older calibrations and the answers, one at a time for each client: an answer has 80 kB.
    pub(super) fn archive(&self) -> Result<Archive<S>, Failure> {
        let name = self.service_name(Topic::Archive)?;
        let builder = || {
            self.node
                .service_builder(&name)
                .request_response::<ArchiveRequestWire, ArchiveResponseWire>()
                .max_servers(1)
                .max_clients(MAX_CLIENTS)
                .max_nodes(MAX_CLIENTS + 1)
                .max_active_requests_per_client(1)
                .max_response_buffer_size(1)
                .max_borrowed_responses_per_pending_response(1)
        };
        self.open((&name, MessagingPattern::RequestResponse), || builder().open(), || builder().create())
    }

    /// An event that wakes the other side.
    pub(super) fn event(&self, topic: Topic) -> Result<Event<S>, Failure> {
        let name = self.service_name(topic)?;
        let builder = || {
            self.node
                .service_builder(&name)
                .event()
                .max_notifiers(MAX_CLIENTS)
                .max_listeners(MAX_CLIENTS)
                .max_nodes(MAX_CLIENTS + 1)
                .event_id_max_value(events::MAX_ID)
        };
        self.open((&name, MessagingPattern::Event), || builder().open(), || builder().create())
    }

    fn service_name(&self, topic: Topic) -> Result<ServiceName, Failure> {
        ServiceName::new(&self.instance.service(topic)).map_err(|error| Failure::Other(format!("{error:?}")))
    }

    /// Opens or makes a service; waits for other processes that are just creating or removing it, and clears away what is left of one that
    /// was killed at that.
    fn open<T, O: Into<ServiceOpenError>, C: Into<ServiceCreateError>>(
        &self,
        (name, pattern): (&ServiceName, MessagingPattern),
        open: impl Fn() -> Result<T, O>,
        create: impl Fn() -> Result<T, C>,
    ) -> Result<T, Failure> {
        let mut deadline = Instant::now() + SETTLE;
        let mut may_clear = self.side == Side::Daemon;
        loop {
            let failure = match open().map_err(|error| Failure::from(error.into())) {
                Ok(service) => return Ok(service),
                Err(Failure::Missing) if self.side == Side::Daemon => match create() {
                    Ok(service) => return Ok(service),
                    Err(error) => Failure::from(error.into()),
                },
                Err(failure) => failure,
            };
            if !matches!(failure, Failure::Unfinished | Failure::Other(_)) {
                return Err(failure);
            }
            if Instant::now() >= deadline {
                let is_cleared = may_clear
                    && failure == Failure::Unfinished
                    && remains::remove::<S>(self.node.config(), name, pattern);
                if !is_cleared {
                    return Err(failure);
                }
                (may_clear, deadline) = (false, Instant::now() + SETTLE);
            }
            std::thread::sleep(RETRY);
        }
    }
}

/// Waits up to `timeout` for events; returns how many came.
pub(super) fn listen<S: Service>(
    listener: &Listener<S>,
    timeout: Duration,
    on_event: &mut dyn FnMut(EventId),
) -> Result<u64, ListenerWaitError> {
    let callback = |event: EventActivation| on_event(event.id);
    // iceoryx2 0.10 hands the timeout to the socket in whole microseconds, and there 0 means for ever.
    if timeout < Duration::from_micros(1) {
        listener.try_wait(callback)
    } else {
        listener.timed_wait(callback, timeout)
    }
}

/// Whether the daemon that publishes this topic lives: a killed one stays listed until somebody cleans up.
pub(super) fn has_living_publisher<S, W>(config: &Config, topic: &Published<S, W>) -> bool
where
    S: Service,
    W: Debug + ZeroCopySend + 'static,
{
    let mut publisher = None;
    topic.dynamic_config().list_publishers(|details| {
        publisher = Some(details.node_id);
        CallbackProgression::Stop
    });
    // What cannot be found out counts as alive: the request that follows will tell.
    publisher.is_some_and(|node| {
        !matches!(iceoryx2::prelude::Node::<S>::state_of(config, node), Ok(None | Some(NodeState::Dead(_))))
    })
}
