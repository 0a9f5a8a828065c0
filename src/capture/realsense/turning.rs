//! From samples of a gyroscope to the turn rate between two frames.

use std::collections::VecDeque;

use crate::capture::frame::TurnRate;

/// Samples that wait for the frame behind them: 2 s at the fastest rate of the D400 family.
const MAX_WAITING: usize = 800;

/// Samples of one camera that no frame has taken yet.
#[derive(Debug, Clone)]
pub struct Turning {
    /// Stamp, ns, and norm, rad/s; oldest first.
    waiting: VecDeque<(i64, f64)>,
}

impl Default for Turning {
    fn default() -> Self {
        Self { waiting: VecDeque::with_capacity(MAX_WAITING) }
    }
}

impl Turning {
    /// Takes a sample, rad/s; one that is no number is left out.
    pub fn add(&mut self, stamp_ns: i64, rad_per_s: [f32; 3]) {
        let norm = rad_per_s.iter().map(|&value| f64::from(value).powi(2)).sum::<f64>().sqrt();
        if !norm.is_finite() {
            return;
        }
        if self.waiting.len() >= MAX_WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back((stamp_ns, norm));
    }

    /// Whether the samples reach up to this stamp.
    pub fn reaches(&self, stamp_ns: i64) -> bool {
        self.waiting.back().is_some_and(|&(newest_ns, _)| newest_ns >= stamp_ns)
    }

    /// What the samples up to a frame's stamp say, which are forgotten with it; `None` where there is none.
    pub fn until(&mut self, frame_ns: i64) -> Option<TurnRate> {
        let n_before = self.waiting.iter().take_while(|(stamp_ns, _)| *stamp_ns <= frame_ns).count();
        let norms = self.waiting.drain(..n_before).map(|(_, norm)| norm);
        norms.reduce(f64::max).map(|max_rad_per_s| TurnRate { max_rad_per_s })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sample_counts_for_the_first_frame_behind_it() {
        let mut turning = Turning::default();
        for (stamp_ns, rate) in [(10, 0.1), (20, 0.5), (30, 0.2), (40, 0.3), (50, 0.1)] {
            turning.add(stamp_ns, [0.0, rate, 0.0]);
        }
        assert!(turning.reaches(50) && !turning.reaches(51));
        let rate =
            |turning: &mut Turning, frame_ns| turning.until(frame_ns).map(|rate| rate.max_rad_per_s as f32);
        assert_eq!(rate(&mut turning, 30), Some(0.5));
        assert_eq!(rate(&mut turning, 45), Some(0.3));
        assert_eq!(rate(&mut turning, 46), None, "nothing was said meanwhile");
        assert_eq!(rate(&mut turning, 60), Some(0.1));
    }

    #[test]
    fn the_norm_counts_and_nonsense_does_not() {
        let mut turning = Turning::default();
        turning.add(1, [3.0, 0.0, -4.0]);
        turning.add(2, [f32::NAN, 0.0, 0.0]);
        assert_eq!(turning.until(5), Some(TurnRate { max_rad_per_s: 5.0 }));
    }

    #[test]
    fn samples_that_no_frame_takes_are_given_up_at_a_bound() {
        let mut turning = Turning::default();
        (0..2000).for_each(|number| turning.add(number, [1.0, 0.0, 0.0]));
        assert_eq!(turning.waiting.len(), MAX_WAITING);
    }
}
