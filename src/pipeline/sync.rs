//! The sync thread: frames into sets, sets into the line stage; notices cameras that stall.
//!
//! All sets go to the line stage. When it is behind, the newest set waits and replaces an older one that waits: counted, never silent.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::MAX_CAMERAS;
use super::buffers::{FrameSlot, SetHeader};
use super::event::CameraState;
use super::matcher::{MatchOptions, Matched, Matcher, Stamped};
use super::options::SyncOptions;
use super::pulse::Pulse;
use super::queues::{MAX_SETS_IN_FLIGHT, SYNC_QUEUE};
use super::shared::{Shared, Waker};
use super::stage::Stage;

/// A camera that was opened takes its time for the first frame: sensors start, exposure settles. It is not waited for that long, but it is
/// not told as stalled before.
const FIRST_FRAME: Duration = Duration::from_secs(2);

/// Forms frame sets and feeds the line stage.
pub(super) struct SyncStage {
    shared: Arc<Shared>,
    matcher: Matcher<Box<FrameSlot>>,
    max_skew: Duration,
    stalled_after: Duration,
    /// The newest set that the line stage has not taken yet.
    pending: Option<Matched<Box<FrameSlot>>>,
    next_id: u64,
}

impl SyncStage {
    pub(super) fn new(shared: Arc<Shared>, options: &SyncOptions) -> Self {
        let match_options = MatchOptions {
            max_skew_ns: u64::try_from(options.max_skew.as_nanos()).unwrap_or(u64::MAX),
            wait: options.wait,
            capacity: SYNC_QUEUE,
        };
        let matcher = Matcher::new(shared.cameras.len(), match_options);
        let SyncOptions { max_skew, stalled_after, .. } = *options;
        Self { shared, matcher, max_skew, stalled_after, pending: None, next_id: 0 }
    }

    /// Fetches what the capture threads have; whether there was anything. A stamp of a camera's own clock may be near one of another
    /// camera by chance, however far apart the images are.
    fn fetch(&mut self) -> bool {
        let mut fetched = false;
        let queues = &self.shared.queues;
        for (camera, queue) in queues.frames.iter().enumerate() {
            while let Some(slot) = queue.pop() {
                fetched = true;
                if queues.frames.len() > 1 && slot.frame.timing.is_of_own_clock() {
                    self.matcher.pass_over(camera);
                    queues.recycle_frame(slot);
                    continue;
                }
                let arrival = slot.arrival.duration_since(self.shared.started);
                let frame = Stamped { stamp: slot.frame.stamp, arrival, item: slot };
                self.matcher.push(camera, frame, &mut |_, slot| queues.recycle_frame(slot));
            }
        }
        fetched
    }

    /// Notices stalls; says which cameras are worth waiting for.
    fn living(&self) -> [bool; MAX_CAMERAS] {
        let mut living = [false; MAX_CAMERAS];
        let now = self.shared.since_start();
        for (camera, (alive, shared)) in living.iter_mut().zip(&self.shared.cameras).enumerate() {
            let silence = now.saturating_sub(shared.last_frame());
            let (state, limit) = (shared.state(), self.stalled_after);
            let patience = if state == CameraState::Opened { limit.max(FIRST_FRAME) } else { limit };
            let is_open = matches!(state, CameraState::Opened | CameraState::Streaming);
            *alive = is_open && silence <= limit;
            if is_open && silence > patience && shared.stall(state) {
                let detail = format!("no frame for {} ms", silence.as_millis());
                self.shared.report_camera(camera, CameraState::Stalled, &detail);
            }
        }
        living
    }

    /// Forms every set there is; the newest stays pending.
    fn form(&mut self) {
        let living = self.living();
        let n_cameras = self.shared.cameras.len();
        loop {
            let (now, queues) = (self.shared.since_start(), &self.shared.queues);
            let recycle = &mut |_, slot| queues.recycle_frame(slot);
            let formed = self.matcher.next_set(now, &living[..n_cameras], recycle);
            for beyond in self.matcher.drain_beyond() {
                self.shared.skews.note_beyond(beyond.cameras, Duration::from_nanos(beyond.gap_ns));
            }
            let Some(set) = formed else { break };
            let stamps = set.frames.iter().map(|frame| frame.as_ref().map(|frame| frame.stamp));
            self.shared.skews.note_set(stamps, self.max_skew);
            self.shared.counters.sets_formed.add_one();
            if let Some(older) = self.pending.replace(set) {
                self.shared.counters.dropped_sets.add_one();
                older.frames.into_iter().flatten().for_each(|frame| queues.recycle_frame(frame.item));
            }
            self.dispatch();
        }
        let strangers = living.iter().enumerate().filter(|(_, alive)| **alive);
        let strangers =
            strangers.fold(0, |mask, (camera, _)| mask | self.matcher.strangers() & (1 << camera));
        self.shared.skews.note_own_clocks(strangers);
        self.publish_counters();
    }

    fn publish_counters(&self) {
        let (from, to) = (self.matcher.counters(), &self.shared.counters);
        to.unmatched_frames.set(from.unmatched_frames);
        to.refused_skew.set(from.refused_sets);
        to.out_of_order.set(from.out_of_order);
        to.clock_resets.set(from.clock_resets);
    }

    /// Sends the pending set to the line stage if it has room; whether it did.
    fn dispatch(&mut self) -> bool {
        let queues = &self.shared.queues;
        // Acquire: pairs with the release in the publish thread, after which the set's buffers are free again.
        if queues.in_flight.load(Ordering::Acquire) >= MAX_SETS_IN_FLIGHT {
            return false;
        }
        let Some(set) = self.pending.take() else { return false };
        let Some(header) = header_of(&set, self.next_id) else { return false };
        self.next_id += 1;
        self.shared.latencies.frame_to_set.record(header.newest_arrival.elapsed());
        // Relaxed: only this thread counts up, and the queue hands the buffers over.
        queues.in_flight.fetch_add(1, Ordering::Relaxed);
        for frame in set.frames.into_iter().flatten() {
            let mut slot = frame.item;
            slot.set = header;
            // The queue has room for all frames of all sets in flight.
            drop(queues.jobs.push(slot));
        }
        self.shared.wakers.lines.iter().for_each(Waker::wake);
        true
    }
}

fn header_of(set: &Matched<Box<FrameSlot>>, id: u64) -> Option<SetHeader> {
    let members = || set.frames.iter().flatten();
    Some(SetHeader {
        id,
        n_members: members().count(),
        newest_stamp: members().map(|frame| frame.stamp).max()?,
        newest_arrival: members().map(|frame| frame.item.arrival).max()?,
        skew: Duration::from_nanos(set.skew_ns),
    })
}

impl Stage for SyncStage {
    fn register(&mut self) {
        self.shared.wakers.sync.register();
    }

    fn pulse(&self) -> &Pulse {
        &self.shared.pulses.sync
    }

    fn step(&mut self) -> bool {
        let _span = tracing::trace_span!("sync").entered();
        let fetched = self.fetch();
        self.form();
        self.dispatch() || fetched
    }
}
