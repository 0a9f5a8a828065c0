//! What was exported is read back the way its readers do, and gives the poses again.

use nalgebra::{Matrix6, Quaternion, Translation3, Vector3};

use super::*;
use crate::ipc::{CameraIdentity, Provenance};
use crate::solver::{CameraPose, RigCalibration, State};

/// The second camera is the reference; the third one's name is hard to write.
fn message() -> CalibrationMessage {
    let identity =
        |name: &str| CameraIdentity { name: name.to_owned(), serial: format!("s--{name}"), firmware: None };
    let pose =
        |reference_from_camera| Some(CameraPose { reference_from_camera, covariance: Matrix6::identity() });
    let left = Motion::new(Vector3::new(-0.3, 0.02, 0.1), Vector3::new(0.3, -1.2, 0.4));
    let top = Motion::new(Vector3::new(1e-7, -0.5, 0.0), Vector3::new(-2.0, 0.1, 1.0));
    CalibrationMessage {
        sequence: 3,
        stamp_ns: 1_795_340_009_000_000_000,
        provenance: Provenance { id: Some(17), ..Provenance::default() },
        cameras: ["left", "front", "- \"top\": <ü>"].map(identity).to_vec(),
        calibration: RigCalibration {
            state: State::Converged,
            reason: None,
            reference: 1,
            cameras: vec![pose(left), pose(Motion::identity()), pose(top)],
            pairs: Vec::new(),
            frame_sets_used: 12,
        },
    }
}

fn motion(t: [f64; 3], q: [f64; 4]) -> Motion {
    let rotation = UnitQuaternion::new_normalize(Quaternion::from(q));
    Motion::from_parts(Translation3::from(t), rotation)
}

#[track_caller]
fn check_same(found: &Motion, expected: &Motion) {
    let gap = expected.inverse() * found;
    assert!(
        gap.translation.vector.norm() < 1e-12 && gap.rotation.angle() < 1e-7,
        "{found} is not {expected}"
    );
}

fn placed(frame: ExportFrame) -> Placed {
    Placed::of(&message(), frame).expect("names that differ")
}

/// The camera poses but the reference's.
fn expected() -> [Motion; 2] {
    let pose = |camera: usize| {
        message().calibration.cameras[camera]
            .as_ref()
            .map(|pose| pose.reference_from_camera)
            .expect("has a pose")
    };
    [pose(0), pose(2)]
}

#[test]
fn yaml_has_the_layout_of_a_ground_truth() {
    let text = yaml(&message());
    let value: serde_yaml::Value = serde_yaml::from_str(&text).expect("YAML");
    let numbers = |camera: &str, key: &str| -> Vec<f64> {
        let list = value["poses"][camera][key].as_sequence().expect("a list");
        list.iter().map(|number| number.as_f64().expect("a number")).collect()
    };
    for (camera, expected) in ["left", "- \"top\": <ü>"].into_iter().zip(expected()) {
        let (t, q) = (numbers(camera, "translation_m"), numbers(camera, "quaternion_xyzw"));
        let found = motion(t.try_into().expect("three"), q.try_into().expect("four"));
        assert_eq!(found.translation, expected.translation, "to the bit");
        check_same(&found, &expected);
    }
    assert_eq!(numbers("front", "quaternion_xyzw"), [0.0, 0.0, 0.0, 1.0]);
    assert!(text.contains("calibration 17") && text.contains("2026-11-22T09:33:29"), "{text}");
}

#[test]
fn a_launch_file_of_ros_has_one_transform_for_each_camera_but_the_reference() {
    let text = ros_tf(&message(), &placed(ExportFrame::Optical));
    let value: serde_yaml::Value = serde_yaml::from_str(&text).expect("YAML");
    let nodes = value["launch"].as_sequence().expect("a list");
    assert_eq!(nodes.len(), 2);
    let children = ["left_color_optical_frame", "___top_______color_optical_frame"];
    for ((node, child), expected) in nodes.iter().zip(children).zip(expected()) {
        let node = &node["node"];
        let named = (node["pkg"].as_str(), node["exec"].as_str());
        assert_eq!(named, (Some("tf2_ros"), Some("static_transform_publisher")));
        let words: Vec<&str> = node["args"].as_str().expect("text").split(' ').collect();
        let value = |flag: &str| words[words.iter().position(|word| *word == flag).expect(flag) + 1];
        let number = |flag: &str| value(flag).parse::<f64>().expect("a number");
        assert_eq!((value("--frame-id"), value("--child-frame-id")), ("front_color_optical_frame", child));
        let found = motion(["--x", "--y", "--z"].map(number), ["--qx", "--qy", "--qz", "--qw"].map(number));
        check_same(&found, &expected);
    }
}

#[test]
fn urdf_turns_about_fixed_axes_in_their_order() {
    let text = urdf(&message(), &placed(ExportFrame::Optical));
    let origins = text.lines().filter(|line| line.contains("<origin"));
    let numbers = |line: &str, key: &str| -> Vec<f64> {
        let rest = line.split(&format!("{key}=\"")).nth(1).expect(key);
        let list = rest.split('"').next().expect("quotes");
        list.split(' ').map(|number| number.parse().expect("a number")).collect()
    };
    let mut count = 0;
    for (line, expected) in origins.zip(expected()) {
        let (xyz, rpy) = (numbers(line, "xyz"), numbers(line, "rpy"));
        // As the format has it: roll about x, then pitch about y, then yaw about z, all of the parent.
        let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let rotation =
            about(Vector3::z(), rpy[2]) * about(Vector3::y(), rpy[1]) * about(Vector3::x(), rpy[0]);
        let found = Motion::from_parts(Translation3::new(xyz[0], xyz[1], xyz[2]), rotation);
        check_same(&found, &expected);
        count += 1;
    }
    assert_eq!(count, 2);
    assert_eq!(text.matches("<link name=").count(), 3);
    // Two hyphens end a comment, and the serial numbers have them.
    assert!(
        text.lines().filter(|line| line.contains("<!--")).all(|line| line.matches("--").count() == 2),
        "{text}"
    );
}

#[test]
fn body_frames_look_along_x_with_z_up() {
    let placed = placed(ExportFrame::Body);
    assert_eq!(placed.parent, "front_color_frame");
    let (_, parent_from_left) = &placed.children[0];
    // 0.3 m to the left of the reference, 2 cm below it and 10 cm before it.
    let place = parent_from_left.translation.vector;
    assert!((place - Vector3::new(0.1, 0.3, -0.02)).norm() < 1e-12, "{place}");
    // The same direction, told in both kinds of axes.
    let forward_in_optical = expected()[0].rotation * Vector3::z();
    let forward_in_body = parent_from_left.rotation * Vector3::x();
    let told = Vector3::new(forward_in_optical.z, -forward_in_optical.x, -forward_in_optical.y);
    assert!((forward_in_body - told).norm() < 1e-12);
}

#[test]
fn cameras_that_ros_could_not_tell_apart_are_refused() {
    let mut message = message();
    message.cameras[0].name = "arm/left".to_owned();
    message.cameras[2].name = "arm left".to_owned();
    let error = Placed::of(&message, ExportFrame::Optical).err().expect("the same frame name");
    assert!(error.contains("\"arm/left\" and \"arm left\"") && error.contains("arm_left_color"), "{error}");
}
