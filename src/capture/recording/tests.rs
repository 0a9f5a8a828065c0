//! Whatever a text says, its parser answers: a checked recording or a sentence, never a panic.

use proptest::prelude::*;

use super::sections::parse_recording;
use super::truth::parse_ground_truth;
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

/// What is put in place of a piece of a valid text: values that tend to break parsers, or anything.
fn piece() -> impl Strategy<Value = String> {
    let nasty = [
        "",
        "\0",
        "&a [*a]",
        "*a",
        "<<: *a",
        "!!binary x",
        ".nan",
        "-.inf",
        "1e999",
        "-1",
        "0x7fffffffffffffff",
        "9223372036854775808",
        "~",
        "[",
        "]",
        "{",
        "}",
        "- ",
        ":",
        "\n",
        "\t",
        "\"",
        "'",
        "|",
        ">",
        "---\n",
        "...\n",
        "%YAML 9",
        "é",
        "../..",
        "[[]]",
    ];
    prop_oneof![prop::sample::select(nasty.to_vec()).prop_map(str::to_owned), any::<String>()]
}

/// A valid text with one stretch replaced.
fn mutated(text: &'static str) -> impl Strategy<Value = String> {
    (0..=text.len(), 0..40usize, piece()).prop_map(move |(start, length, piece)| {
        let end = (start + length).min(text.len());
        format!("{}{piece}{}", &text[..start], &text[end..])
    })
}

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
        let truth = parse_ground_truth(&String::from_utf8_lossy(bytes), &NAMES);
        let poses = truth.iter().flat_map(|truth| &truth.reference_from_camera);
        assert!(poses.flat_map(|pose| pose.to_homogeneous().data.0.concat()).all(f64::is_finite));
        truth.is_ok()
    });
}

proptest! {
    #![proptest_config(crate::tests::hostile::properties())]

    #[test]
    fn a_changed_recording_yaml_is_refused_or_usable(text in mutated(RECORDING)) {
        assert_usable(&text);
    }

    #[test]
    fn a_changed_ground_truth_is_refused_or_finite(text in mutated(TRUTH)) {
        if let Ok(truth) = parse_ground_truth(&text, &NAMES) {
            for motion in truth.reference_from_camera {
                prop_assert!(motion.to_homogeneous().iter().all(|value| value.is_finite()));
            }
        }
    }

    #[test]
    fn arbitrary_text_never_panics(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let text = String::from_utf8_lossy(&bytes);
        assert_usable(&text);
        let _ = parse_ground_truth(&text, &NAMES);
    }
}
