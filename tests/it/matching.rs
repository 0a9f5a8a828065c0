//! `pelical match` and `pelical bench`: documents, the picture, and honest messages.

use std::fs;

use serde_json::Value;

use crate::env::{Ended, TestEnv};
use crate::fixture::{self, Fixture};
use crate::synthetic_pair;

fn run(arguments: &[&str]) -> Ended {
    TestEnv::new().pelical(arguments)
}

fn folder() -> &'static str {
    synthetic_pair::recording().to_str().unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

fn count(value: &Value, key: &str) -> usize {
    value[key].as_u64().unwrap_or_else(|| panic!("{key} in {value}")) as usize
}

/// Counts agree with what they count, and indices with what they name.
fn check_set(set: &Value) {
    assert_eq!(keys(set), ["counts", "pairs", "precision", "recall", "set", "timing_ms", "views"]);
    let lines: Vec<&Vec<Value>> =
        set["views"].as_array().unwrap().iter().map(|view| view["segments"].as_array().unwrap()).collect();
    assert_eq!(count(&set["counts"], "segments"), lines.iter().map(|lines| lines.len()).sum::<usize>());
    let pair = &set["pairs"][0];
    assert_eq!([&pair["target"], &pair["source"]], ["left", "right"]);
    let matches = pair["matches"].as_array().unwrap();
    assert_eq!(count(&pair["counts"], "matches"), matches.len());
    for found in matches {
        assert!(
            count(found, "target") < lines[0].len() && count(found, "source") < lines[1].len(),
            "{found}"
        );
    }
    let judged = |is: Value| matches.iter().filter(|found| found["true"] == is).count();
    let truth = &set["counts"]["truth"];
    assert_eq!(count(truth, "right"), judged(true.into()));
    assert_eq!(count(truth, "wrong"), judged(false.into()));
    assert_eq!(count(truth, "unjudged"), judged(Value::Null));
    assert_eq!(count(truth, "shared"), pair["shared"].as_array().unwrap().len());
    assert!(count(truth, "shared_found") <= count(truth, "shared"), "{truth}");
}

#[test]
fn the_document_has_segments_lines_and_judged_matches_of_every_set() {
    let document = run(&["match", folder(), "--association", "descriptor", "--min-length-px", "0", "--json"])
        .expect_code(0)
        .json();
    let expected = [
        "association",
        "counts",
        "min_length_px",
        "precision",
        "recall",
        "recording",
        "schema",
        "sets",
        "timing_ms",
    ];
    assert_eq!(keys(&document), expected);
    assert_eq!(
        (&document["schema"], &document["association"]),
        (&"pelical.match/1".into(), &"descriptor".into())
    );
    let sets = document["sets"].as_array().unwrap();
    assert_eq!(sets.len(), 10);
    sets.iter().for_each(check_set);
    for key in ["right", "wrong", "shared", "shared_found"] {
        let sum: usize = sets.iter().map(|set| count(&set["counts"]["truth"], key)).sum();
        assert_eq!(count(&document["counts"]["truth"], key), sum, "{key}");
    }
    let line =
        sets[0]["views"][0]["segments"].as_array().unwrap().iter().find(|line| !line["line"].is_null());
    assert_eq!(keys(line.unwrap()), ["length_px", "line", "px", "sigma_across_px"]);
    assert_eq!(keys(&line.unwrap()["line"]), ["ends_m", "side", "sigma_z_m"]);
    let truth = &document["counts"]["truth"];
    assert!(count(truth, "shared") > 50, "views that overlap share edges: {truth}");
    assert!(document["precision"].as_f64().unwrap() > 0.5, "{truth}");
    assert!(document["recall"].as_f64().unwrap() > 0.3, "{truth}");
}

#[test]
fn a_pose_that_is_right_explains_nearly_all_that_is_shared() {
    let arguments = ["match", folder(), "--association", "geometric", "--set", "1", "--json"];
    let document = run(&arguments).expect_code(0).json();
    let sets = document["sets"].as_array().unwrap();
    assert_eq!((sets.len(), &sets[0]["set"]), (1, &1.into()));
    check_set(&sets[0]);
    assert!(document["precision"].as_f64().unwrap() > 0.95, "{}", document["counts"]);
    assert!(document["recall"].as_f64().unwrap() > 0.9, "{}", document["counts"]);
    assert!(sets[0]["pairs"][0]["matches"][0]["nats"].is_null(), "no score was asked");
}

#[test]
fn the_picture_shows_both_images_and_says_which_set_it_is() {
    let env = TestEnv::new();
    let arguments = [
        "match",
        folder(),
        "--association",
        "descriptor",
        "--set",
        "2",
        "-o",
        "overlay.png",
        "--min-length-px",
        "50",
    ];
    let ended = env.pelical(&arguments).expect_code(0).expect_talk(&["frame set 2", "overlay.png"]);
    assert!(ended.stdout.contains("left <- right") && ended.stdout.contains("precision"), "{}", ended.stdout);
    let picture = image::open(env.path("overlay.png")).unwrap().into_rgb8();
    assert!(picture.width() > 2 * picture.height() && picture.height() > 480, "{:?}", picture.dimensions());
    let is_coloured =
        |pixel: &&image::Rgb<u8>| pixel.0.iter().max().unwrap() - pixel.0.iter().min().unwrap() > 120;
    assert!(picture.pixels().filter(is_coloured).count() > 500, "matches have colours");
    let nowhere =
        ["match", folder(), "--association", "descriptor", "--set", "2", "-o", "nowhere/overlay.png"];
    env.pelical(&nowhere).expect_code(1).expect_talk(&["cannot write nowhere/overlay.png", "No such file"]);
}

#[test]
fn without_ground_truth_nothing_is_judged() {
    let fixture = Fixture::new(2);
    fs::remove_file(fixture.path().join("ground_truth.yaml")).unwrap();
    let document = run(&["match", fixture.path().to_str().unwrap(), "--json"]).expect_code(0).json();
    assert_eq!([&document["precision"], &document["recall"]], [&Value::Null; 2]);
    assert_eq!(document["counts"]["truth"], Value::Null);
    assert_eq!(document["sets"][1]["pairs"][0]["shared"], Value::Null);
}

#[test]
fn what_cannot_be_matched_is_told() {
    let fixture = Fixture::new(2);
    let path = fixture.path().to_str().unwrap();
    run(&["match", path, "--set", "2"]).expect_code(65).expect_talk(&[path, "no frame set 2", "0 to 1"]);
    run(&["match", path, "--set", "first"]).expect_code(2);
    run(&["match", path, "--association", "guess"]).expect_code(2);
    run(&["match"]).expect_code(2);
    run(&["match", "nowhere"]).expect_code(65).expect_talk(&["nowhere", "no such folder"]);
    let no_model =
        run(&["match", path, "--association", "onnx"]).expect_code(1).expect_talk(&["no learned matcher"]);
    assert_eq!(no_model.stdout, "", "no document without a result");
    let both = fixture::valid_text(2);
    let (left, right) = (both.find("  - name: left").unwrap(), both.find("  - name: right").unwrap());
    let alone = format!("{}{}frame_sets:\n", &both[..left], &both[left..right]);
    let sets = (0..2).map(|set| format!("  - [{}]\n", fixture::stamp_ns(0, set)));
    fixture.write("recording.yaml", alone + &sets.collect::<String>());
    fs::remove_file(fixture.path().join("ground_truth.yaml")).unwrap();
    run(&["match", path]).expect_code(65).expect_talk(&["one camera", "two or more"]);
}

#[test]
fn the_bench_tells_times_lines_and_drops() {
    let document = run(&["bench", folder(), "--seconds", "2", "--json"]).expect_code(0).json();
    assert_eq!(keys(&document), ["cores", "images_px", "one_core", "pipeline", "recording", "schema"]);
    assert_eq!(document["schema"], "pelical.bench/1");
    let stages = |part: &str| document[part]["stages"].as_array().unwrap().clone();
    let names = |part: &str| -> Vec<String> {
        stages(part).iter().map(|stage| stage["stage"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(names("one_core"), ["gray", "detect", "lift", "describe", "match"]);
    let live = ["detect", "lift", "frame to set", "frame to progress", "associate", "estimate"];
    assert_eq!(names("pipeline"), live);
    for stage in [&stages("one_core")[..], &stages("pipeline")[..2]].concat() {
        let times = ["p50_ms", "p95_ms", "p99_ms", "max_ms"].map(|key| stage[key].as_f64().unwrap());
        assert!(times.is_sorted(), "{stage}");
        assert!(count(&stage, "count") > 0, "{stage}");
    }
    for part in ["one_core", "pipeline"] {
        let lines = &document[part]["lines"];
        assert!(
            lines["per_image"].as_f64().unwrap() >= lines["lifted_per_image"].as_f64().unwrap(),
            "{lines}"
        );
        assert!(lines["per_image"].as_f64().unwrap() > 10.0, "{lines}");
    }
    assert!(count(&document["pipeline"]["sets"], "done") > 0, "{document}");
    assert_eq!(
        keys(&document["pipeline"]["drops"]),
        ["frames", "sets", "skipped_by_estimator", "unmatched_frames"]
    );
    run(&["bench", "nowhere"]).expect_code(65);
    let text = run(&["bench", folder(), "--seconds", "0.2", "--rate-hz", "5"]).expect_code(0).stdout;
    assert!(text.contains("one core: ") && text.contains("dropped  "), "{text}");
}
