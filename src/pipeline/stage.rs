//! A step, the loop that runs it, and the thread it runs on: written once for every stage.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::event::PipelineEvent;
use super::options::StartError;
use super::pulse::Pulse;
use super::shared::Shared;

/// Longest sleep of a thread that has nothing to do; a wake-up ends it earlier.
pub(super) const POLL: Duration = Duration::from_millis(20);

/// One stage of the pipeline, owned by one thread.
pub(super) trait Stage: Send {
    /// Tells the others whom to wake; called once, on the stage's own thread.
    fn register(&mut self) {}

    /// Where the stage's turns are counted.
    fn pulse(&self) -> &Pulse;

    /// Does one piece of work; `false` when there was none.
    fn step(&mut self) -> bool;
}

/// Runs `stage` until the pipeline stops.
fn run(stage: &mut dyn Stage, shared: &Shared) {
    stage.register();
    while !shared.is_stopping() {
        let has_worked = stage.step();
        stage.pulse().turn();
        if has_worked {
            stage.pulse().worked();
        } else {
            thread::park_timeout(POLL);
        }
    }
}

/// Starts a named thread for a stage.
pub(super) fn spawn(
    name: String,
    shared: &Arc<Shared>,
    mut stage: Box<dyn Stage>,
) -> Result<JoinHandle<()>, StartError> {
    let of_thread = Arc::clone(shared);
    spawn_body(name, shared, Box::new(move || run(stage.as_mut(), &of_thread)))
}

/// Starts a named thread; a panic in it is an event, not the end of the process.
pub(super) fn spawn_body(
    name: String,
    shared: &Arc<Shared>,
    body: Box<dyn FnOnce() + Send>,
) -> Result<JoinHandle<()>, StartError> {
    let (of_thread, thread_name) = (Arc::clone(shared), name.clone());
    let guarded = move || {
        // Unwind safety: after a panic the stage is gone, and what it shared are atomics and queues of whole buffers.
        if catch_unwind(AssertUnwindSafe(body)).is_err() {
            tracing::error!(thread = thread_name, "thread ended by a panic");
            of_thread.tell_surely(PipelineEvent::Bug { thread: thread_name });
        }
    };
    thread::Builder::new()
        .name(name.clone())
        .spawn(guarded)
        .map_err(|source| StartError::Thread { name, source })
}

/// Waits for a thread to end, but not beyond `deadline`; whether it ended. One that did not is left alone.
pub(super) fn join_until(handle: JoinHandle<()>, deadline: Instant) -> bool {
    while !handle.is_finished() {
        if Instant::now() >= deadline {
            return false;
        }
        thread::sleep(Duration::from_millis(1));
    }
    // A panic has been reported by the thread itself.
    drop(handle.join());
    true
}
