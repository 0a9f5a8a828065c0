//! The documents: keys as the contract has them, units, truth in the frame of the reference.

use nalgebra::{Matrix6, Vector3};
use serde_json::{Value, json};

use super::document::{CalibrationDocument, Findings, FrameSets, TimingMs};
use super::moved::MovedDocument;
use super::status::{self, StatusDocument, Words};
use super::text;
use crate::geometry::motion::Motion;
use crate::ipc::{
    Activity, CameraHealth, CameraIdentity, CameraState, FrameClock, FrameSetCounts, HealthMessage,
    InstanceName, Snapshot,
};
use crate::solver::{
    CameraPose, Moved, PairEstimate, Reason, ReasonCode, RigCalibration, State, WatchReport, Who,
};

fn identity(name: &str) -> CameraIdentity {
    CameraIdentity { name: name.into(), serial: format!("s-{name}"), firmware: None }
}

fn pair(matches: usize) -> PairEstimate {
    PairEstimate {
        target: 0,
        source: 1,
        state: State::Converged,
        reason: None,
        target_from_source: None,
        matches,
        full: matches,
        pnl: 0,
        lead: Some(2.5),
        residual_px: if matches > 0 { 0.6 } else { f64::NAN },
        residual_m: if matches > 0 { 0.0041 } else { f64::NAN },
        line_residuals: Vec::new(),
    }
}

fn converged(reference_from_camera: Motion) -> RigCalibration {
    let covariance = Matrix6::from_diagonal_element(4e-6);
    let origin = CameraPose { reference_from_camera: Motion::identity(), covariance: Matrix6::zeros() };
    RigCalibration {
        state: State::Converged,
        reason: None,
        reference: 0,
        cameras: vec![Some(origin), Some(CameraPose { reference_from_camera, covariance })],
        pairs: vec![pair(73)],
        frame_sets_used: 12,
    }
}

fn document(calibration: &RigCalibration, truth: Option<&[Motion]>) -> CalibrationDocument {
    CalibrationDocument::new(&Findings {
        cameras: &[identity("left"), identity("right")],
        calibration,
        frame_sets: FrameSets { seen: 12, used: 12, ..FrameSets::default() },
        pair_skews: &[],
        timing_ms: TimingMs { total: Some(5.0), ..TimingMs::default() },
        truth,
        provenance: None,
    })
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().expect("an object").keys().map(String::as_str).collect()
}

#[test]
fn the_keys_are_those_of_the_contract() {
    let place = Motion::translation(0.2, 0.0, 0.0);
    let truth = [Motion::identity(), place];
    let json = serde_json::to_value(document(&converged(place), Some(&truth))).expect("serialisable");
    let mut expected = vec![
        "schema",
        "state",
        "reason",
        "reference",
        "cameras",
        "pairs",
        "frame_sets",
        "timing_ms",
        "truth",
    ];
    expected.sort_unstable();
    assert_eq!(keys(&json), expected);
    assert_eq!(json["schema"], "pelical.calibration/1");
    assert_eq!(json["reference"], "left");
    assert_eq!(json["reason"], Value::Null);
    let camera = &json["cameras"][0];
    assert_eq!(
        keys(camera),
        ["covariance", "name", "reference_from_camera", "serial", "sigma_deg", "sigma_mm"]
    );
    assert_eq!(
        camera["reference_from_camera"],
        json!({"translation_m": [0.2, 0.0, 0.0], "rotation_xyzw": [0.0, 0.0, 0.0, 1.0]})
    );
    assert_eq!(
        keys(&json["pairs"][0]),
        ["full", "lead", "matches", "pnl", "residual_mm", "residual_px", "source", "target"]
    );
    assert_eq!(keys(&json["frame_sets"]), ["refused", "seen", "used"]);
    assert_eq!(keys(&json["timing_ms"]), ["associate", "detect", "estimate", "lift", "total"]);
    assert_eq!(keys(&json["truth"][0]), ["camera", "rotation_error_deg", "translation_error_mm"]);
}

#[test]
fn units_are_the_users() {
    let document = document(&converged(Motion::translation(0.2, 0.0, 0.0)), None);
    let camera = &document.cameras[0];
    // Variance 4e-6 m^2 and rad^2: 2 mm and 0.1146 deg.
    assert!((camera.sigma_mm.expect("known")[1].expect("finite") - 2.0).abs() < 1e-9);
    assert!((camera.sigma_deg.expect("known")[2].expect("finite") - 0.1146).abs() < 1e-4);
    assert!((document.pairs[0].residual_mm.expect("matches") - 4.1).abs() < 1e-9);
    assert!(
        !serde_json::to_value(&document)
            .expect("serialisable")
            .as_object()
            .expect("object")
            .contains_key("truth")
    );
}

#[test]
fn a_result_without_places_has_null_and_no_nan() {
    let reason = Reason { code: ReasonCode::NoLines, sentence: "no camera shows an edge".into() };
    let calibration = RigCalibration {
        state: State::Collecting,
        reason: Some(reason),
        cameras: vec![None, None],
        pairs: vec![pair(0)],
        ..converged(Motion::identity())
    };
    let document = document(&calibration, Some(&[Motion::identity(), Motion::identity()]));
    let json = serde_json::to_value(&document).expect("serialisable");
    assert_eq!(json["reason"], json!({"code": "no_lines", "sentence": "no camera shows an edge"}));
    assert_eq!(json["cameras"][0]["reference_from_camera"], Value::Null);
    assert_eq!(json["pairs"][0]["residual_px"], Value::Null);
    assert_eq!(json["truth"][0]["rotation_error_deg"], Value::Null);
    assert!(!document.is_converged() && !document.is_wrong(0.5, 15.0));
    let text = text::calibration(&document);
    assert!(text.contains("no camera shows an edge") && text.contains("unknown"), "{text}");
}

#[test]
fn a_missing_camera_is_told_with_its_reason_while_the_others_have_their_places() {
    let reason = Reason { code: ReasonCode::NoLines, sentence: "door saw no straight edge".into() };
    let lost = PairEstimate { source: 2, state: State::Collecting, reason: Some(reason), ..pair(0) };
    let mut calibration = converged(Motion::translation(0.2, 0.0, 0.0));
    calibration.state = State::Collecting;
    calibration.cameras.push(None);
    calibration.pairs.push(lost);
    let document = CalibrationDocument::new(&Findings {
        cameras: &[identity("left"), identity("right"), identity("door")],
        calibration: &calibration,
        frame_sets: FrameSets::default(),
        pair_skews: &[],
        timing_ms: TimingMs::default(),
        truth: None,
        provenance: None,
    });
    let json = serde_json::to_value(&document).expect("serialisable");
    let reason = json!({"code": "no_lines", "sentence": "door from left: door saw no straight edge"});
    assert_eq!(json["missing"], json!([{"name": "door", "serial": "s-door", "reason": reason}]));
    assert!(json["cameras"][0]["reference_from_camera"].is_object());
    let text = text::calibration(&document);
    assert!(text.contains("door is missing: door from left: door saw no straight edge"), "{text}");
}

#[test]
fn errors_are_taken_in_the_frame_of_the_reference() {
    let first_from_left = Motion::new(Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.3, 0.2, 0.1));
    let left_from_right = Motion::new(Vector3::new(0.2, 0.0, 0.01), Vector3::new(0.0, 0.5, 0.0));
    let truth = [first_from_left, first_from_left * left_from_right];
    let good = document(&converged(left_from_right), Some(&truth));
    let error = &good.truth.as_ref().expect("given")[0];
    assert!(
        error.translation_error_mm.expect("known") < 1e-9 && error.rotation_error_deg.expect("known") < 1e-6
    );
    let off = Motion::translation(0.0, 0.016, 0.0) * left_from_right;
    let wrong = document(&converged(off), Some(&truth));
    assert!(
        (wrong.truth.as_ref().expect("given")[0].translation_error_mm.expect("known") - 16.0).abs() < 1e-6
    );
    assert!(wrong.is_wrong(0.5, 15.0) && !wrong.is_wrong(0.5, 17.0) && !good.is_wrong(0.5, 15.0));
}

#[test]
fn tables_have_straight_columns() {
    let rows = vec![vec!["a".to_owned(), "1".to_owned()], vec!["bbbb".to_owned(), "22".to_owned()]];
    assert_eq!(text::table(&["x", "y"], &rows), "x     y\na     1\nbbbb  22\n");
}

/// What a daemon says whose left camera was moved after a result.
fn words_of_a_moved_camera() -> (Snapshot, HealthMessage) {
    let moved = Moved {
        who: Who::Camera(1),
        rotation_rad: 0.05,
        sigma_rotation_rad: 0.001,
        translation_m: 0.02,
        sigma_translation_m: 0.0005,
    };
    let watch = Some(WatchReport { moved: vec![moved], sets_since_confirmed: 12, is_verified: false });
    let camera = |name: &str| CameraHealth {
        name: name.to_owned(),
        state: CameraState::Streaming,
        frames: 1,
        dropped: 0,
        last_frame_age_ns: Some(0),
        fps_hz: 30.0,
        lost: 0,
        bad: 0,
        valid_depth: Some(0.75),
        clock: Some(FrameClock::Source),
        gravity_off_deg: None,
    };
    let health = HealthMessage {
        sequence: 1,
        uptime_ns: 1,
        watch: watch.clone(),
        cameras: vec![camera("front"), camera("left")],
        stages: Vec::new(),
        pair_skews: Vec::new(),
    };
    let snapshot = Snapshot {
        activity: Activity::Watching,
        state: State::Converged,
        reason: None,
        watch,
        calibration_sequence: 3,
        calibration_id: Some(5),
        calibration_stamp_ns: Some(1_700_000_000_000_000_000),
        store_fault: None,
        uptime_ns: 1,
        frame_sets: FrameSetCounts { used: 2, ..FrameSetCounts::default() },
        cameras: 2,
        cameras_streaming: 2,
    };
    (snapshot, health)
}

#[test]
fn the_status_of_a_moved_camera_says_which_and_how_far() {
    let (snapshot, health) = words_of_a_moved_camera();
    let words = Words { snapshot: &snapshot, health: Some(&health), progress: None };
    let document = StatusDocument::new(&InstanceName::default(), &words);
    let json = serde_json::to_value(&document).expect("serialisable");
    assert_eq!((&json["activity"], &json["state"]), (&"watching".into(), &"moved".into()));
    assert_eq!(json["reason"]["code"], "camera_moved");
    assert_eq!((&json["sets_since_confirmed"], &json["sets_unconfirmed"]), (&json!(12), &Value::Null));
    let moved = &json["moved"][0];
    assert_eq!(keys(moved), ["cameras", "rotation_deg", "sigma_deg", "sigma_mm", "translation_mm"]);
    assert_eq!(moved["cameras"], json!(["left"]));
    assert!((moved["rotation_deg"].as_f64().expect("a number") - 2.8648).abs() < 1e-4, "{moved}");
    let text = status::text(&document);
    let sentence = "left was moved by 2.86 deg (sigma 0.06) and 20.0 mm (sigma 0.5)";
    assert!(text.contains("state       moved\n") && text.contains(sentence), "{text}");
    // Before the daemon's first word about its cameras there are no names.
    let nameless = StatusDocument::new(&InstanceName::default(), &Words { health: None, ..words });
    assert_eq!(nameless.moved[0].cameras, ["camera 1"]);
}

#[test]
fn the_angle_to_gravity_is_shown_where_any_camera_has_one() {
    let (snapshot, mut health) = words_of_a_moved_camera();
    let status_of = |health: &HealthMessage| {
        let words = Words { snapshot: &snapshot, health: Some(health), progress: None };
        let document = StatusDocument::new(&InstanceName::default(), &words);
        (serde_json::to_value(&document).expect("serialisable"), status::text(&document))
    };
    let (json, text) = status_of(&health);
    assert_eq!(json["cameras"][0].get("gravity_off_deg"), Some(&Value::Null));
    assert!(!text.contains("gravity"), "{text}");
    health.cameras[1].gravity_off_deg = Some(1.26);
    let (json, text) = status_of(&health);
    assert_eq!(json["cameras"][1]["gravity_off_deg"], 1.26);
    let last_cell = |name: &str| {
        let row = text.lines().find(|line| line.starts_with(name)).expect("a row");
        row.split_whitespace().next_back().expect("cells").to_owned()
    };
    assert!(text.contains("gravity off deg\n"), "{text}");
    assert_eq!([last_cell("front"), last_cell("left ")], ["-", "1.3"], "{text}");
}

#[test]
fn a_result_of_an_earlier_run_is_never_said_to_have_been_confirmed() {
    let (mut snapshot, _) = words_of_a_moved_camera();
    snapshot.state = State::Stored;
    let mut status_of = |sets_since_confirmed| {
        snapshot.watch = Some(WatchReport { sets_since_confirmed, ..WatchReport::default() });
        let words = Words { snapshot: &snapshot, health: None, progress: None };
        let document = StatusDocument::new(&InstanceName::default(), &words);
        (serde_json::to_value(&document).expect("serialisable"), status::text(&document))
    };
    let (json, text) = status_of(0);
    assert_eq!((&json["sets_since_confirmed"], &json["sets_unconfirmed"]), (&Value::Null, &json!(0)));
    assert!(text.contains("confirmed   not yet\n") && !text.contains("ago\nup"), "{text}");
    let (json, text) = status_of(7);
    assert_eq!((&json["sets_since_confirmed"], &json["sets_unconfirmed"]), (&Value::Null, &json!(7)));
    assert!(text.contains("not yet: nothing in 7 compared frame sets"), "{text}");
}

#[test]
fn what_watch_says_changes_with_the_cameras_and_not_with_the_amounts() {
    let (_, mut health) = words_of_a_moved_camera();
    let before = MovedDocument::new(&health);
    assert!(before.text().starts_with("moved: left was moved by 2.86 deg"), "{}", before.text());
    let watch = health.watch.as_mut().expect("watched");
    watch.moved[0].rotation_rad = 0.06;
    assert!(MovedDocument::new(&health).is_same(&before));
    health.watch = None;
    let back = MovedDocument::new(&health);
    assert!(!back.is_same(&before) && back.text().contains("any more"), "{}", back.text());
}
