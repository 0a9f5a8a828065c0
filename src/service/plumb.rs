//! Compares where a calibration puts the cameras with where each of them feels up: a check that knows nothing of lines. It sees roll and
//! pitch about gravity only, and an accelerometer that is not calibrated is off by 1 to 3 deg: it is shown and decides nothing.

use nalgebra::Vector3;

use crate::geometry::motion::Motion;
use crate::pipeline::{CameraSnapshot, CameraState, Snapshot};
use crate::solver::RigCalibration;

/// deg; from here on a camera is warned of, until it is back below half.
const WARN_DEG: f64 = 5.0;

/// What is remembered of it.
#[derive(Debug, Default)]
pub struct PlumbTeller {
    /// By camera, whether it was warned of.
    is_told: Vec<bool>,
}

impl PlumbTeller {
    /// How far apart up is for each camera and for the reference camera, deg, by a calibration; `None` where one of them has no place, no
    /// frames, or no word of its accelerometer. Warns of who is far off, once.
    pub fn look(&mut self, pipeline: &Snapshot, served: Option<&RigCalibration>) -> Vec<Option<f64>> {
        let off_deg =
            served.map_or_else(|| vec![None; pipeline.cameras.len()], |served| angles(pipeline, served));
        self.is_told.resize(off_deg.len(), false);
        for ((camera, off_deg), is_told) in pipeline.cameras.iter().zip(&off_deg).zip(&mut self.is_told) {
            let Some(off_deg) = *off_deg else { continue };
            let limit_deg = if *is_told { 0.5 * WARN_DEG } else { WARN_DEG };
            let is_off = off_deg > limit_deg;
            if is_off && !*is_told {
                warn(&camera.name, off_deg);
            }
            *is_told = is_off;
        }
        off_deg
    }
}

fn warn(camera: &str, off_deg: f64) {
    let off_deg = (10.0 * off_deg).round() / 10.0;
    tracing::warn!(
        camera,
        off_deg,
        "gravity contradicts the published extrinsics: either the camera was moved or the calibration is wrong (compare with `pelical status` \
         and `pelical recalibrate`), or an accelerometer, its own or the reference camera's, is not calibrated (calibrate it with the \
         maker's tool)"
    );
}

fn angles(pipeline: &Snapshot, served: &RigCalibration) -> Vec<Option<f64>> {
    let felt = |camera: &CameraSnapshot| {
        let is_there = camera.state == CameraState::Streaming;
        camera.frame_health.up_m_per_s2.filter(|_| is_there)
    };
    let place = |camera: usize| Some(served.cameras.get(camera)?.as_ref()?.reference_from_camera);
    let reference_up = || {
        place(served.reference)?;
        felt(pipeline.cameras.get(served.reference)?)
    };
    let reference_up = reference_up();
    let angle = |(number, camera): (usize, &CameraSnapshot)| {
        Some(off_deg(&reference_up?, &place(number)?, &felt(camera)?))
    };
    pipeline.cameras.iter().enumerate().map(angle).collect()
}

/// The angle between up in the reference camera and up in another one, turned into the reference camera's axes.
fn off_deg(reference_up: &Vector3<f64>, reference_from_camera: &Motion, up: &Vector3<f64>) -> f64 {
    reference_up.angle(&(reference_from_camera.rotation * up)).to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::FrameHealth;
    use crate::solver::{CameraPose, State};
    use nalgebra::{Matrix6, UnitQuaternion};

    const UP: Vector3<f64> = Vector3::new(0.0, -9.81, 0.0);

    fn turned(axis: Vector3<f64>, deg: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_scaled_axis(deg.to_radians() * axis)
    }

    /// A pair whose right camera looks 60 deg to the right, with what is wrong in the calibration, before and by the reference's axes.
    fn rig(wrong: UnitQuaternion<f64>) -> (Snapshot, RigCalibration) {
        let true_rotation = turned(Vector3::y(), 60.0) * turned(Vector3::z(), 10.0);
        let camera = |name: &str, up| CameraSnapshot {
            name: name.to_owned(),
            state: CameraState::Streaming,
            frames: 9,
            dropped: 0,
            last_frame_age: None,
            frame_health: FrameHealth { up_m_per_s2: Some(up), ..FrameHealth::default() },
            firmware: None,
        };
        let cameras = vec![camera("left", UP), camera("right", true_rotation.inverse() * UP)];
        let pose = |rotation| {
            let reference_from_camera = Motion::from_parts([0.3, 0.0, 0.0].into(), rotation);
            Some(CameraPose { reference_from_camera, covariance: Matrix6::zeros() })
        };
        let calibration = RigCalibration {
            state: State::Converged,
            reason: None,
            reference: 0,
            cameras: vec![pose(UnitQuaternion::identity()), pose(wrong * true_rotation)],
            pairs: Vec::new(),
            frame_sets_used: 12,
        };
        (Snapshot { cameras, ..Snapshot::default() }, calibration)
    }

    fn right_deg(wrong: UnitQuaternion<f64>) -> f64 {
        let (snapshot, calibration) = rig(wrong);
        PlumbTeller::default().look(&snapshot, Some(&calibration))[1].expect("both are known")
    }

    #[test]
    fn a_wrong_turn_about_a_horizontal_axis_shows_and_one_about_the_vertical_does_not() {
        assert!((right_deg(turned(Vector3::x(), 4.0)) - 4.0).abs() < 1e-9);
        assert!((right_deg(turned(Vector3::z(), -4.0)) - 4.0).abs() < 1e-9);
        assert!(right_deg(turned(Vector3::y(), 4.0)) < 1e-5);
        assert!(right_deg(UnitQuaternion::identity()) < 1e-5);
    }

    #[test]
    fn nothing_is_said_where_a_place_a_camera_or_its_accelerometer_is_missing() {
        let look = |change: fn(&mut Snapshot, &mut RigCalibration)| {
            let (mut snapshot, mut calibration) = rig(UnitQuaternion::identity());
            change(&mut snapshot, &mut calibration);
            let off_deg = PlumbTeller::default().look(&snapshot, Some(&calibration));
            [off_deg[0], off_deg[1]].map(|off_deg| off_deg.is_some())
        };
        assert_eq!(look(|_, _| {}), [true, true]);
        assert_eq!(look(|_, calibration| calibration.cameras[1] = None), [true, false]);
        assert_eq!(look(|snapshot, _| snapshot.cameras[1].state = CameraState::Unplugged), [true, false]);
        assert_eq!(look(|snapshot, _| snapshot.cameras[1].frame_health.up_m_per_s2 = None), [true, false]);
        assert_eq!(look(|snapshot, _| snapshot.cameras[0].frame_health.up_m_per_s2 = None), [false, false]);
        let (snapshot, _) = rig(UnitQuaternion::identity());
        assert_eq!(PlumbTeller::default().look(&snapshot, None), [None, None]);
    }

    #[test]
    fn a_camera_is_warned_of_once_until_it_is_back_below_half() {
        let mut teller = PlumbTeller::default();
        let told = [4.9, 5.1, 4.0, 6.0, 2.0, 4.0, 5.5].map(|deg| {
            let (snapshot, calibration) = rig(turned(Vector3::x(), deg));
            let was_told = teller.is_told.get(1).copied().unwrap_or(false);
            teller.look(&snapshot, Some(&calibration));
            teller.is_told[1] && !was_told
        });
        assert_eq!(told, [false, true, false, false, false, false, true]);
    }
}
