//! After convergence: does the frozen result still explain what the cameras see, and if not, which camera was moved, and by how
//! much?
//!
//! A sliding window of the newest rig views is compared with the frozen poses, pair by pair. Alarm is raised only when another
//! pose passes the tests of a verdict, differs beyond its uncertainty, and is seen again and again; darkness, people, or views without
//! common lines change nothing but the number of frame sets since the result was last confirmed.

mod culprit;
mod pair;
mod shift;

use super::evidence::{Evidence, EvidenceLimits};
use super::result::{RigCalibration, State};
use super::rig::EstimateOptions;
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, CameraView};
use culprit::culprits;
use pair::{Bench, PairWatch, Sight};

/// Rig views that are compared at a time: enough lines for a verdict, few enough to be renewed soon after a camera was moved.
const WINDOW_SETS: usize = 10;
/// A view that was not seen again for so many frame sets no longer counts: it may show the rig as it was before a move.
const MAX_AGE_SETS: u64 = 30;
/// Successive findings of the same move, each with another frame set, that raise the alarm ...
const RAISE_AFTER: u32 = 3;
/// ... and successive confirmations of the frozen result that take it back.
const CLEAR_AFTER: u32 = 3;

/// From when on a camera counts as moved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchLimits {
    /// Least turn beyond its uncertainty, rad.
    pub min_rotation_rad: f64,
    /// Least shift beyond its uncertainty, m.
    pub min_translation_m: f64,
}

impl Default for WatchLimits {
    fn default() -> Self {
        // What a good calibration promises: 0.3 degrees; 5 mm.
        Self { min_rotation_rad: 0.3_f64.to_radians(), min_translation_m: 0.005 }
    }
}

/// What was moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Who {
    /// This camera, against others that agree among themselves.
    Camera(usize),
    /// One of these two against the other; nothing tells which.
    OneOf(usize, usize),
}

/// One move. A camera's is that of its frame as the others see it; of two cameras, that of the second as the first sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moved {
    /// What was moved.
    pub who: Who,
    /// Turn, rad.
    pub rotation_rad: f64,
    /// Standard deviation of the turn, rad.
    pub sigma_rotation_rad: f64,
    /// Shift of the camera's centre, m.
    pub translation_m: f64,
    /// Standard deviation of the shift, m.
    pub sigma_translation_m: f64,
}

/// How the frozen result stands.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WatchReport {
    /// What was moved; empty while nothing shows that anything was.
    pub moved: Vec<Moved>,
    /// Frame sets since the result was last confirmed: large when the cameras see nothing in common.
    pub sets_since_confirmed: u64,
    /// Whether lines seen since the watch began vouch for the place of every camera, as surely as a calibration must; what a
    /// result of an earlier run has to show.
    pub is_verified: bool,
}

impl WatchReport {
    /// What was moved, without the amounts.
    pub fn who(&self) -> impl Iterator<Item = Who> {
        self.moved.iter().map(|moved| moved.who)
    }
}

/// Compares what the cameras see with a frozen result. Bounded memory; the same sets give the same bits.
#[derive(Debug, Clone)]
pub struct Watch {
    cameras: Vec<Camera>,
    poses: Vec<Option<Motion>>,
    pairs: Vec<PairWatch>,
    window: Evidence,
    options: EstimateOptions,
    limits: WatchLimits,
    /// The newest finding that has not led to anything yet, and how often it was made in succession.
    pending: (Finding, u32),
    has_searched: bool,
    report: WatchReport,
}

/// How much may be done about one frame set.
#[derive(Clone, Copy)]
pub struct WatchEffort<'a> {
    /// Asked now and then; once it says no, everything is given up.
    pub keep_going: &'a dyn Fn() -> bool,
    /// Whether all poses may be searched where the frozen one has lost its support.
    pub may_search: bool,
}

/// What one look at all pairs comes to.
#[derive(Debug, Clone, PartialEq)]
enum Finding {
    Moved(Vec<Moved>),
    Confirmed,
    CannotTell,
}

impl Watch {
    /// Watches a converged result, pair by pair of those that converged.
    pub fn new(
        cameras: Vec<Camera>,
        frozen: &RigCalibration,
        options: EstimateOptions,
        limits: WatchLimits,
    ) -> Self {
        let pose = |camera: usize| frozen.cameras.get(camera)?.as_ref();
        let converged = frozen.pairs.iter().filter(|pair| pair.state == State::Converged);
        let pairs = converged.filter_map(|pair| {
            let usual = pair.full as f64 / frozen.frame_sets_used.max(1) as f64;
            PairWatch::new([pair.target, pair.source], [pose(pair.target)?, pose(pair.source)?], usual)
        });
        let evidence =
            EvidenceLimits { max_lines_per_view: options.evidence.max_lines_per_view, max_sets: WINDOW_SETS };
        Self {
            pairs: pairs.collect(),
            poses: (0..cameras.len())
                .map(|camera| pose(camera).map(|pose| pose.reference_from_camera))
                .collect(),
            cameras,
            window: Evidence::new(evidence),
            options,
            limits,
            pending: (Finding::CannotTell, 0),
            has_searched: false,
            report: WatchReport::default(),
        }
    }

    /// Takes one frame set (as [`super::RigEstimator::add`]) and says how the result stands.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> &WatchReport {
        self.add_within(views, &WatchEffort { keep_going: &|| true, may_search: true })
    }

    /// The same with no more effort than that; when it is given up, the report stays as it is.
    pub fn add_within(&mut self, views: &[Option<CameraView>], effort: &WatchEffort<'_>) -> &WatchReport {
        self.report.sets_since_confirmed += 1;
        self.has_searched = false;
        if self.window.refresh(views, MAX_AGE_SETS) {
            let finding = self.look(effort);
            if (effort.keep_going)() {
                self.take(finding);
                let moved = &self.report.moved;
                for pair in &mut self.pairs {
                    pair.is_accused = moved.iter().any(|moved| moved.who.concerns(pair.cameras));
                }
                self.report.is_verified = self.is_every_camera_vouched_for();
            }
        }
        &self.report
    }

    /// Whether all poses were searched with the newest set, which takes a hundred times as long as a look at the frozen ones.
    pub fn has_searched(&self) -> bool {
        self.has_searched
    }

    /// Compares the window with the frozen poses.
    fn look(&mut self, effort: &WatchEffort<'_>) -> Finding {
        let bench = Bench {
            evidence: &self.window,
            cameras: &self.cameras,
            options: &self.options,
            limits: &self.limits,
            effort,
        };
        let sights: Vec<Sight> = self.pairs.iter_mut().map(|pair| pair.look(&bench)).collect();
        self.has_searched = self.pairs.iter().any(PairWatch::has_searched);
        let moved = culprits(&self.poses, &self.pairs, &sights);
        if !moved.is_empty() {
            return Finding::Moved(moved);
        }
        // A camera that was moved is back only when it is seen to be back.
        let is_confirmed = |sight: &Sight| matches!(sight, Sight::Confirmed(_));
        let is_back =
            self.pairs.iter().zip(&sights).all(|(pair, sight)| is_confirmed(sight) || !pair.is_accused);
        if is_back && sights.iter().any(is_confirmed) { Finding::Confirmed } else { Finding::CannotTell }
    }

    /// Whether pairs that live lines vouch for connect all cameras.
    fn is_every_camera_vouched_for(&self) -> bool {
        let mut is_reached = vec![false; self.cameras.len()];
        is_reached.iter_mut().take(1).for_each(|first| *first = true);
        let vouched: Vec<[usize; 2]> =
            self.pairs.iter().filter(|pair| pair.is_vouched_for()).map(|pair| pair.cameras).collect();
        // Each round reaches a camera or is the last.
        for _ in 0..self.cameras.len() {
            for &[a, b] in &vouched {
                let either = is_reached[a] || is_reached[b];
                (is_reached[a], is_reached[b]) = (either, either);
            }
        }
        self.report.moved.is_empty() && is_reached.len() > 1 && is_reached.into_iter().all(|reached| reached)
    }

    /// Raises or takes back the alarm when a finding is made often enough in succession.
    fn take(&mut self, finding: Finding) {
        if finding == Finding::CannotTell {
            return;
        }
        let (before, count) = &mut self.pending;
        *count = if before.is_same(&finding) { count.saturating_add(1) } else { 1 };
        *before = finding;
        match &*before {
            Finding::Moved(moved) if *count >= RAISE_AFTER => {
                self.report.moved = not_widened(moved, &self.report.moved);
            }
            Finding::Confirmed => {
                if *count >= CLEAR_AFTER {
                    self.report.moved.clear();
                }
                self.report.sets_since_confirmed = 0;
            }
            _ => {}
        }
    }
}

/// The newer finding, but a camera that was named before stays named where the newer one only says that it was one of two: looks
/// that cannot tell take nothing back.
fn not_widened(newer: &[Moved], before: &[Moved]) -> Vec<Moved> {
    let named = |a: usize, b: usize| {
        before.iter().find(|moved| moved.who == Who::Camera(a) || moved.who == Who::Camera(b))
    };
    let keep = |moved: &Moved| match moved.who {
        Who::OneOf(a, b) => *named(a, b).unwrap_or(moved),
        Who::Camera(_) => *moved,
    };
    let mut kept: Vec<Moved> = newer.iter().map(keep).collect();
    kept.sort_by_key(|moved| moved.who);
    kept.dedup_by_key(|moved| moved.who);
    kept
}

impl Finding {
    /// Whether both say the same, but for numbers.
    fn is_same(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Moved(a), Self::Moved(b)) => {
                a.iter().map(|moved| moved.who).eq(b.iter().map(|moved| moved.who))
            }
            (Self::Confirmed, Self::Confirmed) | (Self::CannotTell, Self::CannotTell) => true,
            _ => false,
        }
    }
}

impl Who {
    /// Whether a pair of cameras could see this move.
    fn concerns(self, [target, source]: [usize; 2]) -> bool {
        match self {
            Who::Camera(camera) => camera == target || camera == source,
            Who::OneOf(a, b) => (a, b) == (target, source),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_was_named_stays_named_when_later_looks_cannot_tell() {
        let moved = |who, translation_m| Moved {
            who,
            rotation_rad: 0.01,
            sigma_rotation_rad: 0.001,
            translation_m,
            sigma_translation_m: 0.001,
        };
        let before = [moved(Who::Camera(1), 0.03)];
        assert_eq!(not_widened(&[moved(Who::OneOf(0, 1), 0.04)], &before), before);
        let elsewhere = [moved(Who::OneOf(0, 2), 0.04)];
        assert_eq!(not_widened(&elsewhere, &before), elsewhere);
        let surer = [moved(Who::Camera(0), 0.02)];
        assert_eq!(not_widened(&surer, &before), surer, "another camera named replaces the first");
    }
}
