//! The alarm for frames that are old when they arrive: somewhere below a queue fills up, and what is seen is long past.

use std::time::{Duration, Instant};

/// Between two alarms of one camera.
const QUIET: Duration = Duration::from_secs(10);

/// Watches the age of one camera's frames.
#[derive(Debug)]
pub struct AgeAlarm {
    limit_ns: i64,
    told: Option<Instant>,
    n_late: u64,
}

/// What is to be told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LateFrames {
    /// Late frames since the last alarm.
    pub n_late: u64,
    /// Age of the last one.
    pub age: Duration,
}

impl AgeAlarm {
    /// Frames older than this are late.
    pub fn new(limit: Duration) -> Self {
        Self { limit_ns: i64::try_from(limit.as_nanos()).unwrap_or(i64::MAX), told: None, n_late: 0 }
    }

    /// Takes the stamp and arrival of a frame on one clock; says what is to be told, if anything.
    pub fn on_frame(&mut self, stamp_ns: i64, arrival_ns: i64, now: Instant) -> Option<LateFrames> {
        let age_ns = arrival_ns.saturating_sub(stamp_ns);
        if age_ns <= self.limit_ns {
            return None;
        }
        self.n_late += 1;
        if self.told.is_some_and(|told| now.duration_since(told) < QUIET) {
            return None;
        }
        self.told = Some(now);
        let n_late = std::mem::take(&mut self.n_late);
        Some(LateFrames { n_late, age: Duration::from_nanos(age_ns.unsigned_abs()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn late_frames_are_told_at_once_then_counted_and_told_again_later() {
        let mut alarm = AgeAlarm::new(Duration::from_millis(300));
        let start = Instant::now();
        assert_eq!(alarm.on_frame(0, 299_000_000, start), None);
        let told = |n_late| Some(LateFrames { n_late, age: Duration::from_secs(2) });
        assert_eq!(alarm.on_frame(0, 2_000_000_000, start), told(1));
        for _ in 0..5 {
            assert_eq!(alarm.on_frame(0, 2_000_000_000, start + Duration::from_secs(1)), None);
        }
        assert_eq!(alarm.on_frame(0, 2_000_000_000, start + QUIET), told(6));
    }

    #[test]
    fn frames_from_the_future_are_not_late() {
        let mut alarm = AgeAlarm::new(Duration::from_millis(300));
        assert_eq!(alarm.on_frame(i64::MAX, i64::MIN, Instant::now()), None);
    }
}
