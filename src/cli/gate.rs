//! When the next frame set of a recording is due: at a given rate, or when the pipeline is through with the one before.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use crate::pipeline::PipelineOptions;

/// Sets released ahead of the last one done: enough to keep every thread busy, fewer than the pipeline has room for.
const AHEAD: u64 = 3;
/// Between two looks whether a set was released.
const POLL: Duration = Duration::from_micros(200);

/// Held cameras are late on purpose: how long sync waits for one before it goes on without it.
const HELD_WAIT: Duration = Duration::from_secs(2);
/// And how long one may be silent.
const HELD_SILENCE: Duration = Duration::from_secs(24 * 3600);

/// Lets a pipeline wait for cameras behind a gate: at its start, too, when the thread of one runs before that of the other.
pub fn wait_for_held_cameras(options: &mut PipelineOptions) {
    options.sync.wait = options.sync.wait.max(HELD_WAIT);
    (options.sync.stalled_after, options.sync.reopen_after) = (HELD_SILENCE, HELD_SILENCE);
}

/// When frames are due.
#[derive(Debug)]
pub enum Gate {
    /// So long apart, from the first frame anybody asks for.
    Paced(Duration, OnceLock<Instant>),
    /// When released; counts the sets.
    Released(AtomicU64),
}

impl Gate {
    /// A gate for so many sets per second, or for as many as are released.
    pub fn new(rate_hz: Option<f64>) -> Self {
        match rate_hz {
            Some(rate_hz) => Gate::Paced(Duration::from_secs_f64(1.0 / rate_hz), OnceLock::new()),
            None => Gate::Released(AtomicU64::new(AHEAD)),
        }
    }

    /// Says that so many sets are through, or lost.
    pub fn release_after(&self, n_sets: u64) {
        if let Gate::Released(released) = self {
            // Relaxed: the number is all that is handed over.
            released.fetch_max(n_sets + AHEAD, Ordering::Relaxed);
        }
    }

    /// Waits until a set is due, at most `timeout`; whether it is.
    pub fn wait_for(&self, set: u64, timeout: Duration) -> bool {
        match self {
            Gate::Paced(period, start) => {
                let due = period.mul_f64(set as f64);
                let wait = due.saturating_sub(start.get_or_init(Instant::now).elapsed());
                thread::sleep(wait.min(timeout));
                wait <= timeout
            }
            Gate::Released(released) => {
                let start = Instant::now();
                // Relaxed: as above.
                while released.load(Ordering::Relaxed) <= set {
                    if start.elapsed() > timeout {
                        return false;
                    }
                    thread::sleep(POLL);
                }
                true
            }
        }
    }
}
