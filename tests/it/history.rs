//! What a daemon keeps: over a kill, a restart, a damaged file, other cameras and a disk that does not take it.

use std::path::{Path, PathBuf};

use nalgebra::{Matrix6, Vector3};
use pelical::geometry::motion::Motion;
use pelical::solver::{CameraPose, RigCalibration, State};
use pelical::store::{FrameSets, StoredCalibration, StoredCamera, encode};
use serde_json::Value;

use crate::env::{Running, TestEnv, poll};
use crate::fixture::{Fixture, SERIALS};
use crate::synthetic_pair;

/// Starts a daemon that plays a recording for ever and keeps its calibrations in the test's folder.
fn start(env: &TestEnv, recording: &Path, sections: &str) -> Running {
    let recording = recording.display();
    env.start_daemon(&env.config(&format!(
        "cameras: {{backend: replay, replay: {{recording: {recording}, loop: true}}}}\nsync: {{stalled_after_ms: 5000.0}}\n\
         store: {{directory: state}}\n{sections}"
    )))
}

fn file(env: &TestEnv, id: u64) -> PathBuf {
    env.path("state").join(&env.instance).join(format!("calibration-{id:06}.yaml"))
}

/// Waits until a calibration is on the disk, then kills the daemon.
#[track_caller]
fn kill_once_kept(env: &TestEnv, daemon: Running, id: u64) {
    poll(|| file(env, id).exists().then_some(()))
        .unwrap_or_else(|| panic!("{id} is not kept: {}", daemon.talk()));
    daemon.signal("KILL");
    daemon.wait();
}

/// The first calibration that a client of a new daemon gets.
fn first_calibration(env: &TestEnv) -> Value {
    poll(|| (env.pelical(&["status"]).code == 0).then_some(())).expect("the daemon answers");
    let watch = env.start_pelical(&["watch", "--json"]);
    let document = serde_json::from_str(&watch.first_printed()).unwrap();
    watch.signal("INT");
    watch.wait();
    document
}

fn history(env: &TestEnv) -> Vec<Value> {
    let document = env.pelical(&["history", "--json"]).expect_code(0).json();
    assert_eq!(document["schema"], "pelical.history/1");
    document["calibrations"].as_array().unwrap().clone()
}

fn place(document: &Value) -> &Value {
    &document["cameras"][0]["reference_from_camera"]
}

#[test]
fn an_accepted_calibration_survives_a_kill_is_verified_and_can_be_gone_back_to() {
    let env = TestEnv::new();
    let daemon = start(&env, synthetic_pair::recording(), "");
    env.wait_for_status("a result", |status| status["state"] == "converged");
    let made = env.pelical(&["export"]).expect_code(0).json();
    assert_eq!((&made["state"], &made["provenance"]["id"]), (&"converged".into(), &1.into()));
    kill_once_kept(&env, daemon, 1);

    let daemon = start(&env, synthetic_pair::recording(), "");
    let first = first_calibration(&env);
    assert_eq!(first["state"], "stored");
    assert_eq!((place(&first), &first["pairs"]), (place(&made), &made["pairs"]));
    for key in ["id", "made", "version", "config_sha256", "cameras", "restored_from"] {
        assert_eq!(first["provenance"][key], made["provenance"][key], "{key}");
    }
    let status = env.wait_for_status("a verified result", |status| status["state"] == "converged");
    assert_eq!((&status["calibration_id"], &status["activity"]), (&1.into(), &"watching".into()));
    assert!(status["calibration_age_s"].as_f64().unwrap() > 0.0, "{status}");
    assert!(daemon.talk().contains("the stored calibration is verified"), "{}", daemon.talk());
    assert_eq!(history(&env).len(), 1, "verifying makes no new calibration");

    env.pelical(&["recalibrate", "--wait"]).expect_code(0);
    assert_eq!(env.pelical(&["status", "--json"]).json()["calibration_id"], 2);
    env.pelical(&["rollback", "1"]).expect_code(0);
    let entries = history(&env);
    let ids: Vec<&Value> = entries.iter().map(|entry| &entry["id"]).collect();
    assert_eq!(ids, [3, 2, 1]);
    assert_eq!((&entries[0]["restored_from"], &entries[0]["is_published"]), (&1.into(), &true.into()));
    assert_eq!(entries[0]["made"], made["provenance"]["made"], "the provenance is that of the older one");
    let text = env.pelical(&["history"]).expect_code(0).stdout;
    assert!(text.contains("gone back to 1 published"), "{text}");
    kill_once_kept(&env, daemon, 3);

    let _daemon = start(&env, synthetic_pair::recording(), "");
    let first = first_calibration(&env);
    assert_eq!((&first["provenance"]["id"], place(&first)), (&3.into(), place(&made)));
    let older = env.pelical(&["export", "--id", "2"]).expect_code(0).json();
    assert_eq!((&older["provenance"]["id"], &older["state"]), (&2.into(), &"converged".into()));
}

#[test]
fn a_camera_that_was_moved_while_the_daemon_was_down_is_found_and_calibrated_again() {
    let env = TestEnv::new();
    let daemon = start(&env, synthetic_pair::recording(), "");
    env.wait_for_status("a result", |status| status["state"] == "converged");
    kill_once_kept(&env, daemon, 1);
    let daemon = start(&env, synthetic_pair::recording_after_a_move(), "watch: {on_moved: recalibrate}\n");
    assert_eq!(first_calibration(&env)["state"], "stored");
    env.wait_for_status("a new result", |status| {
        assert!(status["state"] != "converged" || status["calibration_id"] == 2, "verified: {status}");
        status["state"] == "converged"
    });
    let talk = daemon.talk();
    assert!(talk.contains("one of two cameras was moved") && !talk.contains("is verified"), "{talk}");
}

/// A calibration of cameras with these serial numbers.
fn stored(id: u64, serials: [&str; 2]) -> StoredCalibration {
    let camera = |(name, serial): (&str, &str)| StoredCamera {
        name: name.to_owned(),
        serial: serial.to_owned(),
        firmware: None,
    };
    let pose = |reference_from_camera| {
        Some(CameraPose { reference_from_camera, covariance: Matrix6::from_diagonal_element(1e-6) })
    };
    let place = Motion::new(Vector3::new(0.3, -0.02, 0.1 * id as f64), Vector3::new(0.1, 1.1, -0.2));
    StoredCalibration {
        id,
        made_ns: 1_700_000_000_000_000_000,
        restored: None,
        version: "0.1.0".to_owned(),
        config_hash: "0".repeat(64),
        frame_sets: FrameSets::default(),
        cameras: ["left", "right"].into_iter().zip(serials).map(camera).collect(),
        calibration: RigCalibration {
            state: State::Converged,
            reason: None,
            reference: 0,
            cameras: vec![pose(Motion::identity()), pose(place)],
            pairs: Vec::new(),
            frame_sets_used: 12,
        },
    }
}

/// Puts calibrations into the folder of a daemon that has not been started yet.
fn put(env: &TestEnv, entries: &[StoredCalibration]) {
    std::fs::create_dir_all(file(env, 1).parent().unwrap()).unwrap();
    for entry in entries {
        std::fs::write(file(env, entry.id), encode(entry).unwrap()).unwrap();
    }
}

#[test]
fn a_damaged_file_is_passed_over_and_what_cannot_be_verified_stays_stored() {
    let env = TestEnv::new();
    let fixture = Fixture::new(5);
    put(&env, &[stored(1, SERIALS), stored(2, SERIALS)]);
    let text = std::fs::read(file(&env, 2)).unwrap();
    std::fs::write(file(&env, 2), &text[..text.len() - 7]).unwrap();
    let daemon = start(&env, fixture.path(), "");
    let first = first_calibration(&env);
    assert_eq!((&first["state"], &first["provenance"]["id"]), (&"stored".into(), &1.into()));
    assert!(daemon.talk().contains("calibration-000002.yaml"), "{}", daemon.talk());
    let status = env.wait_for_status("frames", |status| status["activity"] == "watching");
    assert_eq!((&status["state"], &status["store_fault"]), (&"stored".into(), &Value::Null));
    let text = env.pelical(&["status"]).expect_code(0).stdout;
    assert!(text.contains("state       stored") && text.contains("calibration 1, made"), "{text}");
    env.pelical(&["export"]).expect_code(0).expect_talk(&["not verified"]);
    let refused = env.pelical(&["rollback", "2", "--json"]).expect_code(1).json();
    assert_eq!(refused["reason"]["code"], "unknown_calibration");
    env.pelical(&["export", "--id", "2"]).expect_code(4).expect_talk(&["no calibration 2"]);
    // Who goes back to the one that is served says that it is the right one from now on.
    env.pelical(&["rollback", "1"]).expect_code(0);
    poll(|| file(&env, 3).exists().then_some(())).expect("the number of the damaged file is not used again");
    env.pelical(&["recalibrate"]).expect_code(0);
    env.wait_for_status("collecting", |status| status["state"] == "collecting");
}

#[test]
fn a_calibration_of_other_cameras_is_not_served_and_the_log_says_why() {
    let env = TestEnv::new();
    let fixture = Fixture::new(5);
    put(&env, &[stored(1, SERIALS), stored(2, [SERIALS[0], "another"])]);
    let daemon = start(&env, fixture.path(), "");
    assert_eq!(first_calibration(&env)["provenance"]["id"], 1, "the newest one of these cameras");
    let talk = daemon.talk();
    assert!(talk.contains("right (another)") && talk.contains("right (left's)"), "{talk}");
    let refused = env.pelical(&["rollback", "2", "--json"]).expect_code(1).json();
    assert_eq!(refused["reason"]["code"], "other_rig");
    assert_eq!(history(&env).len(), 2);
}

#[test]
fn a_listed_rig_is_served_in_the_order_of_the_config() {
    let env = TestEnv::new();
    let fixture = Fixture::new(5);
    put(&env, &[stored(1, SERIALS)]);
    let [left, right] = SERIALS;
    let list = |names: [&str; 2], serials: [&str; 2]| {
        format!(
            "instance: {}\ncameras:\n  backend: replay\n  replay: {{recording: {}, loop: true}}\n  list: [{{name: {}, serial: \
             \"{}\"}}, {{name: {}, serial: \"{}\"}}]\nstore: {{directory: state}}\n",
            env.instance,
            fixture.path().display(),
            names[0],
            serials[0],
            names[1],
            serials[1]
        )
    };
    let daemon = env.start_daemon(&env.write("pelicald.yaml", &list(["eye", "other"], [left, right])));
    let first = first_calibration(&env);
    assert_eq!((&first["reference"], &first["cameras"][0]["name"]), (&"eye".into(), &"other".into()));
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
    let daemon = env.start_daemon(&env.write("pelicald.yaml", &list(["other", "eye"], [right, left])));
    env.wait_for_status("frames", |status| status["activity"] == "collecting");
    assert!(daemon.talk().contains("told in the frame of left"), "{}", daemon.talk());
    env.pelical(&["export"]).expect_code(4).expect_talk(&["no converged calibration"]);
}

#[test]
fn a_place_that_cannot_be_used_is_said_and_the_daemon_works_without() {
    let env = TestEnv::new();
    let fixture = Fixture::new(5);
    env.write("state", "a file, no folder");
    let daemon = start(&env, fixture.path(), "");
    let status = env.wait_for_status("frames", |status| status["activity"] == "collecting");
    let fault = status["store_fault"].as_str().expect("a fault");
    assert!(fault.contains("state") && fault.contains("set store.directory to a folder"), "{fault}");
    assert!(daemon.talk().contains(fault), "{}", daemon.talk());
    env.pelical(&["history"]).expect_code(1).expect_talk(&["set store.directory to a folder"]);
    assert!(env.pelical(&["status"]).stdout.contains("not kept    "));
}

#[test]
fn a_calibration_that_the_disk_does_not_take_is_marked_in_the_history() {
    let env = TestEnv::new();
    let _daemon = start(&env, synthetic_pair::recording(), "");
    poll(|| file(&env, 1).exists().then_some(())).expect("the first is kept");
    assert!(!env.pelical(&["history"]).expect_code(0).stdout.contains("not kept"));
    std::fs::remove_dir_all(env.path("state")).unwrap();
    env.write("state", "a file, no folder");
    env.pelical(&["recalibrate", "--wait"]).expect_code(0);
    let status = env.wait_for_status("a fault", |status| status["store_fault"].is_string());
    let document = env.pelical(&["history", "--json"]).expect_code(0).json();
    assert_eq!(document["store_fault"], status["store_fault"]);
    let text = env.pelical(&["history"]).expect_code(0).stdout;
    let rows: Vec<&str> = text.lines().collect();
    assert!(rows[1].starts_with("2 ") && rows[1].ends_with("published not kept"), "{text}");
    assert!(rows[2].starts_with("1 ") && !rows[2].contains("not kept"), "{text}");
    assert!(text.ends_with(&format!("not kept    {}\n", status["store_fault"].as_str().unwrap())), "{text}");
}

#[test]
fn without_a_place_nothing_is_kept_and_every_question_says_so() {
    let env = TestEnv::new();
    let fixture = Fixture::new(5);
    let recording = fixture.path().display();
    let daemon =
        env.start_daemon(&env.config(&format!(
            "cameras: {{backend: replay, replay: {{recording: {recording}, loop: true}}}}\n"
        )));
    env.wait_for_status("frames", |status| status["activity"] == "collecting");
    assert_eq!(daemon.talk().matches("calibrations are not kept").count(), 1, "{}", daemon.talk());
    env.pelical(&["history", "--json"]).expect_code(1).expect_talk(&["store.directory"]);
    env.pelical(&["rollback", "1"]).expect_code(1).expect_talk(&["keeps no history"]);
    for command in [&["history"][..], &["rollback", "1"], &["export"]] {
        let elsewhere = [command, &["--instance", "nobody"]].concat();
        env.pelical(&elsewhere).expect_code(3);
    }
    env.pelical(&["rollback", "0"]).expect_code(2);
}
