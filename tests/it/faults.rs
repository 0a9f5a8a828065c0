//! Cameras that stall, go away and come back in a running daemon, from `cameras.faults` of its config.

use serde_json::Value;

use crate::env::{Running, TestEnv};
use crate::fixture::{Fixture, SERIALS};

/// A daemon of two cameras, the first of which suffers; with what its sections `cameras.recovery` and `sync` say.
pub fn start_with(env: &TestEnv, fault: &str, (recovery, sync): (&str, &str)) -> (Fixture, Running) {
    let fixture = Fixture::new(5);
    let config = env.config(&format!(
        "cameras:\n  backend: replay\n  replay: {{recording: {}, loop: true}}\n  recovery: {{{recovery}}}\n  faults:\n    list: \
         [{{serial: \"{}\", {fault}}}]\nsync: {{{sync}}}\n",
        fixture.path().display(),
        SERIALS[0]
    ));
    let daemon = env.start_daemon(&config);
    (fixture, daemon)
}

fn start(env: &TestEnv, fault: &str) -> (Fixture, Running) {
    start_with(env, fault, ("", "stalled_after_ms: 300, reopen_after_ms: 60000"))
}

/// The cameras' states, in their order.
pub fn states(status: &Value) -> Vec<&str> {
    status["cameras"].as_array().unwrap().iter().map(|camera| camera["state"].as_str().unwrap()).collect()
}

#[test]
fn a_stalled_camera_is_reported_and_comes_back_while_the_other_goes_on() {
    let env = TestEnv::new();
    let (_fixture, daemon) = start(&env, "fault: stall, at_frame: 20, for_s: 3");
    env.wait_for_status("a stalled camera", |status| states(status) == ["stalled", "streaming"]);
    env.wait_for_status("it is back", |status| states(status) == ["streaming", "streaming"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn an_unplugged_camera_is_opened_again_when_it_is_back() {
    let env = TestEnv::new();
    let (_fixture, daemon) = start(&env, "fault: unplug, at_frame: 20, for_s: 2");
    let is_away = |status: &Value| states(status) == ["unplugged", "streaming"];
    env.wait_for_status("an unplugged camera", is_away);
    env.wait_for_status("it is back", |status| states(status) == ["streaming", "streaming"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn a_camera_that_is_gone_for_good_is_not_the_end_of_the_daemon() {
    let env = TestEnv::new();
    let (_fixture, daemon) = start(&env, "fault: unplug, at_frame: 5");
    let status =
        env.wait_for_status("an unplugged camera", |status| states(status) == ["unplugged", "streaming"]);
    let frames = |status: &Value| status["cameras"][1]["frames"].as_u64().unwrap();
    env.wait_for_status("frames of the other", |later| frames(later) > frames(&status));
    let refused = env.pelical(&["recalibrate", "--json"]).expect_code(1).json();
    assert_eq!(refused["reason"]["code"], "no_cameras");
    assert!(env.pelical(&["status"]).stdout.contains("unplugged"));
    daemon.signal("INT");
    daemon.wait().expect_code(0);
}

#[test]
fn a_fault_that_cannot_be_meant_is_refused() {
    let env = TestEnv::new();
    for (fault, part) in [
        ("fault: explode, at_frame: 1", "`unplug`"),
        ("fault: drop", "either at_frame or chance"),
        ("fault: drop, chance: 2", "0 to 1"),
        ("fault: stall, at_frame: 1, for_s: -1", "out of range"),
        ("fault: drop, at_frame: 1, serial: 12", "twice"),
        ("fault: stamp_jump, at_frame: 1", "stamp_jump needs it"),
        ("fault: stall, at_frame: 1, by_ms: 5", "no other fault has it"),
        ("fault: stamp_jump, at_frame: 1, by_ms: 1e9", "out of range"),
    ] {
        env.write("c.yaml", &format!("cameras:\n  faults:\n    list:\n    - {{serial: \"1\", {fault}}}\n"));
        let ended = env.pelicald(&["--config", "c.yaml", "--check-config"]).expect_code(78);
        ended.expect_talk(&["c.yaml:4: cameras.faults.list[0]", part]);
    }
}
