//! The paper's errors of change: how well a step of protractor or ruler is seen (paper, section IV-A).
//!
//! Euler angles are about x, y, z with the yaw about y outermost (`R = Ry Rx Rz`): their singularity is then a camera that looks
//! straight up or down, and no configuration of the paper comes near it. The paper does not name its convention.

use nalgebra::{UnitQuaternion, Vector3};

use crate::geometry::motion::Motion;

/// Pitch, yaw and roll, deg: angles about x, y and z with `R = Ry(yaw) Rx(pitch) Rz(roll)`.
pub fn euler_deg(rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    let r = rotation.to_rotation_matrix();
    let pitch = (-r[(1, 2)]).clamp(-1.0, 1.0).asin();
    let yaw = r[(0, 2)].atan2(r[(2, 2)]);
    let roll = r[(1, 0)].atan2(r[(1, 1)]);
    Vector3::new(pitch, yaw, roll).map(f64::to_degrees)
}

/// `|(theta_2 - theta_1) - (0, step, 0)|`, deg.
pub fn rotation_change_error_deg([first, second]: [&Motion; 2], step_deg: f64) -> f64 {
    let change = euler_deg(&second.rotation) - euler_deg(&first.rotation) - Vector3::new(0.0, step_deg, 0.0);
    // Angles may have gone once around.
    change.map(|angle_deg| angle_deg - 360.0 * (angle_deg / 360.0).round()).norm()
}

/// `| |X_2 - X_1| - step |`, mm.
pub fn distance_change_error_mm([first, second]: [&Motion; 2], step_mm: f64) -> f64 {
    let moved_m = (second.translation.vector - first.translation.vector).norm();
    (moved_m * 1e3 - step_mm).abs()
}

#[cfg(test)]
mod tests {
    use nalgebra::Translation3;

    use super::*;

    /// Yaw outermost, then pitch, then roll.
    fn pose(at_m: [f64; 3], [pitch, yaw, roll]: [f64; 3]) -> Motion {
        let about = |axis, angle_deg: f64| UnitQuaternion::from_axis_angle(&axis, angle_deg.to_radians());
        let rotation =
            about(Vector3::y_axis(), yaw) * about(Vector3::x_axis(), pitch) * about(Vector3::z_axis(), roll);
        Motion::from_parts(Translation3::from(Vector3::from(at_m)), rotation)
    }

    #[test]
    fn euler_angles_are_those_the_rotation_was_made_of() {
        for angles_deg in [[0.0, 80.0, 0.0], [3.0, 61.0, -2.0], [-20.0, 179.0, 45.0]] {
            let found = euler_deg(&pose([0.0; 3], angles_deg).rotation);
            assert!((found - Vector3::from(angles_deg)).norm() < 1e-9, "{found} for {angles_deg:?}");
        }
    }

    #[test]
    fn the_rotation_error_is_what_is_left_of_the_three_angles() {
        // Changes by (0.3, 20 - 0.4, 1.2): the error is |(0.3, -0.4, 1.2)| = 1.3.
        let (first, second) = (pose([0.0; 3], [0.1, 40.1, -0.2]), pose([0.0; 3], [0.4, 59.7, 1.0]));
        assert!((rotation_change_error_deg([&first, &second], 20.0) - 1.3).abs() < 1e-9);
    }

    #[test]
    fn a_turn_past_half_a_turn_is_no_error() {
        let (first, second) = (pose([0.0; 3], [0.0, 170.0, 0.0]), pose([0.0; 3], [0.0, -170.0, 0.0]));
        assert!(rotation_change_error_deg([&first, &second], 20.0) < 1e-9);
    }

    #[test]
    fn the_distance_error_is_the_length_of_the_step_less_the_nominal_one() {
        // A step of (48, 14, 0) mm is 50 mm long, one of (51, 0, 0) mm 1 mm too long.
        let at = |x_mm: f64, y_mm: f64| pose([0.2 + x_mm / 1e3, y_mm / 1e3, 0.01], [0.0; 3]);
        assert!(distance_change_error_mm([&at(0.0, 0.0), &at(48.0, 14.0)], 50.0) < 1e-9);
        assert!((distance_change_error_mm([&at(0.0, 0.0), &at(51.0, 0.0)], 50.0) - 1.0).abs() < 1e-9);
    }
}
