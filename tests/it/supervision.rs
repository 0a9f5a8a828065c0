//! What the built daemon tells its service manager, over a socket as systemd gives it one; and the config it takes on SIGHUP.

use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

use crate::env::{PATIENCE, Running, TestEnv, poll};
use crate::fixture::{Fixture, SERIALS};

/// Longest silence that counts as the end of the signs of life; they come four times in this time.
const SILENCE: Duration = Duration::from_secs(1);
/// What the manager's patience is said to be.
const WATCHDOG_USEC: &str = "2000000";

/// A service manager that only listens.
struct Manager {
    socket: UnixDatagram,
    daemon: Running,
    env: TestEnv,
    _fixture: Fixture,
}

impl Manager {
    /// Starts a daemon of two cameras with more lines in its config; `faults` go to the first camera.
    fn start(faults: &str, more: &str) -> Self {
        let (env, fixture) = (TestEnv::new(), Fixture::new(5));
        let config = env.config(&text(&fixture, faults, more));
        let path = env.path("notify");
        let socket = UnixDatagram::bind(&path).unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
        let variables = [("NOTIFY_SOCKET", path.to_str().unwrap()), ("WATCHDOG_USEC", WATCHDOG_USEC)];
        let daemon = env.start_daemon_with(&config, &variables);
        Self { socket, daemon, env, _fixture: fixture }
    }

    /// The next thing that is told; `None` after a short silence.
    fn next(&self) -> Option<String> {
        let mut buffer = [0; 4096];
        let length = self.socket.recv(&mut buffer).ok()?;
        Some(String::from_utf8(buffer[..length].to_vec()).unwrap())
    }

    /// Waits until something like this is told; what was told before and it, in order.
    #[track_caller]
    fn wait_for(&self, what: &str) -> Vec<String> {
        let (start, mut told) = (Instant::now(), Vec::new());
        while start.elapsed() < PATIENCE {
            told.extend(self.next());
            if told.last().is_some_and(|last| last.contains(what)) {
                return told;
            }
        }
        panic!("{what:?} was not told, but {told:#?}; the daemon said {}", self.daemon.talk());
    }

    /// Everything that is told during this time.
    fn told_within(&self, time: Duration) -> Vec<String> {
        let start = Instant::now();
        let mut told = Vec::new();
        while start.elapsed() < time {
            told.extend(self.next());
        }
        told
    }

    fn rewrite(&self, faults: &str, more: &str) {
        self.env.config(&text(&self._fixture, faults, more));
    }

    fn stop(self) {
        self.daemon.signal("TERM");
        self.daemon.wait().expect_code(0);
    }
}

fn text(fixture: &Fixture, faults: &str, more: &str) -> String {
    format!(
        "cameras:\n  backend: replay\n  replay: {{recording: {}, loop: true}}\n  recovery: {{leave_after_s: null}}\n  faults:\n    list: [{faults}]\n\
         sync: {{stalled_after_ms: 300, reopen_after_ms: 60000}}\n{more}",
        fixture.path().display(),
    )
}

fn fault(what: &str) -> String {
    format!("{{serial: \"{}\", fault: {what}}}", SERIALS[0])
}

#[test]
fn the_manager_hears_that_it_is_ready_how_it_is_that_it_lives_and_that_it_ends() {
    let manager = Manager::start("", "");
    manager.wait_for("READY=1");
    manager.wait_for("STATUS=collecting; 2 of 2 cameras deliver frames");
    for _ in 0..3 {
        manager.wait_for("WATCHDOG=1");
    }
    manager.daemon.signal("TERM");
    manager.wait_for("STOPPING=1");
    manager.daemon.wait().expect_code(0);
}

#[test]
fn a_device_that_hangs_ends_the_signs_of_life_and_is_named() {
    let manager = Manager::start(&fault("hang, at_frame: 20"), "");
    manager.wait_for("WATCHDOG=1");
    manager.wait_for("STATUS=hangs: cap-left does not move");
    let told = manager.told_within(SILENCE);
    assert!(!told.iter().any(|what| what.contains("WATCHDOG=1")), "{told:?}");
    assert!(manager.daemon.talk().contains("hangs"), "{}", manager.daemon.talk());
    manager.stop();
}

#[test]
fn a_device_that_comes_back_from_a_hang_is_forgiven() {
    let manager = Manager::start(&fault("hang, at_frame: 20, for_s: 4"), "");
    manager.wait_for("STATUS=hangs: cap-left does not move");
    manager.wait_for("WATCHDOG=1");
    manager.wait_for("2 of 2 cameras deliver frames");
    manager.stop();
}

#[test]
fn cameras_without_frames_are_a_state_and_no_hang() {
    let both =
        SERIALS.map(|serial| format!("{{serial: \"{serial}\", fault: stall, at_frame: 20, for_s: 600}}"));
    let manager = Manager::start(&both.join(", "), "");
    manager.wait_for("0 of 2 cameras deliver frames (left is stalled, right is stalled)");
    for _ in 0..3 {
        manager.wait_for("WATCHDOG=1");
    }
    manager.stop();
}

#[test]
fn a_start_that_waits_for_its_cameras_is_extended_and_ends_when_they_are_there() {
    let faults = fault("unplug, at_frame: 0, for_s: 4");
    let manager = Manager::start(&faults, "service: {ready_when: cameras}\n");
    let told = manager.wait_for("ready when every camera delivers frames");
    assert!(!told.iter().any(|what| what == "READY=1"), "{told:?}");
    manager.wait_for("EXTEND_TIMEOUT_USEC=");
    manager.wait_for("READY=1");
    manager.wait_for("WATCHDOG=1");
    manager.stop();
}

#[test]
fn a_new_config_is_taken_as_a_whole_or_not_at_all() {
    let manager = Manager::start("", "log: {level: info}\n");
    manager.wait_for("READY=1");
    let said = |what: &str| poll(|| manager.daemon.talk().contains(what).then_some(()));
    for (faults, more, what) in [
        ("", "log: {level: debug}\nwatch: {min_moved_mm: 7}\n", "watch.min_moved_mm cannot be changed while"),
        ("", "log: {level: debug}\nwatch: {on_moved: never}\n", "watch.on_moved"),
        ("", "log: {level: debug}\n", "changed=\"log.level\""),
    ] {
        manager.rewrite(faults, more);
        manager.daemon.signal("HUP");
        let told = manager.wait_for("RELOADING=1");
        let stamp = told
            .last()
            .and_then(|last| last.split_once("MONOTONIC_USEC="))
            .map(|(_, stamp)| stamp.to_owned());
        assert!(stamp.is_some_and(|stamp| stamp.parse::<u64>().is_ok()), "{told:?}");
        manager.wait_for("READY=1");
        said(what).unwrap_or_else(|| panic!("{what:?} is not in {}", manager.daemon.talk()));
        // The manager takes every reload for a success: the status tells whether it was one.
        let status = manager.wait_for("STATUS=").pop().unwrap();
        assert_eq!(status.contains("config file is not taken"), !what.starts_with("changed"), "{status}");
        let is_debug = manager.daemon.talk().contains("DEBUG");
        assert!(
            !is_debug || what.starts_with("changed"),
            "the level of a refused config: {}",
            manager.daemon.talk()
        );
    }
    manager.stop();
}
