//! The built programs with this back end: without a camera, and with recordings that the SDK plays.

use std::os::unix::net::UnixDatagram;
use std::path::PathBuf;
use std::time::Duration;

use pelical::capture::recording::Recording;
use pelical::capture::{RgbdFrame, StampNs};
use serde_json::Value;

use crate::env::{Running, TestEnv, poll};
use crate::scenes::{N_FRAMES, SERIALS, script, stamp_ms, two_cameras};

fn states(status: &Value) -> Vec<&str> {
    status["cameras"].as_array().unwrap().iter().map(|camera| camera["state"].as_str().unwrap()).collect()
}

fn playback(paths: &[PathBuf]) -> String {
    let paths: Vec<String> = paths.iter().map(|path| format!("{:?}", path.display().to_string())).collect();
    let paths = paths.join(", ");
    format!("cameras:\n  backend: realsense\n  realsense: {{playback: [{paths}], pace: unpaced}}\n")
}

#[test]
fn the_daemon_starts_without_its_cameras_and_waits() {
    let env = TestEnv::new();
    let [left, right] = SERIALS;
    let config = env.config(&format!(
        "cameras:\n  backend: realsense\n  list: [{{name: left, serial: \"{left}\"}}, {{name: right, serial: \"{right}\"}}]\n"
    ));
    let daemon = env.start_daemon(&config);
    env.wait_for_status("cameras that are waited for", |status| states(status) == ["waiting", "waiting"]);
    poll(|| daemon.talk().contains(left).then_some(())).expect("the missing serial is named");
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

/// Waits until something like each of these is told, in this order.
#[track_caller]
fn expect_told(manager: &UnixDatagram, expected: &[&str], daemon: &Running) {
    let mut told: Vec<String> = Vec::new();
    for what in expected {
        poll(|| {
            let mut buffer = [0; 4096];
            let length = manager.recv(&mut buffer).ok()?;
            told.push(String::from_utf8(buffer[..length].to_vec()).unwrap());
            told.last().is_some_and(|last| last.contains(what)).then_some(())
        })
        .unwrap_or_else(|| panic!("{what:?} was not told, but {told:#?}; {}", daemon.talk()));
    }
}

/// A daemon whose cameras nobody named, and its service manager; `more` is for its config.
fn waiting_daemon(env: &TestEnv, more: &str) -> (Running, UnixDatagram) {
    let path = env.path("notify");
    let manager = UnixDatagram::bind(&path).unwrap();
    manager.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
    let variables = [("NOTIFY_SOCKET", path.to_str().unwrap()), ("WATCHDOG_USEC", "4000000")];
    let config = env.config(&format!("cameras: {{backend: realsense{more}}}\n"));
    (env.start_daemon_with(&config, &variables), manager)
}

#[test]
fn a_daemon_that_waits_for_cameras_that_nobody_named_is_ready_alive_reloads_and_answers() {
    let env = TestEnv::new();
    let (daemon, manager) = waiting_daemon(&env, "");
    expect_told(&manager, &["READY=1", "STATUS=waiting for cameras", "WATCHDOG=1", "WATCHDOG=1"], &daemon);
    let status = env.pelical(&["status", "--json"]).expect_code(0).json();
    assert_eq!(status["activity"], "starting");
    let refused = env.pelical(&["recalibrate", "--json"]).expect_code(1).json();
    let sentence = refused["reason"]["sentence"].as_str().unwrap();
    assert!(sentence.contains("waits for its cameras") && sentence.contains("plug one in"), "{sentence}");
    daemon.signal("HUP");
    expect_told(&manager, &["RELOADING=1", "READY=1", "WATCHDOG=1"], &daemon);
    assert_eq!(daemon.talk().matches("cameras are waited for").count(), 1, "{}", daemon.talk());
    daemon.signal("TERM");
    expect_told(&manager, &["STOPPING=1"], &daemon);
    daemon.wait().expect_code(0);
}

#[test]
fn a_start_that_is_ready_with_its_cameras_is_extended_while_it_waits_for_them() {
    let env = TestEnv::new();
    let (daemon, manager) = waiting_daemon(&env, ", reference: front}\nservice: {ready_when: cameras");
    let extended = "EXTEND_TIMEOUT_USEC=";
    expect_told(&manager, &[extended, "STATUS=waiting for cameras", extended, extended], &daemon);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn devices_of_recordings_are_listed() {
    let env = TestEnv::new();
    let config = env.config(&playback(&two_cameras(&env.path(""))));
    let listed =
        env.pelical(&["devices", "--config", config.to_str().unwrap(), "--json"]).expect_code(0).json();
    let serials: Vec<&str> = listed["devices"]
        .as_array()
        .unwrap()
        .iter()
        .map(|device| device["serial"].as_str().unwrap())
        .collect();
    assert_eq!((listed["backend"].as_str(), serials.as_slice()), (Some("realsense"), SERIALS.as_slice()));
}

#[test]
fn the_daemon_plays_recordings_to_their_end() {
    let env = TestEnv::new();
    let config = env.config(&playback(&two_cameras(&env.path(""))));
    let daemon = env.start_daemon(&config);
    env.wait_for_status("ended cameras", |status| states(status) == ["ended", "ended"]);
    daemon.signal("TERM");
    daemon.wait().expect_code(0);
}

#[test]
fn depth_recorded_from_the_sdk_is_what_was_played_byte_for_byte() {
    let env = TestEnv::new();
    let config = env.config(&playback(&two_cameras(&env.path(""))));
    let folder = env.path("recording");
    env.pelical(&["record", folder.to_str().unwrap(), "--config", config.to_str().unwrap()]).expect_code(0);
    let recording = Recording::open(&folder).unwrap();
    let mut frame = RgbdFrame::default();
    let first = StampNs((stamp_ms(0) * 1e6) as i64);
    for (camera, serial) in SERIALS.into_iter().enumerate() {
        let script = script(serial, camera);
        assert_eq!(recording.cameras()[camera].serial, serial);
        let sets = recording.frame_sets().iter().filter(|set| set[camera] >= first);
        let mut n_sets = 0;
        for (set, moment) in sets.zip(&script.frames) {
            recording.read_frame(camera, set[camera], &mut frame).unwrap();
            // Colour is JPEG in a recording.
            assert_eq!(frame.depth, moment.depth, "{serial} at {set:?}");
            n_sets += 1;
        }
        assert_eq!(n_sets, N_FRAMES);
    }
}
