//! Tells in the log when frames of some cameras meet no others, and when they do again.

use std::time::{Duration, Instant};

use crate::pipeline::Snapshot;
use crate::pipeline::apart::Skews;
use crate::solver::{Reason, RigCalibration};

/// What holds for less than this is not told: where cameras lose most of their frames, they meet now and then.
const HOLDS_AFTER: Duration = Duration::from_secs(2);

/// What is remembered of it.
#[derive(Debug)]
pub struct ApartTeller {
    max_skew: Duration,
    is_told: bool,
    /// Since when it is otherwise than told.
    otherwise: Option<Instant>,
}

impl ApartTeller {
    /// Nothing is told yet.
    pub fn new(max_skew: Duration) -> Self {
        Self { max_skew, is_told: false, otherwise: None }
    }

    /// Looks at the pipeline; why frames of two cameras meet no others, if they have not for some time.
    pub fn look(&mut self, pipeline: &Snapshot, now: Instant) -> Option<Reason> {
        let names = names(pipeline);
        let reason = self.skews(pipeline, &names).reason();
        if reason.is_some() == self.is_told {
            self.otherwise = None;
        } else if now.duration_since(*self.otherwise.get_or_insert(now)) >= HOLDS_AFTER {
            self.otherwise = None;
            self.is_told = reason.is_some();
            match &reason {
                Some(reason) => tracing::warn!("no common frame sets: {}", reason.sentence),
                None => tracing::info!("frames of all cameras meet in frame sets"),
            }
        }
        reason.filter(|_| self.is_told)
    }

    /// Tells of every camera without a place that it has none because its frames meet no others.
    pub fn explain(&self, calibration: &mut RigCalibration, pipeline: &Snapshot) {
        self.skews(pipeline, &names(pipeline)).explain(calibration);
    }

    fn skews<'a>(&self, pipeline: &'a Snapshot, names: &'a [String]) -> Skews<'a> {
        Skews { pairs: &pipeline.pair_skews, names, max_skew: self.max_skew }
    }
}

fn names(pipeline: &Snapshot) -> Vec<String> {
    pipeline.cameras.iter().map(|camera| camera.name.clone()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::StampNs;
    use crate::pipeline::skew::SkewBook;
    use crate::pipeline::{CameraSnapshot, CameraState, Counts, FrameHealth, LatencySummaries, Phase};

    const MAX_SKEW: Duration = Duration::from_millis(8);

    fn pipeline(book: &SkewBook) -> Snapshot {
        let camera = |name: &str| CameraSnapshot {
            name: name.to_owned(),
            state: CameraState::Streaming,
            frames: 9,
            dropped: 0,
            last_frame_age: None,
            frame_health: FrameHealth::default(),
            firmware: None,
        };
        Snapshot {
            cameras: ["left", "right"].map(camera).to_vec(),
            phase: Phase::Collecting,
            counts: Counts::default(),
            latencies: LatencySummaries::default(),
            pair_skews: book.pairs(),
        }
    }

    #[test]
    fn who_meets_now_and_then_is_not_told_as_apart_and_who_does_not_is() {
        let (book, start) = (SkewBook::new(2), Instant::now());
        let mut teller = ApartTeller::new(MAX_SKEW);
        let mut is_told = |book: &SkewBook, at_ms: u64| {
            teller.look(&pipeline(book), start + Duration::from_millis(at_ms)).is_some()
        };
        let lose = || (0..5).for_each(|_| book.note_beyond((0, 1), Duration::from_millis(33)));
        let meet = || book.note_set([Some(StampNs(0)); 2].into_iter(), MAX_SKEW);
        for second in 0..10 {
            lose();
            assert!(!is_told(&book, 1000 * second), "after {second} s");
            meet();
            assert!(!is_told(&book, 1000 * second + 500), "after {second} s");
        }
        lose();
        assert_eq!([10_000, 11_900, 12_000].map(|at_ms| is_told(&book, at_ms)), [false, false, true]);
        meet();
        assert_eq!([12_100, 14_000, 14_100].map(|at_ms| is_told(&book, at_ms)), [false, false, false]);
    }
}
