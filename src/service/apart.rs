//! Tells in the log when frames of some cameras meet no others, and when they do again.

use std::time::Duration;

use crate::pipeline::Snapshot;
use crate::pipeline::apart::Skews;
use crate::solver::{Reason, RigCalibration};

/// What is remembered of it.
#[derive(Debug)]
pub struct ApartTeller {
    max_skew: Duration,
    is_told: bool,
}

impl ApartTeller {
    /// Nothing is told yet.
    pub fn new(max_skew: Duration) -> Self {
        Self { max_skew, is_told: false }
    }

    /// Looks at the pipeline; why frames of two cameras meet no others, if they do not.
    pub fn look(&mut self, pipeline: &Snapshot) -> Option<Reason> {
        let names = names(pipeline);
        let reason = self.skews(pipeline, &names).reason();
        match (&reason, self.is_told) {
            (Some(reason), false) => tracing::warn!("no common frame sets: {}", reason.sentence),
            (None, true) => tracing::info!("frames of all cameras meet in frame sets"),
            _ => {}
        }
        self.is_told = reason.is_some();
        reason
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
