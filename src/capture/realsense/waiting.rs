//! Samples of an inertial sensor that wait for the frame behind them.

use std::collections::VecDeque;

/// Samples that wait at most: 2 s at the fastest rate of the D400 family.
pub const MAX_WAITING: usize = 800;

/// Samples of one sensor that no frame has taken yet; allocates when it is made and then never.
#[derive(Debug, Clone)]
pub struct Waiting<T> {
    /// With stamps, ns; oldest first.
    samples: VecDeque<(i64, T)>,
}

impl<T> Default for Waiting<T> {
    fn default() -> Self {
        Self { samples: VecDeque::with_capacity(MAX_WAITING) }
    }
}

impl<T> Waiting<T> {
    /// Takes a sample; where too many wait, the oldest is given up.
    pub fn add(&mut self, stamp_ns: i64, sample: T) {
        if self.samples.len() >= MAX_WAITING {
            self.samples.pop_front();
        }
        self.samples.push_back((stamp_ns, sample));
    }

    /// Whether the samples reach up to this stamp.
    pub fn reaches(&self, stamp_ns: i64) -> bool {
        self.samples.back().is_some_and(|&(newest_ns, _)| newest_ns >= stamp_ns)
    }

    /// The samples up to a frame's stamp, which are forgotten with it.
    pub fn until(&mut self, frame_ns: i64) -> impl Iterator<Item = T> {
        let n_before = self.samples.iter().take_while(|(stamp_ns, _)| *stamp_ns <= frame_ns).count();
        self.samples.drain(..n_before).map(|(_, sample)| sample)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_sample_counts_for_the_first_frame_behind_it() {
        let mut waiting = Waiting::default();
        for (stamp_ns, sample) in [(10, 'a'), (20, 'b'), (30, 'c'), (40, 'd'), (50, 'e')] {
            waiting.add(stamp_ns, sample);
        }
        assert!(waiting.reaches(50) && !waiting.reaches(51));
        for (frame_ns, expected) in [(30, "abc"), (45, "d"), (46, ""), (60, "e")] {
            assert_eq!(waiting.until(frame_ns).collect::<String>(), expected, "at {frame_ns}");
        }
    }

    #[test]
    fn samples_that_no_frame_takes_are_given_up_at_a_bound() {
        let mut waiting = Waiting::default();
        (0..2000).for_each(|number| waiting.add(number, number));
        assert!(waiting.until(2000).eq(2000 - MAX_WAITING as i64..2000));
    }
}
