//! Payloads of any bytes: refused by the name of the field, or sound.

use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;

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
        codes in proptest::collection::vec(any_code(), 9),
        name in any_text::<MAX_NAME_BYTES>(),
        fps_hz in any_number(),
    ) {
        let mut wire = HealthWire::try_from(&health()).expect("fits");
        (wire.n_cameras, wire.n_stages, wire.cameras[0].state) = (codes[0], codes[1], codes[2]);
        (wire.cameras[0].name, wire.cameras[0].fps_hz, wire.stages[0].stage) = (name, fps_hz, name);
        (wire.cameras[0].clock, wire.cameras[0].valid_depth) = (codes[8], fps_hz);
        wire.cameras[1].gravity_off_deg = fps_hz;
        (wire.watch.is_watching, wire.watch.n_moved) = (codes[4], codes[5]);
        (wire.watch.moved[0].camera, wire.watch.moved[0].or_camera) = (codes[6], codes[7]);
        wire.watch.moved[1].translation_m = fps_hz;
        if let Ok(message) = HealthMessage::try_from(&wire) {
            prop_assert!(message.cameras.len() <= MAX_CAMERAS && message.stages.len() <= MAX_STAGES);
            prop_assert!(message.cameras.iter().all(|camera| camera.fps_hz.is_finite() && camera.fps_hz >= 0.0));
            let mut shares = message.cameras.iter().filter_map(|camera| camera.valid_depth);
            prop_assert!(shares.all(|share| (0.0..=1.0).contains(&share)));
            let mut angles = message.cameras.iter().filter_map(|camera| camera.gravity_off_deg);
            prop_assert!(angles.all(|angle| (0.0..=180.0).contains(&angle)));
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
