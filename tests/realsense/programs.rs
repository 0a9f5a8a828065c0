//! The built programs with this back end: without a camera, and with recordings that the SDK plays.

use std::path::PathBuf;

use pelical::capture::recording::Recording;
use pelical::capture::{RgbdFrame, StampNs};
use serde_json::Value;

use crate::env::{TestEnv, poll};
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

#[test]
fn the_daemon_waits_for_cameras_that_nobody_named() {
    let env = TestEnv::new();
    let daemon = env.start_daemon(&env.config("cameras: {backend: realsense}\n"));
    poll(|| daemon.talk().contains("cameras are waited for").then_some(())).expect("it says so");
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
