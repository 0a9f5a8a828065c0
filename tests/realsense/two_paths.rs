//! A recording read by the SDK and the same file read without it: the same frames, the same calibration.

use std::path::Path;
use std::slice::Iter;

use pelical::capture::recording::Recording;
use pelical::capture::{CaptureError, DeviceFactory, RgbdFrame};
use pelical::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use pelical::pipeline::PipelineOptions;
use pelical::pipeline::offline::{FrameSetReader, run_offline};
use pelical::solver::{RigCamera, State};
use tempfile::tempdir;

use crate::recorder::{Script, record};
use crate::scenes::{N_FRAMES, SERIALS, all_frames, factory, script, stamp_ms, two_cameras};

/// Fails unless both give the same frames of this camera, and as many as were recorded.
#[track_caller]
fn check_same_frames(serial: &str, path: &Path) {
    let by_sdk = all_frames(&factory(&[path.to_owned()]), serial);
    let recording = Recording::open(path).unwrap();
    // The SDK may lose what the recorder was warmed up with, which stands in front.
    let n_common = by_sdk.len().min(recording.frame_sets().len());
    assert!(n_common >= N_FRAMES, "{n_common} frames");
    let sets = recording.frame_sets().iter().rev().take(n_common);
    for (number, (set, theirs)) in sets.zip(by_sdk.iter().rev()).enumerate() {
        let mut ours = RgbdFrame::default();
        recording.read_frame(0, set[0], &mut ours).unwrap();
        assert_eq!(ours.stamp, theirs.stamp);
        assert_eq!((ours.width, ours.height), (theirs.width, theirs.height));
        assert_eq!(ours.rgb, theirs.rgb, "{serial} at {:?}", ours.stamp);
        assert_eq!(ours.depth, theirs.depth, "{serial} at {:?}", ours.stamp);
        // What the recorder was warmed up with has no samples; summed in another order, the last bit of a norm may differ.
        let rates =
            [&ours, theirs].map(|frame| frame.turn_rate.map(|rate| (rate.max_rad_per_s * 1e9).round()));
        assert_eq!(rates[0], rates[1], "{serial} at {:?}", ours.stamp);
        let forces = [&ours, theirs].map(|frame| frame.specific_force.map(|force| force.mean_m_per_s2));
        match forces {
            [Some(ours_m_per_s2), Some(theirs_m_per_s2)] => {
                // The file has a quaternion, of which the SDK makes a matrix of single precision.
                let gap_m_per_s2 = (ours_m_per_s2 - theirs_m_per_s2).norm();
                assert!(gap_m_per_s2 < 1e-5, "{serial} at {:?}: {gap_m_per_s2}", ours.stamp);
            }
            // What the recorder was warmed up with comes last here.
            _ => {
                assert!(forces == [None; 2] && number >= N_FRAMES, "{serial} at {:?}: {forces:?}", ours.stamp)
            }
        }
        assert_eq!(ours.depth_unit_m, theirs.depth_unit_m);
    }
}

#[test]
fn the_sdk_and_the_reader_without_it_give_the_same_bytes_stamps_turns_and_forces() {
    let folder = tempdir().unwrap();
    for (serial, path) in SERIALS.into_iter().zip(&two_cameras(folder.path())) {
        check_same_frames(serial, path);
    }
}

#[test]
fn depth_that_is_late_by_less_than_half_a_frame_is_paired_by_both_at_every_rate() {
    let folder = tempdir().unwrap();
    // More than half a frame of any faster stream, and of either side.
    for (rate_hz, depth_late_ms) in [(15, 25.0), (15, -30.0), (6, 80.0), (60, 5.0)] {
        let path = folder.path().join(format!("{rate_hz}hz{depth_late_ms}.bag"));
        let mut script = Script { rate_hz, depth_late_ms, ..script(SERIALS[0], 0) };
        for (number, moment) in script.frames.iter_mut().enumerate() {
            let shift_ms = 1000.0 / f64::from(rate_hz) * number as f64 - (stamp_ms(number) - stamp_ms(0));
            moment.stamp_ms += shift_ms;
            moment.gyro.iter_mut().chain(&mut moment.accel).for_each(|(stamp_ms, _)| *stamp_ms += shift_ms);
        }
        record(&script, &path);
        check_same_frames(SERIALS[0], &path);
    }
}

#[test]
fn the_sdk_and_the_reader_without_it_give_the_same_calibration_of_the_device() {
    let folder = tempdir().unwrap();
    let paths = two_cameras(folder.path());
    let by_sdk = factory(&paths).list().unwrap();
    let ours = Recording::open_all(&paths).unwrap();
    assert_eq!(ours.cameras().len(), by_sdk.len());
    for (ours, theirs) in ours.cameras().iter().zip(&by_sdk) {
        assert_eq!((&ours.serial, &ours.firmware), (&theirs.serial, &theirs.firmware));
        assert_eq!((ours.camera, ours.depth_unit_m), (theirs.camera, theirs.depth_unit_m));
        let (ours, theirs) = (ours.depth_camera.unwrap(), theirs.depth_camera.unwrap());
        assert_eq!(ours.camera, theirs.camera);
        // The file has a quaternion, of which the SDK makes a matrix of single precision.
        let (ours, theirs) = (ours.color_from_depth, theirs.color_from_depth);
        assert!(translation_gap_m(&ours, &theirs) < 1e-8, "{ours} {theirs}");
        assert!(rotation_gap_rad(&ours, &theirs) < 1e-6, "{ours} {theirs}");
    }
}

/// Frame sets that were read before.
struct Sets<'a>(Iter<'a, Vec<RgbdFrame>>);

impl FrameSetReader for Sets<'_> {
    fn next_set(&mut self, frames: &mut [RgbdFrame]) -> Result<bool, CaptureError> {
        let Some(set) = self.0.next() else { return Ok(false) };
        frames.clone_from_slice(set);
        Ok(true)
    }
}

/// Where the right camera is, in the left one.
fn calibrated(sets: &[Vec<RgbdFrame>], rig: &[RigCamera]) -> Motion {
    let run = run_offline(&mut Sets(sets.iter()), rig, &PipelineOptions::default(), &mut |_| {}).unwrap();
    assert_eq!(run.calibration.state, State::Converged, "{:?}", run.calibration.reason);
    run.calibration.cameras[1].as_ref().unwrap().reference_from_camera
}

#[test]
fn the_sdk_and_the_reader_without_it_come_to_the_same_calibration_of_the_rig() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/bags/pair");
    let paths = ["left.bag", "right.bag"].map(|name| folder.join(name));
    let recording = Recording::open_all(&paths).unwrap();
    let factory = factory(&paths);
    let by_sdk: Vec<Vec<RgbdFrame>> =
        recording.cameras().iter().map(|info| all_frames(&factory, &info.serial)).collect();
    let (mut ours, mut theirs) = (Vec::new(), Vec::new());
    for stamps in recording.frame_sets() {
        let played = stamps.iter().zip(&by_sdk).map(|(stamp, frames)| {
            // The SDK may lose the first frames, and counts in milliseconds of double precision.
            frames.iter().find(|frame| frame.stamp.0.abs_diff(stamp.0) < 1000).cloned()
        });
        let Some(played) = played.collect::<Option<Vec<_>>>() else { continue };
        let read = |(camera, stamp)| {
            let mut frame = RgbdFrame::default();
            recording.read_frame(camera, stamp, &mut frame).map(|()| frame)
        };
        ours.push(stamps.iter().copied().enumerate().map(read).collect::<Result<Vec<_>, _>>().unwrap());
        theirs.push(played);
    }
    assert!(ours.len() >= 3, "{} sets in common", ours.len());
    let rig = |infos: &[pelical::capture::CameraInfo]| -> Vec<RigCamera> {
        infos.iter().map(|info| RigCamera { name: info.name.clone(), camera: info.camera }).collect()
    };
    let ours = calibrated(&ours, &rig(recording.cameras()));
    let theirs = calibrated(&theirs, &rig(&factory.list().unwrap()));
    // The rotation of depth to colour differs in the last bits of single precision.
    assert!(rotation_gap_rad(&ours, &theirs) < 1e-5, "{ours} {theirs}");
    assert!(translation_gap_m(&ours, &theirs) < 1e-5, "{ours} {theirs}");
}
