//! From samples of an accelerometer to the specific force between two frames.

use nalgebra::{UnitQuaternion, Vector3};

use super::waiting::Waiting;
use crate::capture::frame::SpecificForce;

/// Samples of one camera that no frame has taken yet.
#[derive(Debug, Clone)]
pub struct Forces {
    color_from_accel: UnitQuaternion<f64>,
    /// m/s², in the axes of the accelerometer.
    waiting: Waiting<Vector3<f64>>,
}

impl Forces {
    /// Of an accelerometer that is turned against the colour camera like this.
    pub fn new(color_from_accel: UnitQuaternion<f64>) -> Self {
        Self { color_from_accel, waiting: Waiting::default() }
    }

    /// Takes a sample, m/s²; one that is no number is left out.
    pub fn add(&mut self, stamp_ns: i64, m_per_s2: [f32; 3]) {
        if m_per_s2.iter().all(|value| value.is_finite()) {
            self.waiting.add(stamp_ns, Vector3::from(m_per_s2.map(f64::from)));
        }
    }

    /// Whether the samples reach up to this stamp.
    pub fn reaches(&self, stamp_ns: i64) -> bool {
        self.waiting.reaches(stamp_ns)
    }

    /// What the samples up to a frame's stamp say, which are forgotten with it; `None` where there is none.
    pub fn until(&mut self, frame_ns: i64) -> Option<SpecificForce> {
        SpecificForce::mean(self.waiting.until(frame_ns), &self.color_from_accel)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_has_the_mean_since_the_one_before_in_the_axes_of_colour() {
        // Colour is pitched 90 deg against the accelerometer: what that has down, colour has forward.
        let pitch = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
        let mut forces = Forces::new(pitch);
        for (stamp_ns, y) in [(10, -9.0), (20, -10.0), (30, f32::NAN), (40, 4.0)] {
            forces.add(stamp_ns, [0.5, y, 0.0]);
        }
        assert!(forces.reaches(40) && !forces.reaches(41));
        let mut check = |frame_ns, expected: Vector3<f64>| {
            let found = forces.until(frame_ns).expect("samples").mean_m_per_s2;
            assert!((found - expected).norm() < 1e-12, "{found} at {frame_ns}");
        };
        check(30, Vector3::new(0.5, 0.0, -9.5));
        check(45, Vector3::new(0.5, 0.0, 4.0));
        assert_eq!(forces.until(50), None, "nothing was said meanwhile");
    }
}
