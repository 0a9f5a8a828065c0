//! The publish thread: joins the lines of a set, tests for motion, tells the owner, hands the set to the estimator.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::MAX_CAMERAS;
use super::buffers::{LineSet, LineSlot, SetHeader};
use super::event::{CameraProgress, Phase, PipelineEvent, Progress};
use super::motion::{Glimpse, MotionOptions, image_speed_px_per_s};
use super::pulse::Pulse;
use super::queues::MAX_SETS_IN_FLIGHT;
use super::shared::Shared;
use super::stage::Stage;

type Slots = [Option<Box<LineSlot>>; MAX_CAMERAS];

/// Joins and publishes.
pub(super) struct PublishStage {
    shared: Arc<Shared>,
    motion: MotionOptions,
    /// Sets in flight by number modulo their count, as far as their frames are done.
    open: [(usize, Slots); MAX_SETS_IN_FLIGHT],
    next_id: u64,
    last_glimpse: [Option<Glimpse>; MAX_CAMERAS],
}

impl PublishStage {
    pub(super) fn new(shared: Arc<Shared>, motion: MotionOptions) -> Self {
        let open = std::array::from_fn(|_| (0, std::array::from_fn(|_| None)));
        Self { shared, motion, open, next_id: 0, last_glimpse: [None; MAX_CAMERAS] }
    }

    fn place(&mut self, slot: Box<LineSlot>) {
        let (n_done, slots) = &mut self.open[slot.set.id as usize % MAX_SETS_IN_FLIGHT];
        *n_done += 1;
        let camera = slot.camera;
        slots[camera] = Some(slot);
    }

    /// The set whose turn it is, once all its frames are done: sets are published in their order.
    fn complete(&mut self) -> Option<(SetHeader, Slots)> {
        let (n_done, slots) = &mut self.open[self.next_id as usize % MAX_SETS_IN_FLIGHT];
        let header = slots.iter().flatten().next()?.set;
        if header.id != self.next_id || *n_done < header.n_members {
            return None;
        }
        *n_done = 0;
        self.next_id += 1;
        Some((header, std::mem::replace(slots, std::array::from_fn(|_| None))))
    }

    fn publish(&mut self, header: SetHeader, slots: Slots) {
        let _span = tracing::trace_span!("publish", set = header.id).entered();
        let shared = Arc::clone(&self.shared);
        let speed_px_per_s = self.speed(&slots);
        let is_fast = speed_px_per_s.is_some_and(|speed| speed > self.motion.max_speed_px_per_s);
        shared.counters.sets_done.add_one();
        let phase = shared.phase.phase();
        if phase == Phase::Collecting && is_fast {
            shared.counters.refused_motion.add_one();
        }
        let cameras = progress_of(&slots);
        let latency = header.newest_arrival.elapsed();
        shared.latencies.frame_to_progress.record(latency);
        shared.tell(PipelineEvent::Progress(Progress {
            set: header.id,
            newest_stamp: header.newest_stamp,
            newest_arrival: header.newest_arrival,
            latency,
            skew: header.skew,
            speed_px_per_s,
            cameras,
            phase,
            counts: shared.counters.counts(),
        }));
        let is_wanted = match phase {
            _ if is_fast => false,
            Phase::Collecting => true,
            Phase::Watching => shared.wants_watched_set.swap(false, Ordering::Relaxed),
            Phase::Idle => false,
        };
        self.hand_on(header, slots, is_wanted);
        // Release: pairs with the acquire in sync; the set's buffers are back in their pools.
        shared.queues.in_flight.fetch_sub(1, Ordering::Release);
        shared.wakers.sync.wake();
    }

    /// Speed of the fastest image since that camera's last set.
    fn speed(&mut self, slots: &Slots) -> Option<f64> {
        let mut fastest: Option<f64> = None;
        for slot in slots.iter().flatten() {
            let now = Glimpse { stamp: slot.stamp, thumbnail: slot.found.thumbnail };
            let before = self.last_glimpse[slot.camera].replace(now);
            let speed = before.and_then(|before| image_speed_px_per_s(&before, &now));
            fastest = fastest.into_iter().chain(speed).reduce(f64::max);
        }
        fastest
    }

    /// Gives the set to the estimator, or its buffers back.
    fn hand_on(&self, header: SetHeader, slots: Slots, wanted: bool) {
        let queues = &self.shared.queues;
        let free_set = || queues.set_pool.pop().or_else(|| self.steal_oldest());
        let Some(mut set) = wanted.then(free_set).flatten() else {
            slots.into_iter().flatten().for_each(|slot| drop(queues.line_pool.push(slot)));
            return;
        };
        (set.header, set.slots) = (header, slots);
        if let Some(evicted) = queues.sets.force_push(set) {
            self.shared.counters.skipped_sets.add_one();
            queues.recycle_set(evicted);
        }
        self.shared.wakers.estimate.wake();
    }

    fn steal_oldest(&self) -> Option<Box<LineSet>> {
        let queues = &self.shared.queues;
        let mut set = queues.sets.pop()?;
        self.shared.counters.skipped_sets.add_one();
        set.slots.iter_mut().filter_map(Option::take).for_each(|slot| drop(queues.line_pool.push(slot)));
        Some(set)
    }
}

fn progress_of(slots: &Slots) -> [CameraProgress; MAX_CAMERAS] {
    let mut cameras = [CameraProgress::default(); MAX_CAMERAS];
    for slot in slots.iter().flatten() {
        let lines = &slot.found.view.lines;
        let n_lifted = lines.iter().filter(|line| line.depth.is_some()).count();
        cameras[slot.camera] =
            CameraProgress { is_present: true, lines: lines.len() as u32, lifted: n_lifted as u32 };
    }
    cameras
}

impl Stage for PublishStage {
    fn register(&mut self) {
        self.shared.wakers.publish.register();
    }

    fn pulse(&self) -> &Pulse {
        &self.shared.pulses.publish
    }

    fn step(&mut self) -> bool {
        let Some(slot) = self.shared.queues.done.pop() else { return false };
        self.place(slot);
        while let Some((header, slots)) = self.complete() {
            self.publish(header, slots);
        }
        true
    }
}
