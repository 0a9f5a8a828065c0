//! How a camera that fails is brought back, step by step: opened again, then reset, one camera at a time and seldom. The last step, an
//! end of the process because a thread hangs in a driver, is the owner's: [`HangWatch`] says when.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use super::pulse::Vitals;

/// The steps of recovery.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RecoveryOptions {
    /// A camera that is there but gives no frames is opened again so often before it is reset.
    pub reopens_before_reset: u32,
    /// Least time between two resets of any cameras: a reset takes a bus down for seconds, and never helps twice in a row.
    pub reset_interval: Duration,
    /// A camera whose driver does not come back for so long cannot be recovered in this process; `None`: it is left to itself.
    pub leave_after: Option<Duration>,
}

impl Default for RecoveryOptions {
    fn default() -> Self {
        Self {
            reopens_before_reset: 3,
            // A D435 is back 7 s after a reset, and streams again some seconds later.
            reset_interval: Duration::from_secs(60),
            // Before the watchdog of the unit ends the process without a word.
            leave_after: Some(Duration::from_secs(8)),
        }
    }
}

/// What to do about a camera that was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// Look for it and open it again.
    Reopen,
    /// Reset it first, if nobody else was reset lately.
    Reset,
}

/// How a camera was lost.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// It is not there: it waits for a hand, not for a reset.
    Away,
    /// It is there, but not for us as it is asked for: a reset changes nothing of that, and would disturb who has it.
    Refused,
    /// It is there and fails.
    Failed,
}

/// Where one camera is on the way.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Ladder {
    /// Openings in a row that gave no frame, of a camera that is there.
    failures: u32,
}

impl Ladder {
    /// The camera was lost; `has_delivered` says whether it gave frames since it was opened.
    pub fn on_lost(&mut self, loss: Loss, has_delivered: bool, options: &RecoveryOptions) -> Step {
        if has_delivered || loss == Loss::Away {
            self.failures = 0;
        }
        if loss != Loss::Failed {
            return Step::Reopen;
        }
        self.failures = self.failures.saturating_add(1);
        if self.failures > options.reopens_before_reset { Step::Reset } else { Step::Reopen }
    }

    /// It was reset: the first step comes first again.
    pub fn on_reset(&mut self) {
        self.failures = 0;
    }
}

/// Whose turn it is to be reset: one camera at a time.
#[derive(Debug, Default)]
pub struct ResetTurn {
    /// The next reset may begin then, ns since the start. Relaxed: nothing is handed over.
    free_at_ns: AtomicU64,
}

impl ResetTurn {
    /// Takes the turn for one reset at `now` since the start, if it is free; it is free again after the interval.
    pub fn take(&self, now: Duration, interval: Duration) -> bool {
        let ns = |time: Duration| u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
        let (now_ns, next_ns) = (ns(now), ns(now.saturating_add(interval)));
        let is_free = |free_at_ns| (free_at_ns <= now_ns).then_some(next_ns);
        self.free_at_ns.fetch_update(Ordering::Relaxed, Ordering::Relaxed, is_free).is_ok()
    }

    /// Gives back a turn in which there was nothing to reset.
    pub fn give_back(&self) {
        self.free_at_ns.store(0, Ordering::Relaxed);
    }
}

/// Looks for capture threads that do not come back from a driver.
#[derive(Debug, Default)]
pub struct HangWatch {
    /// How long one may stand still; `None`: for ever.
    limit: Option<Duration>,
    /// Turns of each camera's thread and when they were new.
    seen: Vec<(String, u64, Instant)>,
}

impl HangWatch {
    /// A thread may stand still for so long; `None`: for ever.
    pub fn new(limit: Option<Duration>) -> Self {
        Self { limit, seen: Vec::new() }
    }

    /// The first camera's thread that has not moved for too long.
    pub fn look(&mut self, vitals: &Vitals, now: Instant) -> Option<String> {
        let limit = self.limit?;
        let cameras =
            vitals.threads.iter().filter(|thread| thread.name.starts_with("cap-") && !thread.has_ended);
        let before = std::mem::take(&mut self.seen);
        for thread in cameras {
            let known = before.iter().find(|(name, turns, _)| *name == thread.name && *turns == thread.turns);
            let since = known.map_or(now, |(_, _, since)| *since);
            self.seen.push((thread.name.clone(), thread.turns, since));
        }
        let hangs = |(_, _, since): &&(String, u64, Instant)| now.duration_since(*since) >= limit;
        self.seen.iter().find(hangs).map(|(name, _, _)| name.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::ThreadVitals;

    const OPTIONS: RecoveryOptions = RecoveryOptions {
        reopens_before_reset: 2,
        reset_interval: Duration::from_secs(60),
        leave_after: None,
    };

    #[test]
    fn a_camera_without_frames_is_reopened_then_reset_then_reopened_again() {
        let mut ladder = Ladder::default();
        for _ in 0..3 {
            assert_eq!(ladder.on_lost(Loss::Failed, false, &OPTIONS), Step::Reopen);
            assert_eq!(ladder.on_lost(Loss::Failed, false, &OPTIONS), Step::Reopen);
            assert_eq!(ladder.on_lost(Loss::Failed, false, &OPTIONS), Step::Reset);
            assert_eq!(ladder.on_lost(Loss::Failed, false, &OPTIONS), Step::Reset, "until it was reset");
            ladder.on_reset();
        }
    }

    #[test]
    fn frames_in_between_begin_anew() {
        let mut ladder = Ladder::default();
        for _ in 0..100 {
            assert_eq!(ladder.on_lost(Loss::Failed, true, &OPTIONS), Step::Reopen);
        }
    }

    #[test]
    fn a_camera_that_is_not_there_or_refuses_is_never_reset_however_it_failed_before() {
        for loss in [Loss::Away, Loss::Refused] {
            for n_failures in 0..6 {
                let mut ladder = Ladder::default();
                for _ in 0..n_failures {
                    ladder.on_lost(Loss::Failed, false, &OPTIONS);
                }
                for _ in 0..50 {
                    assert_eq!(ladder.on_lost(loss, false, &OPTIONS), Step::Reopen);
                }
            }
        }
    }

    #[test]
    fn what_was_away_begins_anew() {
        let mut ladder = Ladder::default();
        for _ in 0..10 {
            for loss in [Loss::Failed, Loss::Failed, Loss::Away] {
                assert_eq!(ladder.on_lost(loss, false, &OPTIONS), Step::Reopen);
            }
        }
    }

    #[test]
    fn a_turn_that_was_given_back_is_free_for_the_next() {
        let (turn, interval) = (ResetTurn::default(), Duration::from_secs(60));
        assert!(turn.take(Duration::from_secs(5), interval));
        turn.give_back();
        assert!(turn.take(Duration::from_secs(6), interval));
        assert!(!turn.take(Duration::from_secs(7), interval));
    }

    #[test]
    fn one_reset_at_a_time_and_not_too_often() {
        let (turn, interval) = (ResetTurn::default(), Duration::from_secs(60));
        assert!(turn.take(Duration::from_secs(5), interval));
        assert!(!turn.take(Duration::from_secs(5), interval), "another camera in the same moment");
        assert!(!turn.take(Duration::from_secs(64), interval));
        assert!(turn.take(Duration::from_secs(65), interval));
    }

    #[test]
    fn of_threads_that_begin_at_once_one_takes_the_turn() {
        let turn = ResetTurn::default();
        let take = || turn.take(Duration::from_secs(1), Duration::from_secs(60));
        let taken: usize = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..8).map(|_| scope.spawn(take)).collect();
            threads.into_iter().map(|thread| usize::from(thread.join().expect("no panic"))).sum()
        });
        assert_eq!(taken, 1);
    }

    #[test]
    fn a_camera_thread_that_stands_still_is_named_after_the_limit() {
        let thread =
            |(name, turns): (&str, u64)| ThreadVitals { name: name.to_owned(), turns, has_ended: false };
        let vitals = |left: u64, right: u64| Vitals {
            threads: [("cap-left", left), ("cap-right", right), ("estimate", 1)].map(thread).to_vec(),
            ..Vitals::default()
        };
        let (mut watch, start) = (HangWatch::new(Some(Duration::from_secs(8))), Instant::now());
        let at = |s: u64| start + Duration::from_secs(s);
        assert_eq!(watch.look(&vitals(1, 1), at(0)), None);
        assert_eq!(watch.look(&vitals(2, 1), at(5)), None);
        assert_eq!(watch.look(&vitals(3, 2), at(7)), None, "it came back");
        assert_eq!(watch.look(&vitals(3, 3), at(12)), None);
        assert_eq!(watch.look(&vitals(3, 4), at(15)).as_deref(), Some("cap-left"));
        let mut ended = vitals(3, 5);
        ended.threads[0].has_ended = true;
        assert_eq!(watch.look(&ended, at(99)), None, "a recording that is over");
    }
}
