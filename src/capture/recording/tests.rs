//! Whatever a text says, its parser answers: a checked recording or a sentence, never a panic.

use super::sections::parse_recording;
use super::truth::{parse_for_some, parse_ground_truth};
use crate::tests::hostile::check_any_bytes;

const RECORDING: &str = "\
format: rgbd-rig/1
description: two cameras
source: a test
cameras:
  - name: left
    serial: \"0123\"
    width: 640
    height: 480
    fx: 606.366
    fy: 606.101
    cx: 324.313
    cy: 247.906
    distortion: {model: brown_conrady, coeffs: [0.26, -0.95, -0.005, 0.002, 1.16]}
    depth_unit_m: 0.001
  - name: right
    serial: sim-2
    width: 640
    height: 480
    fx: 606.776
    fy: 606.615
    cx: 323.227
    cy: 247.246
    distortion: {model: none, coeffs: [0, 0, 0, 0, 0]}
    depth_unit_m: 0.001
frame_sets: [[1700101000345711384, 1700101000345655618], [1700101002035462484, 1700101002035430910]]
";
const TRUTH: &str = "\
poses:
  left: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}
  right: {translation_m: [0.3, 0, 0], quaternion_xyzw: [0, 0.17, 0, 0.98]}
";
const NAMES: [&str; 2] = ["left", "right"];

/// What every recording that was accepted promises.
fn assert_usable(text: &str) {
    let Ok(recording) = parse_recording(text) else { return };
    assert!(!recording.cameras.is_empty() && !recording.frame_sets.is_empty());
    assert!(recording.frame_sets.iter().all(|set| set.len() == recording.cameras.len()));
    for camera in &recording.cameras {
        assert!(
            camera.depth_unit_m.is_finite()
                && camera.depth_unit_m > 0.0
                && camera.camera.pinhole().fx_px > 0.0
        );
        assert!(
            !camera.name.contains(['/', '\\', '\0'])
                && !camera.name.starts_with('.')
                && !camera.serial.is_empty()
        );
    }
    for pair in recording.frame_sets.windows(2) {
        assert!(pair[0].iter().zip(&pair[1]).all(|(before, after)| before < after));
    }
}

#[test]
fn the_texts_that_are_mutated_here_are_valid() {
    assert_eq!(parse_recording(RECORDING).expect("a valid text").frame_sets.len(), 2);
    assert_eq!(parse_ground_truth(TRUTH, &NAMES).expect("a valid text").reference_from_camera.len(), 2);
}

#[test]
fn a_recording_yaml_of_any_bytes_is_refused_or_usable() {
    check_any_bytes("recording.yaml", &[RECORDING.as_bytes().to_vec()], |bytes| {
        let text = String::from_utf8_lossy(bytes);
        assert_usable(&text);
        parse_recording(&text).inspect_err(|what| assert!(!what.is_empty())).is_ok()
    });
}

#[test]
fn a_ground_truth_of_any_bytes_is_refused_or_finite() {
    check_any_bytes("ground_truth.yaml", &[TRUTH.as_bytes().to_vec()], |bytes| {
        let text = String::from_utf8_lossy(bytes);
        let truth = parse_ground_truth(&text, &NAMES);
        // As beside bags.
        let of_some = parse_for_some(&text, &[NAMES[1], NAMES[0]]);
        let poses =
            truth.iter().chain(of_some.iter().flatten()).flat_map(|truth| &truth.reference_from_camera);
        assert!(poses.flat_map(|pose| pose.to_homogeneous().data.0.concat()).all(f64::is_finite));
        assert!(
            truth.is_err() || of_some.is_ok_and(|truth| truth.is_some()),
            "good enough for some cameras too"
        );
        truth.is_ok()
    });
}

#[test]
fn a_text_of_open_brackets_is_refused_before_it_is_parsed() {
    let text = "[".repeat(200_000);
    for refused in [
        parse_recording(&text).err(),
        parse_ground_truth(&text, &NAMES).err(),
        parse_for_some(&text, &NAMES).err(),
    ] {
        let refused = refused.expect("refused");
        assert!(refused.contains("nested deeper than"), "{refused}");
    }
}
