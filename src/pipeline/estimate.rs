//! The estimator's thread: collects line sets, solves when enough new evidence has come, then watches whether the result still
//! stands. It may take seconds; nobody waits for it.

use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::capture::StampNs;
use crate::geometry::{Camera, CameraView, PairScores};
use crate::solver::{RigCalibration, RigCamera, RigEstimator, State};

use super::MAX_CAMERAS;
use super::associate::{MatchSource, SeenLines};
use super::buffers::LineSet;
use super::event::{Phase, PipelineEvent, Solved};
use super::options::{PipelineOptions, SolveOptions};
use super::pulse::Pulse;
use super::shared::Shared;
use super::stage::Stage;
use super::watching::Watching;

/// Below every other thread of the pipeline, so that frames are never late because of a solution.
const NICE: i32 = 10;

/// Collects views and solves for the rig; another one can be put into the pipeline, in tests for example.
pub trait Estimator: Send {
    /// Takes one frame set; whether it brought new evidence. `score` is asked only then: it may take long.
    fn add(&mut self, views: &[Option<CameraView>], score: &mut dyn FnMut() -> Vec<PairScores>) -> bool;

    /// The best estimate so far; `None` soon after `keep_going` says no.
    fn solve_while(&self, keep_going: &dyn Fn() -> bool) -> Option<RigCalibration>;
}

impl Estimator for RigEstimator {
    fn add(&mut self, views: &[Option<CameraView>], score: &mut dyn FnMut() -> Vec<PairScores>) -> bool {
        self.add_and_score(views, score)
    }

    fn solve_while(&self, keep_going: &dyn Fn() -> bool) -> Option<RigCalibration> {
        RigEstimator::solve_while(self, keep_going)
    }
}

/// Makes an estimator without evidence for the given cameras.
pub type MakeEstimator = dyn Fn(Vec<RigCamera>) -> Box<dyn Estimator> + Send;

/// Makes what scores candidate matches.
pub type MakeMatchSource = dyn Fn() -> Box<dyn MatchSource> + Send;

/// Collects and solves.
pub(super) struct EstimateStage {
    shared: Arc<Shared>,
    options: SolveOptions,
    /// Sets that an estimator keeps at most.
    max_sets: usize,
    make: Box<MakeEstimator>,
    estimator: Option<Box<dyn Estimator>>,
    make_source: Box<MakeMatchSource>,
    /// `None` before the first set.
    source: Option<Box<dyn MatchSource>>,
    /// Intrinsics as far as they are known: a camera that was never there has none.
    intrinsics: [Option<Camera>; MAX_CAMERAS],
    views: Vec<Option<CameraView>>,
    evidence: Evidence,
    watching: Watching,
    /// A result of an earlier run that is, or will be once its cameras are seen, under watch.
    given: Option<RigCalibration>,
}

/// What was collected in this round.
#[derive(Debug, Default)]
struct Evidence {
    round: u64,
    seen: u64,
    accepted: u64,
    accepted_at_last_solve: u64,
    last_accepted: Option<Instant>,
    newest_stamp: StampNs,
}

impl Evidence {
    /// Whether a solution is worth its time, with an estimator that keeps so many sets at most.
    fn is_worth_solving(&self, options: &SolveOptions, max_sets: usize) -> bool {
        let new = self.accepted - self.accepted_at_last_solve;
        let known = self.accepted_at_last_solve.min(max_sets as u64);
        let has_grown = new as f64 >= options.min_growth * known as f64;
        let quiet = self.last_accepted.map_or(Duration::ZERO, |last| last.elapsed());
        new > 0 && ((new >= u64::from(options.min_new_sets) && has_grown) || quiet >= options.after_quiet)
    }
}

impl EstimateStage {
    pub(super) fn new(
        shared: Arc<Shared>,
        options: &PipelineOptions,
        (make, make_source): (Box<MakeEstimator>, Box<MakeMatchSource>),
    ) -> Self {
        Self {
            views: vec![None; shared.cameras.len()],
            intrinsics: [None; MAX_CAMERAS],
            watching: Watching::new(Arc::clone(&shared), options),
            options: options.solve,
            max_sets: options.estimate.evidence.max_sets,
            estimator: None,
            source: None,
            evidence: Evidence::default(),
            given: None,
            shared,
            make,
            make_source,
        }
    }

    /// Forgets the evidence when a new round of collecting has begun, and what was seen before it.
    fn notice_new_round(&mut self) {
        let round = self.shared.phase.round();
        if self.evidence.round != round {
            self.forget();
            self.evidence.round = round;
            let queues = &self.shared.queues;
            while let Some(set) = queues.sets.pop() {
                queues.recycle_set(set);
            }
        }
    }

    /// Takes over a result of an earlier run.
    fn notice_given(&mut self) {
        let given = self.shared.given.pop();
        // After the queue: its result brings its round with it.
        self.notice_new_round();
        if let Some((calibration, _)) = given.filter(|(_, round)| *round == self.evidence.round) {
            self.given = Some(calibration);
        }
    }

    fn forget(&mut self) {
        self.estimator = None;
        self.given = None;
        self.watching.end();
        self.evidence = Evidence { round: self.evidence.round, ..Evidence::default() };
    }

    /// Takes note of the set's intrinsics. New ones make the evidence so far useless, and a camera's first ones restart the estimator,
    /// because it is made for all cameras at once.
    fn notice_intrinsics(&mut self, set: &LineSet) {
        for slot in set.slots.iter().flatten() {
            if slot.intrinsics.is_some() && self.intrinsics[slot.camera] != slot.intrinsics {
                self.intrinsics[slot.camera] = slot.intrinsics;
                if self.evidence.accepted > 0 {
                    let camera = &self.shared.cameras[slot.camera].name;
                    tracing::info!(camera, "camera is new to the rig: collecting starts over");
                }
                self.forget();
            }
        }
    }

    fn add(&mut self, mut set: Box<LineSet>) {
        let _span = tracing::trace_span!("add", set = set.header.id).entered();
        self.notice_intrinsics(&set);
        // A camera that was never there borrows intrinsics: without views they are not used.
        let n_cameras = self.views.len();
        if self.estimator.is_none()
            && let Some(known) = self.intrinsics.iter().flatten().next()
        {
            let intrinsics = self.intrinsics[..n_cameras].iter().map(|camera| camera.unwrap_or(*known));
            let names = self.shared.cameras.iter().map(|camera| camera.name.clone());
            let cameras = names.zip(intrinsics).map(|(name, camera)| RigCamera { name, camera });
            self.estimator = Some((self.make)(cameras.collect()));
        }
        self.swap_views(&mut set);
        let start = Instant::now();
        let is_new = self.add_views(&set);
        self.shared.latencies.associate.record(start.elapsed());
        self.swap_views(&mut set);
        self.evidence.seen += 1;
        self.evidence.newest_stamp = self.evidence.newest_stamp.max(set.header.newest_stamp);
        if is_new {
            self.evidence.accepted += 1;
            self.evidence.last_accepted = Some(Instant::now());
            self.shared.counters.accepted_sets.add_one();
        } else {
            self.shared.counters.repeated_sets.add_one();
        }
        self.shared.queues.recycle_set(set);
    }

    /// Gives the views to the estimator, and their scores where it asks for them.
    fn add_views(&mut self, set: &LineSet) -> bool {
        let Some(estimator) = &mut self.estimator else { return false };
        let (views, make_source) = (&self.views, &self.make_source);
        let source = self.source.get_or_insert_with(|| make_source());
        let is_wanted = || {
            // Scores take as long as a matcher takes; it asks as it goes on.
            self.shared.pulses.estimate.turn();
            !self.shared.is_stopping() && self.shared.phase.is_collecting(self.evidence.round)
        };
        let mut score = || {
            let slots = views.iter().zip(&set.slots);
            let seen = slots.map(|(view, slot)| Some(SeenLines::new(view.as_ref()?, &slot.as_ref()?.found)));
            let scores = source.score(&seen.collect::<Vec<_>>(), &is_wanted);
            if let Some(complaint) = source.complaint() {
                tracing::warn!("{complaint}");
            }
            scores
        };
        estimator.add(views, &mut score)
    }

    /// Begins to watch a given result, and begins again with every camera that is seen for the first time.
    fn watch_given(&mut self, set: &LineSet) {
        let Some(given) = &self.given else { return };
        let mut is_new = !self.watching.has_begun();
        for slot in set.slots.iter().flatten() {
            is_new |= slot.intrinsics.is_some() && self.intrinsics[slot.camera] != slot.intrinsics;
            self.intrinsics[slot.camera] = slot.intrinsics.or(self.intrinsics[slot.camera]);
        }
        let Some(known) = self.intrinsics.iter().flatten().next().copied().filter(|_| is_new) else { return };
        // A camera that was never there borrows intrinsics, as in `add`.
        let cameras = self.intrinsics[..self.views.len()].iter().map(|camera| camera.unwrap_or(known));
        self.watching.begin(cameras.collect(), given, self.evidence.round);
    }

    /// Compares a set with the result, if there is one.
    fn compare(&mut self, mut set: Box<LineSet>) {
        self.watch_given(&set);
        self.swap_views(&mut set);
        self.watching.compare(&self.views);
        self.swap_views(&mut set);
        self.shared.queues.recycle_set(set);
    }

    /// Moves the views of a set to the form the estimator takes, or back: no view is copied.
    fn swap_views(&mut self, set: &mut LineSet) {
        for (view, slot) in self.views.iter_mut().zip(&mut set.slots) {
            let Some(slot) = slot else { continue };
            match view.take() {
                None => *view = Some(std::mem::take(&mut slot.found.view)),
                Some(moved) => slot.found.view = moved,
            }
        }
    }

    fn solve(&mut self) {
        let Some(estimator) = &self.estimator else { return };
        self.evidence.accepted_at_last_solve = self.evidence.accepted;
        let start = Instant::now();
        // What was cancelled or begun anew meanwhile is not published; a solution that nobody waits for is given up.
        let round = self.evidence.round;
        let is_wanted = || {
            // A solution takes as long as it takes, but it asks as it goes on: that is its pulse.
            self.shared.pulses.estimate.turn();
            !self.shared.is_stopping() && self.shared.phase.is_collecting(round)
        };
        let solved = {
            let _span = tracing::trace_span!("solve").entered();
            estimator.solve_while(&is_wanted)
        };
        let Some(calibration) = solved else { return };
        let took = start.elapsed();
        self.shared.latencies.solve.record(took);
        self.shared.counters.solves.add_one();
        tracing::debug!(state = calibration.state.name(), ms = took.as_millis() as u64, "solved");
        let is_wanted = if calibration.state == State::Converged {
            self.shared.phase.end(Some(round), Phase::Watching)
        } else {
            self.shared.phase.is_collecting(round)
        };
        if is_wanted {
            if calibration.state == State::Converged {
                let known: Option<Vec<Camera>> =
                    self.intrinsics[..self.views.len()].iter().copied().collect();
                if let Some(cameras) = known {
                    self.watching.begin(cameras, &calibration, round);
                }
            }
            let Evidence { newest_stamp, seen: sets_seen, accepted: sets_accepted, .. } = self.evidence;
            let solved = Solved { calibration, newest_stamp, sets_seen, sets_accepted, took, round };
            self.shared.tell_surely(PipelineEvent::Calibration(Box::new(solved)));
        }
    }
}

impl Stage for EstimateStage {
    fn register(&mut self) {
        self.shared.wakers.estimate.register();
        if let Err(error) = rustix::process::setpriority_process(None, NICE) {
            tracing::debug!("the estimator keeps its priority: {error}");
        }
    }

    fn pulse(&self) -> &Pulse {
        &self.shared.pulses.estimate
    }

    fn step(&mut self) -> bool {
        self.notice_given();
        let set = self.shared.queues.sets.pop();
        let had_set = set.is_some();
        let round = self.evidence.round;
        match set {
            Some(set) if self.shared.phase.is_collecting(round) => self.add(set),
            Some(set) => self.compare(set),
            None => {}
        }
        if self.shared.phase.is_collecting(round)
            && self.evidence.is_worth_solving(&self.options, self.max_sets)
        {
            self.solve();
        }
        self.watching.ask_for_set(self.given.is_some());
        had_set
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn once_the_memory_is_full_a_solution_waits_for_no_more_sets_however_long_it_was_collected() {
        let evidence = |new: u64| Evidence {
            accepted: 100_000 + new,
            accepted_at_last_solve: 100_000,
            last_accepted: Some(Instant::now() + Duration::from_secs(60)),
            ..Evidence::default()
        };
        let is_worth = |new: u64| evidence(new).is_worth_solving(&SolveOptions::default(), 80);
        assert!(is_worth(20) && !is_worth(19), "a quarter of 80");
    }
}
