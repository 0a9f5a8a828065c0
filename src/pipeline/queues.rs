//! The lock-free queues between the stages and the pools their buffers come back to; everything is allocated here, at the start.
//!
//! Drop policies: `frames` keeps the newest and counts what it evicts (capture); `jobs` and `done` are sized for all sets in flight and
//! never overflow; `sets` keeps the newest and counts what it evicts (publish). Evicted buffers go back to their pool.

use std::sync::atomic::AtomicUsize;
use std::time::Instant;

use crossbeam_queue::ArrayQueue;

use super::buffers::{FrameSlot, LineSet, LineSlot};

/// Frame sets in the line stage at a time: with the one that is pending, a busy machine may pause it for 160 ms at 30 fps before a set
/// is dropped; in an overload it is also what a frame may have to wait for.
pub(super) const MAX_SETS_IN_FLIGHT: usize = 4;
/// Frames between a capture thread and the sync thread: a pause of 130 ms at 30 fps.
const CAPTURE_QUEUE: usize = 4;
/// Frames the sync thread keeps per camera: a full capture queue on top of one frame that waits for its partner, and one.
pub(super) const SYNC_QUEUE: usize = CAPTURE_QUEUE + 2;
/// Line sets waiting for the estimator.
const ESTIMATE_QUEUE: usize = 4;
/// Frames per camera: queued, matched, pending, in flight, and one in the capture thread's hands, with one to spare.
const FRAMES_PER_CAMERA: usize = CAPTURE_QUEUE + SYNC_QUEUE + 1 + MAX_SETS_IN_FLIGHT + 2;

/// Buffers on their way, and the pools they come back to.
#[derive(Debug)]
pub(super) struct Queues {
    /// Capture to sync, per camera; newest wins.
    pub(super) frames: Vec<ArrayQueue<Box<FrameSlot>>>,
    pub(super) frame_pools: Vec<ArrayQueue<Box<FrameSlot>>>,
    /// Sync to line stage.
    pub(super) jobs: ArrayQueue<Box<FrameSlot>>,
    /// Sets in the line stage; sync counts up, publish down.
    pub(super) in_flight: AtomicUsize,
    /// Line stage to publish.
    pub(super) done: ArrayQueue<Box<LineSlot>>,
    pub(super) line_pool: ArrayQueue<Box<LineSlot>>,
    /// Publish to estimate; newest wins.
    pub(super) sets: ArrayQueue<Box<LineSet>>,
    pub(super) set_pool: ArrayQueue<Box<LineSet>>,
}

impl Queues {
    pub(super) fn new(n_cameras: usize, n_line_threads: usize) -> Self {
        let now = Instant::now();
        let filled = |n: usize, make: &dyn Fn() -> Box<FrameSlot>| {
            let pool = ArrayQueue::new(n);
            (0..n).for_each(|_| drop(pool.push(make())));
            pool
        };
        let frame_pool = |camera| filled(FRAMES_PER_CAMERA, &|| Box::new(FrameSlot::new(camera, now)));
        // Queued, being filled, waiting in the estimator's queue, being added, and one in the publisher's hands.
        let n_sets = ESTIMATE_QUEUE + 2;
        let n_lines = n_cameras * (MAX_SETS_IN_FLIGHT + n_sets + 1) + n_line_threads;
        let (line_pool, set_pool) = (ArrayQueue::new(n_lines), ArrayQueue::new(n_sets));
        (0..n_lines).for_each(|_| drop(line_pool.push(Box::new(LineSlot::new(now)))));
        (0..n_sets).for_each(|_| drop(set_pool.push(Box::new(LineSet::new(now)))));
        let in_flight = n_cameras * MAX_SETS_IN_FLIGHT;
        Self {
            frames: (0..n_cameras).map(|_| ArrayQueue::new(CAPTURE_QUEUE)).collect(),
            frame_pools: (0..n_cameras).map(frame_pool).collect(),
            jobs: ArrayQueue::new(in_flight),
            in_flight: AtomicUsize::new(0),
            done: ArrayQueue::new(in_flight),
            line_pool,
            sets: ArrayQueue::new(ESTIMATE_QUEUE),
            set_pool,
        }
    }

    /// Gives a frame buffer back.
    pub(super) fn recycle_frame(&self, slot: Box<FrameSlot>) {
        // The pool has room for every slot of its camera, so nothing is lost here.
        drop(self.frame_pools[slot.camera].push(slot));
    }

    /// Gives the buffers of a line set back.
    pub(super) fn recycle_set(&self, mut set: Box<LineSet>) {
        for slot in set.slots.iter_mut().filter_map(Option::take) {
            drop(self.line_pool.push(slot));
        }
        drop(self.set_pool.push(set));
    }
}
