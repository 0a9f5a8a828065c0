//! What the writer stores is what the reader finds, also when the writer is killed.

use std::fs;

use nalgebra::Vector3;
use pelical::capture::recording::Recording;
use pelical::capture::writer::{ColorFormat, RecordingWriter};
use pelical::capture::{CameraInfo, RgbdFrame};
use pelical::geometry::camera::Pinhole;
use pelical::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use pelical::geometry::{Camera, DepthCamera, Distortion};
use tempfile::TempDir;

use crate::fixture::Fixture;

fn frame_sets(recording: &Recording) -> Vec<Vec<RgbdFrame>> {
    let read = |(camera_idx, stamp): (usize, &_)| {
        let mut frame = RgbdFrame::default();
        recording.read_frame(camera_idx, *stamp, &mut frame).unwrap();
        frame
    };
    recording.frame_sets().iter().map(|set| set.iter().enumerate().map(read).collect()).collect()
}

fn new_folder() -> (TempDir, std::path::PathBuf) {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("deep/recording");
    (parent, folder)
}

#[test]
fn png_recordings_come_back_bit_for_bit() {
    let fixture = Fixture::new(3);
    let original = fixture.open();
    let sets = frame_sets(&original);
    let (_parent, folder) = new_folder();
    let description = "quotes \" and ' and \\,\nlines: - #";
    let writer = RecordingWriter::create(&folder, original.cameras(), description, "a: b").unwrap();
    let mut writer = writer.with_color_format(ColorFormat::Png);
    for set in &sets {
        writer.write_set(set).unwrap();
    }
    writer.finish().unwrap();
    let copy = Recording::open(&folder).unwrap();
    assert_eq!((copy.description(), copy.source()), (description, "a: b"));
    assert_eq!(copy.cameras(), original.cameras());
    assert_eq!(copy.frame_sets(), original.frame_sets());
    for (read, written) in frame_sets(&copy).iter().flatten().zip(sets.iter().flatten()) {
        assert!(read.rgb == written.rgb && read.depth == written.depth);
        assert_eq!((read.stamp, read.sequence), (written.stamp, written.sequence));
    }
}

#[test]
fn jpeg_recordings_come_back_nearly_alike_with_exact_depth() {
    let fixture = Fixture::new(1);
    let original = fixture.open();
    let sets = frame_sets(&original);
    let (_parent, folder) = new_folder();
    let mut writer = RecordingWriter::create(&folder, original.cameras(), "", "").unwrap();
    writer.write_set(&sets[0]).unwrap();
    writer.finish().unwrap();
    let copy = frame_sets(&Recording::open(&folder).unwrap());
    for (read, written) in copy[0].iter().zip(&sets[0]) {
        assert_eq!(read.depth, written.depth);
        let gaps = read.rgb.iter().zip(&written.rgb).map(|(a, b)| u64::from(a.abs_diff(*b)));
        let mean_gap = gaps.sum::<u64>() as f64 / read.rgb.len() as f64;
        assert!(mean_gap < 4.0, "colour is off by {mean_gap} on average");
    }
}

#[test]
fn every_digit_of_the_intrinsics_survives() {
    let pinhole = Pinhole { fx_px: 1.0 / 3.0 * 1e3, fy_px: 606.1000000000001, cx_px: -1e-9, cy_px: 1e9 };
    let lens = Distortion::BrownConrady { k1: 0.262383, k2: -0.953104, p1: -5.358e-13, p2: 0.0, k3: 1e20 };
    let camera = Camera::try_new((64, 48), pinhole, lens).unwrap();
    let info = CameraInfo {
        name: "väder".into(),
        serial: "007".into(),
        camera,
        depth_camera: None,
        depth_unit_m: 1.25e-5,
        firmware: None,
    };
    let (_parent, folder) = new_folder();
    let mut writer = RecordingWriter::create(&folder, std::slice::from_ref(&info), "", "").unwrap();
    let (rgb, depth) = (vec![7; 3 * 64 * 48], vec![9; 64 * 48]);
    let frame =
        RgbdFrame { width: 64, height: 48, rgb, depth, depth_unit_m: 1.25e-5, ..RgbdFrame::default() };
    writer.write_set(&[frame]).unwrap();
    writer.finish().unwrap();
    assert_eq!(Recording::open(&folder).unwrap().cameras(), [info]);
}

#[test]
fn a_writer_that_is_killed_leaves_a_readable_recording() {
    let fixture = Fixture::new(4);
    let original = fixture.open();
    let sets = frame_sets(&original);
    let (_parent, folder) = new_folder();
    let mut writer = RecordingWriter::create(&folder, original.cameras(), "", "").unwrap();
    for set in &sets {
        writer.write_set(set).unwrap();
    }
    // A killed process runs no destructor.
    std::mem::forget(writer);
    fs::write(folder.join("recording.yaml.tmp"), "half a te").unwrap();
    fs::write(folder.join("left/color/1.jpg"), [0xFF, 0xD8]).unwrap();
    let copy = Recording::open(&folder).unwrap();
    assert_eq!(frame_sets(&copy).len(), copy.frame_sets().len());
    assert!(!copy.frame_sets().is_empty());
    assert_eq!(copy.frame_sets()[0], original.frame_sets()[0]);
}

#[test]
fn nothing_stored_is_overwritten() {
    let fixture = Fixture::new(1);
    let recording = fixture.open();
    let before = fs::read(fixture.path().join("recording.yaml")).unwrap();
    let message =
        RecordingWriter::create(fixture.path(), recording.cameras(), "", "").unwrap_err().to_string();
    assert!(message.contains("not empty") && message.contains("new folder"), "{message}");
    assert_eq!(fs::read(fixture.path().join("recording.yaml")).unwrap(), before);
}

#[test]
fn frames_that_do_not_fit_are_refused_and_the_recording_goes_on() {
    let fixture = Fixture::new(2);
    let original = fixture.open();
    let sets = frame_sets(&original);
    let (_parent, folder) = new_folder();
    let mut writer = RecordingWriter::create(&folder, original.cameras(), "", "").unwrap();
    let refused = |writer: &mut RecordingWriter, set: &[RgbdFrame], word: &str| {
        let message = writer.write_set(set).unwrap_err().to_string();
        assert!(message.contains(word), "{message:?} does not say {word:?}");
    };
    refused(&mut writer, &sets[0][..1], "1 frames for 2 cameras");
    let mut set = sets[0].clone();
    set[1].depth.pop();
    refused(&mut writer, &set, "\"right\"");
    set[1] = RgbdFrame { depth_unit_m: 0.002, ..sets[0][1].clone() };
    refused(&mut writer, &set, "depth unit");
    writer.write_set(&sets[0]).unwrap();
    refused(&mut writer, &sets[0], "stamps increase");
    writer.write_set(&sets[1]).unwrap();
    writer.finish().unwrap();
    assert_eq!(Recording::open(&folder).unwrap().frame_sets(), original.frame_sets());
}

#[test]
fn truth_comes_back_in_the_first_cameras_frame() {
    let fixture = Fixture::new(1);
    let original = fixture.open();
    let (_parent, folder) = new_folder();
    let mut writer = RecordingWriter::create(&folder, original.cameras(), "", "").unwrap();
    writer.write_set(&frame_sets(&original)[0]).unwrap();
    let world_from_left = Motion::new(Vector3::new(1.0, -2.0, 0.3), Vector3::new(0.2, 1.9, -0.4));
    let left_from_right = Motion::new(Vector3::new(0.3, 0.01, -0.02), Vector3::new(0.1, 2.5, 0.05));
    assert!(writer.write_ground_truth(&[world_from_left]).is_err());
    let lost = Motion::translation(f64::NAN, 0.0, 0.0);
    assert!(writer.write_ground_truth(&[world_from_left, lost]).is_err());
    writer.write_ground_truth(&[world_from_left, world_from_left * left_from_right]).unwrap();
    writer.finish().unwrap();
    let truth = Recording::open(&folder).unwrap().ground_truth().unwrap().unwrap();
    for (read, written) in truth.reference_from_camera.iter().zip([Motion::identity(), left_from_right]) {
        assert!(rotation_gap_rad(read, &written) < 1e-12 && translation_gap_m(read, &written) < 1e-12);
    }
}

#[test]
fn a_recording_without_a_frame_set_is_not_passed_off_as_one() {
    let fixture = Fixture::new(1);
    let original = fixture.open();
    let (_parent, folder) = new_folder();
    RecordingWriter::create(&folder, original.cameras(), "", "").unwrap().finish().unwrap();
    assert!(Recording::open(&folder).is_err());
}

#[test]
fn depth_that_is_not_registered_keeps_its_size_and_geometry() {
    let pinhole = Pinhole { fx_px: 60.0, fy_px: 60.0, cx_px: 31.5, cy_px: 23.5 };
    let camera = Camera::try_new((64, 48), pinhole, Distortion::None).unwrap();
    let lens = Distortion::BrownConrady { k1: 0.1, k2: -0.2, p1: 0.001, p2: 0.0, k3: 0.05 };
    let imager = Camera::try_new((40, 32), Pinhole { fx_px: 41.25, ..pinhole }, lens).unwrap();
    let color_from_depth = Motion::translation(-0.0151, 2e-4, 1.0 / 3.0 * 1e-3);
    let depth_camera = Some(DepthCamera { camera: imager, color_from_depth });
    let (name, serial) = ("a".into(), "1".into());
    let info = CameraInfo { name, serial, camera, depth_camera, depth_unit_m: 0.001, firmware: None };
    let frame = RgbdFrame {
        width: 64,
        height: 48,
        rgb: vec![7; 3 * 64 * 48],
        depth: (0..40 * 32).collect(),
        depth_camera,
        depth_unit_m: 0.001,
        ..RgbdFrame::default()
    };
    let (_parent, folder) = new_folder();
    let mut writer = RecordingWriter::create(&folder, std::slice::from_ref(&info), "", "").unwrap();
    let registered = RgbdFrame { depth_camera: None, depth: vec![1; 64 * 48], ..frame.clone() };
    let message = writer.write_set(&[registered]).unwrap_err().to_string();
    assert!(message.contains("another depth imager"), "{message}");
    writer.write_set(std::slice::from_ref(&frame)).unwrap();
    writer.finish().unwrap();
    let copy = Recording::open(&folder).unwrap();
    assert_eq!(copy.cameras(), [info]);
    let read = &frame_sets(&copy)[0][0];
    assert!(read.depth == frame.depth && read.depth_camera == frame.depth_camera);
    assert_eq!(read.depth_view().unwrap().width(), 40);
}
