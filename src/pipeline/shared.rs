//! What the pipeline's threads share besides the queues: atomics, wake-ups, and the way events go to the owner.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock, PoisonError};
use std::thread::Thread;
use std::time::{Duration, Instant};

use crossbeam_channel::{Sender, TrySendError};
use crossbeam_queue::ArrayQueue;

use super::event::{CameraState, Phase, PipelineEvent};
use super::frame_health::FrameHealthCell;
use super::pulse::Pulses;
use super::queues::Queues;
use super::recovery::ResetTurn;
use super::skew::SkewBook;
use super::stats::{Counter, Counters, Latencies};
use crate::solver::RigCalibration;

/// Wakes one parked thread; a lost wake-up costs at most one poll interval.
#[derive(Debug, Default)]
pub(super) struct Waker(OnceLock<Thread>);

impl Waker {
    /// Makes the calling thread the one to wake.
    pub(super) fn register(&self) {
        // A second registration would be another thread of the same stage, which does not exist.
        let _ = self.0.set(std::thread::current());
    }

    pub(super) fn wake(&self) {
        if let Some(thread) = self.0.get() {
            thread.unpark();
        }
    }
}

/// What is known of one camera.
#[derive(Debug)]
pub(super) struct CameraShared {
    pub(super) name: String,
    // Relaxed: a state hands nothing over; frames go through the queues.
    state: AtomicU8,
    last_frame_ns: AtomicU64,
    pub(super) frames: Counter,
    pub(super) dropped: Counter,
    pub(super) health: FrameHealthCell,
    /// Locked when a camera is opened and when somebody asks, never per frame.
    firmware: Mutex<Option<String>>,
}

impl CameraShared {
    fn new(name: String) -> Self {
        Self {
            name,
            state: AtomicU8::new(CameraState::Waiting as u8),
            last_frame_ns: AtomicU64::new(0),
            frames: Counter::default(),
            dropped: Counter::default(),
            health: FrameHealthCell::default(),
            firmware: Mutex::new(None),
        }
    }

    pub(super) fn firmware(&self) -> Option<String> {
        self.firmware.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub(super) fn set_firmware(&self, firmware: Option<String>) {
        *self.firmware.lock().unwrap_or_else(PoisonError::into_inner) = firmware;
    }

    pub(super) fn state(&self) -> CameraState {
        let number = usize::from(self.state.load(Ordering::Relaxed));
        CameraState::ALL.get(number).copied().unwrap_or(CameraState::Failed)
    }

    /// Sets the state; whether it was another one before.
    pub(super) fn change(&self, state: CameraState) -> bool {
        self.state.swap(state as u8, Ordering::Relaxed) != state as u8
    }

    /// From this state to stalled, unless the capture thread has changed it meanwhile.
    pub(super) fn stall(&self, from: CameraState) -> bool {
        let (from, stalled) = (from as u8, CameraState::Stalled as u8);
        self.state.compare_exchange(from, stalled, Ordering::Relaxed, Ordering::Relaxed).is_ok()
    }

    /// A frame has come, or the time in which the first one may come begins.
    pub(super) fn note_frame(&self, since_start: Duration) {
        self.last_frame_ns.store(since_start.as_nanos() as u64, Ordering::Relaxed);
    }

    pub(super) fn last_frame(&self) -> Duration {
        Duration::from_nanos(self.last_frame_ns.load(Ordering::Relaxed))
    }
}

/// The phase and how often collecting has begun, in one atomic, so that a result of an earlier round never ends a later one.
#[derive(Debug)]
// Relaxed: the phase hands nothing over; the estimator owns its evidence.
pub(super) struct PhaseCell(AtomicU64);

impl PhaseCell {
    fn new() -> Self {
        Self(AtomicU64::new(pack(Phase::Collecting, 1)))
    }

    pub(super) fn phase(&self) -> Phase {
        unpack(self.0.load(Ordering::Relaxed)).0
    }

    /// The round of collecting, counting from 1.
    pub(super) fn round(&self) -> u64 {
        unpack(self.0.load(Ordering::Relaxed)).1
    }

    /// Whether this round is still going on.
    pub(super) fn is_collecting(&self, round: u64) -> bool {
        unpack(self.0.load(Ordering::Relaxed)) == (Phase::Collecting, round)
    }

    /// Begins a new round, unless one is going on.
    pub(super) fn begin(&self) -> bool {
        self.replace(|phase, round| (phase != Phase::Collecting).then_some((Phase::Collecting, round + 1)))
    }

    /// Ends the round with the given phase, unless it has ended already.
    pub(super) fn end(&self, in_round: Option<u64>, into: Phase) -> bool {
        self.replace(|phase, round| {
            let is_meant = phase == Phase::Collecting && in_round.is_none_or(|meant| meant == round);
            is_meant.then_some((into, round))
        })
    }

    /// Begins a round in which a result that is there already is watched; the round.
    pub(super) fn watch(&self) -> u64 {
        self.replace(|_, round| Some((Phase::Watching, round + 1)));
        self.round()
    }

    fn replace(&self, next: impl Fn(Phase, u64) -> Option<(Phase, u64)>) -> bool {
        let update = |value| {
            let (phase, round) = unpack(value);
            next(phase, round).map(|(phase, round)| pack(phase, round))
        };
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, update).is_ok()
    }
}

fn pack(phase: Phase, round: u64) -> u64 {
    let number = match phase {
        Phase::Collecting => 0,
        Phase::Watching => 1,
        Phase::Idle => 2,
    };
    round << 2 | number
}

fn unpack(value: u64) -> (Phase, u64) {
    let phase = match value & 3 {
        0 => Phase::Collecting,
        1 => Phase::Watching,
        _ => Phase::Idle,
    };
    (phase, value >> 2)
}

/// Everything the threads share.
#[derive(Debug)]
pub(super) struct Shared {
    pub(super) stop: AtomicBool,
    pub(super) started: Instant,
    pub(super) cameras: Vec<CameraShared>,
    pub(super) phase: PhaseCell,
    pub(super) counters: Counters,
    pub(super) latencies: Latencies,
    pub(super) skews: SkewBook,
    pub(super) queues: Queues,
    pub(super) wakers: Wakers,
    pub(super) pulses: Pulses,
    /// Whose turn it is to be reset.
    pub(super) resets: ResetTurn,
    /// Set while the estimator has time for a frame set to compare its result with. Relaxed: sets go through the queues.
    pub(super) wants_watched_set: AtomicBool,
    /// A result to watch that was not made in this run, with its round; the newest wins.
    pub(super) given: ArrayQueue<(RigCalibration, u64)>,
    events: Sender<PipelineEvent>,
}

/// Whom to wake.
#[derive(Debug)]
pub(super) struct Wakers {
    pub(super) sync: Waker,
    pub(super) lines: Vec<Waker>,
    pub(super) publish: Waker,
    pub(super) estimate: Waker,
}

impl Shared {
    pub(super) fn new(names: Vec<String>, n_line_threads: usize, events: Sender<PipelineEvent>) -> Self {
        let wakers = Wakers {
            sync: Waker::default(),
            lines: (0..n_line_threads).map(|_| Waker::default()).collect(),
            publish: Waker::default(),
            estimate: Waker::default(),
        };
        Self {
            stop: AtomicBool::new(false),
            started: Instant::now(),
            phase: PhaseCell::new(),
            counters: Counters::default(),
            latencies: Latencies::default(),
            skews: SkewBook::new(names.len()),
            queues: Queues::new(names.len(), n_line_threads),
            wakers,
            pulses: Pulses::new(names.len(), n_line_threads),
            resets: ResetTurn::default(),
            wants_watched_set: AtomicBool::new(false),
            given: ArrayQueue::new(1),
            cameras: names.into_iter().map(CameraShared::new).collect(),
            events,
        }
    }

    pub(super) fn is_stopping(&self) -> bool {
        // Relaxed: nothing is handed over through `stop`.
        self.stop.load(Ordering::Relaxed)
    }

    pub(super) fn since_start(&self) -> Duration {
        self.started.elapsed()
    }

    /// Tells the owner, or counts that it was not listening.
    pub(super) fn tell(&self, event: PipelineEvent) {
        if let Err(TrySendError::Full(_)) = self.events.try_send(event) {
            self.counters.dropped_events.add_one();
        }
    }

    /// Tells the owner, waiting until it listens or the pipeline stops. Not for the frame path.
    pub(super) fn tell_surely(&self, mut event: PipelineEvent) {
        while !self.is_stopping() {
            match self.events.send_timeout(event, Duration::from_millis(50)) {
                Err(crossbeam_channel::SendTimeoutError::Timeout(unsent)) => event = unsent,
                _ => return,
            }
        }
    }

    /// Tells the owner of a camera's new state; nothing when it is not new.
    pub(super) fn change_camera(&self, camera: usize, state: CameraState, detail: &str) {
        if self.cameras[camera].change(state) {
            self.report_camera(camera, state, detail);
        }
    }

    pub(super) fn report_camera(&self, camera: usize, state: CameraState, detail: &str) {
        let name = &self.cameras[camera].name;
        let colon = if detail.is_empty() { "" } else { ": " };
        match state {
            CameraState::Waiting | CameraState::Opened | CameraState::Streaming | CameraState::Ended => {
                tracing::info!(camera = name, "camera is {}{colon}{detail}", state.name());
            }
            CameraState::Stalled | CameraState::Unplugged | CameraState::Failed => {
                tracing::warn!(camera = name, "camera is {}{colon}{detail}", state.name());
            }
        }
        self.tell(PipelineEvent::Camera { camera, state, detail: detail.to_owned() });
    }
}
