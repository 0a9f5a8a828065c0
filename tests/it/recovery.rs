//! What the daemon does about a camera that opening again does not help, and about one whose driver hangs.

use serde_json::Value;

use crate::env::{Running, TestEnv};
use crate::fixture::{Fixture, SERIALS};

/// A daemon of two cameras, the first of which suffers.
fn start(env: &TestEnv, fault: &str, recovery: &str) -> (Fixture, Running) {
    let fixture = Fixture::new(5);
    let config = env.config(&format!(
        "cameras:\n  backend: replay\n  replay: {{recording: {}, loop: true}}\n  recovery: {{{recovery}}}\n  faults:\n    list: \
         [{{serial: \"{}\", {fault}}}]\nsync: {{stalled_after_ms: 200, reopen_after_ms: 300}}\n",
        fixture.path().display(),
        SERIALS[0]
    ));
    let daemon = env.start_daemon(&config);
    (fixture, daemon)
}

fn states(status: &Value) -> Vec<&str> {
    status["cameras"].as_array().unwrap().iter().map(|camera| camera["state"].as_str().unwrap()).collect()
}

#[test]
fn a_camera_that_opening_does_not_help_is_reset_and_streams_again() {
    let env = TestEnv::new();
    let recovery = "reopens_before_reset: 2, reset_interval_s: 1";
    let (_fixture, daemon) = start(&env, "fault: wedge, at_frame: 20", recovery);
    env.wait_for_status("a wedged camera", |status| states(status) == ["stalled", "streaming"]);
    env.wait_for_status("it is back", |status| states(status) == ["streaming", "streaming"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0).expect_talk(&["camera was reset"]);
}

#[test]
fn a_driver_that_hangs_ends_the_daemon_with_its_own_exit_code() {
    let env = TestEnv::new();
    let (_fixture, daemon) = start(&env, "fault: hang, at_frame: 10", "leave_after_s: 1");
    daemon.wait().expect_code(74).expect_talk(&["cap-", "hangs in the driver", "leave_after_s"]);
}

#[test]
fn a_driver_that_hangs_for_a_moment_is_waited_for() {
    let env = TestEnv::new();
    let (_fixture, daemon) = start(&env, "fault: hang, at_frame: 10, for_s: 1", "leave_after_s: 30");
    env.wait_for_status("a hanging camera", |status| states(status) == ["stalled", "streaming"]);
    env.wait_for_status("it is back", |status| states(status) == ["streaming", "streaming"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}
