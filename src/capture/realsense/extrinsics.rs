//! Where the depth imager stands beside the colour camera, and how the accelerometer is turned, from the numbers of the SDK.

use nalgebra::{Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::capture::recording::check_housing;
use crate::geometry::motion::Motion;

/// How far a matrix may be from a rotation, per entry of `RᵀR`: single precision leaves 1e-6.
const MAX_SKEWNESS: f64 = 1e-3;

/// The motion with this rotation, column-major, and translation, m.
///
/// # Errors
/// When they are no motion, or not one of two imagers of one camera.
pub fn color_from_depth(rotation: [f32; 9], translation: [f32; 3]) -> Result<Motion, String> {
    let translation = Vector3::from(translation.map(f64::from));
    let found = self::rotation(rotation).filter(|_| translation.norm().is_finite());
    let rotation = found.ok_or_else(|| {
        format!(
            "the extrinsics from depth to colour are no motion: rotation {rotation:?}, translation {:?}",
            translation.as_slice()
        )
    })?;
    let motion = Motion::from_parts(Translation3::from(translation), rotation);
    check_housing(&motion)?;
    Ok(motion)
}

/// The rotation with this matrix, column-major; `None` where it is none.
pub fn rotation(matrix: [f32; 9]) -> Option<UnitQuaternion<f64>> {
    let matrix = Matrix3::from_column_slice(&matrix.map(f64::from));
    let skewness = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    let is_rotation = skewness <= MAX_SKEWNESS && matrix.determinant() > 0.0;
    is_rotation.then(|| UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&matrix)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    #[test]
    fn the_matrix_is_read_by_columns() {
        // 0.1 rad about z: x turns towards y.
        let (sin, cos) = (0.1f32.sin(), 0.1f32.cos());
        let rotation = [cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0];
        let motion = color_from_depth(rotation, [0.015, 0.0, 0.0]).expect("a rotation");
        let point = motion * Point3::new(1.0, 0.0, 2.0);
        let expected = Point3::new(f64::from(cos) + 0.015, f64::from(sin), 2.0);
        assert!((point - expected).norm() < 1e-6, "{point}");
    }

    #[test]
    fn a_sensor_may_be_turned_any_way_but_not_mirrored() {
        // A quarter turn about z, which no two imagers of a camera are turned by.
        let turned = rotation([0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0]).expect("a rotation");
        assert!((turned * Vector3::x() - Vector3::y()).norm() < 1e-12);
        assert_eq!(rotation([-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]), None);
        assert_eq!(rotation([f32::NAN; 9]), None);
    }

    #[test]
    fn what_is_no_rotation_or_no_housing_is_refused() {
        const UNIT: [f32; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        // A quarter turn about z.
        const TURNED: [f32; 9] = [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        let color_from_depth = |rotation, translation| color_from_depth(rotation, translation).ok();
        assert!(color_from_depth(UNIT, [0.015, 0.0, 0.0]).is_some());
        assert!(color_from_depth(TURNED, [0.015, 0.0, 0.0]).is_none(), "as a recording with it is refused");
        assert!(color_from_depth(UNIT.map(|value| -value), [0.0; 3]).is_none(), "a mirror");
        assert!(color_from_depth([0.0; 9], [0.0; 3]).is_none(), "never set");
        assert!(color_from_depth(UNIT.map(|value| 1.01 * value), [0.0; 3]).is_none());
        assert!(color_from_depth(UNIT, [0.6, 0.0, 0.0]).is_none());
        assert!(color_from_depth(UNIT, [f32::NAN, 0.0, 0.0]).is_none());
        assert!(color_from_depth([f32::NAN; 9], [0.0; 3]).is_none());
    }
}
