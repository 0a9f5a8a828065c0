//! The publish thread: joins the lines of a set, tests for motion, tells the owner, hands the set to the estimator.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::MAX_CAMERAS;
use super::buffers::{LineSet, LineSlot, SetHeader};
use super::event::{CameraProgress, Phase, PipelineEvent, Progress};
use super::motion::{MotionOptions, MotionTest, SeenFrame, Turn, TurnSense};
use super::pulse::Pulse;
use super::queues::MAX_SETS_IN_FLIGHT;
use super::shared::Shared;
use super::stage::Stage;

type Slots = [Option<Box<LineSlot>>; MAX_CAMERAS];

/// Joins and publishes.
pub(super) struct PublishStage {
    shared: Arc<Shared>,
    motion: MotionTest,
    /// Sets in flight by number modulo their count, as far as their frames are done.
    open: [(usize, Slots); MAX_SETS_IN_FLIGHT],
    next_id: u64,
}

impl PublishStage {
    pub(super) fn new(shared: Arc<Shared>, motion: MotionOptions) -> Self {
        let open = std::array::from_fn(|_| (0, std::array::from_fn(|_| None)));
        let motion = MotionTest::new(shared.cameras.len(), motion);
        Self { shared, motion, open, next_id: 0 }
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
        let turn = self.turn(&slots);
        let refused_by = self.motion.refuses(turn);
        shared.counters.sets_done.add_one();
        let phase = shared.phase.phase();
        if phase == Phase::Collecting {
            match refused_by {
                Some(TurnSense::Gyro) => shared.counters.refused_gyro.add_one(),
                Some(TurnSense::Image) => shared.counters.refused_image.add_one(),
                None => {}
            }
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
            turn,
            cameras,
            phase,
            counts: shared.counters.counts(),
        }));
        let is_wanted = match phase {
            _ if refused_by.is_some() => false,
            Phase::Collecting => true,
            Phase::Watching => shared.wants_watched_set.swap(false, Ordering::Relaxed),
            Phase::Idle => false,
        };
        self.hand_on(header, slots, is_wanted);
        // Release: pairs with the acquire in sync; the set's buffers are back in their pools.
        shared.queues.in_flight.fetch_sub(1, Ordering::Release);
        shared.wakers.sync.wake();
    }

    fn turn(&mut self, slots: &Slots) -> Option<Turn> {
        self.motion.turn(slots.iter().flatten().filter_map(|slot| {
            Some(SeenFrame {
                camera: slot.camera,
                stamp: slot.stamp,
                focal_px: slot.intrinsics?.mean_focal_px(),
                thumbnail: &slot.found.thumbnail,
                turn_rate: slot.turn_rate,
            })
        }))
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
