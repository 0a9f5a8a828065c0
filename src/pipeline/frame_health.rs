//! What the frames of a camera say about its health besides their number: lost and damaged ones, how much depth they have, whose
//! clock stamps them. Written by the capture thread, read by whoever asks.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering};

use nalgebra::Vector3;

use super::plumb::PlumbCell;
use super::stats::Counter;
use crate::capture::{RgbdFrame, StampClock};

/// Below this share of readings depth is as good as gone: a blocked imager, a projector that is off, or a fault that only a cold start of the
/// camera ends. A room seen from a metre or more has 60 % and more.
const DEPTH_FLOOR: f64 = 0.05;
/// From here on it is back.
const DEPTH_BACK: f64 = 0.1;
/// Every so many readings one is looked at.
const DEPTH_STEP: usize = 61;
/// Readings are counted in shares of this.
const WHOLE: f64 = 10_000.0;

const CLOCKS: [StampClock; 4] =
    [StampClock::Source, StampClock::Device, StampClock::Translated, StampClock::Host];

/// What the frames of one camera say.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameHealth {
    /// Frames that the camera numbered and that never came.
    pub lost: u64,
    /// Frames that were damaged, or not as large as the camera says.
    pub bad: u64,
    /// Share of the newest frame's depth image that has a reading, 0 to 1; `None` before the first frame.
    pub valid_depth: Option<f64>,
    /// Whose clock stamped the newest frame; `None` before it.
    pub clock: Option<StampClock>,
    /// Which way is up in the axes of the colour camera: its specific force over about a second. `None` where nothing tells it, or while
    /// the rig is shaken.
    pub up_m_per_s2: Option<Vector3<f64>>,
}

/// The same while it is counted. Relaxed throughout: nothing is handed over through a count.
#[derive(Debug, Default)]
pub(super) struct FrameHealthCell {
    pub(super) lost: Counter,
    pub(super) bad: Counter,
    /// One more than the readings in [`WHOLE`].
    valid_depth: AtomicU32,
    is_below_floor: AtomicBool,
    /// One more than the place in [`CLOCKS`].
    clock: AtomicU8,
    plumb: PlumbCell,
}

impl FrameHealthCell {
    /// Takes note of a good frame; the share of depth where it has just fallen below the floor.
    pub(super) fn note(&self, frame: &RgbdFrame) -> Option<f64> {
        let clock = CLOCKS.iter().position(|clock| *clock == frame.timing.clock);
        self.clock.store(clock.map_or(0, |at| at as u8 + 1), Ordering::Relaxed);
        self.plumb.note(frame);
        let share = valid_share(&frame.depth);
        self.valid_depth.store((share * WHOLE).round() as u32 + 1, Ordering::Relaxed);
        let was_below = self.is_below_floor.load(Ordering::Relaxed);
        let is_below = share < if was_below { DEPTH_BACK } else { DEPTH_FLOOR };
        self.is_below_floor.store(is_below, Ordering::Relaxed);
        (is_below && !was_below).then_some(share)
    }

    /// All of it now.
    pub(super) fn read(&self) -> FrameHealth {
        let valid_depth = self.valid_depth.load(Ordering::Relaxed).checked_sub(1);
        let clock = usize::from(self.clock.load(Ordering::Relaxed)).checked_sub(1);
        FrameHealth {
            lost: self.lost.get(),
            bad: self.bad.get(),
            valid_depth: valid_depth.map(|readings| f64::from(readings) / WHOLE),
            clock: clock.and_then(|at| CLOCKS.get(at).copied()),
            up_m_per_s2: self.plumb.read(),
        }
    }
}

/// The share of readings that are there, by samples that fall on all columns.
fn valid_share(depth: &[u16]) -> f64 {
    let n_samples = depth.len().div_ceil(DEPTH_STEP).max(1);
    let n_valid = depth.iter().step_by(DEPTH_STEP).filter(|reading| **reading != 0).count();
    n_valid as f64 / n_samples as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A frame of whose depth so many columns of 640 have readings.
    fn frame(n_columns: usize) -> RgbdFrame {
        let depth = (0..640 * 480).map(|at| if at % 640 < n_columns { 1000 } else { 0 }).collect();
        RgbdFrame { depth, ..RgbdFrame::default() }
    }

    #[test]
    fn the_share_of_depth_is_that_of_the_image_and_unknown_before_a_frame() {
        let cell = FrameHealthCell::default();
        assert_eq!(cell.read(), FrameHealth::default());
        for (n_columns, share) in [(640, 1.0), (320, 0.5), (64, 0.1), (0, 0.0)] {
            cell.note(&frame(n_columns));
            let found = cell.read().valid_depth.expect("a frame came");
            assert!((found - share).abs() < 0.02, "{found} instead of {share}");
        }
        assert_eq!(cell.read().clock, Some(StampClock::Source));
    }

    #[test]
    fn depth_that_goes_is_told_once_until_it_has_come_back() {
        let cell = FrameHealthCell::default();
        let told = [640, 16, 48, 0, 16, 128, 16].map(|n_columns| cell.note(&frame(n_columns)).is_some());
        assert_eq!(told, [false, true, false, false, false, false, true]);
        assert_eq!(FrameHealthCell::default().note(&RgbdFrame::default()), Some(0.0), "no depth at all");
    }
}
