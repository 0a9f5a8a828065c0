//! Recordings that are not what the layout promises: each is refused with the file and the cause, and nothing panics.

use std::fs;
use std::path::Path;

use image::DynamicImage;
use pelical::capture::RgbdFrame;
use pelical::capture::recording::Recording;

use crate::fixture::{FIRST_STAMP_NS, Fixture, color, depth, mixed, stamp_ns, valid_text};

/// The recording of these `recording.yaml` bytes is refused in words that hold all of `expected`.
#[track_caller]
fn check_text_refused(text: impl AsRef<[u8]>, expected: &[&str]) {
    let fixture = Fixture::new(2);
    fixture.write("recording.yaml", text);
    let message = Recording::open(fixture.path()).expect_err("a broken recording.yaml").to_string();
    check_words(&message, &fixture.path().join("recording.yaml"), expected);
}

/// As [`check_text_refused`], with one piece of the valid text replaced wherever it stands.
#[track_caller]
fn check_change_refused(from: &str, to: &str, expected: &[&str]) {
    let text = valid_text(2);
    assert!(text.contains(from), "the fixture has no {from:?}");
    check_text_refused(text.replace(from, to), expected);
}

#[track_caller]
fn check_words(message: &str, file: &Path, expected: &[&str]) {
    assert!(message.starts_with(&file.display().to_string()), "{message:?} does not name {}", file.display());
    for word in expected {
        assert!(message.contains(word), "{message:?} does not say {word:?}");
    }
}

/// Reading frame set 1 of a camera is refused with this file and these words, and leaves no image; frame set 0 stays readable.
#[track_caller]
fn check_image_refused(fixture: &Fixture, camera_idx: usize, file: &Path, expected: &[&str]) {
    let recording = fixture.open();
    let mut frame = RgbdFrame::default();
    let [first, second] = [0, 1].map(|set_idx| recording.frame_sets()[set_idx][camera_idx]);
    recording.read_frame(camera_idx, first, &mut frame).expect("the frame before is whole");
    let refused = recording.read_frame(camera_idx, second, &mut frame).expect_err("a broken image");
    check_words(&refused.to_string(), file, expected);
    assert!(!frame.is_consistent(), "a refused frame still passes as an image");
}

/// Stores an image in place of a depth image (camera 0) or a colour image (0: PNG, 1: JPEG) and expects the words.
#[track_caller]
fn check_color_refused(camera_idx: usize, image: &DynamicImage, expected: &[&str]) {
    let fixture = Fixture::new(2);
    let file = fixture.color_file(camera_idx, 1);
    image.save(&file).unwrap();
    check_image_refused(&fixture, camera_idx, &file, expected);
}

#[track_caller]
fn check_depth_refused(image: &DynamicImage, expected: &[&str]) {
    let fixture = Fixture::new(2);
    let file = fixture.depth_file(0, 1);
    image.save(&file).unwrap();
    check_image_refused(&fixture, 0, &file, expected);
}

#[track_caller]
fn check_truth_refused(text: &str, expected: &[&str]) {
    let fixture = Fixture::new(1);
    fixture.write("ground_truth.yaml", text);
    let message = fixture.open().ground_truth().expect_err("broken truth").to_string();
    check_words(&message, &fixture.path().join("ground_truth.yaml"), expected);
}

#[test]
fn the_fixture_itself_is_valid() {
    let fixture = Fixture::new(2);
    let recording = fixture.open();
    let mut frame = RgbdFrame::default();
    for (camera_idx, stamp) in recording.frame_sets()[1].iter().enumerate() {
        recording.read_frame(camera_idx, *stamp, &mut frame).unwrap();
        assert!(frame.is_consistent());
        assert_eq!(frame.depth, depth(1000 * camera_idx as u64 + 1).into_luma16().into_raw());
    }
    assert_eq!(recording.ground_truth().unwrap().unwrap().reference_from_camera.len(), 2);
}

#[test]
fn one_camera_is_a_recording() {
    let fixture = Fixture::new(1);
    let text = valid_text(1);
    let (head, rest) = text.split_once("  - name: right").unwrap();
    assert!(rest.contains("frame_sets"));
    fixture.write("recording.yaml", format!("{head}frame_sets: [[{FIRST_STAMP_NS}]]\n"));
    assert_eq!(fixture.open().cameras().len(), 1);
}

#[test]
fn a_folder_without_recording_yaml_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("recording.yaml");
    let message = Recording::open(folder.path()).unwrap_err().to_string();
    check_words(&message, &file, &["no such file", "not a recording"]);
    let nowhere = folder.path().join("nowhere");
    let message = Recording::open(&nowhere).unwrap_err().to_string();
    check_words(&message, &nowhere.join("recording.yaml"), &["there is no such folder"]);
}

#[test]
fn broken_yaml_is_refused_with_its_line() {
    check_change_refused("    width: 64", "    width: [64", &["line"]);
    check_text_refused([0xFF, 0xFE, 0x00, 0x80], &["UTF-8"]);
    check_text_refused("", &["format"]);
}

#[test]
fn unknown_and_missing_keys_are_refused_by_name() {
    check_change_refused(
        "depth_unit_m",
        "depth_unit",
        &["cameras[0]", "unknown field `depth_unit`", "line 14"],
    );
    check_change_refused("source:", "sauce:", &["`sauce`", "line 3"]);
    check_change_refused("    height: 48\n", "", &["missing field `height`"]);
}

#[test]
fn another_format_is_refused_whatever_else_it_holds() {
    check_change_refused("rgbd-rig/1", "rgbd-rig/2", &["\"rgbd-rig/2\"", "\"rgbd-rig/1\""]);
    check_text_refused("format: rgbd-rig/2\nimu: {}\n", &["\"rgbd-rig/2\""]);
}

#[test]
fn an_unquoted_serial_is_refused_with_the_reason() {
    check_change_refused(
        "\"018322070001\"",
        "18322070001",
        &["18322070001", "quotes", "leading zeros", "line"],
    );
    check_change_refused("\"018322070001\"", "1.5", &["quotes", "leading zeros"]);
    check_change_refused("\"018322070001\"", "\"\"", &["serial is empty"]);
}

#[test]
fn cameras_have_names_that_stay_in_the_folder_and_are_unique() {
    for name in ["../left", "a/b", "..", "", "a\\\\b", ".hidden", "/etc", "a\\0b"] {
        check_change_refused("name: left", &format!("name: \"{name}\""), &["name", "folder"]);
    }
    check_change_refused("name: right", "name: left", &["\"left\"", "twice"]);
    check_change_refused("\"left's\"", "\"018322070001\"", &["018322070001", "twice"]);
    check_text_refused("format: rgbd-rig/1\ncameras: []\nframe_sets: [[1]]\n", &["at least one camera"]);
}

#[test]
fn nan_and_zero_intrinsics_are_refused_with_camera_and_line() {
    check_change_refused("fx: 60.5", "fx: .nan", &["\"left\"", "fx is NaN", "line 5"]);
    check_change_refused("fy: 60.25", "fy: 0", &["fy is 0"]);
    check_change_refused("fx: 60.5", "fx: -60.5", &["fx is -60.5"]);
    check_change_refused("cx: 31.5", "cx: .inf", &["cx is inf"]);
    check_change_refused("width: 64", "width: 0", &["0 x 48"]);
    check_change_refused("height: 48", "height: 4000000000", &["16 to 16384"]);
    check_change_refused("width: 64", "width: -64", &["line"]);
}

#[test]
fn a_depth_unit_that_is_no_length_is_refused() {
    for unit in [".nan", ".inf", "0", "-0.001", "1000"] {
        check_change_refused(
            "depth_unit_m: 0.001",
            &format!("depth_unit_m: {unit}"),
            &["depth_unit_m", "metres"],
        );
    }
}

#[test]
fn an_unknown_or_incomplete_lens_is_refused() {
    check_change_refused("model: none", "model: fisheye", &["fisheye", "brown_conrady"]);
    check_change_refused("coeffs: [0, 0, 0, 0, 0]", "coeffs: [0.1, 0, 0, 0, 0]", &["model none"]);
    let four = "model: brown_conrady, coeffs: [0, 0, 0, 0]";
    check_change_refused("model: none, coeffs: [0, 0, 0, 0, 0]", four, &["4 numbers", "has 5"]);
    let nan = "model: brown_conrady, coeffs: [0, 0, .nan, 0, 0]";
    check_change_refused("model: none, coeffs: [0, 0, 0, 0, 0]", nan, &["p1 is NaN"]);
}

#[test]
fn an_empty_recording_is_refused() {
    let text = valid_text(0).replace("frame_sets:\n", "frame_sets: []\n");
    check_text_refused(text, &["empty recording"]);
}

#[test]
fn stamps_out_of_order_are_refused_with_row_and_camera() {
    let second = stamp_ns(1, 1).to_string();
    let back = (stamp_ns(1, 0) - 1).to_string();
    check_change_refused(&second, &back, &["frame_sets[1]", "stamps out of order", "\"right\""]);
    check_change_refused(&second, &stamp_ns(1, 0).to_string(), &["frame_sets[1]", "stamps out of order"]);
    check_change_refused(&second, "-5", &["frame_sets[1]", "negative"]);
    check_change_refused(&second, "1.5", &["frame_sets[1]", "line"]);
}

#[test]
fn a_frame_set_has_one_stamp_per_camera() {
    let second = format!(", {}]", stamp_ns(1, 1));
    check_change_refused(&second, "]", &["frame_sets[1]", "1 stamps", "2 cameras"]);
}

#[test]
fn a_missing_image_is_named() {
    for camera_idx in [0, 1] {
        let fixture = Fixture::new(2);
        fs::remove_file(fixture.color_file(camera_idx, 1)).unwrap();
        let looked_for = fixture.color_file(camera_idx, 1).with_extension("jpg");
        check_image_refused(&fixture, camera_idx, &looked_for, &["no such file", "or .png"]);
    }
    let fixture = Fixture::new(2);
    let file = fixture.depth_file(1, 1);
    fs::remove_file(&file).unwrap();
    check_image_refused(&fixture, 1, &file, &["no such file"]);
}

#[test]
fn a_truncated_image_names_its_file() {
    for (camera_idx, is_color) in [(0, true), (1, true), (0, false)] {
        let fixture = Fixture::new(2);
        let file =
            if is_color { fixture.color_file(camera_idx, 1) } else { fixture.depth_file(camera_idx, 1) };
        let whole = fs::read(&file).unwrap();
        for length in [0, 1, 20, whole.len() / 2, whole.len() - 20, whole.len() - 1] {
            // The last 12 bytes of a PNG only say that it ends; without them all pixels are there.
            if file.extension().is_some_and(|ending| ending == "png") && length + 12 >= whole.len() {
                continue;
            }
            fs::write(&file, &whole[..length]).unwrap();
            check_image_refused(&fixture, camera_idx, &file, &["truncated"]);
        }
    }
}

#[test]
fn an_image_of_another_type_is_refused() {
    check_depth_refused(&DynamicImage::ImageLuma8(depth(1).into_luma8()), &["8-bit gray", "16-bit gray"]);
    check_depth_refused(&DynamicImage::ImageRgb8(color(1).into_rgb8()), &["8-bit RGB", "16-bit gray"]);
    check_color_refused(0, &DynamicImage::ImageRgb16(color(1).into_rgb16()), &["16-bit RGB", "8-bit RGB"]);
    check_color_refused(0, &DynamicImage::ImageLuma8(color(1).into_luma8()), &["8-bit gray", "8-bit RGB"]);
    check_color_refused(0, &DynamicImage::ImageRgba8(color(1).into_rgba8()), &["with alpha", "8-bit RGB"]);
    check_color_refused(1, &DynamicImage::ImageLuma8(color(1).into_luma8()), &["8-bit gray", "8-bit RGB"]);
}

#[test]
fn an_image_of_another_size_is_refused() {
    check_depth_refused(&depth(1).crop_imm(0, 0, 64, 47), &["64 x 47", "64 x 48"]);
    check_color_refused(0, &color(1).crop_imm(0, 0, 32, 48), &["32 x 48", "64 x 48"]);
    check_color_refused(1, &color(1).crop_imm(0, 0, 48, 48), &["48 x 48", "64 x 48"]);
}

#[test]
fn a_header_that_promises_gigabytes_is_refused_by_its_size() {
    let fixture = Fixture::new(2);
    let file = fixture.depth_file(0, 1);
    let mut png = fs::read(&file).unwrap();
    // Width and height of IHDR; its checksum is wrong then, and that may be what is said.
    png[16..24].copy_from_slice(&[0x7F, 0xFF, 0xFF, 0xFF, 0x7F, 0xFF, 0xFF, 0xFF]);
    fs::write(&file, png).unwrap();
    check_image_refused(&fixture, 0, &file, &["image"]);
    let file = fixture.depth_file(0, 1);
    fs::File::create(&file).unwrap().set_len(10 << 30).unwrap();
    check_image_refused(&fixture, 0, &file, &["at most"]);
}

#[test]
fn a_folder_in_place_of_an_image_is_refused() {
    let fixture = Fixture::new(2);
    let file = fixture.depth_file(0, 1);
    fs::remove_file(&file).unwrap();
    fs::create_dir(&file).unwrap();
    check_image_refused(&fixture, 0, &file, &["not a file"]);
}

#[test]
fn a_camera_or_stamp_that_is_not_there_is_refused() {
    let fixture = Fixture::new(1);
    let recording = fixture.open();
    let mut frame = RgbdFrame::default();
    let stamp = recording.frame_sets()[0][0];
    let message = recording.read_frame(2, stamp, &mut frame).unwrap_err().to_string();
    assert!(message.contains("camera number 2"), "{message}");
    let message = recording.read_frame(1, stamp, &mut frame).unwrap_err().to_string();
    assert!(message.contains("\"right\"") && message.contains(&stamp.0.to_string()), "{message}");
}

#[test]
fn truth_that_is_no_motion_of_every_camera_is_refused() {
    let pose = "{translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}";
    check_truth_refused(&format!("poses:\n  left: {pose}\n"), &["\"right\"", "every camera"]);
    check_truth_refused(&format!("poses:\n  left: {pose}\n  front: {pose}\n"), &["front", "left, right"]);
    let with = |right: &str| format!("poses:\n  left: {pose}\n  right: {right}\n");
    let nan = "{translation_m: [0, .nan, 0], quaternion_xyzw: [0, 0, 0, 1]}";
    check_truth_refused(&with(nan), &["poses.right", "NaN"]);
    for quaternion in ["[0, 0, 0, 0]", "[1, 1, 0, 0]", "[.nan, 0, 0, 1]", "[.inf, 0, 0, 1]"] {
        let text = with(&format!("{{translation_m: [0, 0, 0], quaternion_xyzw: {quaternion}}}"));
        check_truth_refused(&text, &["poses.right", "norm"]);
    }
    check_truth_refused(
        &with("{translation_m: [0, 0], quaternion_xyzw: [0, 0, 0, 1]}"),
        &["poses.right", "line"],
    );
    let moved = "{translation_m: [1, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}";
    check_truth_refused(&format!("poses:\n  left: {moved}\n  right: {pose}\n"), &["poses.left", "identity"]);
}

#[test]
fn broken_truth_is_no_matter_until_it_is_asked_for() {
    let fixture = Fixture::new(1);
    fixture.write("ground_truth.yaml", "nonsense: [");
    assert_eq!(fixture.open().frame_sets().len(), 1);
    fs::remove_file(fixture.path().join("ground_truth.yaml")).unwrap();
    assert_eq!(fixture.open().ground_truth().unwrap(), None);
}

#[test]
fn images_with_flipped_bytes_never_panic() {
    let fixture = Fixture::new(2);
    let recording = fixture.open();
    let mut frame = RgbdFrame::default();
    for (camera_idx, file) in
        [(1, fixture.color_file(1, 1)), (0, fixture.color_file(0, 1)), (0, fixture.depth_file(0, 1))]
    {
        let whole = fs::read(&file).unwrap();
        for round in 0..300 {
            let mut broken = whole.clone();
            let at = mixed(round) as usize % broken.len();
            broken[at] = mixed(round << 8) as u8;
            fs::write(&file, broken).unwrap();
            let _ = recording.read_frame(camera_idx, recording.frame_sets()[1][camera_idx], &mut frame);
        }
        fs::write(&file, whole).unwrap();
        recording.read_frame(camera_idx, recording.frame_sets()[1][camera_idx], &mut frame).unwrap();
        assert!(frame.is_consistent());
    }
}

/// The key `depth` of a camera whose depth is not registered, in place of its first `depth_unit_m`.
fn depth_key(changed: (&str, &str)) -> String {
    let key = "depth_unit_m: 0.001\n    depth: {registered: false, width: 32, height: 24, fx: 30, fy: 30, cx: 16, cy: 12, \
        distortion: {model: none, coeffs: [0, 0, 0, 0, 0]}, \
        color_from_depth: {translation_m: [0.015, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}}";
    assert!(key.contains(changed.0), "the key has no {:?}", changed.0);
    key.replace(changed.0, changed.1)
}

#[test]
fn a_depth_imager_that_cannot_be_is_refused() {
    let cases: [(&str, &str, &[&str]); 9] = [
        (
            "registered: false",
            "registered: true",
            &["depth", "registered is true", "leave the key `depth` out"],
        ),
        ("width: 32", "width: 0", &["\"left\"", "depth", "0 x 24"]),
        ("fx: 30", "fx: .nan", &["depth", "fx is NaN"]),
        ("model: none", "model: fisheye", &["depth", "fisheye"]),
        ("[0.015, 0, 0]", "[.inf, 0, 0]", &["color_from_depth", "translation_m", "inf"]),
        ("[0.015, 0, 0]", "[15, 0, 0]", &["color_from_depth", "15.000 m", "at most"]),
        ("[0, 0, 0, 1]", "[0, 0, 0, 2]", &["color_from_depth", "quaternion_xyzw", "norm 2"]),
        ("[0, 0, 0, 1]", "[0, 1, 0, 0]", &["color_from_depth", "a turn of 3.142 rad"]),
        ("height: 24, ", "", &["missing field `height`"]),
    ];
    for (from, to, expected) in cases {
        check_change_refused("depth_unit_m: 0.001", &depth_key((from, to)), expected);
    }
}

#[test]
fn a_depth_image_has_the_size_of_its_imager() {
    let fixture = Fixture::new(1);
    let text = valid_text(1).replace("depth_unit_m: 0.001", &depth_key(("width: 32", "width: 32")));
    fs::write(fixture.path().join("recording.yaml"), text).unwrap();
    let recording = Recording::open(fixture.path()).unwrap();
    let message = recording
        .read_frame(0, recording.frame_sets()[0][0], &mut RgbdFrame::default())
        .unwrap_err()
        .to_string();
    check_words(&message, &fixture.depth_file(0, 0), &["64 x 48", "32 x 24"]);
}
