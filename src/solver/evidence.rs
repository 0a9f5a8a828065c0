//! The evidence: what each camera of the rig saw, prepared for voting, and which of it is new.
//!
//! The same physical line seen again from the same rig pose averages noise but is not new evidence: coincidences repeat with
//! the frames. Of a frame set that repeats an earlier one only the lines that were not there before are kept. Memory is bounded; what
//! stays is decided in `retention`.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Unit, Vector3};

use super::appearance::in_kept_lines;
use super::place::Place;
use super::retention::{Coverage, keep_best_lines, superfluous};
use crate::geometry::{CameraView, LineObservation, PairScores, RayPoint, SurfaceSample};

/// A frame set repeats an old one when more than this share of its lines is where it was.
const REPEATED_SHARE: f64 = 0.5;
/// Sets kept of one rig pose: a scene may change before a standing rig, but flicker must not fill the memory.
const MAX_SETS_PER_POSE: usize = 8;
/// Of so many times the lines that are kept, the longest, a view's lines are chosen.
const LINES_TO_CHOOSE_FROM: usize = 3;
/// Of a repeated set fewer new lines than this, in each of two cameras, are flicker and not a changed scene.
const MIN_NEW_LINES: usize = 3;

/// Segments without depth kept per view, the longest: short ones match anything.
const MAX_UNLIFTED_PER_VIEW: usize = 80;
/// Segments whose place is kept per view, the longest: to know what a camera did not see.
const MAX_OUTLINES_PER_VIEW: usize = 300;

/// A lifted line prepared for voting.
#[derive(Debug, Clone, PartialEq)]
pub struct EvidenceLine {
    /// What was measured.
    pub observation: LineObservation,
    /// Index in the camera's view as it was delivered; 0 for a line that is from no view.
    pub in_view: u32,
    /// The two end points in the camera's frame, m.
    pub ends_m: [Point3<f64>; 2],
    /// Unit direction from start to end.
    pub direction: Unit<Vector3<f64>>,
    /// Standard deviation of the direction, the worse of two, rad.
    pub sigma_direction_rad: f64,
    /// Standard deviation of the middle across the line, the worse of two, m.
    pub sigma_position_m: f64,
    /// Covariance of the four measured numbers: offsets across at start and end, inverse depths at start and end.
    pub covariance: Matrix4<f64>,
}

impl EvidenceLine {
    /// Prepares an observation; `None` when it is not lifted or its ends are not in front of the camera.
    pub fn try_new(observation: &LineObservation) -> Option<Self> {
        let depth = observation.depth?;
        let ends_m = [0, 1].map(|i| observation.ends[i].at_inverse_depth(depth.inverse_depth_per_m[i]));
        if ends_m.iter().any(|end_m| !(end_m.iter().all(|value| value.is_finite()) && end_m.z > 0.05)) {
            return None;
        }
        let direction = Unit::try_new(ends_m[1] - ends_m[0], 1e-3)?;
        let mut covariance = Matrix4::zeros();
        let across = observation.sigma_across * observation.sigma_across;
        covariance[(0, 0)] = across;
        covariance[(1, 1)] = across;
        covariance.fixed_view_mut::<2, 2>(2, 2).copy_from(&depth.covariance_per_m2);
        let mut line = Self {
            observation: *observation,
            in_view: 0,
            ends_m,
            direction,
            sigma_direction_rad: 0.0,
            sigma_position_m: 0.0,
            covariance,
        };
        let [start, end] = line.d_ends_d_measurement();
        let length_m = (ends_m[1] - ends_m[0]).norm();
        line.sigma_direction_rad = line.worst_sigma_across(&(end - start)) / length_m;
        line.sigma_position_m = line.worst_sigma_across(&((end + start) * 0.5));
        (line.sigma_direction_rad.is_finite() && line.sigma_position_m.is_finite()).then_some(line)
    }

    /// Middle of the observed part, m.
    pub fn middle_m(&self) -> Point3<f64> {
        nalgebra::center(&self.ends_m[0], &self.ends_m[1])
    }

    /// Derivatives of both end points (m) by the four measured numbers (see [`Self::covariance`]).
    pub fn d_ends_d_measurement(&self) -> [Matrix3x4<f64>; 2] {
        let [start, end] = self.observation.ends;
        // Across the segment on the plane z = 1.
        let along = Vector3::new(end.x - start.x, end.y - start.y, 0.0).normalize();
        let across = Vector3::new(-along.y, along.x, 0.0);
        [0, 1].map(|i| {
            let depth_m = self.ends_m[i].z;
            let mut derivative = Matrix3x4::zeros();
            // X = ray / q, so dX/d(offset) = across / q and dX/dq = -X / q.
            derivative.set_column(i, &(across * depth_m));
            derivative.set_column(2 + i, &(-self.ends_m[i].coords * depth_m));
            derivative
        })
    }

    /// Largest standard deviation, perpendicular to the line, of the vector with this derivative.
    fn worst_sigma_across(&self, d_vector_d_measurement: &Matrix3x4<f64>) -> f64 {
        let covariance = d_vector_d_measurement * self.covariance * d_vector_d_measurement.transpose();
        let reject = Matrix3::identity() - self.direction.into_inner() * self.direction.transpose();
        let across = reject * covariance * reject;
        across.symmetric_eigenvalues().max().max(0.0).sqrt()
    }
}

/// One camera's part of a stored frame set.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct EvidenceView {
    /// Lifted lines, longest first.
    pub lines: Vec<EvidenceLine>,
    /// Segments without depth, longest first; none in a set that repeats a rig pose.
    pub unlifted: Vec<LineObservation>,
    /// The ends of all segments, lifted or not and whether kept as a line or not, longest first: what is not here was not seen.
    pub outlines: Vec<[RayPoint; 2]>,
    /// Coarse surfaces.
    pub surface: Vec<SurfaceSample>,
}

/// One stored frame set.
#[derive(Debug, Clone, PartialEq)]
pub struct EvidenceSet {
    /// A view per camera, `None` where the camera was missing.
    pub views: Vec<Option<EvidenceView>>,
    /// Number of the set.
    id: u64,
    /// Number of the set whose rig pose this one repeats, or its own.
    pub repeats: u64,
    /// What appearance says of the kept lines, by their indices here, sorted by source and target; none where nobody compared.
    pub scores: Vec<PairScores>,
    /// Per camera, where its lines were, also those that were not kept.
    places: Vec<Vec<Place>>,
    /// What it adds to the whole.
    pub(super) coverage: Coverage,
}

impl EvidenceSet {
    /// A set of the best `max_lines` of each view; the other lines are remembered by their places.
    fn new(mut views: Vec<Option<EvidenceView>>, (id, repeats): (u64, u64), max_lines: usize) -> Self {
        let places = views.iter().map(places).collect();
        views.iter_mut().flatten().for_each(|view| keep_best_lines(&mut view.lines, max_lines));
        let coverage =
            Coverage::of(views.iter().map(|view| view.as_ref().map_or(&[][..], |view| &view.lines)));
        Self { views, id, repeats, scores: Vec::new(), places, coverage }
    }

    /// Lifted lines of one camera.
    pub(super) fn n_lines(&self, camera: usize) -> usize {
        self.views.get(camera).and_then(Option::as_ref).map_or(0, |view| view.lines.len())
    }

    /// Whether this set repeats the rig pose of another one.
    pub(super) fn is_repeat_of(&self, other: &EvidenceSet) -> bool {
        self.repeats == other.id && self.id != other.id
    }
}

/// Everything the estimator keeps, in the order of arrival.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The frame sets that brought something new.
    pub sets: Vec<EvidenceSet>,
    next_id: u64,
    limits: EvidenceLimits,
}

/// Bounds on what is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvidenceLimits {
    /// Lifted lines kept per view, the most informative.
    pub max_lines_per_view: usize,
    /// Frame sets kept, the most informative.
    pub max_sets: usize,
}

impl Evidence {
    /// No evidence yet.
    pub fn new(limits: EvidenceLimits) -> Self {
        Self { sets: Vec::new(), next_id: 0, limits }
    }

    /// Takes what is new of a frame set; says whether at least two cameras brought something that is worth keeping.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> bool {
        let mut views: Vec<_> =
            views.iter().map(|view| view.as_ref().map(|view| self.prepare(view))).collect();
        let all_places: Vec<_> = views.iter().map(places).collect();
        let old = self
            .sets
            .iter()
            .find(|old| old.repeats == old.id && share_in_place(&all_places, old) > REPEATED_SHARE);
        let mut min_lines = 1;
        let repeats = old.map_or(self.next_id, |old| old.id);
        if old.is_some() {
            min_lines = MIN_NEW_LINES;
            let same_pose: Vec<_> = self.sets.iter().filter(|known| known.repeats == repeats).collect();
            if same_pose.len() >= MAX_SETS_PER_POSE {
                return false;
            }
            same_pose.iter().for_each(|known| drop_known(&mut views, known));
            // Whether one without depth was there before is hard to say.
            views.iter_mut().flatten().for_each(|view| view.unlifted.clear());
        }
        if views.iter().flatten().filter(|view| view.lines.len() >= min_lines).count() < 2 {
            return false;
        }
        self.keep(EvidenceSet::new(views, (self.next_id, repeats), self.limits.max_lines_per_view))
    }

    /// Stores what appearance says of the set that was taken last; its scores are by the lines of the views as delivered.
    pub fn score_newest(&mut self, scores: &[PairScores]) {
        if let Some(set) = self.sets.last_mut() {
            set.scores = scores.iter().filter_map(|scores| in_kept_lines(scores, &set.views)).collect();
        }
    }

    /// Takes a frame set for watching: the newest sight of a rig pose takes the place of the older ones, which may show the cameras
    /// as they stood before. Kept are `max_sets`, and none beyond `max_age` sets. Says whether two cameras brought something.
    pub fn refresh(&mut self, views: &[Option<CameraView>], max_age: u64) -> bool {
        let views: Vec<_> = views.iter().map(|view| view.as_ref().map(|view| self.prepare(view))).collect();
        let set = EvidenceSet::new(views, (self.next_id, self.next_id), self.limits.max_lines_per_view);
        self.next_id += 1;
        let is_new = set.views.iter().flatten().filter(|view| view.lines.len() >= MIN_NEW_LINES).count() >= 2;
        if is_new {
            let is_kept = |old: &EvidenceSet| {
                set.id - old.id < max_age && share_in_place(&set.places, old) <= REPEATED_SHARE
            };
            self.sets.retain(is_kept);
            let too_many = (self.sets.len() + 1).saturating_sub(self.limits.max_sets);
            self.sets.drain(..too_many);
            self.sets.push(set);
        }
        is_new
    }

    /// Keeps a new set and drops what has become superfluous by it; whether the new set stays.
    fn keep(&mut self, set: EvidenceSet) -> bool {
        self.sets.push(set);
        let superfluous = superfluous(&self.sets, &self.limits);
        if superfluous.contains(&(self.sets.len() - 1)) {
            self.sets.pop();
            return false;
        }
        let mut idx = 0;
        self.sets.retain(|_| {
            idx += 1;
            !superfluous.contains(&(idx - 1))
        });
        self.next_id += 1;
        true
    }

    fn prepare(&self, view: &CameraView) -> EvidenceView {
        let max_lines = LINES_TO_CHOOSE_FROM * self.limits.max_lines_per_view;
        let numbered = (0..).zip(&view.lines).filter_map(|(in_view, line)| {
            EvidenceLine::try_new(line).map(|line| EvidenceLine { in_view, ..line })
        });
        let lines = numbered.take(max_lines);
        let unlifted = view.lines.iter().filter(|line| line.depth.is_none()).take(MAX_UNLIFTED_PER_VIEW);
        let outlines = view.lines.iter().map(|line| line.ends).take(MAX_OUTLINES_PER_VIEW);
        EvidenceView {
            lines: lines.collect(),
            unlifted: unlifted.copied().collect(),
            outlines: outlines.collect(),
            surface: view.surface.clone(),
        }
    }
}

fn places(view: &Option<EvidenceView>) -> Vec<Place> {
    view.iter().flat_map(|view| &view.lines).filter_map(|line| Place::try_new(&line.observation)).collect()
}

/// Share of the lines of a set that lie where the same camera saw a line in an old set.
fn share_in_place(places: &[Vec<Place>], old: &EvidenceSet) -> f64 {
    let (mut in_place, mut all) = (0_usize, 0_usize);
    for ((places, old_places), old_view) in places.iter().zip(&old.places).zip(&old.views) {
        if places.is_empty() || old_view.is_none() {
            continue;
        }
        all += places.len();
        in_place += places.iter().filter(|place| is_known(place, old_places)).count();
    }
    in_place as f64 / all.max(1) as f64
}

fn drop_known(views: &mut [Option<EvidenceView>], known: &EvidenceSet) {
    for (view, known_places) in views.iter_mut().zip(&known.places) {
        if let Some(view) = view {
            let is_new = |line: &EvidenceLine| {
                Place::try_new(&line.observation).is_some_and(|place| !is_known(&place, known_places))
            };
            view.lines.retain(is_new);
        }
    }
}

fn is_known(place: &Place, known: &[Place]) -> bool {
    known.iter().any(|known| known.is_same(place))
}
