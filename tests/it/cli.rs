//! The offline commands: exit codes, documents, and honest messages about bad input.

use serde_json::Value;

use crate::env::{Ended, TestEnv};
use crate::fixture::{self, Fixture};
use crate::synthetic_pair;

#[track_caller]
fn calibrate(folder: &std::path::Path) -> Ended {
    TestEnv::new().pelical(&["calibrate", folder.to_str().unwrap(), "--json"])
}

#[track_caller]
fn check_bad(fixture: &Fixture, parts: &[&str]) {
    let ended = calibrate(fixture.path()).expect_code(65).expect_talk(parts);
    assert_eq!(ended.stdout, "", "no document without a result");
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn a_good_recording_converges_close_to_the_truth() {
    let document = calibrate(synthetic_pair::recording()).expect_code(0).json();
    assert_eq!(document["state"], "converged");
    assert_eq!(document["reason"], Value::Null);
    assert_eq!(document["reference"], "left");
    let truth = &document["truth"][0];
    assert_eq!(truth["camera"], "right");
    assert!(truth["rotation_error_deg"].as_f64().unwrap() < 0.3, "{truth}");
    assert!(truth["translation_error_mm"].as_f64().unwrap() < 10.0, "{truth}");
}

#[test]
fn the_document_has_the_keys_of_the_contract() {
    let document = calibrate(synthetic_pair::recording()).json();
    let expected =
        ["cameras", "frame_sets", "pairs", "reason", "reference", "schema", "state", "timing_ms", "truth"];
    assert_eq!(keys(&document), expected);
    assert_eq!(document["schema"], "pelical.calibration/1");
    let camera = &document["cameras"][0];
    assert_eq!(
        keys(camera),
        ["covariance", "name", "reference_from_camera", "serial", "sigma_deg", "sigma_mm"]
    );
    assert_eq!(keys(&camera["reference_from_camera"]), ["rotation_xyzw", "translation_m"]);
    assert_eq!(camera["covariance"].as_array().unwrap().len(), 6);
    assert_eq!(
        keys(&document["pairs"][0]),
        ["full", "lead", "matches", "pnl", "residual_mm", "residual_px", "skew", "source", "target"]
    );
    let skew = ["beyond", "last_beyond_ms", "max_ms", "p50_ms", "p99_ms", "sets"];
    assert_eq!(keys(&document["pairs"][0]["skew"]), skew);
    assert_eq!(keys(&document["frame_sets"]), ["refused", "refused_for", "seen", "used"]);
    let reasons = ["gyro", "image", "incomplete", "nothing_new", "skew"];
    assert_eq!(keys(&document["frame_sets"]["refused_for"]), reasons);
    assert_eq!(keys(&document["timing_ms"]), ["associate", "detect", "estimate", "lift", "total"]);
}

#[test]
fn the_same_recording_gives_the_same_answer_whatever_the_number_of_threads() {
    let env = TestEnv::new();
    let of_threads = |threads: u32| {
        env.config(&format!("lines: {{threads: {threads}}}\n"));
        let folder = synthetic_pair::recording().to_str().unwrap();
        let mut document = env.pelical(&["calibrate", folder, "--config", "pelicald.yaml", "--json"]).json();
        document.as_object_mut().unwrap().remove("timing_ms");
        document.to_string()
    };
    assert_eq!(of_threads(1), of_threads(2));
}

#[test]
fn the_text_says_places_in_words() {
    let folder = synthetic_pair::recording().to_str().unwrap();
    let ended = TestEnv::new().pelical(&["calibrate", folder]).expect_code(0);
    for part in ["converged", "mm right", "deg to the right", "sigma mm", "off by deg"] {
        assert!(ended.stdout.contains(part), "{part:?} is not in {}", ended.stdout);
    }
}

#[test]
fn without_lines_the_answer_is_no_result_with_a_reason() {
    let fixture = Fixture::new(3);
    let document = calibrate(fixture.path()).expect_code(4).json();
    assert_ne!(document["state"], "converged");
    assert!(document["reason"]["sentence"].as_str().unwrap().len() > 20, "{document}");
    assert!(keys(&document["reason"]).contains(&"code"));
}

#[test]
fn one_camera_is_no_rig() {
    let fixture = Fixture::new(1);
    let two = fixture::valid_text(1);
    let second = two.find("  - name: right").unwrap();
    let sets = two.find("frame_sets:").unwrap();
    let stamp = fixture::stamp_ns(0, 0);
    fixture.write("recording.yaml", format!("{}frame_sets:\n  - [{stamp}]\n", &two[..second.min(sets)]));
    fixture.write(
        "ground_truth.yaml",
        "poses:\n  left: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}\n",
    );
    let document = calibrate(fixture.path()).expect_code(4).json();
    assert_eq!(document["reason"]["code"], "one_camera");
}

#[test]
fn a_folder_that_is_no_recording_is_bad_data() {
    let env = TestEnv::new();
    env.pelical(&["calibrate", "nowhere"]).expect_code(65).expect_talk(&["nowhere"]);
    env.pelical(&["calibrate", "."]).expect_code(65).expect_talk(&["recording.yaml"]);
    env.pelical(&["evaluate", "."]).expect_code(65).expect_talk(&["ground_truth.yaml"]);
    env.pelical(&["evaluate", "nowhere"]).expect_code(65).expect_talk(&["nowhere"]);
    env.write("file", "");
    env.pelical(&["calibrate", "file"]).expect_code(65).expect_talk(&["that is a file"]);
    env.pelical(&["evaluate", "file"]).expect_code(65).expect_talk(&["file"]);
}

#[test]
fn a_name_that_leads_to_no_bag_is_bad_data_and_a_pipe_is_not_waited_for() {
    use rustix::fs::{CWD, FileType, Mode, mknodat};
    use std::os::unix::fs::symlink;

    let env = TestEnv::new();
    let calibrate = |name: &str| env.pelical(&["calibrate", name]).expect_code(65);
    calibrate("nowhere.bag").expect_talk(&["nowhere.bag: there is no such file"]);
    env.write("file", "");
    calibrate("file/below.bag").expect_talk(&["file/below.bag: there is no such file"]);
    for name in ["round.bag", "round"] {
        symlink(name, env.path(name)).unwrap();
        calibrate(name).expect_talk(&[name, "there is no such"]);
    }
    mknodat(CWD, env.path("pipe.bag"), FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    calibrate("pipe.bag").expect_talk(&["pipe.bag: is no regular file"]);
    // Beside others, and as the recording that a daemon plays.
    env.pelical(&["calibrate", "pipe.bag", "nowhere.bag"]).expect_code(65);
    env.config("cameras: {backend: replay, replay: {recording: nowhere.bag}}\n");
    env.pelicald(&["--config", "pelicald.yaml"])
        .expect_code(65)
        .expect_talk(&["nowhere.bag: there is no such file"]);
}

#[test]
fn a_byte_order_mark_does_not_spoil_a_recording() {
    let fixture = Fixture::new(2);
    fixture.write("recording.yaml", format!("\u{feff}{}", fixture::valid_text(2)));
    calibrate(fixture.path()).expect_code(4);
}

#[test]
fn frame_sets_of_different_moments_are_refused_with_the_reason() {
    let fixture = Fixture::new(2);
    let text = fixture::valid_text(2);
    let head = &text[..text.find("frame_sets:").unwrap()];
    let row = format!("frame_sets:\n  - [{}, {}]\n", fixture::stamp_ns(0, 0), fixture::stamp_ns(1, 1));
    fixture.write("recording.yaml", format!("{head}{row}"));
    let document = calibrate(fixture.path()).expect_code(4).json();
    assert_eq!((&document["state"], &document["frame_sets"]["refused"]), (&"collecting".into(), &1.into()));
    assert_eq!(document["frame_sets"]["refused_for"]["skew"], 1);
    let sentence = document["reason"]["sentence"].as_str().unwrap();
    assert!(sentence.contains("20.1 ms apart, the limit is 8 ms"), "{document}");
}

#[test]
fn missing_and_truncated_images_are_bad_data() {
    let missing = Fixture::new(2);
    std::fs::remove_file(missing.depth_file(1, 1)).unwrap();
    check_bad(&missing, &["right", "depth", "no such file"]);
    let truncated = Fixture::new(2);
    let bytes = std::fs::read(truncated.color_file(0, 0)).unwrap();
    std::fs::write(truncated.color_file(0, 0), &bytes[..bytes.len() / 2]).unwrap();
    check_bad(&truncated, &["left", "color", "truncated"]);
}

#[test]
fn eight_bit_depth_and_wrong_sizes_are_bad_data() {
    let shallow = Fixture::new(1);
    image::GrayImage::new(fixture::WIDTH, fixture::HEIGHT).save(shallow.depth_file(0, 0)).unwrap();
    check_bad(&shallow, &["8-bit", "16-bit"]);
    let small = Fixture::new(1);
    image::RgbImage::new(32, 24).save(small.color_file(0, 0)).unwrap();
    check_bad(&small, &["32 x 24", "64 x 48"]);
}

#[test]
fn impossible_intrinsics_stamps_and_emptiness_are_bad_data() {
    for (from, to, part) in [
        ("fx: 60.5", "fx: .nan", "fx"),
        ("fy: 60.25", "fy: 0.0", "fy"),
        ("depth_unit_m: 0.001", "depth_unit_m: 0", "depth_unit_m"),
        ("serial: \"018322070001\"", "serial: 18322070001", "serial"),
    ] {
        let fixture = Fixture::new(1);
        fixture.write("recording.yaml", fixture::valid_text(1).replacen(from, to, 1));
        check_bad(&fixture, &["recording.yaml", part]);
    }
    let reversed = Fixture::new(2);
    let (first, second) = (fixture::stamp_ns(0, 0).to_string(), fixture::stamp_ns(0, 1).to_string());
    let text = fixture::valid_text(2).replace(&first, "X").replace(&second, &first).replace('X', &second);
    reversed.write("recording.yaml", text);
    check_bad(&reversed, &["recording.yaml", "left"]);
    let empty = Fixture::new(0);
    empty.write("recording.yaml", fixture::valid_text(0).replace("frame_sets:", "frame_sets: []"));
    check_bad(&empty, &["recording.yaml", "empty"]);
}

#[test]
fn wrong_truth_is_bad_data() {
    let fixture = Fixture::new(1);
    fixture.write(
        "ground_truth.yaml",
        "poses:\n  left: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 0]}\n",
    );
    check_bad(&fixture, &["ground_truth.yaml"]);
}

#[test]
fn an_evaluation_goes_on_after_a_bad_recording() {
    let env = TestEnv::new();
    copy(synthetic_pair::recording(), &env.path("set/good"));
    copy(Fixture::new(1).path(), &env.path("set/deeper/dull"));
    copy(Fixture::new(1).path(), &env.path("set/bad"));
    std::fs::write(env.path("set/bad/recording.yaml"), "format: other\n").unwrap();
    copy(Fixture::new(1).path(), &env.path("set/untold"));
    std::fs::remove_file(env.path("set/untold/ground_truth.yaml")).unwrap();
    let ended =
        env.pelical(&["evaluate", "set", "--json"]).expect_code(65).expect_talk(&["set/bad", "1 of 3"]);
    let document = ended.json();
    assert_eq!(keys(&document), ["converged", "recordings", "schema", "wrong"]);
    assert_eq!(document["schema"], "pelical.evaluation/1");
    assert_eq!((&document["converged"], &document["wrong"]), (&1.into(), &0.into()));
    let paths: Vec<&str> = document["recordings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| entry["path"].as_str().unwrap())
        .collect();
    assert_eq!(paths, ["set/deeper/dull", "set/good"]);
    assert_eq!(document["recordings"][1]["calibration"]["schema"], "pelical.calibration/1");
}

#[test]
fn an_evaluation_follows_links_to_recordings_and_counts_each_once() {
    let env = TestEnv::new();
    std::fs::create_dir(env.path("set")).unwrap();
    copy(Fixture::new(1).path(), &env.path("dull"));
    std::os::unix::fs::symlink(env.path("dull"), env.path("set/link")).unwrap();
    std::os::unix::fs::symlink(env.path("set"), env.path("set/loop")).unwrap();
    let document = env.pelical(&["evaluate", "set", "./set/", "dull", "--json"]).expect_code(0).json();
    assert_eq!(document["recordings"].as_array().unwrap().len(), 1, "{document}");
}

#[test]
fn converged_far_from_the_truth_is_counted_wrong() {
    let env = TestEnv::new();
    copy(synthetic_pair::recording(), &env.path("set/good"));
    let text = "poses:\n  left: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}\n  right: {translation_m: [0.25, 0.1, 0], quaternion_xyzw: [0, 0, 0, 1]}\n";
    std::fs::write(env.path("set/good/ground_truth.yaml"), text).unwrap();
    let document = env.pelical(&["evaluate", "set", "--json"]).expect_code(1).json();
    assert_eq!((&document["converged"], &document["wrong"]), (&1.into(), &1.into()));
    let text = env.pelical(&["evaluate", "set"]).expect_code(1).stdout;
    assert!(text.contains("1 converged, 1 wrong"), "{text}");
}

#[test]
fn a_recording_is_never_written_over() {
    let env = TestEnv::new();
    env.config("cameras: {synthetic: {rig: pair, pace: unpaced}}\n");
    env.write("keep.txt", "mine");
    let arguments = ["record", ".", "--config", "pelicald.yaml", "--sets", "1"];
    env.pelical(&arguments).expect_code(1).expect_talk(&["empty"]);
    assert_eq!(std::fs::read_to_string(env.path("keep.txt")).unwrap(), "mine");
}

#[test]
fn a_recording_of_a_recording_is_the_same_frames() {
    let env = TestEnv::new();
    let fixture = Fixture::new(4);
    let from = fixture.path().display();
    env.config(&format!("cameras: {{backend: replay, replay: {{recording: {from}, pace: unpaced}}}}\n"));
    let arguments = ["record", "copy", "--config", "pelicald.yaml", "--json"];
    let document = env.pelical(&arguments).expect_code(0).json();
    assert_eq!((&document["schema"], &document["frame_sets"]), (&"pelical.recording/1".into(), &4.into()));
    let copy = pelical::capture::recording::Recording::open(&env.path("copy")).unwrap();
    assert_eq!(copy.frame_sets(), fixture.open().frame_sets());
}

#[test]
fn recording_ends_in_time_although_no_two_frames_belong_together() {
    let env = TestEnv::new();
    let fixture = Fixture::new(4);
    let from = fixture.path().display();
    let max_skew_ms = 0.5e-6 * fixture::SKEW_NS as f64;
    env.config(&format!(
        "cameras: {{backend: replay, replay: {{recording: {from}, loop: true}}}}\n\
         sync: {{max_skew_ms: {max_skew_ms}}}\n"
    ));
    let arguments = ["record", "nothing", "--config", "pelicald.yaml", "--duration", "0.3"];
    env.pelical(&arguments).expect_code(1).expect_talk(&["no frame set", "sync.max_skew_ms"]);
}

#[test]
fn devices_says_which_config_it_has_read() {
    let env = TestEnv::new();
    let config = env.config("");
    let config = config.to_str().unwrap();
    env.pelical(&["devices", "--config", config])
        .expect_code(0)
        .expect_talk(&[&format!("the cameras of {config}")]);
    let document = env.pelical(&["devices", "--config", config, "--json"]).json();
    assert_eq!(document["config"], config);
    if !std::path::Path::new("/etc/pelical/pelicald.yaml").exists() {
        let talk = ["no /etc/pelical/pelicald.yaml", "cameras of the defaults"];
        let ended = env.pelical(&["devices"]).expect_code(0).expect_talk(&talk);
        assert!(ended.stdout.contains("front") && ended.stdout.contains("synthetic"), "{}", ended.stdout);
        assert_eq!(env.pelical(&["devices", "--json"]).json()["config"], Value::Null);
    }
}

#[test]
fn devices_lists_the_cameras_of_the_back_end() {
    let env = TestEnv::new();
    let fixture = Fixture::new(1);
    env.config(&format!(
        "cameras: {{backend: replay, replay: {{recording: {}}}}}\n",
        fixture.path().display()
    ));
    let document = env.pelical(&["devices", "--config", "pelicald.yaml", "--json"]).expect_code(0).json();
    assert_eq!((&document["schema"], &document["backend"]), (&"pelical.devices/1".into(), &"replay".into()));
    assert_eq!(document["devices"][0]["serial"], fixture::SERIALS[0]);
}

fn copy(from: &std::path::Path, to: &std::path::Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}
