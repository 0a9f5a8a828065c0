//! The built daemon with the built client, over real shared memory.

use serde_json::Value;

use crate::env::{Running, TestEnv, poll};
use crate::fixture::{Fixture, SERIALS};
use crate::synthetic_pair;

/// A daemon of a recording that never converges: noise, played for ever.
fn start_dull(env: &TestEnv) -> (Fixture, Running) {
    let fixture = Fixture::new(5);
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), true)));
    env.wait_for_status("streaming cameras", |status| camera_states(status) == ["streaming", "streaming"]);
    (fixture, daemon)
}

/// A daemon that converges.
fn start_good(env: &TestEnv) -> Running {
    let daemon = env.start_daemon(&env.config(&replay(synthetic_pair::recording(), true)));
    env.wait_for_status("a converged result", |status| status["activity"] == "watching");
    daemon
}

fn replay(recording: &std::path::Path, is_loop: bool) -> String {
    let recording = recording.display();
    format!("cameras: {{backend: replay, replay: {{recording: {recording}, loop: {is_loop}}}}}\n")
}

fn camera_states(status: &Value) -> Vec<&str> {
    status["cameras"].as_array().unwrap().iter().map(|camera| camera["state"].as_str().unwrap()).collect()
}

#[test]
fn without_a_daemon_every_question_ends_with_3_and_what_to_do() {
    let env = TestEnv::new();
    for command in ["status", "watch", "recalibrate", "cancel"] {
        env.pelical(&[command]).expect_code(3).expect_talk(&[&env.instance, "start pelicald"]);
        let ended = env.pelical(&[command, "--json"]).expect_code(3);
        assert_eq!(ended.stdout, "");
    }
}

#[test]
fn a_daemon_answers_and_stops_cleanly_on_either_signal() {
    for signal in ["TERM", "INT"] {
        let env = TestEnv::new();
        let (_fixture, daemon) = start_dull(&env);
        let status = env.pelical(&["status", "--json"]).expect_code(0).json();
        assert_eq!(status["schema"], "pelical.status/1");
        assert_eq!(status["instance"], env.instance.as_str());
        assert_eq!(status["cameras"][0]["name"], "left");
        assert!(status["frame_sets"]["dropped"].is_u64(), "{status}");
        let text = env.pelical(&["status"]).expect_code(0).stdout;
        assert!(["streaming", "depth %", "lost", "clock"].iter().all(|word| text.contains(word)), "{text}");
        daemon.signal(signal);
        let ended = daemon.wait().expect_code(0);
        assert!(ended.stderr.contains("stopped"), "{}", ended.stderr);
        env.pelical(&["status"]).expect_code(3);
    }
}

#[test]
fn a_second_daemon_of_the_same_name_is_refused_and_the_first_goes_on() {
    let env = TestEnv::new();
    let (_fixture, _daemon) = start_dull(&env);
    let config = env.path("pelicald.yaml");
    let second = env.pelicald(&["--config", config.to_str().unwrap()]);
    second.expect_code(1).expect_talk(&[&env.instance, "already running"]);
    env.pelical(&["status"]).expect_code(0);
}

#[test]
fn a_killed_daemon_leaves_nothing_in_the_way_of_the_next() {
    let env = TestEnv::new();
    let (fixture, daemon) = start_dull(&env);
    daemon.signal("KILL");
    daemon.wait();
    env.pelical(&["status"]).expect_code(3);
    let _next = env.start_daemon(&env.config(&replay(fixture.path(), true)));
    env.wait_for_status("cameras after a restart", |status| {
        camera_states(status) == ["streaming", "streaming"]
    });
}

#[test]
fn requests_get_typed_answers() {
    let env = TestEnv::new();
    let (_fixture, _daemon) = start_dull(&env);
    env.wait_for_status("collecting", |status| status["activity"] == "collecting");
    let busy = env.pelical(&["recalibrate", "--json"]).expect_code(1).expect_talk(&["busy"]).json();
    assert_eq!((&busy["schema"], &busy["answer"]), (&"pelical.answer/1".into(), &"busy".into()));
    env.pelical(&["cancel"]).expect_code(0);
    let refused =
        env.pelical(&["cancel", "--json"]).expect_code(1).expect_talk(&["nothing to cancel"]).json();
    assert_eq!(refused["reason"]["code"], "nothing_to_cancel");
    let status = env.pelical(&["status", "--json"]).expect_code(0).json();
    assert_eq!(status["activity"], "idle");
    env.pelical(&["recalibrate"]).expect_code(0);
    env.wait_for_status("collecting again", |status| status["activity"] == "collecting");
}

#[test]
fn waiting_for_a_result_that_does_not_come_ends_with_4() {
    let env = TestEnv::new();
    let (_fixture, _daemon) = start_dull(&env);
    env.pelical(&["cancel"]).expect_code(0);
    let ended = env.pelical(&["recalibrate", "--wait", "--timeout", "1", "--json"]).expect_code(4);
    assert_eq!(ended.json()["reason"]["code"], "no_result");
}

#[test]
fn a_wait_ends_when_somebody_cancels() {
    let env = TestEnv::new();
    let (_fixture, _daemon) = start_dull(&env);
    env.pelical(&["cancel"]).expect_code(0);
    let waiting = env.start_pelical(&["recalibrate", "--wait"]);
    env.wait_for_status("collecting", |status| status["activity"] == "collecting");
    env.pelical(&["cancel"]).expect_code(0);
    waiting.wait().expect_code(4);
}

#[test]
fn a_late_subscriber_gets_the_result_and_recalibrating_gives_another() {
    let env = TestEnv::new();
    let _daemon = start_good(&env);
    let watch = env.start_pelical(&["watch", "--json"]);
    // The result that was there before.
    let document: Value = serde_json::from_str(&watch.first_printed()).unwrap();
    assert_eq!(
        (&document["schema"], &document["state"]),
        (&"pelical.calibration/1".into(), &"converged".into())
    );
    watch.signal("INT");
    watch.wait().expect_code(0);
    let before = env.pelical(&["status", "--json"]).json()["calibration_sequence"].as_u64().unwrap();
    let again = env.pelical(&["recalibrate", "--wait", "--json"]).expect_code(0).json();
    assert_eq!(again["state"], "converged");
    assert_eq!(again["cameras"][0]["name"], "right");
    let after = env.pelical(&["status", "--json"]).json()["calibration_sequence"].as_u64().unwrap();
    assert!(after > before, "{after} after {before}");
}

#[test]
fn a_frozen_daemon_is_not_said_to_have_nothing_published() {
    let env = TestEnv::new();
    let daemon = start_good(&env);
    env.pelical(&["export"]).expect_code(0);
    daemon.signal("STOP");
    for command in [&["export"][..], &["export", "--id", "1"], &["status"], &["history"]] {
        let ended = env.pelical(command).expect_code(3);
        assert!(ended.stdout.is_empty() && ended.stderr.contains("did not answer"), "{command:?}: {ended:?}");
    }
}

#[test]
fn a_missing_camera_is_reported_and_the_daemon_goes_on() {
    let env = TestEnv::new();
    let fixture = Fixture::new(5);
    let list = format!(
        "{}  list: [{{name: eye, serial: \"{}\"}}, {{name: ghost, serial: \"9\"}}]\n",
        block(&fixture),
        SERIALS[0]
    );
    let daemon = env.start_daemon(&env.config(&list));
    let status = env.wait_for_status("one eye", |status| camera_states(status).first() == Some(&"streaming"));
    assert_eq!(camera_states(&status), ["streaming", "waiting"]);
    let refused = env.pelical(&["recalibrate", "--json"]).expect_code(1).json();
    assert_eq!(refused["reason"]["code"], "no_cameras");
    assert!(daemon.talk().contains("waited for: no camera with serial \"9\""), "{}", daemon.talk());
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

fn block(fixture: &Fixture) -> String {
    format!(
        "cameras:\n  backend: replay\n  replay: {{recording: {}, loop: true}}\n",
        fixture.path().display()
    )
}

#[test]
fn the_end_of_a_recording_is_not_the_end_of_the_daemon() {
    let env = TestEnv::new();
    let fixture = Fixture::new(2);
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), false)));
    env.wait_for_status("ended cameras", |status| camera_states(status) == ["ended", "ended"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn a_camera_that_gives_bad_frames_is_reported_and_the_daemon_goes_on() {
    let env = TestEnv::new();
    let fixture = Fixture::new(1);
    std::fs::write(fixture.depth_file(1, 0), "no image").unwrap();
    let daemon = env.start_daemon(&env.config(&replay(fixture.path(), true)));
    env.wait_for_status("a failed camera", |status| {
        let bad = [0, 1].map(|camera| status["cameras"][camera]["bad"].as_u64());
        camera_states(status) == ["streaming", "failed"] && bad[0] == Some(0) && bad[1] > Some(0)
    });
    let talk = daemon.talk();
    let warnings: Vec<&str> = talk.lines().filter(|line| line.contains("bad frame")).collect();
    assert!(warnings.len() < 4, "seldom: {talk}");
    let file = fixture.depth_file(1, 0).display().to_string();
    assert!(warnings.first().is_some_and(|line| line.contains("WARN") && line.contains(&file)), "{talk}");
}

#[test]
fn a_folder_that_cannot_be_made_is_named_with_what_to_do() {
    let env = TestEnv::new();
    for folder in ["/proc/none", "/dev/null/x"] {
        let config = env.config(&format!("ipc: {{variant: file, directory: {folder}}}\n"));
        let ended = env.pelicald(&["--config", config.to_str().unwrap()]).expect_code(1);
        ended.expect_talk(&["ipc.directory", folder, "mode 0750", "RuntimeDirectory="]);
    }
}

#[test]
fn what_the_daemon_cannot_start_with_is_said_at_once() {
    let env = TestEnv::new();
    let config = env.config("cameras: {backend: replay, replay: {recording: nowhere}}\n");
    env.pelicald(&["--config", config.to_str().unwrap()]).expect_code(65).expect_talk(&["nowhere"]);
    let config = env.config("cameras: {reference: nobody}\n");
    let ended = env.pelicald(&["--config", config.to_str().unwrap()]);
    ended.expect_code(78).expect_talk(&["cameras.reference", "front, left, right"]);
    let config = env.config("cameras: {list: [{name: only, serial: \"synthetic-01\"}]}\n");
    let ended = env.pelicald(&["--config", config.to_str().unwrap()]);
    ended.expect_code(78).expect_talk(&["\"only\"", "at least two", "cameras.list"]);
}

#[test]
fn without_a_journal_the_log_goes_to_stderr_and_says_so() {
    if std::path::Path::new("/run/systemd/journal/socket").exists() {
        return;
    }
    let env = TestEnv::new();
    let fixture = Fixture::new(2);
    let config = env.config(&format!("log: {{format: journald}}\n{}", replay(fixture.path(), true)));
    let daemon = env.start_daemon(&config);
    poll(|| daemon.talk().contains("logging to stderr instead").then_some(())).expect("a warning");
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn the_demo_agrees_with_its_truth_and_leaves_no_daemon() {
    let env = TestEnv::new();
    let ended = env.pelical(&["demo", "--json"]).expect_code(0);
    let document = ended.json();
    assert_eq!((&document["state"], &document["reference"]), (&"converged".into(), &"front".into()));
    for entry in document["truth"].as_array().unwrap() {
        assert!(entry["rotation_error_deg"].as_f64().unwrap() < 0.2, "{entry}");
        assert!(entry["translation_error_mm"].as_f64().unwrap() < 5.0, "{entry}");
    }
    assert_eq!(document["truth"].as_array().unwrap().len(), 2);
    let firmware = &document["provenance"]["cameras"][1]["firmware"];
    assert_eq!(firmware, "synthetic-1", "{}", document["provenance"]);
    for stage in ["detect", "lift", "associate", "estimate", "total"] {
        assert!(document["timing_ms"][stage].as_f64().unwrap() > 0.0, "{stage} in {}", document["timing_ms"]);
    }
    env.pelical(&["status", "--instance", &demo_instance(&ended.stderr)]).expect_code(3);
}

#[test]
fn a_killed_demo_takes_its_daemon_along() {
    let env = TestEnv::new();
    let demo = env.start_pelical(&["demo"]);
    let instance =
        poll(|| Some(demo_instance(&demo.talk())).filter(|name| !name.is_empty())).expect("its name");
    let code = || env.pelical(&["status", "--instance", &instance]).code;
    poll(|| (code() == 0).then_some(())).expect("the demo's daemon answers");
    demo.signal("KILL");
    demo.wait();
    poll(|| (code() == 3).then_some(())).expect("the demo's daemon ends");
}

fn demo_instance(talk: &str) -> String {
    let name = talk.split("instance ").nth(1).and_then(|rest| rest.split_whitespace().next());
    name.unwrap_or_default().to_owned()
}

#[test]
fn the_log_is_json_when_asked() {
    let env = TestEnv::new();
    let fixture = Fixture::new(2);
    let daemon =
        env.start_daemon(&env.config(&format!("log: {{format: json}}\n{}", replay(fixture.path(), true))));
    let event: Value = serde_json::from_str(&daemon.first_talk()).unwrap();
    assert_eq!(event["level"], "INFO");
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn a_calibrated_rig_with_accelerometers_agrees_with_gravity_and_one_without_says_nothing_of_it() {
    for has_accel in [true, false] {
        let env = TestEnv::new();
        let _daemon = env.start_daemon(&env.config(&format!(
            "cameras:\n  backend: synthetic\n  synthetic: {{rig: pair, yaw_deg: 15.0, baseline_m: 0.25, seed: 7, rate_hz: 10.0, \
             view_step: 1.0, frames_per_view: 10, accel: {has_accel}}}\n"
        )));
        let off_deg = |status: &Value| -> Vec<Option<f64>> {
            let cameras = status["cameras"].as_array().unwrap().iter();
            cameras.map(|camera| camera["gravity_off_deg"].as_f64()).collect()
        };
        env.wait_for_status("small angles once calibrated", |status| {
            let is_small = |off_deg: &Option<f64>| off_deg.is_some_and(|off_deg| off_deg < 0.5);
            match has_accel {
                true => status["state"] == "converged" && off_deg(status).iter().all(is_small),
                false => status["state"] == "collecting" && off_deg(status) == [None, None],
            }
        });
        let text = env.pelical(&["status"]).expect_code(0).stdout;
        assert_eq!(text.contains("gravity off deg"), has_accel, "{text}");
    }
}
