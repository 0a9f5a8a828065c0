//! Places and directions in words: nobody should have to know which way y points to check a result by eye.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::document::MotionEntry;

/// Below this a direction is not worth a word, mm and deg.
const NOTHING: f64 = 0.05;

/// Where a camera is as seen from the reference: "203.1 mm right, 0.6 mm up".
pub fn position(reference_from_camera: &MotionEntry) -> String {
    let [x, y, z] = reference_from_camera.translation_m.map(|value| value * 1e3);
    let parts =
        [side(x, ["right", "left"], "mm"), side(y, ["down", "up"], "mm"), side(z, ["forward", "back"], "mm")];
    joined(&parts, "at the reference")
}

/// How a camera is turned against the reference: "60.1 deg to the right, 0.4 deg up".
///
/// The angles are those of `R = Ry(yaw) Rx(pitch) Rz(roll)`: pan first, then tilt, then roll about the viewing axis.
pub fn orientation(reference_from_camera: &MotionEntry) -> String {
    let [x, y, z, w] = reference_from_camera.rotation_xyzw;
    let reference_from_camera = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
    let forward = reference_from_camera * Vector3::z();
    let (right, down) = (reference_from_camera * Vector3::x(), reference_from_camera * Vector3::y());
    let yaw = forward.x.atan2(forward.z).to_degrees();
    let pitch = (-forward.y).clamp(-1.0, 1.0).asin().to_degrees();
    let roll = right.y.atan2(down.y).to_degrees();
    let parts = [
        side(yaw, ["to the right", "to the left"], "deg"),
        side(pitch, ["up", "down"], "deg"),
        side(roll, ["rolled clockwise", "rolled counter-clockwise"], "deg"),
    ];
    joined(&parts, "as the reference")
}

fn side(value: f64, [positive, negative]: [&str; 2], unit: &str) -> Option<String> {
    (value.abs() >= NOTHING)
        .then(|| format!("{:.1} {unit} {}", value.abs(), if value > 0.0 { positive } else { negative }))
}

fn joined(parts: &[Option<String>], nothing: &str) -> String {
    let said: Vec<&str> = parts.iter().filter_map(|part| part.as_deref()).collect();
    if said.is_empty() { nothing.to_owned() } else { said.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(axis: Vector3<f64>, angle_deg: f64) -> String {
        let rotation = UnitQuaternion::from_scaled_axis(axis * angle_deg.to_radians()).coords;
        let rotation_xyzw = [rotation.x, rotation.y, rotation.z, rotation.w];
        orientation(&MotionEntry { translation_m: [0.0; 3], rotation_xyzw })
    }

    #[test]
    fn turns_about_each_axis_have_their_words() {
        // Optical frame: x right, y down, z forward; a turn about y carries z towards x.
        assert_eq!(turned(Vector3::y(), 60.0), "60.0 deg to the right");
        assert_eq!(turned(Vector3::y(), -120.0), "120.0 deg to the left");
        assert_eq!(turned(Vector3::x(), 5.0), "5.0 deg up");
        assert_eq!(turned(Vector3::z(), -90.0), "90.0 deg rolled counter-clockwise");
        assert_eq!(turned(Vector3::z(), 0.0), "as the reference");
    }

    #[test]
    fn places_have_their_words() {
        let at =
            |translation_m| position(&MotionEntry { translation_m, rotation_xyzw: [0.0, 0.0, 0.0, 1.0] });
        assert_eq!(at([0.2031, -0.0006, 0.0]), "203.1 mm right, 0.6 mm up");
        assert_eq!(at([-0.1, 0.02, -0.5]), "100.0 mm left, 20.0 mm down, 500.0 mm back");
        assert_eq!(at([0.0; 3]), "at the reference");
    }
}
