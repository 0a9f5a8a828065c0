//! Every fault of a script, as the user of a camera sees it.

use std::time::{Duration, Instant};

use pelical::capture::recording::Recording;
use pelical::capture::replay::{Pace, ReplayFactory, ReplayOptions};
use pelical::capture::scripted::{Fault, FaultScript, Replug, ScriptedFactory};
use pelical::capture::{CaptureError, DeviceFactory, RgbdFrame};

use crate::fixture::{Fixture, INTERVAL_NS, SERIALS, stamp_ns};

const TIMEOUT: Duration = Duration::from_millis(5);

fn scripted(recording: Recording, script: FaultScript) -> ScriptedFactory {
    let options = ReplayOptions { pace: Pace::Unpaced, repeat: true, preload: false };
    let replay = ReplayFactory::new(recording, options).unwrap();
    ScriptedFactory::new(Box::new(replay)).with_script(SERIALS[0], script)
}

/// What the first calls of the left camera give: frames, or errors.
fn play(script: FaultScript, n_calls: usize, timeout: Duration) -> Vec<Result<RgbdFrame, CaptureError>> {
    let fixture = Fixture::new(6);
    let mut source = scripted(fixture.open(), script).open(SERIALS[0]).unwrap();
    let mut frame = RgbdFrame::default();
    (0..n_calls).map(|_| source.next_frame(&mut frame, timeout).map(|()| frame.clone())).collect()
}

/// As [`play`] where every call gives a frame, however slow the machine.
fn frames(script: FaultScript, n_frames: usize) -> Vec<RgbdFrame> {
    let calls = play(script, n_frames, Duration::from_secs(30));
    calls.into_iter().map(|frame| frame.expect("a frame")).collect()
}

fn script() -> FaultScript {
    FaultScript::with_seed(7)
}

#[test]
fn a_dropped_frame_is_a_gap_in_the_sequence() {
    let sequences: Vec<u64> =
        frames(script().at(0, Fault::Drop).at(2, Fault::Drop), 3).iter().map(|f| f.sequence).collect();
    assert_eq!(sequences, [1, 3, 4]);
}

#[test]
fn a_camera_that_drops_everything_times_out() {
    let calls = play(script().by_chance(1.0, Fault::Drop), 2, TIMEOUT);
    assert!(calls.iter().all(|call| matches!(call, Err(CaptureError::Timeout(TIMEOUT)))), "{calls:?}");
}

#[test]
fn a_stall_waits_in_vain_and_loses_nothing() {
    let started = Instant::now();
    let calls = play(script().at(1, Fault::Stall { timeouts: 2 }), 4, TIMEOUT);
    assert!(started.elapsed() >= 2 * TIMEOUT, "a stalled camera answered early");
    let shown: Vec<Option<u64>> = calls.iter().map(|call| call.as_ref().ok().map(|f| f.sequence)).collect();
    assert_eq!(shown, [Some(0), None, None, Some(1)]);
    assert!(matches!(calls[1], Err(CaptureError::Timeout(TIMEOUT))));
}

#[test]
fn a_stamp_jump_lasts() {
    let shown = frames(script().at(2, Fault::StampJump { by_ns: -5_000 }), 4);
    let expected = [0, 0, -5_000, -5_000];
    for (set_idx, (frame, gap_ns)) in shown.iter().zip(expected).enumerate() {
        assert_eq!(frame.stamp.0, stamp_ns(0, set_idx) + gap_ns);
    }
}

#[test]
fn a_clock_of_32_bits_of_microseconds_wraps() {
    let shown = frames(script().at(1, Fault::ClockWrap), 2);
    let wrapped_ns = shown[0].stamp.0 + INTERVAL_NS - shown[1].stamp.0;
    assert_eq!(wrapped_ns, (1i64 << 32) * 1000);
}

#[test]
fn zero_depth_and_half_an_image_spoil_one_frame() {
    let shown = frames(script().at(1, Fault::ZeroDepth).at(2, Fault::HalfBlack), 4);
    let clean = frames(script(), 4);
    assert!(shown[1].depth.iter().all(|&count| count == 0) && shown[1].rgb == clean[1].rgb);
    let half = shown[2].rgb.len() / 2;
    assert!(shown[2].rgb[half..].iter().all(|&value| value == 0));
    assert!(shown[2].rgb[..half] == clean[2].rgb[..half] && shown[2].depth == clean[2].depth);
    for idx in [0, 3] {
        assert!(shown[idx].rgb == clean[idx].rgb && shown[idx].depth == clean[idx].depth);
    }
}

#[test]
fn an_unplugged_camera_is_gone_until_it_has_been_asked_for_often_enough() {
    let fixture = Fixture::new(6);
    let factory = scripted(fixture.open(), script().at(2, Fault::Unplug(Replug::AfterAttempts(2))));
    let mut source = factory.open(SERIALS[0]).unwrap();
    let mut frame = RgbdFrame::default();
    source.next_frame(&mut frame, TIMEOUT).unwrap();
    source.next_frame(&mut frame, TIMEOUT).unwrap();
    for _ in 0..2 {
        let gone = source.next_frame(&mut frame, TIMEOUT);
        assert!(matches!(&gone, Err(CaptureError::Unplugged(serial)) if serial == SERIALS[0]), "{gone:?}");
        assert!(!frame.is_consistent());
    }
    for _ in 0..2 {
        let listed: Vec<String> = factory.list().unwrap().into_iter().map(|info| info.serial).collect();
        assert_eq!(listed, [SERIALS[1]], "an unplugged camera is listed");
        match factory.open(SERIALS[0]).err() {
            Some(CaptureError::NotFound { available, .. }) => assert!(!available.contains(SERIALS[0])),
            other => panic!("{other:?} instead of NotFound"),
        }
    }
    let mut again = factory.open(SERIALS[0]).expect("plugged in again");
    assert_eq!(factory.list().unwrap().len(), 2);
    for _ in 0..4 {
        again.next_frame(&mut frame, TIMEOUT).expect("frame 2 does not unplug it twice");
    }
    let old = source.next_frame(&mut frame, TIMEOUT);
    assert!(matches!(old, Err(CaptureError::Unplugged(_))), "the old source came back to life: {old:?}");
}

#[test]
fn a_camera_comes_back_after_its_time_or_never() {
    let fixture = Fixture::new(6);
    for (replug, comes_back) in [(Replug::AfterTime(Duration::from_millis(30)), true), (Replug::Never, false)]
    {
        let factory = scripted(fixture.open(), script().at(0, Fault::Unplug(replug)));
        let mut source = factory.open(SERIALS[0]).unwrap();
        let gone = source.next_frame(&mut RgbdFrame::default(), TIMEOUT);
        assert!(matches!(gone, Err(CaptureError::Unplugged(_))));
        let since = Instant::now();
        let mut is_back = false;
        // A bounded poll: 20 s where the camera comes back, 50 ms where it must not.
        let limit = Duration::from_millis(if comes_back { 20_000 } else { 50 });
        while !is_back && since.elapsed() < limit {
            is_back = factory.open(SERIALS[0]).is_ok();
        }
        assert_eq!(is_back, comes_back, "{replug:?}");
    }
}

#[test]
fn cameras_without_a_script_are_left_alone() {
    let fixture = Fixture::new(3);
    let factory = scripted(fixture.open(), script().by_chance(1.0, Fault::ZeroDepth));
    let mut frame = RgbdFrame::default();
    factory.open(SERIALS[1]).unwrap().next_frame(&mut frame, TIMEOUT).unwrap();
    assert!(frame.depth.iter().any(|&count| count > 0));
    factory.open(SERIALS[0]).unwrap().next_frame(&mut frame, TIMEOUT).unwrap();
    assert!(frame.depth.iter().all(|&count| count == 0));
}

#[test]
fn chance_is_the_same_each_time_and_as_frequent_as_asked_for() {
    let hits = |seed: u64, serial: &str| -> Vec<bool> {
        let script = FaultScript::with_seed(seed).by_chance(0.1, Fault::Drop);
        (0..10_000).map(|number| script.faults(serial, number).next().is_some()).collect()
    };
    let first = hits(1, "a");
    assert_eq!(first, hits(1, "a"));
    assert_ne!(first, hits(2, "a"), "the seed changes nothing");
    assert_ne!(first, hits(1, "b"), "all cameras fail at once");
    let count = first.iter().filter(|&&hit| hit).count();
    // Binomial: 1000 expected, sigma 30.
    assert!((850..=1150).contains(&count), "{count} of 10000");
    assert!(FaultScript::with_seed(1).by_chance(0.0, Fault::Drop).faults("a", 5).next().is_none());
}
