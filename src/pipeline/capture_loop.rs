//! One camera's thread: opens the device, pulls frames, reopens what went away, resets what opening does not help. A dead camera is a
//! state, never the end.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use crate::capture::{CaptureError, FrameSource, RgbdFrame};
use crate::geometry::Camera;

use super::CameraSlot;
use super::buffers::FrameSlot;
use super::event::CameraState;
use super::recovery::{Ladder, Loss, RecoveryOptions, Step};
use super::shared::Shared;

/// Longest wait inside a source: short, so that a stop is noticed even while a camera stalls.
pub const FRAME_TIMEOUT: Duration = Duration::from_millis(100);
/// First and longest pause before a device is looked for again.
const BACKOFF: (Duration, Duration) = (Duration::from_millis(100), Duration::from_secs(2));
/// So many errors in a row without a frame are a failed camera: it is closed and opened again.
const MAX_ERRORS_IN_A_ROW: u32 = 10;
/// Between two warnings of bad frames of one camera.
const QUIET: Duration = Duration::from_secs(10);
const WRONG_SIZE: &str = "its frames do not have the size it promised";

/// The capture thread of one camera.
pub(super) struct CaptureLoop {
    pub(super) shared: Arc<Shared>,
    pub(super) slot: CameraSlot,
    pub(super) camera: usize,
    pub(super) reopen_after: Duration,
    pub(super) recovery: RecoveryOptions,
    pub(super) bad_frames: BadFrames,
}

/// Why a stream of frames ended.
enum StreamEnd {
    /// The pipeline stops.
    Stopped,
    /// There will be no more frames.
    Ended,
    /// Open it again.
    Lost { loss: Loss, state: CameraState, detail: String },
}

impl CaptureLoop {
    /// Runs until the pipeline stops or the recording ends.
    pub(super) fn run(mut self) {
        self.open_again_and_again();
        self.shared.pulses.cameras[self.camera].end();
    }

    fn open_again_and_again(&mut self) {
        let mut pause = BACKOFF.0;
        // A camera that has never been there changes no state, but a wrong serial number should not go unsaid.
        let mut was_told = false;
        let mut ladder = Ladder::default();
        while !self.shared.is_stopping() {
            self.shared.pulses.cameras[self.camera].turn();
            let frames_before = self.frames();
            let lost = match self.open_and_stream() {
                StreamEnd::Stopped => return,
                StreamEnd::Ended => {
                    self.shared.change_camera(self.camera, CameraState::Ended, "");
                    return;
                }
                StreamEnd::Lost { loss, state, detail } => {
                    if state == CameraState::Waiting && !was_told {
                        tracing::warn!(camera = self.slot.name, "camera is waited for: {detail}");
                        was_told = true;
                    }
                    self.shared.change_camera(self.camera, state, &detail);
                    loss
                }
            };
            let worked = self.frames() > frames_before;
            if ladder.on_lost(lost, worked, &self.recovery) == Step::Reset && self.reset() {
                ladder.on_reset();
            }
            pause = if worked { BACKOFF.0 } else { (pause * 2).min(BACKOFF.1) };
            self.rest(pause);
        }
    }

    /// Resets the device when it is its turn; whether it begins anew now.
    fn reset(&self) -> bool {
        let CameraSlot { factory, serial, name } = &self.slot;
        if !self.shared.resets.take(self.shared.since_start(), self.recovery.reset_interval) {
            return false;
        }
        match factory.reset(serial) {
            Ok(true) => {
                tracing::warn!(camera = name, "camera was reset, since opening it again did not help")
            }
            Ok(false) => tracing::debug!(camera = name, "this back end cannot reset a camera"),
            // It has gone meanwhile: the turn is another's.
            Err(CaptureError::NotFound { .. }) => self.shared.resets.give_back(),
            Err(error) => tracing::warn!(camera = name, "camera cannot be reset: {error}"),
        }
        true
    }

    fn frames(&self) -> u64 {
        self.shared.cameras[self.camera].frames.get()
    }

    fn open_and_stream(&mut self) -> StreamEnd {
        match self.slot.factory.open(&self.slot.serial) {
            Ok(mut source) => self.stream(source.as_mut()),
            Err(CaptureError::EndOfStream) => StreamEnd::Ended,
            Err(error) => {
                let (loss, state) = self.without(&error);
                StreamEnd::Lost { loss, state, detail: error.to_string() }
            }
        }
    }

    /// A camera that did not open: one that was there before stays "unplugged".
    fn without(&self, error: &CaptureError) -> (Loss, CameraState) {
        match (error, self.shared.cameras[self.camera].state()) {
            (CaptureError::NotFound { .. }, CameraState::Waiting) => (Loss::Away, CameraState::Waiting),
            (CaptureError::NotFound { .. } | CaptureError::Unplugged(_), _) => {
                (Loss::Away, CameraState::Unplugged)
            }
            (CaptureError::Refused { .. }, _) => (Loss::Refused, CameraState::Failed),
            _ => (Loss::Failed, CameraState::Failed),
        }
    }

    fn stream(&mut self, source: &mut dyn FrameSource) -> StreamEnd {
        let intrinsics = source.info().camera;
        self.size_buffers(&intrinsics);
        self.shared.cameras[self.camera].set_firmware(source.info().firmware.clone());
        self.shared.cameras[self.camera].note_frame(self.shared.since_start());
        self.shared.change_camera(self.camera, CameraState::Opened, "");
        let mut stream = Stream { shared: &self.shared, camera: self.camera, intrinsics, sequence: None };
        let mut errors_in_a_row = 0;
        let mut last_frame = Instant::now();
        let mut spare = None;
        while !self.shared.is_stopping() {
            self.shared.pulses.cameras[self.camera].turn();
            let Some(mut slot) = spare.take().or_else(|| stream.free_slot()) else {
                thread::park_timeout(Duration::from_millis(1));
                continue;
            };
            let answer = source.next_frame(&mut slot.frame, FRAME_TIMEOUT);
            match answer {
                Ok(()) if slot.frame.is_of(&intrinsics) => {
                    (errors_in_a_row, last_frame) = (0, Instant::now());
                    stream.hand_over(slot);
                    continue;
                }
                Err(CaptureError::Timeout(_)) if last_frame.elapsed() > self.reopen_after => {
                    return stream.end(slot, CameraState::Stalled, "reopening it");
                }
                Err(CaptureError::Timeout(_)) => {}
                Err(CaptureError::EndOfStream) => {
                    self.shared.queues.recycle_frame(slot);
                    return StreamEnd::Ended;
                }
                Err(error @ (CaptureError::Unplugged(_) | CaptureError::NotFound { .. })) => {
                    return stream.end(slot, CameraState::Unplugged, &error.to_string());
                }
                bad => {
                    self.shared.counters.bad_frames.add_one();
                    self.shared.cameras[self.camera].health.bad.add_one();
                    errors_in_a_row += 1;
                    let what = bad.map_or_else(|error| error.to_string(), |()| WRONG_SIZE.to_owned());
                    self.bad_frames.tell(&self.slot.name, &what);
                    if errors_in_a_row >= MAX_ERRORS_IN_A_ROW {
                        return stream.end(slot, CameraState::Failed, &what);
                    }
                }
            }
            spare = Some(slot);
        }
        StreamEnd::Stopped
    }

    /// Gives every free buffer the size of this camera's frames, so that the stream itself allocates nothing.
    fn size_buffers(&self, intrinsics: &Camera) {
        let n_pixels = intrinsics.width_px() as usize * intrinsics.height_px() as usize;
        let pool = &self.shared.queues.frame_pools[self.camera];
        for _ in 0..pool.len() {
            let Some(mut slot) = pool.pop() else { return };
            let RgbdFrame { rgb, depth, .. } = &mut slot.frame;
            rgb.reserve_exact((3 * n_pixels).saturating_sub(rgb.len()));
            depth.reserve_exact(n_pixels.saturating_sub(depth.len()));
            self.shared.queues.recycle_frame(slot);
        }
    }

    /// Sleeps, but not through a stop, and not without a sign of life: a camera that is away is no thread that hangs.
    fn rest(&self, pause: Duration) {
        let until = Instant::now() + pause;
        while !self.shared.is_stopping() {
            self.shared.pulses.cameras[self.camera].turn();
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return;
            }
            thread::park_timeout(left.min(FRAME_TIMEOUT));
        }
    }
}

/// Tells of bad frames of a camera: at once, then now and then with their number.
#[derive(Debug, Default)]
pub(super) struct BadFrames {
    told: Option<Instant>,
    count: u64,
}

impl BadFrames {
    fn tell(&mut self, camera: &str, what: &str) {
        self.count += 1;
        if self.told.is_none_or(|told| told.elapsed() >= QUIET) {
            self.told = Some(Instant::now());
            tracing::warn!(
                camera,
                count = std::mem::take(&mut self.count),
                "bad frame, which is left out: {what}"
            );
        }
    }
}

/// An open camera on the frame path.
struct Stream<'a> {
    shared: &'a Shared,
    camera: usize,
    intrinsics: Camera,
    sequence: Option<u64>,
}

impl Stream<'_> {
    /// A buffer to fill; when all are on their way, the oldest that sync has not fetched is taken back and counted.
    fn free_slot(&self) -> Option<Box<FrameSlot>> {
        let queues = &self.shared.queues;
        queues.frame_pools[self.camera].pop().or_else(|| {
            let oldest = queues.frames[self.camera].pop()?;
            self.count_drop();
            Some(oldest)
        })
    }

    fn hand_over(&mut self, mut slot: Box<FrameSlot>) {
        let (shared, camera) = (self.shared, self.camera);
        slot.arrival = Instant::now();
        slot.intrinsics = Some(self.intrinsics);
        let sequence = slot.frame.sequence;
        let expected = self.sequence.map_or(sequence, |last| last.saturating_add(1));
        shared.cameras[camera].health.lost.add(sequence.saturating_sub(expected));
        self.sequence = Some(sequence);
        shared.counters.frames.add_one();
        shared.cameras[camera].frames.add_one();
        shared.cameras[camera].note_frame(slot.arrival.duration_since(shared.started));
        if let Some(share) = shared.cameras[camera].health.note(&slot.frame) {
            let (camera, percent) = (&shared.cameras[camera].name, (100.0 * share).round());
            tracing::warn!(
                camera,
                percent,
                "depth image is all but empty: uncover both imagers, switch the emitter on, or unplug the camera for a moment"
            );
        }
        shared.change_camera(camera, CameraState::Streaming, "");
        if let Some(evicted) = shared.queues.frames[camera].force_push(slot) {
            self.count_drop();
            shared.queues.recycle_frame(evicted);
        }
        shared.wakers.sync.wake();
    }

    fn count_drop(&self) {
        self.shared.counters.dropped_frames.add_one();
        self.shared.cameras[self.camera].dropped.add_one();
    }

    fn end(&self, slot: Box<FrameSlot>, state: CameraState, detail: &str) -> StreamEnd {
        self.shared.queues.recycle_frame(slot);
        let loss = if state == CameraState::Unplugged { Loss::Away } else { Loss::Failed };
        StreamEnd::Lost { loss, state, detail: detail.to_owned() }
    }
}
