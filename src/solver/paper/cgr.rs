//! Rotations by their Cayley-Gibbs-Rodrigues vector (paper, eq. 3 corrected), and what to do about half turns, which have none.
//!
//! s is the rotation's axis times the tangent of half its angle: the unit quaternion's (x, y, z) / w. Around the half turn the
//! source lines are turned first, by one of four fixed rotations.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::geometry::motion::hat;

/// `R = ((1 - s.s) I + 2 [s]x + 2 s s^T) / (1 + s.s)`. The paper's eq. 3 prints s^T s, a number, for the last matrix s s^T.
pub fn rotation_from_cgr(s: &Vector3<f64>) -> Rotation3<f64> {
    let norm2 = s.norm_squared();
    let matrix = Matrix3::identity() * (1.0 - norm2) + hat(s) * 2.0 + s * s.transpose() * 2.0;
    Rotation3::from_matrix_unchecked(matrix / (1.0 + norm2))
}

/// Four rotations `turned_from_source`, none and the half turns about x, y and z. With source lines turned by the right
/// one of them any rotation `target_from_source = target_from_turned * turned_from_source` is left with
/// |s| <= sqrt(3), i.e. at most 120 degrees: the largest of a unit quaternion's four entries is at least one half.
pub fn pre_rotations() -> [Rotation3<f64>; 4] {
    [[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
        .map(|diagonal| Rotation3::from_matrix_unchecked(Matrix3::from_diagonal(&diagonal.into())))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::paper::tests::scenes::cgr_of;
    use crate::solver::tests::room::Random;

    #[test]
    fn a_rotation_comes_back_from_its_vector() {
        let mut random = Random::named("cgr");
        for _ in 0..200 {
            let rotation = random.rotation().to_rotation_matrix();
            let s = cgr_of(&rotation).expect("no half turn");
            assert!((rotation_from_cgr(&s).matrix() - rotation.matrix()).amax() < 1e-9 * (1.0 + s.norm()));
        }
    }

    #[test]
    fn s_points_along_the_axis_with_the_tangent_of_half_the_angle() {
        let axis = Vector3::new(1.0, -2.0, 2.0) / 3.0;
        let found = rotation_from_cgr(&(axis * 20_f64.to_radians().tan()));
        let expected = Rotation3::new(axis * 40_f64.to_radians());
        assert!((found.matrix() - expected.matrix()).amax() < 1e-14);
    }

    #[test]
    fn one_of_the_pre_rotations_leaves_at_most_120_degrees() {
        let mut random = Random::named("pre-rotations");
        let half_turn = Rotation3::new(Vector3::new(1.0, 2.0, -2.0) / 3.0 * std::f64::consts::PI);
        let rotations = (0..500).map(|_| random.rotation().to_rotation_matrix()).chain([half_turn]);
        for rotation in rotations {
            let smallest = pre_rotations()
                .iter()
                .filter_map(|turned_from_source| cgr_of(&(rotation * turned_from_source.inverse())))
                .map(|s| s.norm())
                .fold(f64::INFINITY, f64::min);
            assert!(smallest <= 3_f64.sqrt() + 1e-9, "{rotation}: {smallest}");
        }
    }
}
