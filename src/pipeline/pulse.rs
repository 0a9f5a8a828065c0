//! Whether every thread of the pipeline moves: each counts its turns, and the turns in which it did some work. Who looks twice sees
//! which thread hangs, and whether work waits that nobody does. Atomics only: the frame path counts here.

use std::sync::atomic::{AtomicBool, Ordering};

use super::stats::Counter;

/// The turns of one thread.
#[derive(Debug, Default)]
pub(super) struct Pulse {
    turns: Counter,
    worked: Counter,
    // Relaxed: the end of a thread hands nothing over here.
    has_ended: AtomicBool,
}

impl Pulse {
    /// Once more around the thread's loop, or, in a long computation, one step further.
    pub(super) fn turn(&self) {
        self.turns.add_one();
    }

    /// There was something to do in this turn, and it is done.
    pub(super) fn worked(&self) {
        self.worked.add_one();
    }

    /// The thread has nothing to do any more, for good.
    pub(super) fn end(&self) {
        self.has_ended.store(true, Ordering::Relaxed);
    }
}

/// The pulses of all threads.
#[derive(Debug)]
pub(super) struct Pulses {
    pub(super) cameras: Vec<Pulse>,
    pub(super) sync: Pulse,
    pub(super) lines: Vec<Pulse>,
    pub(super) publish: Pulse,
    pub(super) estimate: Pulse,
}

impl Pulses {
    pub(super) fn new(n_cameras: usize, n_line_threads: usize) -> Self {
        let pulses = |n: usize| (0..n).map(|_| Pulse::default()).collect();
        Self {
            cameras: pulses(n_cameras),
            sync: Pulse::default(),
            lines: pulses(n_line_threads),
            publish: Pulse::default(),
            estimate: Pulse::default(),
        }
    }

    /// What they have counted, with the threads' names.
    pub(super) fn vitals(&self, camera_name: impl Fn(usize) -> String, sets_in_flight: usize) -> Vitals {
        let thread = |name: String, pulse: &Pulse| ThreadVitals {
            name,
            turns: pulse.turns.get(),
            has_ended: pulse.has_ended.load(Ordering::Relaxed),
        };
        let cameras = self.cameras.iter().enumerate();
        let cameras = cameras.map(|(index, pulse)| thread(format!("cap-{}", camera_name(index)), pulse));
        let lines = self.lines.iter().enumerate();
        let lines = lines.map(|(index, pulse)| thread(format!("lines-{index}"), pulse));
        let single = [("sync", &self.sync), ("publish", &self.publish), ("estimate", &self.estimate)];
        let single = single.into_iter().map(|(name, pulse)| thread(name.to_owned(), pulse));
        let done = self.lines.iter().chain([&self.publish]).map(|pulse| pulse.worked.get()).sum();
        Vitals {
            threads: cameras.chain(lines).chain(single).collect(),
            sets_in_flight,
            line_stage_done: done,
        }
    }
}

/// Signs of life at one moment.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Vitals {
    /// Every thread of the pipeline.
    pub threads: Vec<ThreadVitals>,
    /// Frame sets between sync and publish.
    pub sets_in_flight: usize,
    /// Frames and sets that the line stage and publish have done so far.
    pub line_stage_done: u64,
}

/// One thread's signs of life.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ThreadVitals {
    /// Its name, as in the log.
    pub name: String,
    /// Turns of its loop so far.
    pub turns: u64,
    /// Whether it has ended because there is nothing to do any more.
    pub has_ended: bool,
}

impl Vitals {
    /// Who has not moved since `before`, although it should have; none when all is well. A thread that waits for frames turns
    /// all the same: cameras that are not there are a state, not a hang.
    pub fn hanging_since(&self, before: &Vitals) -> Vec<String> {
        let stands = |(now, then): (&ThreadVitals, &ThreadVitals)| {
            (!now.has_ended && now.turns == then.turns).then(|| now.name.clone())
        };
        let mut hanging: Vec<String> = self.threads.iter().zip(&before.threads).filter_map(stands).collect();
        let has_waited = before.sets_in_flight > 0 && self.sets_in_flight > 0;
        if hanging.is_empty() && has_waited && self.line_stage_done == before.line_stage_done {
            hanging.push("the line stage, with work waiting".to_owned());
        }
        hanging
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(pulses: &Pulses) -> Vitals {
        let all = pulses.cameras.iter().chain(&pulses.lines);
        all.chain([&pulses.sync, &pulses.publish, &pulses.estimate]).for_each(Pulse::turn);
        vitals(pulses, 0)
    }

    fn vitals(pulses: &Pulses, sets_in_flight: usize) -> Vitals {
        pulses.vitals(|index| index.to_string(), sets_in_flight)
    }

    #[test]
    fn who_does_not_turn_is_named_and_who_has_ended_is_not() {
        let pulses = Pulses::new(2, 1);
        let before = vitals(&pulses, 0);
        assert_eq!(moved(&pulses).hanging_since(&before), [""; 0]);
        let before = vitals(&pulses, 0);
        for pulse in [&pulses.cameras[0], &pulses.lines[0], &pulses.sync, &pulses.publish] {
            pulse.turn();
        }
        assert_eq!(vitals(&pulses, 0).hanging_since(&before), ["cap-1", "estimate"]);
        pulses.cameras[1].end();
        assert_eq!(vitals(&pulses, 0).hanging_since(&before), ["estimate"]);
    }

    #[test]
    fn turning_is_not_enough_while_work_waits_in_the_line_stage() {
        let pulses = Pulses::new(1, 1);
        let idle = vitals(&pulses, 0);
        let before = Vitals { sets_in_flight: 1, ..moved(&pulses) };
        let after = Vitals { sets_in_flight: 1, ..moved(&pulses) };
        assert_eq!(after.hanging_since(&before).len(), 1);
        assert_eq!(after.hanging_since(&idle), [""; 0], "the set has only just come");
        pulses.lines[0].worked();
        let after = Vitals { sets_in_flight: 1, ..moved(&pulses) };
        assert_eq!(after.hanging_since(&before), [""; 0], "one frame further");
    }
}
