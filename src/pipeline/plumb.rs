//! Which way is up for a camera: its specific force over about a second of frames in which nothing shook or turned it. Written by the capture
//! thread, read by whoever asks.

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};

use nalgebra::Vector3;

use crate::capture::frame::SpecificForce;
use crate::capture::{RgbdFrame, StampNs};

/// Time constant of the low-pass, s.
const TIME_CONSTANT_S: f64 = 1.0;
/// Share of gravity by which a frame's specific force may be longer or shorter than it: more is a rig that is pushed, not held.
const MAX_NORM_GAP: f64 = 0.05;
/// A camera that turns faster than this has another up in each frame, and cameras that lost frames have not the same ones, rad/s (6 deg/s).
const MAX_TURN_RAD_PER_S: f64 = 0.1;
/// After so long without a frame that counts, nobody knows how the camera is held, s.
const FORGET_AFTER_S: f64 = 3.0;
/// Stamp of a camera that never felt anything.
const NEVER_NS: i64 = i64::MIN;

/// Up of one camera. A reader may get a vector of which a part is one frame older: a low-pass moves little in a frame.
#[derive(Debug)]
pub(super) struct PlumbCell {
    /// Bits of the low-passed specific force, m/s². Relaxed: `last_ns` hands it over.
    mean: [AtomicU64; 3],
    /// Stamp of the newest frame that counted.
    last_ns: AtomicI64,
}

impl Default for PlumbCell {
    fn default() -> Self {
        Self { mean: [const { AtomicU64::new(0) }; 3], last_ns: AtomicI64::new(NEVER_NS) }
    }
}

impl PlumbCell {
    /// Takes note of a frame.
    pub(super) fn note(&self, frame: &RgbdFrame) {
        let StampNs(stamp_ns) = frame.stamp;
        if frame.turn_rate.is_some_and(|rate| rate.max_rad_per_s > MAX_TURN_RAD_PER_S) {
            self.last_ns.store(NEVER_NS, Ordering::Release);
            return;
        }
        let felt = frame.specific_force.map(|force| force.mean_m_per_s2).filter(is_rest);
        let since_s = self.mean().map(|(mean, last_ns)| (mean, seconds_between(last_ns, stamp_ns)));
        match (felt, since_s) {
            (Some(felt), Some((mean, since_s))) if (0.0..FORGET_AFTER_S).contains(&since_s) => {
                let share = 1.0 - (-since_s / TIME_CONSTANT_S).exp();
                self.set(&(mean + share * (felt - mean)), stamp_ns);
            }
            // The first, or after a time that the mean of before says nothing about, as when the camera's clock began again.
            (Some(felt), _) => self.set(&felt, stamp_ns),
            (None, Some((_, since_s))) if !(0.0..FORGET_AFTER_S).contains(&since_s) => {
                self.last_ns.store(NEVER_NS, Ordering::Release);
            }
            (None, _) => {}
        }
    }

    /// The low-passed specific force, m/s², in the axes of the colour camera; `None` without an accelerometer, or while the rig
    /// is shaken or turns.
    pub(super) fn read(&self) -> Option<Vector3<f64>> {
        self.mean().map(|(mean, _)| mean)
    }

    fn mean(&self) -> Option<(Vector3<f64>, i64)> {
        let last_ns = self.last_ns.load(Ordering::Acquire);
        let part = |part: &AtomicU64| f64::from_bits(part.load(Ordering::Relaxed));
        let [x, y, z] = self.mean.each_ref().map(part);
        (last_ns != NEVER_NS).then(|| (Vector3::new(x, y, z), last_ns))
    }

    fn set(&self, mean: &Vector3<f64>, stamp_ns: i64) {
        for (part, value) in self.mean.iter().zip(mean.iter()) {
            part.store(value.to_bits(), Ordering::Relaxed);
        }
        self.last_ns.store(stamp_ns, Ordering::Release);
    }
}

fn is_rest(felt: &Vector3<f64>) -> bool {
    (felt.norm() / SpecificForce::AT_REST_M_PER_S2 - 1.0).abs() <= MAX_NORM_GAP
}

fn seconds_between(earlier_ns: i64, later_ns: i64) -> f64 {
    later_ns.saturating_sub(earlier_ns) as f64 * 1e-9
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::TurnRate;

    const FRAME_MS: i64 = 33;

    fn note(cell: &PlumbCell, ms: i64, felt: Option<[f64; 3]>) {
        let specific_force = felt.map(|felt| SpecificForce { mean_m_per_s2: Vector3::from(felt) });
        cell.note(&RgbdFrame { stamp: StampNs(1_000_000 * ms), specific_force, ..RgbdFrame::default() });
    }

    /// Frames of one specific force, up to a moment.
    fn hold(cell: &PlumbCell, (from_ms, to_ms): (i64, i64), felt: [f64; 3]) {
        (from_ms..to_ms).step_by(FRAME_MS as usize).for_each(|ms| note(cell, ms, Some(felt)));
    }

    #[test]
    fn the_mean_follows_a_turn_within_a_second_or_so_whatever_the_rate() {
        for rate_step_ms in [11, 33, 200] {
            let cell = PlumbCell::default();
            note(&cell, 0, Some([0.0, -9.81, 0.0]));
            assert_eq!(cell.read(), Some(Vector3::new(0.0, -9.81, 0.0)), "the first counts at once");
            let turned = [9.81, 0.0, 0.0];
            (1..=2200 / rate_step_ms).for_each(|n| note(&cell, n * rate_step_ms, Some(turned)));
            let share = cell.read().expect("known").x / 9.81;
            assert!((share - (1.0 - (-2.2f64).exp())).abs() < 0.01, "{share} at {rate_step_ms} ms");
        }
    }

    #[test]
    fn a_rig_that_is_pushed_is_left_out_and_what_was_known_stays() {
        let cell = PlumbCell::default();
        hold(&cell, (0, 1000), [0.0, -9.81, 0.0]);
        let before = cell.read();
        for (ms, felt) in [(1010, [0.0, -10.4, 0.0]), (1040, [3.5, -9.81, 0.0]), (1070, [0.0, -9.2, 0.0])] {
            note(&cell, ms, Some(felt));
            note(&cell, ms + 10, None);
        }
        assert_eq!(cell.read(), before);
        note(&cell, 1100, Some([0.0, -9.81 * 1.04, 0.0]));
        assert_ne!(cell.read(), before, "4 % count");
    }

    #[test]
    fn a_turn_makes_it_begin_anew() {
        let cell = PlumbCell::default();
        hold(&cell, (0, 1000), [0.0, -9.81, 0.0]);
        let turning = |ms: i64, max_rad_per_s| RgbdFrame {
            stamp: StampNs(1_000_000 * ms),
            specific_force: Some(SpecificForce { mean_m_per_s2: Vector3::new(9.81, 0.0, 0.0) }),
            turn_rate: Some(TurnRate { max_rad_per_s }),
            ..RgbdFrame::default()
        };
        cell.note(&turning(1010, 0.5));
        assert_eq!(cell.read(), None);
        cell.note(&turning(1040, 0.05));
        assert_eq!(cell.read(), Some(Vector3::new(9.81, 0.0, 0.0)), "nothing of before the turn");
    }

    #[test]
    fn what_was_felt_too_long_ago_is_forgotten_and_a_clock_that_begins_again_begins_anew() {
        let cell = PlumbCell::default();
        note(&cell, 0, None);
        assert_eq!(cell.read(), None, "no accelerometer");
        hold(&cell, (10_000, 11_000), [0.0, -9.81, 0.0]);
        note(&cell, 12_000, None);
        assert!(cell.read().is_some());
        note(&cell, 15_000, None);
        assert_eq!(cell.read(), None);
        hold(&cell, (16_000, 17_000), [0.0, -9.81, 0.0]);
        note(&cell, 5, Some([9.81, 0.0, 0.0]));
        assert_eq!(cell.read(), Some(Vector3::new(9.81, 0.0, 0.0)));
    }
}
