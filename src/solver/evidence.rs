//! The evidence: what each camera of the rig saw, prepared for voting, and which of it is new.
//!
//! The same physical line seen again from the same rig pose averages noise but is not new evidence: coincidences repeat with
//! the frames. Lines that stay where they were in the image keep their *identity*, and identities vote once.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Point3, Unit, Vector3};

use crate::geometry::{CameraView, LineObservation, SurfaceSample};

/// Ends of a line seen again lie within this distance across the segment, px: detection noise and a still camera.
const SAME_LINE_ACROSS_PX: f64 = 2.0;
/// ... and its direction within this angle, rad.
const SAME_LINE_ANGLE_RAD: f64 = 0.02;
/// ... and its depth within this share.
const SAME_LINE_DEPTH_RATIO: f64 = 0.05;
/// A view is new when at most this share of its lines was there before.
const REPEATED_SHARE_OF_OLD_VIEW: f64 = 0.5;

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
    /// The same number as in an earlier set when the line stayed where it was in the image.
    pub identity: u32,
}

impl EvidenceLine {
    /// Prepares an observation; `None` when it is not lifted or its ends are not in front of the camera.
    pub fn try_new(observation: &LineObservation, identity: u32) -> Option<Self> {
        let depth = observation.depth?;
        let ends_m = [0, 1].map(|i| observation.ends[i].at_inverse_depth(depth.inverse_depth_per_m[i]));
        if ends_m.iter().any(|end_m| !(end_m.z.is_finite() && end_m.z > 0.05)) {
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
            identity,
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
    /// Segments without depth, longest first.
    pub unlifted: Vec<LineObservation>,
    /// Coarse surfaces.
    pub surface: Vec<SurfaceSample>,
}

/// One stored frame set: a view per camera, `None` where the camera was missing.
pub type EvidenceSet = Vec<Option<EvidenceView>>;

/// Everything the estimator keeps, in the order of arrival.
#[derive(Debug, Clone)]
pub struct Evidence {
    /// The frame sets that brought something new.
    pub sets: Vec<EvidenceSet>,
    next_identity: u32,
    limits: EvidenceLimits,
}

/// Bounds on what is kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvidenceLimits {
    /// Lifted lines kept per view, the longest.
    pub max_lines_per_view: usize,
    /// Frame sets kept; the oldest goes first.
    pub max_sets: usize,
}

impl Evidence {
    /// No evidence yet.
    pub fn new(limits: EvidenceLimits) -> Self {
        Self { sets: Vec::new(), next_identity: 0, limits }
    }

    /// Takes a frame set unless every camera's view repeats one that is stored; says whether it was taken.
    pub fn add(&mut self, views: &[Option<CameraView>]) -> bool {
        let mut any_new = false;
        let mut set = EvidenceSet::with_capacity(views.len());
        for (camera, view) in views.iter().enumerate() {
            let Some(view) = view else {
                set.push(None);
                continue;
            };
            let (prepared, repeated) = self.prepare(camera, view);
            let n_lines = prepared.lines.len();
            any_new |= n_lines > 0 && (repeated as f64) <= REPEATED_SHARE_OF_OLD_VIEW * n_lines as f64;
            set.push(Some(prepared));
        }
        if any_new {
            if self.sets.len() >= self.limits.max_sets {
                self.sets.remove(0);
            }
            self.sets.push(set);
        }
        any_new
    }

    /// Prepares a view; with it the number of lines that were seen before in the same place.
    fn prepare(&mut self, camera: usize, view: &CameraView) -> (EvidenceView, usize) {
        let mut prepared = EvidenceView { surface: view.surface.clone(), ..EvidenceView::default() };
        let mut repeated = 0;
        for observation in &view.lines {
            if observation.depth.is_none() {
                if prepared.unlifted.len() < self.limits.max_lines_per_view {
                    prepared.unlifted.push(*observation);
                }
                continue;
            }
            if prepared.lines.len() == self.limits.max_lines_per_view {
                continue;
            }
            let known = self.identity_of(camera, observation);
            let Some(line) = EvidenceLine::try_new(observation, known.unwrap_or(self.next_identity)) else {
                continue;
            };
            match known {
                Some(_) => repeated += 1,
                None => self.next_identity += 1,
            }
            prepared.lines.push(line);
        }
        (prepared, repeated)
    }

    /// The identity of a stored line of this camera in the same place of the image, the newest first.
    fn identity_of(&self, camera: usize, observation: &LineObservation) -> Option<u32> {
        let views = self.sets.iter().rev().filter_map(|set| set.get(camera)?.as_ref());
        views
            .flat_map(|view| &view.lines)
            .find_map(|line| same_place(&line.observation, observation).then_some(line.identity))
    }
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
    if (along.0 * b_along.1 - along.1 * b_along.0).abs() > SAME_LINE_ANGLE_RAD
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
    if across_start.abs().max(across_end.abs()) > SAME_LINE_ACROSS_PX || overlap < 0.5 * length.min(b_length)
    {
        return false;
    }
    let mean = |per_m: [f64; 2]| 0.5 * (per_m[0] + per_m[1]);
    let (a_per_m, b_per_m) = (mean(depth_a.inverse_depth_per_m), mean(depth_b.inverse_depth_per_m));
    (a_per_m - b_per_m).abs() < SAME_LINE_DEPTH_RATIO * a_per_m.abs()
}
