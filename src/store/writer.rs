//! A thread of its own that writes: an `fsync` takes from a millisecond to seconds, and no client and no frame shall wait for it.
//!
//! What could not be written is tried again, so that a disk that was full for a while loses nothing.

use std::collections::VecDeque;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use super::Store;
use super::disk::Disk;
use super::entry::StoredCalibration;
use super::error::StoreError;

/// Pause before what failed is tried again.
const RETRY: Duration = Duration::from_secs(10);
/// Most calibrations that wait for a disk to work again; of more, the newest.
const MAX_WAITING: usize = 16;

/// A calibration to write; files with a number below the second are no longer wanted.
type Job = (StoredCalibration, u64);

/// What became of a calibration.
#[derive(Debug)]
pub enum Report {
    /// It is on the disk.
    Saved {
        /// Its number.
        id: u64,
    },
    /// Older ones could not be removed; tried again after the next calibration.
    Untidy {
        /// Why.
        error: StoreError,
    },
    /// It is not; it is tried again.
    Failed {
        /// Its number.
        id: u64,
        /// Why.
        error: StoreError,
    },
}

/// Hands calibrations to the thread that writes them.
#[derive(Debug)]
pub struct Writer {
    jobs: Sender<Job>,
    reports: Receiver<Report>,
    thread: JoinHandle<()>,
}

impl Writer {
    /// Starts the thread.
    ///
    /// # Errors
    /// When there is no thread to be had.
    pub fn start<D: Disk + 'static>(store: Store<D>) -> std::io::Result<Self> {
        let (jobs, todo) = unbounded();
        let (reporter, reports) = unbounded();
        let thread = std::thread::Builder::new().name("store".to_owned());
        let thread = thread.spawn(move || run(&store, &todo, &reporter))?;
        Ok(Self { jobs, reports, thread })
    }

    /// Writes a calibration when its turn comes, then removes files with a number below `oldest_kept`.
    pub fn save(&self, entry: StoredCalibration, oldest_kept: u64) {
        // Fails only when the thread has ended, which `is_running` tells.
        let _ = self.jobs.send((entry, oldest_kept));
    }

    /// Whether the thread goes on; it ends before this does only by a panic, and then nothing is written any more.
    pub fn is_running(&self) -> bool {
        !self.thread.is_finished()
    }

    /// What became of calibrations since this was called last; does not wait.
    pub fn reports(&self) -> impl Iterator<Item = Report> + '_ {
        self.reports.try_iter()
    }

    /// Waits until everything is written or was tried once more, but not longer than `within`; the last reports, and whether it
    /// came to that end.
    pub fn finish(self, within: Duration) -> (Vec<Report>, bool) {
        drop(self.jobs);
        let deadline = Instant::now() + within;
        let mut last = Vec::new();
        loop {
            match self.reports.recv_deadline(deadline) {
                Ok(report) => last.push(report),
                Err(RecvTimeoutError::Disconnected) => return (last, self.thread.join().is_ok()),
                Err(RecvTimeoutError::Timeout) => return (last, false),
            }
        }
    }
}

fn run<D: Disk>(store: &Store<D>, todo: &Receiver<Job>, reporter: &Sender<Report>) {
    let mut waiting: VecDeque<Job> = VecDeque::new();
    let mut is_open = true;
    while is_open {
        let job = if waiting.is_empty() {
            todo.recv().map_err(RecvTimeoutError::from)
        } else {
            todo.recv_timeout(RETRY)
        };
        match job {
            Ok(job) => waiting.push_back(job),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => is_open = false,
        }
        waiting.drain(..waiting.len().saturating_sub(MAX_WAITING));
        while let Some((entry, oldest_kept)) = waiting.front() {
            let id = entry.id;
            // Nobody listens any more when the daemon has given up waiting.
            if let Err(error) = store.save(entry) {
                let _ = reporter.send(Report::Failed { id, error });
                break;
            }
            let _ = reporter.send(Report::Saved { id });
            if let Err(error) = store.remove_old(*oldest_kept) {
                let _ = reporter.send(Report::Untidy { error });
            }
            waiting.pop_front();
        }
    }
}
