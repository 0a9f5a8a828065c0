//! How far a source line, moved by a pose, is from the line the target measured; with derivatives.
//!
//! The four numbers compared are those the target camera measures: the offsets of its segment's two ends from the predicted
//! image line (plane z = 1), and the inverse depths at these ends (1/m). Their covariance is the target's own plus the source
//! line's, carried over; to first order this is the maximum-likelihood estimate with the line itself eliminated. A target without
//! depth (the paper's PnL case) measures the two offsets alone.

use nalgebra::{Matrix2, Matrix2x6, Matrix3, Matrix4, Matrix4x6, Point3, SMatrix, Vector2, Vector3, Vector4};

use super::evidence::EvidenceLine;
use crate::geometry::LineObservation;
use crate::geometry::motion::{Motion, d_inverse_step_d_step, hat};

/// Measured minus predicted, with derivatives and covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct MatchResidual {
    /// Offsets of start and end across the predicted line (z = 1), then inverse depths at start and end, 1/m.
    pub residual: Vector4<f64>,
    /// Derivative by a step of the pose, ordered x y z rx ry rz.
    pub d_residual_d_pose: Matrix4x6<f64>,
    /// Covariance of the residual from both lines' measurement noise.
    pub covariance: Matrix4<f64>,
}

/// As [`MatchResidual`], for a target without depth: offsets of start and end across the predicted line (z = 1).
#[derive(Debug, Clone, PartialEq)]
pub struct OffsetResidual {
    /// Offsets, measured minus predicted.
    pub residual: Vector2<f64>,
    /// Derivative by a step of the pose, ordered x y z rx ry rz.
    pub d_residual_d_pose: Matrix2x6<f64>,
    /// Covariance of the residual from both lines' measurement noise.
    pub covariance: Matrix2<f64>,
    /// Inverse depths that the line would have at the segment's ends, 1/m; negative behind the camera.
    pub inverse_depth_per_m: [f64; 2],
    /// Whether the line's image runs the same way as the segment, each with its brighter side on the right.
    pub is_same_way: bool,
}

/// Compares `source`, moved by `target_from_source`, with `target`. `None` where the moved line passes (nearly) through the
/// target's centre or has no finite image: it predicts nothing then.
pub fn match_residual(
    target: &EvidenceLine,
    source: &EvidenceLine,
    target_from_source: &Motion,
) -> Option<MatchResidual> {
    let inverse_depth_per_m = target.observation.depth?.inverse_depth_per_m;
    let moved = Moved::new(source, target_from_source);
    let predicted = Predicted::new(&moved.ends_m, &target.observation)?;
    let mut residual = predicted.values;
    residual[2] = inverse_depth_per_m[0] - predicted.values[2];
    residual[3] = inverse_depth_per_m[1] - predicted.values[3];
    let mut d_residual_d_ends = predicted.d_values_d_ends;
    d_residual_d_ends.rows_mut(2, 2).neg_mut();
    Some(moved.carry(residual, d_residual_d_ends, &target.covariance))
}

/// Compares `source`, moved by `target_from_source`, with a segment of the target that has no depth (or whose depth is not to be
/// used); `None` as in [`match_residual`].
pub fn offset_residual(
    target: &LineObservation,
    source: &EvidenceLine,
    target_from_source: &Motion,
) -> Option<OffsetResidual> {
    let moved = Moved::new(source, target_from_source);
    let predicted = Predicted::new(&moved.ends_m, target)?;
    let across = target.sigma_across * target.sigma_across;
    let own_covariance = Matrix4::from_diagonal(&Vector4::new(across, across, 0.0, 0.0));
    let carried = moved.carry(predicted.values, predicted.d_values_d_ends, &own_covariance);
    Some(OffsetResidual {
        residual: carried.residual.fixed_rows::<2>(0).into_owned(),
        d_residual_d_pose: carried.d_residual_d_pose.fixed_rows::<2>(0).into_owned(),
        covariance: carried.covariance.fixed_view::<2, 2>(0, 0).into_owned(),
        inverse_depth_per_m: [predicted.values[2], predicted.values[3]],
        is_same_way: moved.runs_as(target),
    })
}

/// The reversed role: compares `target`, moved into the source, with a segment of the source that has no depth. The derivative
/// is still by a step of `target_from_source`; the rest is seen from the source. `None` as in [`match_residual`].
pub fn reversed_offset_residual(
    target: &EvidenceLine,
    source: &LineObservation,
    target_from_source: &Motion,
) -> Option<OffsetResidual> {
    let mut found = offset_residual(source, target, &target_from_source.inverse())?;
    found.d_residual_d_pose *= d_inverse_step_d_step(target_from_source);
    Some(found)
}

/// The source line in the target's frame.
struct Moved<'a> {
    source: &'a EvidenceLine,
    rotation: Matrix3<f64>,
    /// `R X`, without the translation.
    turned_m: [Vector3<f64>; 2],
    ends_m: [Point3<f64>; 2],
}

impl<'a> Moved<'a> {
    fn new(source: &'a EvidenceLine, target_from_source: &Motion) -> Self {
        let rotation = target_from_source.rotation.to_rotation_matrix().into_inner();
        let turned_m = source.ends_m.map(|end_m| rotation * end_m.coords);
        let ends_m = turned_m.map(|turned_m| Point3::from(turned_m + target_from_source.translation.vector));
        Self { source, rotation, turned_m, ends_m }
    }

    /// Whether the line's image runs the same way as a segment, where both are in front of the camera.
    fn runs_as(&self, target: &LineObservation) -> bool {
        let moment = self.ends_m[0].coords.cross(&self.ends_m[1].coords);
        let [start, end] = target.ends;
        // The image line m.u = 0 runs along (m_y, -m_x) from the first end to the second.
        (end.x - start.x) * moment.y - (end.y - start.y) * moment.x > 0.0
    }

    /// Derivatives by the pose and the covariance, from those by the two moved end points.
    fn carry(
        &self,
        residual: Vector4<f64>,
        d_residual_d_ends: SMatrix<f64, 4, 6>,
        own_covariance: &Matrix4<f64>,
    ) -> MatchResidual {
        let mut d_residual_d_pose = Matrix4x6::zeros();
        let mut d_residual_d_source = Matrix4::zeros();
        for (i, by_measurement) in self.source.d_ends_d_measurement().iter().enumerate() {
            // An end moves with its own offset and its own inverse depth alone.
            let by_across = self.rotation * by_measurement.column(i);
            let by_inverse_depth = self.rotation * by_measurement.column(2 + i);
            for row in 0..4 {
                let by_end = d_residual_d_ends.fixed_view::<1, 3>(row, 3 * i).transpose();
                // exp(dr) R X = R X + dr × R X, so the derivative by dr is R X × that by the end.
                let by_turn = self.turned_m[i].cross(&by_end);
                for axis in 0..3 {
                    d_residual_d_pose[(row, axis)] += by_end[axis];
                    d_residual_d_pose[(row, 3 + axis)] += by_turn[axis];
                }
                d_residual_d_source[(row, i)] = by_end.dot(&by_across);
                d_residual_d_source[(row, 2 + i)] = by_end.dot(&by_inverse_depth);
            }
        }
        let covariance =
            own_covariance + d_residual_d_source * self.source.covariance * d_residual_d_source.transpose();
        MatchResidual { residual, d_residual_d_pose, covariance }
    }
}

/// What the target would measure of a line through two points, at the rays of its own segment's ends.
struct Predicted {
    /// Offsets across at start and end (measured minus predicted already), then predicted inverse depths.
    values: Vector4<f64>,
    d_values_d_ends: SMatrix<f64, 4, 6>,
}

impl Predicted {
    fn new(ends_m: &[Point3<f64>; 2], target: &LineObservation) -> Option<Self> {
        let [a, b] = [ends_m[0].coords, ends_m[1].coords];
        let moment = a.cross(&b);
        let extent = b - a;
        let image_norm = moment.xy().norm();
        let moment_norm2 = moment.norm_squared();
        // 1 mm of distance from the centre: below it the image line is noise.
        if moment_norm2 < 1e-6 * extent.norm_squared() || image_norm < 1e-6 * moment_norm2.sqrt() {
            return None;
        }
        let normal = Vector3::new(moment.x / image_norm, moment.y / image_norm, 0.0);
        let reject_normal =
            Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0)) - normal * normal.transpose();
        let d_moment_d_ends = [-hat(&b), hat(&a)];
        let mut values = Vector4::zeros();
        let mut d_values_d_ends = SMatrix::<f64, 4, 6>::zeros();
        for i in 0..2 {
            let ray = Vector3::new(target.ends[i].x, target.ends[i].y, 1.0);
            // e = m.u / |m_xy|
            let offset = moment.dot(&ray) / image_norm;
            let d_offset_d_moment = (ray - normal * offset) / image_norm;
            // The foot of the ray on the predicted image line, v = u - e n, and q = v.(D × m) / |m|².
            let foot = ray - normal * offset;
            let d_foot_d_moment =
                -(normal * d_offset_d_moment.transpose()) - reject_normal * (offset / image_norm);
            let normal_to_both = extent.cross(&moment) / moment_norm2;
            let inverse_depth = foot.dot(&normal_to_both);
            let d_inverse_d_moment = d_foot_d_moment.transpose() * normal_to_both
                + foot.cross(&extent) / moment_norm2
                - moment * (2.0 * inverse_depth / moment_norm2);
            let d_inverse_d_extent = moment.cross(&foot) / moment_norm2;
            values[i] = offset;
            values[2 + i] = inverse_depth;
            for (end, d_moment_d_end) in d_moment_d_ends.iter().enumerate() {
                let sign = if end == 0 { -1.0 } else { 1.0 };
                let by_offset = d_offset_d_moment.transpose() * d_moment_d_end;
                let by_inverse =
                    d_inverse_d_moment.transpose() * d_moment_d_end + d_inverse_d_extent.transpose() * sign;
                d_values_d_ends.fixed_view_mut::<1, 3>(i, 3 * end).copy_from(&by_offset);
                d_values_d_ends.fixed_view_mut::<1, 3>(2 + i, 3 * end).copy_from(&by_inverse);
            }
        }
        Some(Self { values, d_values_d_ends })
    }
}

#[cfg(test)]
pub(super) mod tests;
