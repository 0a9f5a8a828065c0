//! Rigid motions: how far two are apart, and small updates of one.

use nalgebra::{Isometry3, Matrix3, Matrix6, Translation3, UnitQuaternion, Vector3, Vector6};

/// A rigid motion `to_from_from`; the direction is in the variable's name.
pub type Motion = Isometry3<f64>;

/// Angle of the relative rotation, rad, accurate down to 1e-12.
pub fn rotation_gap_rad(a: &Motion, b: &Motion) -> f64 {
    a.rotation.angle_to(&b.rotation)
}

/// Length of the difference of the translations, m.
pub fn translation_gap_m(a: &Motion, b: &Motion) -> f64 {
    (a.translation.vector - b.translation.vector).norm()
}

/// `R <- exp(rotation) R`, `t <- t + translation`; the step is ordered x y z rx ry rz.
pub fn updated(to_from_from: &Motion, step: &Vector6<f64>) -> Motion {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::new(step[3], step[4], step[5]));
    let translation = to_from_from.translation.vector + Vector3::new(step[0], step[1], step[2]);
    Motion::from_parts(
        Translation3::from(translation),
        UnitQuaternion::new_normalize((rotation * to_from_from.rotation).into_inner()),
    )
}

/// How a step of the inverse motion follows from a step of the motion (see [`updated`]).
///
/// `R' = Rᵀ` and `t' = -Rᵀ t`: a turn `exp(dr) R` turns the inverse by `-Rᵀ dr`, and with `t + dt` moves it by
/// `-Rᵀ dt - Rᵀ [t]x dr`.
pub fn d_inverse_step_d_step(motion: &Motion) -> Matrix6<f64> {
    let turn_back = -motion.rotation.inverse().to_rotation_matrix().into_inner();
    let mut derivative = Matrix6::zeros();
    derivative.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn_back);
    derivative.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn_back);
    derivative.fixed_view_mut::<3, 3>(0, 3).copy_from(&(turn_back * hat(&motion.translation.vector)));
    derivative
}

/// The matrix `[v]x` with `[v]x w = v × w`.
pub fn hat(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

/// Two unit vectors that make a right-handed orthonormal frame with the unit vector `axis`.
pub fn normal_basis(axis: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    // The coordinate axis least aligned with `axis` keeps the cross product long.
    let helper = match axis.iamin() {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    let first = axis.cross(&helper).normalize();
    (first, axis.cross(&first))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_update_of_a_degree_turns_by_a_degree() {
        let start = Motion::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(0.4, -0.2, 0.9));
        let step = Vector6::new(0.0, 0.003, 0.004, 1f64.to_radians(), 0.0, 0.0);
        let end = updated(&start, &step);
        assert!((rotation_gap_rad(&start, &end) - 1f64.to_radians()).abs() < 1e-12);
        assert!((translation_gap_m(&start, &end) - 0.005).abs() < 1e-12);
    }

    #[test]
    fn the_step_of_the_inverse_follows_from_the_step() {
        let motion = Motion::new(Vector3::new(0.3, -0.2, 0.5), Vector3::new(0.4, -0.9, 0.2));
        let by_step = d_inverse_step_d_step(&motion);
        for axis in 0..6 {
            let mut step = Vector6::zeros();
            step[axis] = 1e-7;
            let moved = updated(&motion, &step).inverse();
            let expected = updated(&motion.inverse(), &(by_step * step));
            assert!(
                translation_gap_m(&moved, &expected) < 1e-12 && rotation_gap_rad(&moved, &expected) < 1e-12
            );
        }
    }

    #[test]
    fn hat_is_the_cross_product() {
        let (v, w) = (Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.3, 4.0, -1.0));
        assert!((hat(&v) * w - v.cross(&w)).norm() < 1e-15);
    }

    #[test]
    fn the_normal_basis_is_orthonormal_and_right_handed() {
        for axis in [Vector3::x(), Vector3::y(), -Vector3::z(), Vector3::new(1.0, 2.0, -3.0).normalize()] {
            let (a, b) = normal_basis(&axis);
            assert!((a.cross(&b) - axis).norm() < 1e-12 && a.dot(&axis).abs() < 1e-12);
        }
    }
}
