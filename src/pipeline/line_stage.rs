//! A thread of the line stage: takes the frames of the sets in flight one by one, whichever camera they are from.

use std::sync::Arc;

use super::buffers::LineSlot;
use super::finder::LineFinder;
use super::pulse::Pulse;
use super::shared::Shared;
use super::stage::Stage;

/// Turns frames into lines.
pub(super) struct LineStage {
    pub(super) shared: Arc<Shared>,
    pub(super) finder: Box<dyn LineFinder>,
    pub(super) index: usize,
    /// A line buffer in hand, taken before the frame.
    pub(super) spare: Option<Box<LineSlot>>,
}

impl Stage for LineStage {
    fn register(&mut self) {
        self.shared.wakers.lines[self.index].register();
    }

    fn pulse(&self) -> &Pulse {
        &self.shared.pulses.lines[self.index]
    }

    fn step(&mut self) -> bool {
        let queues = &self.shared.queues;
        let Some(mut lines) = self.spare.take().or_else(|| queues.line_pool.pop()) else { return false };
        let Some(job) = queues.jobs.pop() else {
            self.spare = Some(lines);
            return false;
        };
        let _span = tracing::trace_span!("lines", camera = job.camera).entered();
        if let Some(intrinsics) = &job.intrinsics {
            let times = self.finder.find(&job.frame, intrinsics, &mut lines.found);
            self.shared.latencies.detect.record(times.gray + times.detect);
            self.shared.latencies.lift.record(times.lift + times.describe);
        }
        (lines.camera, lines.intrinsics) = (job.camera, job.intrinsics);
        (lines.stamp, lines.turn_rate, lines.set) = (job.frame.stamp, job.frame.turn_rate, job.set);
        queues.recycle_frame(job);
        // The queue has room for all frames of all sets in flight.
        drop(queues.done.push(lines));
        self.shared.wakers.publish.wake();
        true
    }
}
