//! With the rotation known, what a matched pair says of the translation (paper, III-C.2).
//!
//! A full pair leaves a line of translations (eq. 14, corrected). A pair without the target's depth leaves one plane, not the line the
//! text after eq. 15 promises: the planes of both end points are the same one, namely that the moved source line lies in the plane
//! through the target's centre and its segment. Where noise parts them they meet in the pose that puts the source line through the
//! target's centre: a wrong one. Each candidate knows how exact it is from the noise of both lines.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Rotation3, Unit, Vector3};

use crate::geometry::LineObservation;
use crate::geometry::motion::hat;
use crate::solver::evidence::EvidenceLine;
use crate::solver::line_pair::{LinePair, TargetSide};

/// The translations `target_from_source` that one pair allows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TranslationCandidate {
    /// Of a full pair.
    Line(TranslationLine),
    /// Of a pair whose target has no depth.
    Plane(TranslationPlane),
}

/// `t = point_m + k direction`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TranslationLine {
    /// The point closest to the origin, m.
    pub point_m: Vector3<f64>,
    /// `R d_s`.
    pub direction: Unit<Vector3<f64>>,
    /// Standard deviation of the distance (both directions across together) where it is smallest, m.
    sigma_m: f64,
    /// Where along the line that is, m.
    best_at_m: f64,
    /// Growth with the distance from there: how far the source's direction may be off, rad.
    sigma_per_m: f64,
}

/// `normal . (turned_m + t) = 0`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TranslationPlane {
    /// Of the plane through the target's centre and its segment.
    pub normal: Unit<Vector3<f64>>,
    /// `R p_s`, the turned middle of the source line, m.
    pub turned_m: Vector3<f64>,
    /// Standard deviation of that middle along the normal, m.
    sigma_m: f64,
    /// Change of the distance by one standard deviation of each end of the target's segment, per metre of `turned_m + t`.
    by_end: [Vector3<f64>; 2],
}

impl TranslationCandidate {
    /// What a pair allows under a rotation `target_from_source`; `None` when the turned source direction is further than
    /// `max_angle_rad` from the target's line (either way round: lines have no orientation) or plane.
    pub fn try_new(pair: &LinePair, target_from_source: &Rotation3<f64>, max_angle_rad: f64) -> Option<Self> {
        match &pair.target {
            TargetSide::Full(target) => {
                TranslationLine::try_new(target, &pair.source, (target_from_source, max_angle_rad))
                    .map(Self::Line)
            }
            TargetSide::Pnl(target) => {
                TranslationPlane::try_new(target, &pair.source, (target_from_source, max_angle_rad))
                    .map(Self::Plane)
            }
        }
    }

    /// Distance of a translation, m.
    pub fn distance_m(&self, translation_m: &Vector3<f64>) -> f64 {
        match self {
            Self::Line(line) => {
                let offset = translation_m - line.point_m;
                (offset - *line.direction * offset.dot(&line.direction)).norm()
            }
            Self::Plane(plane) => (plane.turned_m + translation_m).dot(&plane.normal).abs(),
        }
    }

    /// Standard deviation of that distance at a translation by the noise of both lines, m; the rotation's own error is not in it.
    pub fn sigma_m(&self, translation_m: &Vector3<f64>) -> f64 {
        match self {
            Self::Line(line) => {
                let along_m = (translation_m - line.point_m).dot(&line.direction) - line.best_at_m;
                let growth_m = line.sigma_per_m * along_m;
                (line.sigma_m * line.sigma_m + growth_m * growth_m).sqrt()
            }
            Self::Plane(plane) => {
                let moved_m = plane.turned_m + translation_m;
                let [start_m, end_m] = plane.by_end.map(|by_end| by_end.dot(&moved_m));
                (plane.sigma_m * plane.sigma_m + start_m * start_m + end_m * end_m).sqrt()
            }
        }
    }

    /// Most that [`Self::sigma_m`] changes per metre of translation.
    pub fn sigma_slope(&self) -> f64 {
        match self {
            Self::Line(line) => line.sigma_per_m,
            Self::Plane(plane) => (plane.by_end[0].norm_squared() + plane.by_end[1].norm_squared()).sqrt(),
        }
    }
}

impl TranslationLine {
    /// Eq. 14 corrected: `t = (b × a) + k a` with a = R d_s and b = R m_s - m_t, moments m = p × d; the paper has no |a|² and the
    /// target's line must be turned to run along a. With noise this is the least-squares solution of a × t = b.
    fn try_new(
        target: &EvidenceLine,
        source: &EvidenceLine,
        (rotation, max_angle_rad): (&Rotation3<f64>, f64),
    ) -> Option<Self> {
        let direction = rotation * source.direction;
        let sign = if direction.dot(&target.direction) < 0.0 { -1.0 } else { 1.0 };
        let sine = direction.cross(&target.direction).norm();
        if sine.atan2(direction.dot(&target.direction).abs()) > max_angle_rad {
            return None;
        }
        let turned_moment_m = rotation * moment_m(source);
        let point_m = (turned_moment_m - moment_m(target) * sign).cross(&direction);

        // The offset of a true translation is b - a × t across a; how source and target change it:
        let across = Matrix3::identity() - direction.into_inner() * direction.transpose();
        let (d_direction, d_moment) = derivatives(source);
        let by_source = across * (rotation * d_moment + hat(&point_m) * (rotation * d_direction));
        let by_source_per_m = hat(&direction) * (rotation * d_direction);
        let by_target = across * derivatives(target).1;
        let product = |left: &Matrix3x4<f64>, covariance: &Matrix4<f64>, right: &Matrix3x4<f64>| {
            (left * covariance).dot(right)
        };
        let constant = product(&by_source, &source.covariance, &by_source)
            + product(&by_target, &target.covariance, &by_target);
        let half_linear = product(&by_source, &source.covariance, &by_source_per_m);
        let square = product(&by_source_per_m, &source.covariance, &by_source_per_m);
        let best_at_m = if square > 0.0 { -half_linear / square } else { 0.0 };
        let least = constant + half_linear * best_at_m;
        Some(Self {
            point_m,
            direction: Unit::new_unchecked(direction.into_inner()),
            sigma_m: least.max(0.0).sqrt(),
            best_at_m,
            sigma_per_m: square.max(0.0).sqrt(),
        })
    }
}

impl TranslationPlane {
    fn try_new(
        target: &LineObservation,
        source: &EvidenceLine,
        (rotation, max_angle_rad): (&Rotation3<f64>, f64),
    ) -> Option<Self> {
        let [start, end] = target.ends.map(|end| Vector3::new(end.x, end.y, 1.0));
        let product = start.cross(&end);
        let normal = Unit::try_new(product, 1e-9)?;
        if normal.dot(&(rotation * source.direction)).abs() > max_angle_rad.sin() {
            return None;
        }
        let middle_by_measurement = {
            let [start, end] = source.d_ends_d_measurement();
            (start + end) * 0.5
        };
        let by_measurement = (rotation.inverse() * normal).transpose() * middle_by_measurement;
        let variance_m2 = (by_measurement * source.covariance * by_measurement.transpose()).x;
        // Each end of the segment may be off across it, on the plane z = 1.
        let along = Unit::try_new((end - start).xy(), 1e-9)?;
        let shift = Vector3::new(-along.y, along.x, 0.0) * (target.sigma_across / product.norm());
        Some(Self {
            normal,
            turned_m: rotation * source.middle_m().coords,
            sigma_m: variance_m2.max(0.0).sqrt(),
            by_end: [shift.cross(&end), start.cross(&shift)],
        })
    }
}

/// `p × d` of the line, m.
fn moment_m(line: &EvidenceLine) -> Vector3<f64> {
    line.middle_m().coords.cross(&line.direction)
}

/// Derivatives of the direction and of the moment by the line's four measured numbers.
fn derivatives(line: &EvidenceLine) -> (Matrix3x4<f64>, Matrix3x4<f64>) {
    let [start, end] = line.d_ends_d_measurement();
    let direction = line.direction.into_inner();
    let length_m = (line.ends_m[1] - line.ends_m[0]).norm();
    let d_direction = (Matrix3::identity() - direction * direction.transpose()) * (end - start) / length_m;
    let d_moment = hat(&line.middle_m().coords) * d_direction - hat(&direction) * ((start + end) * 0.5);
    (d_direction, d_moment)
}

#[cfg(test)]
pub(super) mod tests;
