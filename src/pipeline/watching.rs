//! After a result: at its leisure compares it with a frame set now and then, and tells how it stands.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crate::geometry::{Camera, CameraView};
use crate::solver::{EstimateOptions, RigCalibration, Watch, WatchEffort, WatchLimits, WatchReport};

use super::event::{Phase, PipelineEvent, Watched};
use super::options::PipelineOptions;
use super::shared::Shared;

/// Least time between two comparisons: a camera that was moved stays moved.
const MIN_REST: Duration = Duration::from_millis(200);
/// A comparison is followed by so many times its own duration of rest, and a search over all poses by so many times its own without
/// another: each takes a fifth of one core at most. Comparisons do not rest from a search: what it found is followed up at once.
const REST_RATIO: u32 = 4;

/// Watches over the result of one round.
pub(super) struct Watching {
    shared: Arc<Shared>,
    options: (EstimateOptions, WatchLimits),
    /// The result under watch and its round.
    watch: Option<(Watch, u64)>,
    rest_until: Instant,
    no_search_until: Instant,
    /// What was told last.
    told: WatchReport,
}

impl Watching {
    pub(super) fn new(shared: Arc<Shared>, options: &PipelineOptions) -> Self {
        let start = shared.started;
        let options = (options.estimate, options.watch);
        let told = WatchReport::default();
        Self { shared, options, watch: None, rest_until: start, no_search_until: start, told }
    }

    /// There is a result.
    pub(super) fn begin(&mut self, cameras: Vec<Camera>, result: &RigCalibration, round: u64) {
        let (estimate, limits) = self.options;
        self.watch = Some((Watch::new(cameras, result, estimate, limits), round));
        self.told = WatchReport::default();
    }

    /// Whether there is a result under watch.
    pub(super) fn has_begun(&self) -> bool {
        self.watch.is_some()
    }

    /// The result is no longer of interest.
    pub(super) fn end(&mut self) {
        self.watch = None;
    }

    /// Asks for the next set when there is something to watch over, or will be once its cameras are seen, and the rest is over.
    pub(super) fn ask_for_set(&self, is_awaited: bool) {
        if (is_awaited || self.watch.is_some()) && Instant::now() >= self.rest_until {
            self.shared.wants_watched_set.store(true, Ordering::Relaxed);
        }
    }

    /// Compares the result with one set, and tells what comes out.
    pub(super) fn compare(&mut self, views: &[Option<CameraView>]) {
        let Some((watch, round)) = &mut self.watch else { return };
        let (shared, round) = (&self.shared, *round);
        let is_wanted = || {
            shared.pulses.estimate.turn();
            !shared.is_stopping() && shared.phase.phase() == Phase::Watching && shared.phase.round() == round
        };
        if !is_wanted() {
            return;
        }
        let start = Instant::now();
        let effort = WatchEffort { keep_going: &is_wanted, may_search: start >= self.no_search_until };
        let report = watch.add_within(views, &effort).clone();
        let took = start.elapsed();
        let has_searched = watch.has_searched();
        let (end, rest) = (start + took, REST_RATIO * took);
        self.rest_until = end + if has_searched { MIN_REST } else { MIN_REST.max(rest) };
        if has_searched {
            self.no_search_until = end + rest;
        }
        if !is_wanted() {
            return;
        }
        shared.latencies.watch.record(took);
        let is_news = report.who().ne(self.told.who());
        self.told.clone_from(&report);
        let event = PipelineEvent::Watched(Box::new(Watched { report, round }));
        // The counts are told again with the next set; an alarm must not be lost.
        if is_news { shared.tell_surely(event) } else { shared.tell(event) }
    }
}
