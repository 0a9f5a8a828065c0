//! A recording read by the SDK and the same file read without it: the same frames, the same calibration.

use pelical::capture::recording::Recording;
use pelical::capture::{DeviceFactory, RgbdFrame};
use pelical::geometry::motion::rotation_gap_rad;
use tempfile::tempdir;

use crate::scenes::{N_FRAMES, SERIALS, all_frames, factory, two_cameras};

#[test]
fn the_sdk_and_the_reader_without_it_give_the_same_bytes_stamps_and_turns() {
    let folder = tempdir().unwrap();
    let paths = two_cameras(folder.path());
    let factory = factory(&paths);
    for (serial, path) in SERIALS.into_iter().zip(&paths) {
        let by_sdk = all_frames(&factory, serial);
        let recording = Recording::open(path).unwrap();
        // The SDK may lose what the recorder was warmed up with, which stands in front.
        let n_common = by_sdk.len().min(recording.frame_sets().len());
        assert!(n_common >= N_FRAMES, "{n_common} frames");
        let sets = recording.frame_sets().iter().rev().take(n_common);
        for (set, theirs) in sets.zip(by_sdk.iter().rev()) {
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
            assert_eq!(ours.depth_unit_m, theirs.depth_unit_m);
        }
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
        assert_eq!(ours.translation, theirs.translation);
        assert!(rotation_gap_rad(&ours, &theirs) < 1e-6, "{ours} {theirs}");
    }
}
