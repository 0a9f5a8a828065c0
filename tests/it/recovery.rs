//! What the daemon does about a camera that opening again does not help, and about one whose driver hangs.

use crate::env::{Running, TestEnv, poll};
use crate::faults::{start_with, states};
use crate::fixture::Fixture;

/// A daemon of two cameras, the first of which suffers.
fn start(env: &TestEnv, fault: &str, recovery: &str) -> (Fixture, Running) {
    start_with(env, fault, (recovery, "stalled_after_ms: 200, reopen_after_ms: 300"))
}

#[test]
fn a_camera_that_opening_does_not_help_is_reset_and_streams_again() {
    let env = TestEnv::new();
    let recovery = "reopens_before_reset: 2, reset_interval_s: 1";
    let (_fixture, daemon) = start(&env, "fault: wedge, at_frame: 20", recovery);
    // The states on the way may be shorter than the time between two looks.
    poll(|| daemon.talk().contains("camera was reset").then_some(())).expect("it is reset");
    env.wait_for_status("it is back", |status| states(status) == ["streaming", "streaming"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
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
    let (_fixture, daemon) = start(&env, "fault: hang, at_frame: 10, for_s: 3", "leave_after_s: 30");
    env.wait_for_status("a hanging camera", |status| states(status) == ["stalled", "streaming"]);
    env.wait_for_status("it is back", |status| states(status) == ["streaming", "streaming"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}
