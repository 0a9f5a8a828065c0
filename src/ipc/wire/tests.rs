use std::mem::{offset_of, size_of};

use nalgebra::{Matrix6, UnitQuaternion, Vector3};
use proptest::prelude::*;

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
    assert_eq!(size_of::<HealthWire>(), 32 + 344 + 16 * 72 + 8 * 64 + 120 * 56);
    assert_eq!(offset_of!(HealthWire, pair_skews), 32 + 344 + 16 * 72 + 8 * 64);
    assert_eq!(offset_of!(HealthWire, watch), 32);
    assert_eq!(offset_of!(CameraHealthWire, frames), 40);
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

fn any_code() -> impl Strategy<Value = u32> {
    prop_oneof![0..20u32, any::<u32>()]
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![Just(0.0), -1.0..1.0, any::<f64>()]
}

fn any_text<const N: usize>() -> impl Strategy<Value = FixedText<N>> {
    let bytes = prop_oneof![Just(b'a'), any::<u8>()];
    (prop_oneof![0..(N as u32 + 2), any::<u32>()], proptest::collection::vec(bytes, N)).prop_map(
        |(len, from)| {
            let mut text = FixedText { len, bytes: [0; N] };
            text.bytes.copy_from_slice(&from);
            text
        },
    )
}

fn any_motion() -> impl Strategy<Value = MotionWire> {
    let numbers = || (any_number(), any_number(), any_number());
    (numbers(), numbers(), any_number(), any::<bool>()).prop_map(|(t, a, w, is_unit)| {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(a.0, a.1, a.2)).into_inner().coords;
        let rotation_xyzw = if is_unit { turn.into() } else { [a.0, a.1, a.2, w] };
        MotionWire { translation_m: [t.0, t.1, t.2], rotation_xyzw }
    })
}

fn check_calibration(message: &CalibrationMessage) {
    let rig = &message.calibration;
    assert!(rig.cameras.len() == message.cameras.len() && rig.reference < rig.cameras.len());
    assert!(rig.state != State::Converged || rig.cameras.iter().all(Option::is_some));
    for pose in rig.cameras.iter().flatten() {
        assert!((pose.reference_from_camera.rotation.norm() - 1.0).abs() < 1e-8);
        assert!(pose.reference_from_camera.translation.vector.iter().all(|x| x.is_finite()));
        assert!(pose.covariance.iter().all(|x| x.is_finite()) && pose.covariance.diagonal().min() >= 0.0);
    }
    for pair in &rig.pairs {
        assert!(pair.target < rig.cameras.len() && pair.source < rig.cameras.len());
        assert!(pair.residual_px.is_finite() && pair.residual_m.is_finite());
    }
}

proptest! {
    #![proptest_config(crate::tests::hostile::properties())]

    #[test]
    fn a_request_of_any_bytes_is_refused_or_one_of_the_closed_list(
        codes in proptest::collection::vec(any_code(), 2), id in any::<u64>(), calibration in any::<u64>(),
    ) {
        let version = if codes[0] % 2 == 0 { VERSION } else { codes[0] };
        let wire = RequestWire { version, kind: codes[1], id, calibration };
        match Request::try_from(&wire) {
            Ok(request) => prop_assert!((version, RequestWire::from(request)) == (VERSION, wire)),
            Err(error) => prop_assert!(version != VERSION || error.to_string().contains("request kind")),
        }
        let question = ArchiveRequestWire { version, reserved: codes[1], below: id };
        prop_assert_eq!(question.below().is_ok(), version == VERSION);
    }

    #[test]
    fn a_calibration_of_any_bytes_is_refused_or_sound(
        codes in proptest::collection::vec(any_code(), 12),
        spoiled in proptest::collection::vec(any::<bool>(), 12),
        name in any_text::<MAX_NAME_BYTES>(),
        sentence in any_text::<MAX_SENTENCE_BYTES>(),
        motion in any_motion(),
        numbers in proptest::collection::vec(any_number(), 8),
    ) {
        let mut wire = CalibrationWire::try_from(&calibration()).expect("fits");
        {
            let [camera, ..] = &mut wire.cameras;
            let [pair, ..] = &mut wire.pairs;
            let fields = [
                &mut wire.version, &mut wire.state, &mut wire.n_cameras, &mut wire.n_pairs, &mut wire.reference,
                &mut wire.reason.code, &mut camera.has_pose, &mut pair.target, &mut pair.source, &mut pair.state,
                &mut pair.has_motion, &mut pair.reason.code,
            ];
            for ((field, code), _) in fields.into_iter().zip(&codes).zip(&spoiled).filter(|(_, spoiled)| **spoiled) {
                *field = *code;
            }
        }
        if spoiled[0] { wire.cameras[1].name = name; }
        if spoiled[1] { wire.reason.sentence = sentence; }
        if spoiled[2] { wire.cameras[1].reference_from_camera = motion; }
        if spoiled[3] { wire.pairs[0].target_from_source = motion; }
        if spoiled[4] { wire.pairs[0].residual_px = numbers[0]; }
        if spoiled[5] { wire.cameras[0].covariance[7..14].copy_from_slice(&numbers[1..8]); }
        if let Ok(message) = CalibrationMessage::try_from(&wire) {
            check_calibration(&message);
        }
    }

    #[test]
    fn progress_of_any_bytes_is_refused_or_sound(codes in proptest::collection::vec(any_code(), 6)) {
        let mut wire = ProgressWire::try_from(&progress()).expect("fits");
        wire.version = if codes[0] % 2 == 0 { VERSION } else { codes[0] };
        (wire.state, wire.n_cameras, wire.has_best_pair) = (codes[1], codes[2], codes[3]);
        (wire.best_target, wire.best_source) = (codes[4], codes[5]);
        if let Ok(message) = ProgressMessage::try_from(&wire) {
            let n = message.cameras.len();
            prop_assert!(n <= MAX_CAMERAS);
            prop_assert!(message.best_pair.is_none_or(|pair| pair.target < n && pair.source < n && pair.target != pair.source));
        }
    }

    #[test]
    fn health_of_any_bytes_is_refused_or_sound(
        codes in proptest::collection::vec(any_code(), 8),
        name in any_text::<MAX_NAME_BYTES>(),
        fps_hz in any_number(),
    ) {
        let mut wire = HealthWire::try_from(&health()).expect("fits");
        (wire.n_cameras, wire.n_stages, wire.cameras[0].state) = (codes[0], codes[1], codes[2]);
        (wire.cameras[0].name, wire.cameras[0].fps_hz, wire.stages[0].stage) = (name, fps_hz, name);
        (wire.watch.is_watching, wire.watch.n_moved) = (codes[4], codes[5]);
        (wire.watch.moved[0].camera, wire.watch.moved[0].or_camera) = (codes[6], codes[7]);
        wire.watch.moved[1].translation_m = fps_hz;
        if let Ok(message) = HealthMessage::try_from(&wire) {
            prop_assert!(message.cameras.len() <= MAX_CAMERAS && message.stages.len() <= MAX_STAGES);
            prop_assert!(message.cameras.iter().all(|camera| camera.fps_hz.is_finite() && camera.fps_hz >= 0.0));
            let moved = message.watch.map_or_else(Vec::new, |watch| watch.moved);
            prop_assert!(moved.len() <= MAX_MOVED && moved.iter().all(|moved| moved.translation_m >= 0.0));
        }
    }

    #[test]
    fn an_answer_of_any_bytes_is_refused_or_sound(
        codes in proptest::collection::vec(any_code(), 8),
        sentence in any_text::<MAX_SENTENCE_BYTES>(),
    ) {
        let request = Request { id: 1, kind: RequestKind::Rollback, calibration: u64::MAX };
        let mut wire = ResponseWire::encode(&request.into(), &response(Outcome::Busy)).expect("fits");
        (wire.outcome, wire.refusal, wire.activity, wire.state) = (codes[0], codes[1], codes[2], codes[3]);
        (wire.cameras, wire.cameras_streaming, wire.reason.code) = (codes[4], codes[5], codes[6]);
        (wire.sentence, wire.reason.sentence, wire.store_fault) = (sentence, sentence, sentence);
        wire.has_store_fault = codes[7];
        if let Ok(answer) = wire.decode(request) {
            prop_assert!(answer.snapshot.cameras_streaming <= answer.snapshot.cameras);
        }
    }
    #[test]
    fn an_answer_of_the_archive_of_any_bytes_is_refused_or_sound(
        codes in proptest::collection::vec(any_code(), 5),
        below in prop_oneof![Just(18), any::<u64>()],
        sentence in any_text::<MAX_SENTENCE_BYTES>(),
    ) {
        let found = Archived::Found(Box::new(calibration()));
        let mut wire = ArchiveResponseWire::encode(&ArchiveRequestWire::new(18), &found).expect("fits");
        wire.version = if codes[0] % 2 == 0 { VERSION } else { codes[0] };
        (wire.outcome, wire.below, wire.sentence) = (codes[1], below, sentence);
        if codes[2] % 2 == 0 { wire.calibration.state = codes[3]; }
        if codes[2] % 3 == 0 { wire.calibration.n_cameras = codes[4]; }
        if let Ok(Archived::Found(message)) = wire.decode(18) {
            check_calibration(&message);
            prop_assert!(message.provenance.id.is_some_and(|id| id < 18));
        }
    }
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
fn a_long_firmware_is_cut_and_does_not_keep_the_result_from_being_published() {
    let mut message = calibration();
    message.cameras[0].firmware = Some("5.16.0.1 ".repeat(10));
    let wire = CalibrationWire::try_from(&message).expect("fits");
    let firmware = CalibrationMessage::try_from(&wire).expect("whole").cameras[0].firmware.clone();
    assert_eq!(firmware.expect("there").len(), MAX_NAME_BYTES);
}
