//! When a replay gives its frames, and what it does at the end and with broken images.

use std::fs;
use std::time::{Duration, Instant};

use pelical::capture::replay::{Pace, ReplayFactory, ReplayOptions};
use pelical::capture::{CaptureError, DeviceFactory, FrameSource, RgbdFrame};

use crate::fixture::{Fixture, INTERVAL_NS, SERIALS, SKEW_NS};

const UNPACED: ReplayOptions = ReplayOptions { pace: Pace::Unpaced, repeat: false, preload: false };
const LONG: Duration = Duration::from_secs(30);

fn open_both(fixture: &Fixture, options: ReplayOptions) -> [Box<dyn FrameSource>; 2] {
    let factory = ReplayFactory::new(fixture.open(), options).unwrap();
    SERIALS.map(|serial| factory.open(serial).unwrap())
}

#[test]
fn in_real_time_no_frame_comes_before_it_is_due() {
    let fixture = Fixture::new(4);
    let [mut left, mut right] = open_both(&fixture, ReplayOptions::default());
    let mut frame = RgbdFrame::default();
    let started = Instant::now();
    for set_idx in 0..4 {
        left.next_frame(&mut frame, LONG).unwrap();
        right.next_frame(&mut frame, LONG).unwrap();
        let due_ns = set_idx * INTERVAL_NS + SKEW_NS;
        assert!(started.elapsed() >= Duration::from_nanos(due_ns as u64), "frame set {set_idx} is early");
    }
}

#[test]
fn a_frame_that_is_not_due_in_time_is_a_time_out_and_comes_later() {
    let fixture = Fixture::new(2);
    let [mut left, _] = open_both(&fixture, ReplayOptions::default());
    let mut frame = RgbdFrame::default();
    left.next_frame(&mut frame, LONG).unwrap();
    let none = left.next_frame(&mut frame, Duration::ZERO);
    assert!(matches!(none, Err(CaptureError::Timeout(Duration::ZERO))), "{none:?}");
    assert!(!frame.is_consistent());
    left.next_frame(&mut frame, LONG).unwrap();
    assert_eq!(frame.sequence, 1);
}

#[test]
fn a_repeated_recording_goes_on_in_step_with_growing_stamps() {
    let fixture = Fixture::new(3);
    let [mut left, mut right] = open_both(&fixture, ReplayOptions { repeat: true, ..UNPACED });
    let (mut a, mut b) = (RgbdFrame::default(), RgbdFrame::default());
    let mut shown = Vec::new();
    let mut before_ns = None;
    for idx in 0..10 {
        left.next_frame(&mut a, LONG).unwrap();
        right.next_frame(&mut b, LONG).unwrap();
        assert_eq!((a.sequence, b.sequence), (idx, idx));
        assert_eq!(b.stamp.0 - a.stamp.0, SKEW_NS, "the cameras fall out of step");
        let gap_ns = before_ns.map_or(INTERVAL_NS, |before| a.stamp.0 - before);
        // The seam is one mean interval plus the skew that the last frame set ends with.
        assert!((INTERVAL_NS..=INTERVAL_NS + 2 * SKEW_NS).contains(&gap_ns), "gap of {gap_ns} ns");
        before_ns = Some(a.stamp.0);
        shown.push(a.rgb.clone());
    }
    assert!(shown[0] == shown[3] && shown[1] == shown[4] && shown[0] != shown[1]);
}

#[test]
fn a_repeated_single_frame_set_has_an_interval_too() {
    let fixture = Fixture::new(1);
    let [mut left, _] = open_both(&fixture, ReplayOptions { repeat: true, ..UNPACED });
    let (mut a, mut b) = (RgbdFrame::default(), RgbdFrame::default());
    left.next_frame(&mut a, LONG).unwrap();
    left.next_frame(&mut b, LONG).unwrap();
    assert!(b.stamp.0 - a.stamp.0 > 30_000_000);
}

#[test]
fn a_camera_that_is_opened_again_goes_on_with_the_present() {
    let fixture = Fixture::new(3);
    let options = ReplayOptions { repeat: true, preload: true, pace: Pace::RealTime };
    let factory = ReplayFactory::new(fixture.open(), options).unwrap();
    let (mut first, mut again) = (RgbdFrame::default(), RgbdFrame::default());
    let mut source = factory.open(SERIALS[0]).unwrap();
    source.next_frame(&mut first, LONG).unwrap();
    let begin_ns = first.stamp.0;
    // Real time passes with the frames: 1.2 s.
    while first.stamp.0 - begin_ns < 1_200_000_000 {
        source.next_frame(&mut first, LONG).unwrap();
    }
    factory.open(SERIALS[0]).unwrap().next_frame(&mut again, LONG).unwrap();
    let behind_ns = first.stamp.0 - again.stamp.0;
    assert!(again.stamp.0 > begin_ns && behind_ns <= 1_000_000_000, "starts {behind_ns} ns in the past");
}

#[test]
fn a_broken_image_is_one_lost_frame() {
    let fixture = Fixture::new(3);
    fs::write(fixture.depth_file(0, 1), "nonsense").unwrap();
    let [mut left, _] = open_both(&fixture, UNPACED);
    let mut frame = RgbdFrame::default();
    left.next_frame(&mut frame, LONG).unwrap();
    let broken = left.next_frame(&mut frame, LONG);
    assert!(matches!(broken, Err(CaptureError::BadData { .. })), "{broken:?}");
    left.next_frame(&mut frame, LONG).unwrap();
    assert_eq!(frame.sequence, 2, "the gap in the sequence shows the loss");
}

#[test]
fn preloading_finds_a_broken_image_before_the_start() {
    let fixture = Fixture::new(3);
    fs::write(fixture.depth_file(1, 2), "nonsense").unwrap();
    let refused = ReplayFactory::new(fixture.open(), ReplayOptions { preload: true, ..UNPACED });
    let message = refused.expect_err("a broken image").to_string();
    assert!(message.contains(&fixture.depth_file(1, 2).display().to_string()), "{message}");
}

#[test]
fn preloaded_frames_need_the_files_no_more() {
    let fixture = Fixture::new(2);
    let [mut left, _] = open_both(&fixture, ReplayOptions { preload: true, ..UNPACED });
    fs::remove_dir_all(fixture.path().join("left")).unwrap();
    let mut frame = RgbdFrame::default();
    left.next_frame(&mut frame, LONG).unwrap();
    assert!(frame.is_consistent());
}
