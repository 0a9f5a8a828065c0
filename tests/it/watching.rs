//! A camera is moved under a daemon that has a result: what it says, and what it does about it.

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};
use pelical::geometry::motion::Motion;
use serde_json::Value;

use crate::env::{Running, TestEnv, poll};
use crate::synthetic_pair;

/// A daemon that plays a recording for ever, and converges; the recording's pictures can be exchanged under it.
struct Rig {
    env: TestEnv,
    daemon: Running,
    recording: PathBuf,
}

impl Rig {
    fn start(on_moved: &str) -> Self {
        let env = TestEnv::new();
        let recording = env.path("rig");
        copy_files(synthetic_pair::recording(), &recording);
        let daemon = env.start_daemon(&env.config(&format!(
            "cameras: {{backend: replay, replay: {{recording: rig, loop: true}}}}\nsync: {{stalled_after_ms: 5000.0}}\nwatch: {{on_moved: {on_moved}}}\n"
        )));
        let rig = Self { env, daemon, recording };
        rig.wait_for_state("converged");
        rig
    }

    #[track_caller]
    fn wait_for_state(&self, state: &str) -> Value {
        self.env.wait_for_status(state, |status| status["state"] == state)
    }

    /// From now on the cameras see what they see in another recording.
    fn show(&self, other: &Path) {
        copy_files(other, &self.recording);
    }

    /// The published result: its number and the place of the right camera.
    fn published(&self) -> (u64, Motion) {
        let watch = self.env.start_pelical(&["watch", "--json"]);
        let document: Value = serde_json::from_str(&watch.first_printed()).unwrap();
        watch.signal("INT");
        watch.wait().expect_code(0);
        assert_eq!(document["state"], "converged");
        let place = &document["cameras"][0]["reference_from_camera"];
        let number = |key: &str, index: usize| place[key][index].as_f64().unwrap();
        let [x, y, z] = [0, 1, 2].map(|index| number("translation_m", index));
        let [i, j, k, w] = [0, 1, 2, 3].map(|index| number("rotation_xyzw", index));
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k));
        let status = self.env.pelical(&["status", "--json"]).json();
        let sequence = status["calibration_sequence"].as_u64().unwrap();
        (sequence, Motion::from_parts(Translation3::new(x, y, z), rotation))
    }
}

/// Copies a recording file by file, each at once, so that who plays it never sees half of one.
fn copy_files(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let (from, to) = (entry.path(), to.join(entry.file_name()));
        if from.is_dir() {
            copy_files(&from, &to);
        } else {
            let half = to.with_extension("half");
            fs::copy(&from, &half).unwrap();
            fs::rename(&half, &to).unwrap();
        }
    }
}

#[test]
fn a_moved_camera_is_reported_with_its_amounts_and_the_result_stays_until_it_is_back() {
    let rig = Rig::start("report");
    let before = rig.published();
    rig.show(synthetic_pair::recording_after_a_move());
    let status = rig.wait_for_state("moved");
    assert_eq!(
        (&status["activity"], &status["reason"]["code"]),
        (&"watching".into(), &"camera_moved".into())
    );
    let moved = &status["moved"][0];
    assert_eq!(moved["cameras"], serde_json::json!(["left", "right"]), "two cameras: nothing tells which");
    let (mm, deg) = synthetic_pair::MOVED_BY;
    assert!((moved["rotation_deg"].as_f64().unwrap() - deg).abs() < 0.3, "{moved}");
    assert!((moved["translation_mm"].as_f64().unwrap() - mm).abs() < 8.0, "{moved}");
    assert!(moved["sigma_deg"].as_f64().unwrap() > 0.0 && moved["sigma_mm"].as_f64().unwrap() > 0.0);
    let text = rig.env.pelical(&["status"]).expect_code(0).stdout;
    assert!(text.contains("left or right was moved by"), "{text}");
    assert!(rig.daemon.talk().contains("one of two cameras was moved"), "{}", rig.daemon.talk());
    assert_eq!(rig.published(), before, "the result was changed");
    let watch = rig.env.start_pelical(&["watch", "--json"]);
    poll(|| watch.printed().contains("pelical.moved/1").then_some(())).expect("watch says it");
    rig.show(synthetic_pair::recording());
    let status = rig.wait_for_state("converged");
    assert_eq!(status["moved"], serde_json::json!([]));
    assert_eq!(rig.published(), before);
}

#[test]
fn a_moved_camera_is_calibrated_again_where_that_is_wanted() {
    let rig = Rig::start("recalibrate");
    let (sequence, before) = rig.published();
    rig.show(synthetic_pair::recording_after_a_move());
    // The old result is replaced by a converged one, and by nothing else.
    let is_new =
        |status: &Value| status["calibration_sequence"] != sequence && status["state"] == "converged";
    let status = rig.env.wait_for_status("a new result", is_new);
    assert_eq!(status["calibration_sequence"], sequence + 1);
    let talk = rig.daemon.talk();
    assert!(talk.contains("calibrating again because a camera was moved"), "{talk}");
    let (_, after) = rig.published();
    let (mm, deg) = synthetic_pair::MOVED_BY;
    let knock = before.inverse() * after;
    assert!((knock.rotation.angle().to_degrees() - deg).abs() < 0.2, "{knock}");
    assert!((knock.translation.vector - Vector3::new(mm * 1e-3, 0.0, 0.0)).norm() < 0.006, "{knock}");
}
