//! From samples of a gyroscope to the turn rate between two frames.

use super::waiting::Waiting;
use crate::capture::frame::TurnRate;

/// Samples of one camera that no frame has taken yet.
#[derive(Debug, Clone, Default)]
pub struct Turning {
    /// Norms, rad/s.
    waiting: Waiting<f64>,
}

impl Turning {
    /// Takes a sample, rad/s; one that is no number is left out.
    pub fn add(&mut self, stamp_ns: i64, rad_per_s: [f32; 3]) {
        let norm = rad_per_s.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>().sqrt();
        if norm.is_finite() {
            self.waiting.add(stamp_ns, norm);
        }
    }

    /// Whether the samples reach up to this stamp.
    pub fn reaches(&self, stamp_ns: i64) -> bool {
        self.waiting.reaches(stamp_ns)
    }

    /// What the samples up to a frame's stamp say, which are forgotten with it; `None` where there is none.
    pub fn until(&mut self, frame_ns: i64) -> Option<TurnRate> {
        self.waiting.until(frame_ns).reduce(f64::max).map(|max_rad_per_s| TurnRate { max_rad_per_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_fastest_sample_up_to_a_frame_is_its_turn_rate() {
        let mut turning = Turning::default();
        for (stamp_ns, rate) in [(10, 0.125), (20, 0.5), (30, 0.25), (40, 0.75)] {
            turning.add(stamp_ns, [0.0, rate, 0.0]);
        }
        assert!(turning.reaches(40) && !turning.reaches(41));
        for (frame_ns, expected) in [(30, Some(0.5)), (31, None), (40, Some(0.75))] {
            assert_eq!(turning.until(frame_ns).map(|rate| rate.max_rad_per_s), expected, "at {frame_ns}");
        }
    }

    #[test]
    fn the_norm_counts_and_nonsense_does_not() {
        let mut turning = Turning::default();
        turning.add(1, [3.0, 0.0, -4.0]);
        turning.add(2, [f32::NAN, 0.0, 0.0]);
        assert_eq!(turning.until(5), Some(TurnRate { max_rad_per_s: 5.0 }));
    }
}
