//! Stand-ins for the line stage and the estimator.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use pelical::capture::RgbdFrame;
use pelical::geometry::{Camera, CameraView, PairScores};
use pelical::pipeline::{Estimator, FindTimes, FoundLines, LineFinder};
use pelical::solver::{RigCalibration, State};

/// Finds nothing, slowly.
pub struct SlowFinder(pub Duration);

impl LineFinder for SlowFinder {
    fn find(&mut self, _: &RgbdFrame, _: &Camera, _: &mut FoundLines) -> FindTimes {
        std::thread::sleep(self.0);
        FindTimes::default()
    }
}

/// Has a bug.
pub struct BrokenFinder;

impl LineFinder for BrokenFinder {
    fn find(&mut self, _: &RgbdFrame, _: &Camera, _: &mut FoundLines) -> FindTimes {
        panic!("this finder is broken on purpose")
    }
}

/// A calibration of no cameras.
pub fn calibration(state: State, frame_sets_used: usize) -> RigCalibration {
    RigCalibration {
        state,
        reason: None,
        reference: 0,
        cameras: Vec::new(),
        pairs: Vec::new(),
        frame_sets_used,
    }
}

/// Takes every set for new and converges after some.
pub struct CountingEstimator {
    sets: u64,
    converging_at: u64,
}

impl CountingEstimator {
    pub fn converging_at(sets: u64) -> Self {
        Self { sets: 0, converging_at: sets }
    }
}

impl Estimator for CountingEstimator {
    fn add(&mut self, views: &[Option<CameraView>], _: &mut dyn FnMut() -> Vec<PairScores>) -> bool {
        assert!(views.iter().flatten().count() >= 2, "a set has at least two views");
        self.sets += 1;
        true
    }

    fn solve_while(&self, _: &dyn Fn() -> bool) -> Option<RigCalibration> {
        let state = if self.sets >= self.converging_at { State::Converged } else { State::Collecting };
        Some(calibration(state, self.sets as usize))
    }
}

/// Holds a solution back until the test opens it.
#[derive(Debug, Default)]
pub struct Gate {
    pub is_solving: AtomicBool,
    pub is_open: AtomicBool,
}

/// Solves for as long as its gate is shut.
pub struct BlockingEstimator(pub Arc<Gate>);

impl Estimator for BlockingEstimator {
    fn add(&mut self, _: &[Option<CameraView>], _: &mut dyn FnMut() -> Vec<PairScores>) -> bool {
        true
    }

    fn solve_while(&self, _: &dyn Fn() -> bool) -> Option<RigCalibration> {
        self.0.is_solving.store(true, Ordering::SeqCst);
        while !self.0.is_open.load(Ordering::SeqCst) {
            std::thread::sleep(Duration::from_millis(1));
        }
        Some(calibration(State::Converged, 1))
    }
}
