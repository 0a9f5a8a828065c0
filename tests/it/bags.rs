//! RealSense bags without the SDK: what its own recorder wrote is found again bit for bit, and calibrates like any recording.

use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use pelical::capture::recording::Recording;
use pelical::capture::writer::{ColorFormat, RecordingWriter};
use pelical::capture::{CameraInfo, RgbdFrame};
use pelical::geometry::Camera;
use pelical::geometry::camera::RayPoint;
use pelical::pipeline::PipelineOptions;
use pelical::pipeline::offline::{RecordedSets, run_offline};
use pelical::solver::{RigCalibration, State};
use serde_json::Value;
use sha2::{Digest, Sha256};

use crate::bag_bytes::{Compression, bag, fixture, messages};
use crate::env::TestEnv;

fn expected(name: &str) -> Value {
    let text = std::fs::read_to_string(fixture("expected.json")).unwrap();
    serde_json::from_str::<Value>(&text).unwrap()[name].clone()
}

fn pair() -> [PathBuf; 2] {
    [fixture("pair/left.bag"), fixture("pair/right.bag")]
}

fn frames(recording: &Recording, camera_idx: usize) -> Vec<RgbdFrame> {
    let read = |set: &Vec<_>| {
        let mut frame = RgbdFrame::default();
        recording.read_frame(camera_idx, set[camera_idx], &mut frame).unwrap();
        assert!(frame.is_of(&recording.cameras()[camera_idx].camera));
        frame
    };
    recording.frame_sets().iter().map(read).collect()
}

fn sha(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}

#[track_caller]
fn check_frames(path: &Path, name: &str) {
    let expected = expected(name);
    let frames = frames(&Recording::open(path).unwrap(), 0);
    let expected = expected["frames"].as_array().unwrap();
    assert_eq!(frames.len(), expected.len());
    for (frame, expected) in frames.iter().zip(expected) {
        // The SDK keeps ms in f64, which since 1970 is good to a quarter of a microsecond.
        assert!(frame.stamp.0.abs_diff(expected["stamp_ns"].as_i64().unwrap()) < 500, "{:?}", frame.stamp);
        assert_eq!(sha(&frame.rgb), expected["rgb"].as_str().unwrap());
        let depth: Vec<u8> = frame.depth.iter().flat_map(|count| count.to_le_bytes()).collect();
        assert_eq!(sha(&depth), expected["depth"].as_str().unwrap());
        let turn_rate = frame.turn_rate.unwrap().max_rad_per_s;
        assert!((turn_rate - expected["max_rad_per_s"].as_f64().unwrap()).abs() < 1e-6, "{turn_rate}");
    }
}

#[test]
fn every_frame_is_bit_for_bit_what_was_recorded() {
    check_frames(&fixture("pair/left.bag"), "left");
    check_frames(&fixture("pair/right.bag"), "right");
}

#[test]
fn a_clock_that_wraps_goes_on_and_bgr_becomes_rgb() {
    check_frames(&fixture("single/wrap.bag"), "wrap");
}

#[track_caller]
fn check_camera(camera: &Camera, expected: &Value) {
    let number = |key: &str| expected[key].as_f64().unwrap();
    let pinhole = camera.pinhole();
    for (found, key) in
        [(pinhole.fx_px, "fx"), (pinhole.fy_px, "fy"), (pinhole.cx_px, "cx"), (pinhole.cy_px, "cy")]
    {
        assert!((found - number(key)).abs() < 1e-4, "{key} is {found}");
    }
    assert_eq!(
        (f64::from(camera.width_px()), f64::from(camera.height_px())),
        (number("width"), number("height"))
    );
    let coeffs: Vec<f64> =
        expected["coeffs"].as_array().unwrap().iter().map(|c| c.as_f64().unwrap()).collect();
    for (x, y) in [(0.0, 0.0), (0.3, 0.2), (-0.4, 0.25), (0.2, -0.3)] {
        let (shown, pixel) = (modified((x, y), &coeffs), camera.pixel_from_ray(RayPoint { x, y }));
        let wanted = (pinhole.fx_px * shown.0 + pinhole.cx_px, pinhole.fy_px * shown.1 + pinhole.cy_px);
        assert!((pixel.x - wanted.0).hypot(pixel.y - wanted.1) < 0.05, "{pixel:?} instead of {wanted:?}");
    }
}

/// Where the SDK's `inverse_brown_conrady` shows a ray: tangential terms at the radially distorted point.
fn modified((x, y): (f64, f64), coeffs: &[f64]) -> (f64, f64) {
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (coeffs[0] + r2 * (coeffs[1] + r2 * coeffs[4]));
    let (x, y, p1, p2) = (x * radial, y * radial, coeffs[2], coeffs[3]);
    (x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y))
}

#[track_caller]
fn check_info(info: &CameraInfo, name: &str) {
    let expected = expected(name);
    assert_eq!(info.name, name);
    assert_eq!(info.serial, expected["serial"].as_str().unwrap());
    assert_eq!(info.firmware.as_deref(), expected["firmware"].as_str());
    assert_eq!(info.depth_unit_m, expected["depth_unit_m"].as_f64().unwrap());
    check_camera(&info.camera, &expected["color"]);
    let imager = info.depth_camera.unwrap();
    check_camera(&imager.camera, &expected["depth"]);
    let between = &expected["color_from_depth"];
    let row = |row: usize| {
        let row =
            between["rotation_rows"][row].as_array().unwrap().iter().map(|value| value.as_f64().unwrap());
        nalgebra::RowVector3::from_iterator(row)
    };
    let rotation = Rotation3::from_matrix(&Matrix3::from_rows(&[row(0), row(1), row(2)]));
    let at_m = between["translation_m"].as_array().unwrap().iter().map(|value| value.as_f64().unwrap());
    let motion = Isometry3::from_parts(
        Translation3::from(Vector3::from_iterator(at_m)),
        UnitQuaternion::from_rotation_matrix(&rotation),
    );
    let gap = imager.color_from_depth.inverse() * motion;
    assert!(gap.translation.vector.norm() < 1e-7 && gap.rotation.angle() < 1e-6, "{gap}");
}

#[test]
fn intrinsics_extrinsics_unit_serial_and_firmware_are_those_of_the_device() {
    let rig = Recording::open_all(&pair()).unwrap();
    check_info(&rig.cameras()[0], "left");
    check_info(&rig.cameras()[1], "right");
    check_info(&Recording::open(&fixture("single/wrap.bag")).unwrap().cameras()[0], "wrap");
}

#[test]
fn two_bags_side_by_side_a_folder_of_them_and_both_cameras_in_one_bag_are_the_same_recording() {
    let rig = Recording::open_all(&pair()).unwrap();
    let folder = Recording::open(&fixture("pair")).unwrap();
    let env = TestEnv::new();
    let both = env.path("both.bag");
    std::fs::write(&both, two_devices(&pair())).unwrap();
    let both = Recording::open(&both).unwrap();
    assert_eq!(rig.frame_sets().len(), 12);
    for other in [&folder, &both] {
        assert_eq!(other.frame_sets(), rig.frame_sets());
        for camera_idx in 0..2 {
            let (ours, theirs) = (frames(&rig, camera_idx), frames(other, camera_idx));
            assert!(ours.iter().zip(&theirs).all(|(a, b)| a.rgb == b.rgb && a.depth == b.depth));
        }
    }
    // Two cameras of one file cannot both have its name.
    assert_eq!(
        both.cameras().iter().map(|info| &*info.name).collect::<Vec<_>>(),
        ["0123456789", "042222070001"]
    );
    assert_eq!(both.cameras()[1].depth_camera, rig.cameras()[1].depth_camera);
}

/// The cameras of two bags as two devices of one.
fn two_devices([left, right]: &[PathBuf; 2]) -> Vec<u8> {
    let renamed =
        messages(right).into_iter().map(|(topic, body)| (topic.replace("/device_0", "/device_1"), body));
    bag(&messages(left).into_iter().chain(renamed).collect::<Vec<_>>(), Compression::Lz4)
}

#[test]
fn the_same_frames_as_images_give_the_same_calibration() {
    let bags = Recording::open_all(&pair()).unwrap();
    let env = TestEnv::new();
    let folder = env.path("images");
    let writer = RecordingWriter::create(&folder, bags.cameras(), "", "").unwrap();
    let mut writer = writer.with_color_format(ColorFormat::Png);
    let by_camera = [frames(&bags, 0), frames(&bags, 1)];
    for (left, right) in by_camera[0].iter().zip(&by_camera[1]) {
        writer.write_set(&[left.clone(), right.clone()]).unwrap();
    }
    writer.finish().unwrap();
    let calibrate = |recording: &Recording| {
        let mut sets = RecordedSets::new(recording);
        let rig = sets.rig();
        run_offline(&mut sets, &rig, &PipelineOptions::default(), &mut |_| {}).unwrap().calibration
    };
    let (ours, theirs) = (calibrate(&bags), calibrate(&Recording::open(&folder).unwrap()));
    assert_eq!((ours.state, theirs.state), (State::Converged, State::Converged));
    let found = |calibration: &RigCalibration| {
        let pair = &calibration.pairs[0];
        (pair.matches, pair.full, pair.pnl, calibration.frame_sets_used)
    };
    assert_eq!(found(&ours), found(&theirs));
    // The text of recording.yaml costs the extrinsics of depth their last bit.
    let place = |calibration: &RigCalibration| calibration.cameras[1].as_ref().unwrap().reference_from_camera;
    let gap = place(&ours).inverse() * place(&theirs);
    assert!(gap.translation.vector.norm() < 1e-9 && gap.rotation.angle() < 1e-9, "{gap}");
}

#[track_caller]
fn check_converged(document: &Value) {
    assert_eq!(document["state"], "converged", "{document:#}");
    let truth = &document["truth"][0];
    let (deg, mm) =
        (truth["rotation_error_deg"].as_f64().unwrap(), truth["translation_error_mm"].as_f64().unwrap());
    assert!(deg < 0.2 && mm < 6.0, "off by {deg} deg, {mm} mm");
}

#[test]
fn bags_are_calibrated_replayed_and_evaluated_like_any_recording() {
    let env = TestEnv::new();
    let [left, right] = pair().map(|path| path.display().to_string());
    let run = |arguments: &[&str]| env.pelical(arguments).expect_code(0).json();
    check_converged(&run(&["calibrate", &left, &right, "--json"]));
    let replayed = run(&["replay", &left, &right, "--fast", "--json"]);
    check_converged(&replayed);
    assert_eq!(replayed["cameras"][0]["serial"], "042222070001");
    let evaluated = run(&["evaluate", &fixture("").display().to_string(), "--json"]);
    assert_eq!((evaluated["converged"].as_u64(), evaluated["wrong"].as_u64()), (Some(1), Some(0)));
    let matched = run(&["match", &left, &right, "--set", "0", "--json"]);
    assert_eq!(matched["sets"].as_array().unwrap().len(), 1);
}

#[test]
fn a_replay_in_real_time_takes_its_time_and_says_how_the_cameras_are() {
    let env = TestEnv::new();
    let start = std::time::Instant::now();
    let ended = env.pelical(&["replay", &fixture("single/wrap.bag").display().to_string(), "--json"]);
    // One camera is no rig, but it plays: six frames, 33 ms apart.
    let document = ended.expect_code(4).expect_talk(&["camera wrap: streaming", "camera wrap: ended"]).json();
    assert_eq!(
        (&document["state"], &document["frame_sets"]["seen"]),
        (&"failed".into(), &6.into()),
        "{document:#}"
    );
    assert!(start.elapsed().as_millis() >= 160);
}

#[test]
fn the_daemons_back_end_plays_a_list_of_bags() {
    let env = TestEnv::new();
    let [left, right] = pair().map(|path| path.display().to_string());
    env.config(&format!(
        "cameras: {{backend: replay, replay: {{recording: [{left}, {right}], pace: unpaced}}}}\n"
    ));
    let listed = env.pelical(&["devices", "--config", "pelicald.yaml", "--json"]).expect_code(0).json();
    assert_eq!(listed["devices"][1]["serial"], "042222070001", "{listed:#}");
    let record = ["record", "copy", "--config", "pelicald.yaml", "--sets", "3", "--json"];
    assert_eq!(env.pelical(&record).expect_code(0).json()["frame_sets"], 3);
    let (copy, bags) = (Recording::open(&env.path("copy")).unwrap(), Recording::open_all(&pair()).unwrap());
    assert_eq!(frames(&copy, 1)[2].depth, frames(&bags, 1)[2].depth);
}
