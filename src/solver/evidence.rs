//! The evidence: what each camera of the rig saw, prepared for voting, and which of it is new.
//!
//! The same physical line seen again from the same rig pose averages noise but is not new evidence: coincidences repeat with
//! the frames. Of a frame set that repeats an earlier one only the lines that were not there before are kept.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Unit, Vector3};

use crate::geometry::{CameraView, LineObservation, RayPoint, SurfaceSample};

/// A line is where it was when its ends lie this close to the old one, across, px: about 2 degrees of rig rotation.
const SAME_PLACE_ACROSS_PX: f64 = 20.0;
/// ... and its direction this close, rad.
const SAME_PLACE_ANGLE_RAD: f64 = 0.05;
/// ... and its inverse depth within this share.
const SAME_PLACE_DEPTH_RATIO: f64 = 0.1;
/// A frame set repeats an old one when more than this share of its lines is where it was.
const REPEATED_SHARE: f64 = 0.5;
/// Sets kept of one rig pose: a scene may change before a standing rig, but flicker must not fill the memory.
const MAX_SETS_PER_POSE: usize = 8;
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
    /// Lifted lines kept per view, the longest.
    pub max_lines_per_view: usize,
    /// Frame sets kept; those of the oldest rig pose go first.
    pub max_sets: usize,
}

impl Evidence {
    /// No evidence yet.
    pub fn new(limits: EvidenceLimits) -> Self {
        Self { sets: Vec::new(), next_id: 0, limits }
    }

    /// Takes what is new of a frame set; says whether at least two cameras brought something.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> bool {
        let mut set = EvidenceSet {
            views: views.iter().map(|view| view.as_ref().map(|view| self.prepare(view))).collect(),
            id: self.next_id,
            repeats: self.next_id,
        };
        let old =
            self.sets.iter().find(|old| old.repeats == old.id && share_in_place(&set, old) > REPEATED_SHARE);
        let mut min_lines = 1;
        if let Some(old) = old {
            set.repeats = old.id;
            min_lines = MIN_NEW_LINES;
            let same_pose: Vec<_> = self.sets.iter().filter(|known| known.repeats == old.id).collect();
            if same_pose.len() >= MAX_SETS_PER_POSE {
                return false;
            }
            same_pose.iter().for_each(|known| drop_known(&mut set, known));
            // Whether one without depth was there before is hard to say.
            set.views.iter_mut().flatten().for_each(|view| view.unlifted.clear());
        }
        let is_new = set.views.iter().flatten().filter(|view| view.lines.len() >= min_lines).count() >= 2;
        if is_new {
            if self.sets.len() >= self.limits.max_sets && !self.forget_oldest_pose_but(set.repeats) {
                return false;
            }
            self.sets.push(set);
            self.next_id += 1;
        }
        is_new
    }

    /// Forgets the oldest rig pose other than the given one; whether there was one. All sets of a pose go together: without its
    /// first set the others would not be known as repetitions.
    fn forget_oldest_pose_but(&mut self, kept: u64) -> bool {
        let oldest = self.sets.iter().map(|set| set.repeats).find(|pose| *pose != kept);
        if let Some(oldest) = oldest {
            self.sets.retain(|set| set.repeats != oldest);
        }
        oldest.is_some()
    }

    fn prepare(&self, view: &CameraView) -> EvidenceView {
        let lines = view.lines.iter().filter_map(EvidenceLine::try_new).take(self.limits.max_lines_per_view);
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

/// Share of the lines of a set that lie where the same camera saw a line in an old set.
fn share_in_place(set: &EvidenceSet, old: &EvidenceSet) -> f64 {
    let (mut in_place, mut all) = (0_usize, 0_usize);
    for (view, old_view) in set.views.iter().zip(&old.views) {
        let (Some(view), Some(old_view)) = (view, old_view) else { continue };
        all += view.lines.len();
        in_place += view.lines.iter().filter(|line| is_known(line, old_view)).count();
    }
    in_place as f64 / all.max(1) as f64
}

fn drop_known(set: &mut EvidenceSet, known: &EvidenceSet) {
    for (view, known_view) in set.views.iter_mut().zip(&known.views) {
        if let (Some(view), Some(known_view)) = (view, known_view) {
            view.lines.retain(|line| !is_known(line, known_view));
        }
    }
}

fn is_known(line: &EvidenceLine, view: &EvidenceView) -> bool {
    view.lines.iter().any(|known| same_place(&known.observation, &line.observation))
}

/// Whether two observations of one camera lie on the same image line at the same depth, and overlap.
fn same_place(a: &LineObservation, b: &LineObservation) -> bool {
    let (Some(depth_a), Some(depth_b)) = (a.depth, b.depth) else { return false };
    let (a0, a1) = (a.segment.start, a.segment.end);
    let (length, b_length) = (a.segment.length_px(), b.segment.length_px());
    if length < 1.0 || b_length < 1.0 {
        return false;
    }
    let along = ((a1.x - a0.x) / length, (a1.y - a0.y) / length);
    let b_along =
        ((b.segment.end.x - b.segment.start.x) / b_length, (b.segment.end.y - b.segment.start.y) / b_length);
    if (along.0 * b_along.1 - along.1 * b_along.0).abs() > SAME_PLACE_ANGLE_RAD
        || along.0 * b_along.0 + along.1 * b_along.1 < 0.0
    {
        return false;
    }
    let position = |x: f64, y: f64| {
        let (dx, dy) = (x - a0.x, y - a0.y);
        (dx * along.0 + dy * along.1, dy * along.0 - dx * along.1)
    };
    let (from, across_start) = position(b.segment.start.x, b.segment.start.y);
    let (to, across_end) = position(b.segment.end.x, b.segment.end.y);
    let overlap = to.min(length) - from.max(0.0);
    if across_start.abs().max(across_end.abs()) > SAME_PLACE_ACROSS_PX || overlap < 0.5 * length.min(b_length)
    {
        return false;
    }
    let mean = |per_m: [f64; 2]| 0.5 * (per_m[0] + per_m[1]);
    let (a_per_m, b_per_m) = (mean(depth_a.inverse_depth_per_m), mean(depth_b.inverse_depth_per_m));
    (a_per_m - b_per_m).abs() < SAME_PLACE_DEPTH_RATIO * a_per_m.abs()
}
