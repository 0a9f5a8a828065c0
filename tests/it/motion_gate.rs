//! Which frame sets are kept from the estimator, seen through the programs: fast turns, skew, and how both are told.

use std::path::Path;

use serde_json::Value;

use crate::env::TestEnv;
use crate::fixture::{self, Fixture};

/// A recording of two cameras whose left one has a gyro: a rate per frame set, rad/s.
fn with_gyro(rates_rad_per_s: &[f64]) -> Fixture {
    let fixture = Fixture::new(rates_rad_per_s.len());
    let lines =
        rates_rad_per_s.iter().zip(0..).map(|(rate, set)| format!("{},{rate}\n", fixture::stamp_ns(0, set)));
    fixture.write("left/turn_rates.csv", format!("stamp_ns,max_rad_per_s\n{}", lines.collect::<String>()));
    fixture
}

fn calibrate(env: &TestEnv, sync: &str, recording: &Path) -> Value {
    env.config(&format!("sync: {{{sync}}}\n"));
    let folder = recording.to_str().unwrap();
    env.pelical(&["calibrate", folder, "--config", "pelicald.yaml", "--json"]).json()
}

fn replay(recording: &Path, sync: &str) -> String {
    let folder = recording.display();
    format!("cameras:\n  backend: replay\n  replay: {{recording: {folder}, loop: true}}\nsync: {{{sync}}}\n")
}

#[test]
fn recorded_sets_that_a_gyro_calls_fast_are_not_used() {
    let (env, fixture) = (TestEnv::new(), with_gyro(&[0.1, 3.0, 0.2, 2.0, 0.0]));
    let sets = |sync: &str| calibrate(&env, sync, fixture.path())["frame_sets"].clone();
    let slow = sets("max_turn_deg_per_s: 60");
    assert_eq!((&slow["seen"], &slow["used"], &slow["refused"]), (&5.into(), &3.into(), &2.into()), "{slow}");
    assert_eq!(
        (&slow["refused_for"]["gyro"], &slow["refused_for"]["image"]),
        (&2.into(), &0.into()),
        "{slow}"
    );
    // 2 rad/s are 115 deg/s, 3 are 172.
    assert_eq!(sets("max_turn_deg_per_s: 150")["refused_for"]["gyro"], 1);
    assert_eq!(sets("max_turn_deg_per_s: 180")["refused_for"]["gyro"], 0);
}

#[test]
fn a_recording_of_fast_turns_alone_says_so() {
    let (env, fixture) = (TestEnv::new(), with_gyro(&[3.0; 4]));
    let document = calibrate(&env, "max_turn_deg_per_s: 30", fixture.path());
    assert_eq!(document["frame_sets"]["used"], 0);
    let sentence = document["reason"]["sentence"].as_str().unwrap();
    assert!(sentence.contains("turned faster than 30.0 deg/s") && sentence.contains("slowly"), "{sentence}");
}

#[test]
fn a_running_daemon_uses_no_set_of_a_fast_turn_and_tells_the_rate() {
    let (env, fixture) = (TestEnv::new(), with_gyro(&[3.0; 5]));
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), "max_turn_deg_per_s: 60")));
    let refused = |status: &Value| status["frame_sets"]["refused_for"]["gyro"].as_u64().unwrap();
    let status = env.wait_for_status("refused sets", |status| refused(status) > 20);
    assert_eq!(
        (&status["frame_sets"]["used"], &status["turn"]["by"]),
        (&0.into(), &"gyro".into()),
        "{status}"
    );
    assert!((status["turn"]["deg_per_s"].as_f64().unwrap() - 3f64.to_degrees()).abs() < 1e-6, "{status}");
    let text = env.pelical(&["status"]).expect_code(0).stdout;
    assert!(text.contains("turning fast (gyro)") && text.contains("turning     172 deg/s (gyro)"), "{text}");
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn the_skew_of_each_pair_is_told() {
    let (env, fixture) = (TestEnv::new(), Fixture::new(5));
    let of_recording = &calibrate(&env, "max_skew_ms: 8", fixture.path())["pairs"][0]["skew"];
    assert_eq!((&of_recording["sets"], &of_recording["beyond"]), (&5.into(), &0.into()));
    assert_eq!(of_recording["max_ms"], fixture::SKEW_NS as f64 * 1e-6);
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), "max_skew_ms: 8")));
    let sets = |status: &Value| status["pair_skews"][0]["sets"].as_u64().unwrap_or(0);
    let status = env.wait_for_status("measured skew", |status| sets(status) > 20);
    let skew = &status["pair_skews"][0];
    assert_eq!(skew["cameras"], serde_json::json!(["left", "right"]));
    for quantile in ["p50_ms", "p99_ms"] {
        assert!((skew[quantile].as_f64().unwrap() - 0.15).abs() < 0.01, "{skew}");
    }
    assert!(env.pelical(&["status"]).stdout.contains("time between frames"));
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn frames_beyond_the_limit_form_no_set_and_are_counted() {
    let (env, fixture) = (TestEnv::new(), Fixture::new(5));
    let limit = "max_skew_ms: 0.1";
    let recorded = calibrate(&env, limit, fixture.path());
    assert_eq!(recorded["frame_sets"]["refused_for"]["skew"], 5, "{recorded}");
    assert_eq!(
        (&recorded["pairs"][0]["skew"]["beyond"], &recorded["frame_sets"]["used"]),
        (&5.into(), &0.into())
    );
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), limit)));
    let skew = |status: &Value| status["pair_skews"][0].clone();
    let status =
        env.wait_for_status("refused sets", |status| skew(status)["beyond"].as_u64().unwrap_or(0) > 20);
    assert_eq!((&status["frame_sets"]["seen"], &skew(&status)["sets"]), (&0.into(), &0.into()), "{status}");
    assert!(status["frame_sets"]["refused_for"]["skew"].as_u64().unwrap() > 5, "{status}");
    assert!((skew(&status)["last_beyond_ms"].as_f64().unwrap() - 0.15).abs() < 1e-6, "{status}");
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

/// What is said of the fixture's cameras where the limit is 0.1 ms.
const APART: &str = "frames of left and right are at least 0.15 ms apart, the limit is 0.1 ms: check the cameras' clocks and frame rates, \
                     or raise sync.max_skew_ms";

#[test]
fn cameras_that_never_meet_are_told_as_the_reason_of_a_recording() {
    let (env, fixture) = (TestEnv::new(), Fixture::new(5));
    env.config("sync: {max_skew_ms: 0.1}\n");
    let folder = fixture.path().to_str().unwrap();
    for arguments in [&["calibrate", folder][..], &["replay", folder], &["replay", folder, "--fast"]] {
        let arguments = [arguments, &["--config", "pelicald.yaml"]].concat();
        let document = env.pelical(&[&arguments[..], &["--json"]].concat()).expect_code(4).json();
        assert_eq!(document["reason"]["sentence"], APART, "{arguments:?}");
        let missing = document["missing"][0]["reason"]["sentence"].as_str().unwrap();
        assert!(missing.ends_with(APART), "{arguments:?}: {missing}");
        let text = env.pelical(&arguments).expect_code(4).stdout;
        assert_eq!(text.matches(APART).count(), 1, "once: {text}");
        assert!(!text.contains("lens cover"), "{text}");
    }
}

#[test]
fn a_daemon_whose_cameras_never_meet_says_so_wherever_it_is_asked() {
    let (env, fixture) = (TestEnv::new(), Fixture::new(5));
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), "max_skew_ms: 0.1")));
    let status = env.wait_for_status("a reason", |status| !status["reason"].is_null());
    assert_eq!((&status["activity"], &status["reason"]["sentence"]), (&"collecting".into(), &APART.into()));
    let text = env.pelical(&["status"]).expect_code(0).stdout;
    assert!(text.contains(&format!("reason      {APART}")), "{text}");
    env.pelical(&["cancel"]).expect_code(0);
    env.pelical(&["recalibrate", "--wait", "--timeout", "2"]).expect_code(4).expect_talk(&[APART]);
    let told = daemon.talk().lines().filter(|line| line.contains(APART)).count();
    assert_eq!(told, 1, "{}", daemon.talk());
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn a_recording_with_a_damaged_image_is_not_replayed_in_silence() {
    let env = TestEnv::new();
    for is_gone in [false, true] {
        let fixture = Fixture::new(6);
        let file = fixture.depth_file(1, 3);
        let bytes = std::fs::read(&file).unwrap();
        if is_gone {
            std::fs::remove_file(&file).unwrap()
        } else {
            std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap()
        }
        let folder = fixture.path().to_str().unwrap();
        for arguments in [&["calibrate", folder][..], &["replay", folder], &["replay", folder, "--fast"]] {
            env.pelical(arguments).expect_code(65).expect_talk(&[file.to_str().unwrap()]);
        }
    }
}

#[test]
fn a_rendered_rig_with_a_gyro_is_recorded_with_its_turn_rates_and_firmware() {
    let env = TestEnv::new();
    let record = |folder: &str, gyro: bool| {
        env.config(&format!(
            "cameras:\n  backend: synthetic\n  synthetic: {{rig: pair, seed: 7, pace: unpaced, rate_hz: 2, view_step: 1, gyro: {gyro}}}\n"
        ));
        env.pelical(&["record", folder, "--config", "pelicald.yaml", "--sets", "4"]).expect_code(0);
        calibrate(&env, "max_turn_deg_per_s: 10", &env.path(folder))["frame_sets"].clone()
    };
    // The rig jumps from view to view, half a second apart.
    let with = record("with", true);
    assert_eq!((&with["seen"], &with["refused_for"]["gyro"]), (&4.into(), &3.into()), "{with}");
    // So far apart that images tell nothing.
    assert_eq!(record("without", false)["refused"], 0);
    assert!(!env.path("without").join("left/turn_rates.csv").exists());
    let devices = env.pelical(&["devices", "--json"]).expect_code(0).json();
    assert_eq!(devices["devices"][0]["firmware"], "synthetic-1");
}

#[test]
fn broken_turn_rates_are_bad_data_with_file_and_line() {
    let (env, fixture) = (TestEnv::new(), with_gyro(&[0.1, 0.2]));
    fixture.write("left/turn_rates.csv", "stamp_ns,max_rad_per_s\n5,fast\n");
    let folder = fixture.path().to_str().unwrap();
    env.pelical(&["calibrate", folder]).expect_code(65).expect_talk(&[
        "left/turn_rates.csv",
        "line 2",
        "rad/s",
    ]);
}
