mod any_bytes;

use std::mem::{offset_of, size_of};

use nalgebra::{Matrix6, Vector3};

use super::*;
use crate::geometry::motion::Motion;
use crate::ipc::message::*;
use crate::ipc::request::*;
use crate::solver::{
    CameraPose, Moved, PairEstimate, Reason, ReasonCode, RigCalibration, State, WatchReport, Who,
};

/// A calibration of three cameras with everything in it; the last camera is unknown.
fn calibration() -> CalibrationMessage {
    let motion = |turn: f64| Motion::new(Vector3::new(0.3, -turn, 0.02), Vector3::new(0.1, turn, -0.4));
    let reason = Reason { code: ReasonCode::AxisUnobservable, sentence: "translation along x".to_owned() };
    let mut covariance = Matrix6::from_diagonal_element(1e-6);
    covariance[(0, 4)] = -2e-7;
    covariance[(4, 0)] = -2e-7;
    let pose = |motion| Some(CameraPose { reference_from_camera: motion, covariance });
    let pair = |source, found: Option<Motion>| PairEstimate {
        target: 0,
        source,
        state: if found.is_some() { State::Converged } else { State::Degenerate },
        reason: found.is_none().then(|| reason.clone()),
        target_from_source: found,
        matches: 73,
        full: 60,
        pnl: 13,
        lead: Some(2.5),
        residual_px: 0.6,
        residual_m: 0.004,
        line_residuals: Vec::new(),
    };
    CalibrationMessage {
        sequence: 7,
        stamp_ns: 1_800_000_000_000_000_001,
        provenance: Provenance {
            id: Some(17),
            restored_from: Some(9),
            version: "0.1.0".to_owned(),
            config_hash: "ab".repeat(32),
        },
        cameras: ["left", "rechts ü", "x"]
            .map(|name| CameraIdentity {
                name: name.to_owned(),
                serial: "0123456789".to_owned(),
                firmware: Some("5.16".to_owned()),
            })
            .to_vec(),
        calibration: RigCalibration {
            state: State::Degenerate,
            reason: Some(reason.clone()),
            reference: 0,
            cameras: vec![pose(Motion::identity()), pose(motion(1.2)), None],
            pairs: vec![pair(1, Some(motion(1.2))), pair(2, None)],
            frame_sets_used: 12,
        },
    }
}

fn progress() -> ProgressMessage {
    ProgressMessage {
        sequence: 3,
        newest_frame_ns: -5,
        published_ns: 6,
        latency_ns: 7,
        state: State::Collecting,
        is_moved: true,
        frame_sets: FrameSetCounts {
            seen: 10,
            used: 7,
            refused: RefusedCounts { skew: 2, gyro: 3, image: 4, repeated: 5 },
            dropped: 1,
        },
        cameras: vec![CameraLines { lines: 80, lifted: 61 }, CameraLines { lines: 40, lifted: 12 }],
        best_pair: Some(BestPair { target: 0, source: 1, matches: 9 }),
        skew: Skew { last_ns: 1, max_ns: 2 },
        turning: Some(Turning { rad_per_s: 0.7, sense: TurnSense::Image }),
    }
}

fn watch() -> WatchReport {
    let moved = |who| Moved {
        who,
        rotation_rad: 0.05,
        sigma_rotation_rad: 0.001,
        translation_m: 0.02,
        sigma_translation_m: 0.0005,
    };
    WatchReport {
        moved: vec![moved(Who::Camera(2)), moved(Who::OneOf(0, 1))],
        sets_since_confirmed: 17,
        is_verified: true,
    }
}

fn health() -> HealthMessage {
    let camera = |state, age| CameraHealth {
        name: "left".to_owned(),
        state,
        frames: 1,
        dropped: 2,
        last_frame_age_ns: age,
        fps_hz: 29.97,
        lost: 3,
        bad: 4,
        valid_depth: age.map(|_| 0.5),
        clock: age.map(|_| FrameClock::Device),
        gravity_off_deg: age.map(|_| 1.5),
    };
    HealthMessage {
        sequence: 1,
        uptime_ns: 2,
        watch: Some(watch()),
        cameras: vec![camera(CameraState::Streaming, Some(0)), camera(CameraState::Waiting, None)],
        stages: vec![StageLatency { stage: "detect".to_owned(), p50_ns: 4, p99_ns: 5, total_ns: 6 }],
        pair_skews: vec![PairSkew {
            cameras: (0, 1),
            sets: 7,
            p50_ns: 8,
            p99_ns: 9,
            max_ns: 10,
            beyond: 11,
            last_beyond_ns: 12,
        }],
    }
}

fn response(outcome: Outcome) -> Response {
    let snapshot = Snapshot {
        activity: Activity::Watching,
        state: State::Ambiguous,
        reason: Some(Reason { code: ReasonCode::RunnerUpTooClose, sentence: "9 against 8".to_owned() }),
        watch: Some(watch()),
        calibration_sequence: 4,
        calibration_id: Some(17),
        calibration_stamp_ns: Some(1_800_000_000_000_000_001),
        store_fault: Some("the disk is full".to_owned()),
        uptime_ns: 5,
        frame_sets: progress().frame_sets,
        cameras: 3,
        cameras_streaming: 2,
    };
    Response { outcome, snapshot }
}

#[test]
fn the_layouts_are_frozen() {
    assert_eq!(size_of::<CalibrationWire>(), 82_856);
    assert_eq!(offset_of!(CalibrationWire, id), 48);
    assert_eq!(offset_of!(CalibrationWire, made_by), 64);
    assert_eq!(offset_of!(CalibrationWire, config_hash), 100);
    assert_eq!(offset_of!(CalibrationWire, reason), 168);
    assert_eq!(offset_of!(CalibrationWire, cameras), 680);
    assert_eq!(offset_of!(CalibrationWire, pairs), 680 + 16 * 456);
    assert_eq!(size_of::<CameraWire>(), 456);
    assert_eq!(offset_of!(CameraWire, reference_from_camera), 112);
    assert_eq!(offset_of!(CameraWire, covariance), 168);
    assert_eq!(size_of::<PairWire>(), 624);
    assert_eq!(offset_of!(PairWire, residual_px), 32);
    assert_eq!(offset_of!(PairWire, lead), 48);
    assert_eq!(offset_of!(PairWire, reason), 112);
    assert_eq!(size_of::<ProgressWire>(), 280);
    assert_eq!(offset_of!(ProgressWire, frame_sets), 40);
    assert_eq!(offset_of!(ProgressWire, turn_rad_per_s), 112);
    assert_eq!(offset_of!(ProgressWire, n_cameras), 120);
    assert_eq!(offset_of!(ProgressWire, cameras), 152);
    assert_eq!(size_of::<HealthWire>(), 32 + 344 + 16 * 112 + 8 * 64 + 120 * 56);
    assert_eq!(offset_of!(HealthWire, pair_skews), 32 + 344 + 16 * 112 + 8 * 64);
    assert_eq!(offset_of!(HealthWire, watch), 32);
    assert_eq!(size_of::<CameraHealthWire>(), 112);
    assert_eq!(offset_of!(CameraHealthWire, frames), 40);
    assert_eq!(offset_of!(CameraHealthWire, gravity_off_deg), 104);
    assert_eq!(offset_of!(StageWire, p50_ns), 40);
    assert_eq!(size_of::<RequestWire>(), 24);
    assert_eq!(size_of::<FrameSetsWire>(), 56);
    assert_eq!(size_of::<ResponseWire>(), 1152 + 344 + 512);
    assert_eq!(size_of::<WatchWire>(), 24 + 8 * 40);
    assert_eq!(offset_of!(ResponseWire, watch), 1152);
    assert_eq!(offset_of!(ResponseWire, activity), 532);
    assert_eq!(offset_of!(ResponseWire, frame_sets), 584);
    assert_eq!(offset_of!(ResponseWire, reason), 640);
    assert_eq!(size_of::<ArchiveRequestWire>(), 16);
    assert_eq!(offset_of!(ArchiveResponseWire, calibration), 528);
}

#[test]
fn every_message_survives_the_wire() {
    let (sent, wire) = (calibration(), CalibrationWire::try_from(&calibration()).expect("fits"));
    assert_eq!(CalibrationMessage::try_from(&wire), Ok(sent));
    let (sent, wire) = (progress(), ProgressWire::try_from(&progress()).expect("fits"));
    assert_eq!(ProgressMessage::try_from(&wire), Ok(sent));
    let (sent, wire) = (health(), HealthWire::try_from(&health()).expect("fits"));
    assert_eq!(HealthMessage::try_from(&wire), Ok(sent));
}

#[test]
fn every_request_and_answer_survives_the_wire() {
    let refused = Outcome::Refused { code: RefusalCode::NoCameras, sentence: "plug one in".to_owned() };
    for kind in RequestKind::ALL {
        let request = Request { id: 9, kind, calibration: 3 };
        let wire = RequestWire::from(request);
        assert_eq!(Request::try_from(&wire), Ok(request));
        for outcome in [Outcome::Accepted, Outcome::Busy, refused.clone()] {
            let sent = response(outcome);
            let answer = ResponseWire::encode(&wire, &sent).expect("fits");
            assert_eq!(answer.decode(request), Ok(sent));
            answer.decode(Request { id: 8, ..request }).expect_err("the answer to another request");
        }
    }
}

#[test]
fn every_answer_of_the_archive_survives_the_wire() {
    let request = ArchiveRequestWire::new(18);
    assert_eq!(request.below(), Ok(18));
    let not_kept = Archived::NotKept { sentence: "set store.directory".to_owned() };
    for sent in [Archived::NoOlder, not_kept, Archived::Found(Box::new(calibration()))] {
        let answer = ArchiveResponseWire::encode(&request, &sent).expect("fits");
        assert_eq!(answer.decode(18), Ok(sent));
        answer.decode(19).expect_err("the answer to another question");
    }
}

#[test]
fn an_answer_of_the_archive_that_would_be_asked_for_again_is_refused() {
    let found = Archived::Found(Box::new(calibration()));
    let answer = ArchiveResponseWire::encode(&ArchiveRequestWire::new(17), &found).expect("fits");
    let error = answer.decode(17).expect_err("not below 17").to_string();
    assert!(error.contains("archive id"), "{error}");
    let mut other = ArchiveRequestWire::new(1);
    other.version = 2;
    other.below().expect_err("another version");
    let mut spoiled = answer;
    spoiled.outcome = 0;
    spoiled.decode(17).expect_err("no outcome");
}

#[test]
fn every_state_and_reason_has_a_code() {
    for state in [
        State::Collecting,
        State::Converged,
        State::Stored,
        State::Degenerate,
        State::Ambiguous,
        State::Failed,
    ] {
        let message = ProgressMessage { state, ..progress() };
        let wire = ProgressWire::try_from(&message).expect("has a code");
        assert_eq!(ProgressMessage::try_from(&wire), Ok(message));
    }
    for code in ReasonCode::ALL {
        let reason = Some(Reason { code, sentence: "why".to_owned() });
        assert_eq!(ReasonWire::encode(reason.as_ref()).decode("reason"), Ok(reason));
    }
}

#[test]
fn a_long_sentence_is_cut_between_characters() {
    let sentence = "ü".repeat(MAX_SENTENCE_BYTES);
    let reason = Reason { code: ReasonCode::NoLines, sentence };
    let decoded = ReasonWire::encode(Some(&reason)).decode("reason").expect("UTF-8").expect("a reason");
    assert_eq!(decoded.sentence, "ü".repeat(MAX_SENTENCE_BYTES / 2));
}

/// Spoils a good calibration on the wire and expects the refusal to name the field.
#[track_caller]
fn check_refused(field_expected: &str, spoil: impl FnOnce(&mut CalibrationWire)) {
    let mut wire = CalibrationWire::try_from(&calibration()).expect("fits");
    spoil(&mut wire);
    let error = CalibrationMessage::try_from(&wire).expect_err(field_expected);
    assert!(error.to_string().contains(field_expected), "{error}");
}

#[test]
fn a_spoiled_calibration_is_refused_by_the_name_of_the_field() {
    check_refused("version is 1", |w| w.version = 1);
    check_refused("state has the unknown code 0", |w| w.state = 0);
    check_refused("state has the unknown code 7", |w| w.state = 7);
    check_refused("cameras is 17", |w| w.n_cameras = 17);
    check_refused("cameras must be at least one", |w| w.n_cameras = 0);
    check_refused("pairs is 121", |w| w.n_pairs = 121);
    check_refused("reference is 3", |w| w.reference = 3);
    check_refused("all with a pose", |w| w.state = 2);
    check_refused("all with a pose", |w| w.state = 6);
    check_refused("camera name is 33", |w| w.cameras[0].name.len = 33);
    check_refused("camera serial is not UTF-8", |w| w.cameras[1].serial.bytes[3] = 0xff);
    check_refused("has_pose", |w| w.cameras[0].has_pose = 2);
    check_refused("camera pose", |w| w.cameras[1].reference_from_camera.rotation_xyzw[3] += 1e-6);
    check_refused("camera pose", |w| w.cameras[1].reference_from_camera.rotation_xyzw = [0.0; 4]);
    check_refused("camera pose", |w| w.cameras[1].reference_from_camera.translation_m[0] = f64::NAN);
    check_refused("camera covariance", |w| w.cameras[1].covariance[0] = -1e-9);
    check_refused("camera covariance", |w| w.cameras[1].covariance[1] = 1e-9);
    check_refused("camera covariance", |w| w.cameras[1].covariance[35] = f64::INFINITY);
    check_refused("pair source is 3", |w| w.pairs[1].source = 3);
    check_refused("another camera than the target", |w| w.pairs[1].source = 0);
    check_refused("pair motion", |w| w.pairs[1].has_motion = 1);
    check_refused("pair residual_px", |w| w.pairs[0].residual_px = f64::NAN);
    check_refused("pair residual_m", |w| w.pairs[0].residual_m = -0.1);
    check_refused("pair lead", |w| w.pairs[0].lead = f64::INFINITY);
    let unknown = ReasonCode::ALL.len() as u32 + 1;
    check_refused(&format!("reason has the unknown code {unknown}"), |w| w.reason.code = unknown);
}

#[test]
fn what_a_reader_would_refuse_is_not_sent() {
    let mut message = calibration();
    message.cameras[0].name = "x".repeat(MAX_NAME_BYTES + 1);
    assert!(matches!(
        CalibrationWire::try_from(&message),
        Err(WireError::Count { field: "camera name", .. })
    ));
    let mut message = calibration();
    message.cameras.pop();
    assert!(matches!(CalibrationWire::try_from(&message), Err(WireError::Value { field: "cameras", .. })));
    let mut message = calibration();
    message.calibration.pairs[0].residual_m = f64::INFINITY;
    assert!(matches!(CalibrationWire::try_from(&message), Err(WireError::Value { .. })));
    let mut message = health();
    message.watch =
        Some(WatchReport { moved: vec![watch().moved[0]; 9], sets_since_confirmed: 0, is_verified: false });
    let sent =
        HealthMessage::try_from(&HealthWire::try_from(&message).expect("the first fit")).expect("sound");
    assert_eq!(sent.watch.map(|watch| watch.moved.len()), Some(MAX_MOVED));
    let mut message = progress();
    message.cameras = vec![CameraLines::default(); MAX_CAMERAS + 1];
    assert!(matches!(ProgressWire::try_from(&message), Err(WireError::Count { .. })));
    let mut message = health();
    message.cameras[0].fps_hz = f64::NAN;
    assert!(matches!(HealthWire::try_from(&message), Err(WireError::Value { .. })));
}

#[test]
fn a_spoiled_turn_rate_or_pair_is_refused() {
    for spoil in [|w: &mut ProgressWire| w.turn_by = 3, |w: &mut ProgressWire| w.turn_rad_per_s = f64::NAN] {
        let mut wire = ProgressWire::try_from(&progress()).expect("fits");
        spoil(&mut wire);
        let error = ProgressMessage::try_from(&wire).expect_err("spoiled").to_string();
        assert!(error.contains("turn_"), "{error}");
    }
    for spoil in [
        |w: &mut HealthWire| w.pair_skews[0].second = 0,
        |w: &mut HealthWire| w.pair_skews[0].second = 2,
        |w: &mut HealthWire| w.n_pairs = 121,
    ] {
        let mut wire = HealthWire::try_from(&health()).expect("fits");
        spoil(&mut wire);
        let error = HealthMessage::try_from(&wire).expect_err("spoiled").to_string();
        assert!(error.contains("pair"), "{error}");
    }
}

#[test]
fn an_angle_to_gravity_that_is_none_is_refused() {
    for off_deg in [180.1, -2.0, f64::NAN, f64::INFINITY] {
        let mut wire = HealthWire::try_from(&health()).expect("fits");
        wire.cameras[0].gravity_off_deg = off_deg;
        let error = HealthMessage::try_from(&wire).expect_err("spoiled").to_string();
        assert!(error.contains("gravity_off_deg"), "{error}");
    }
}

#[test]
fn a_long_firmware_is_cut_and_does_not_keep_the_result_from_being_published() {
    let mut message = calibration();
    message.cameras[0].firmware = Some("5.16.0.1 ".repeat(10));
    let wire = CalibrationWire::try_from(&message).expect("fits");
    let firmware = CalibrationMessage::try_from(&wire).expect("whole").cameras[0].firmware.clone();
    assert_eq!(firmware.expect("there").len(), MAX_NAME_BYTES);
}
