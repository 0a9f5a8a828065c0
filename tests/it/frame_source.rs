//! The conformance suite: what every back end promises, checked the same way on each.
//!
//! A back end is plugged in as one [`Case`] at the end of this file.

use std::thread;
use std::time::Duration;

use pelical::capture::recording::Recording;
use pelical::capture::replay::{Pace, ReplayFactory, ReplayOptions};
use pelical::capture::scripted::{FaultScript, ScriptedFactory};
use pelical::capture::synthetic::{SyntheticCamera, SyntheticFactory, SyntheticOptions};
use pelical::capture::writer::{ColorFormat, RecordingWriter};
use pelical::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame};
use pelical::geometry::camera::Pinhole;
use pelical::geometry::motion::Motion;
use pelical::geometry::{Camera, Distortion};
use tempfile::TempDir;

use crate::fixture::{Fixture, SERIALS};

/// Frames read of a stream without end.
const SAMPLE: usize = 8;
/// Per call; the suite calls again after a time-out, at most [`MAX_CALLS`] times per frame.
const TIMEOUT: Duration = Duration::from_millis(50);
const MAX_CALLS: usize = 200;

/// A back end under test.
struct Case<'a> {
    name: &'a str,
    /// A new factory that plays the same from the beginning.
    make: &'a dyn Fn() -> Box<dyn DeviceFactory>,
    /// How many frames a camera gives; `None` for ever.
    length: Option<usize>,
}

/// Runs the whole suite on one back end.
fn check_conformance(case: &Case<'_>) {
    the_list_is_stable(case);
    an_unknown_serial_is_not_found(case);
    frames_are_consistent_and_in_order(case);
    buffers_are_reused(case);
    the_end_is_for_ever(case);
    two_openings_give_the_same_frames(case);
    threads_change_nothing(case);
}

/// The next frame, or `None` at the end; a time-out must say the time that was given.
fn next(case: &Case<'_>, source: &mut dyn FrameSource, frame: &mut RgbdFrame) -> Option<()> {
    for _ in 0..MAX_CALLS {
        match source.next_frame(frame, TIMEOUT) {
            Ok(()) => return Some(()),
            Err(CaptureError::Timeout(waited)) => assert_eq!(waited, TIMEOUT, "{}", case.name),
            Err(CaptureError::EndOfStream) => return None,
            Err(other) => panic!("{}: {other}", case.name),
        }
        assert!(!frame.is_consistent(), "{}: an image although there is none", case.name);
    }
    panic!("{}: no frame after {MAX_CALLS} calls", case.name)
}

/// All frames of a stream, or the first [`SAMPLE`] of one without end.
fn read_all(case: &Case<'_>, source: &mut dyn FrameSource) -> Vec<RgbdFrame> {
    let (mut frames, mut frame) = (Vec::new(), RgbdFrame::default());
    while frames.len() < case.length.map_or(SAMPLE, |length| length + 1) {
        match next(case, source, &mut frame) {
            Some(()) => frames.push(frame.clone()),
            None => break,
        }
    }
    assert_eq!(frames.len(), case.length.unwrap_or(SAMPLE), "{}: number of frames", case.name);
    frames
}

fn serials(factory: &dyn DeviceFactory) -> Vec<String> {
    factory.list().expect("the cameras").into_iter().map(|info| info.serial).collect()
}

/// One source per camera, none of them asked for a frame yet.
fn open_all(factory: &dyn DeviceFactory) -> Vec<Box<dyn FrameSource>> {
    serials(factory).iter().map(|serial| factory.open(serial).expect("a listed camera")).collect()
}

fn assert_same(case: &Case<'_>, a: &[RgbdFrame], b: &[RgbdFrame]) {
    assert_eq!(a.len(), b.len(), "{}", case.name);
    for (a, b) in a.iter().zip(b) {
        assert_eq!((a.stamp, a.sequence), (b.stamp, b.sequence), "{}", case.name);
        assert_eq!(a.depth_unit_m.to_bits(), b.depth_unit_m.to_bits(), "{}", case.name);
        assert!(a.rgb == b.rgb, "{}: colour of frame {} differs", case.name, a.sequence);
        assert!(a.depth == b.depth, "{}: depth of frame {} differs", case.name, a.sequence);
    }
}

fn the_list_is_stable(case: &Case<'_>) {
    let factory = (case.make)();
    assert!(!factory.name().is_empty());
    let first = factory.list().expect("the cameras");
    assert!(!first.is_empty(), "{}", case.name);
    assert_eq!(factory.list().expect("the cameras"), first, "{}: the list changes", case.name);
    assert_eq!((case.make)().list().expect("the cameras"), first, "{}: factories differ", case.name);
    for info in first {
        let opened = factory.open(&info.serial).expect("a listed camera");
        assert_eq!(opened.info(), &info, "{}: list and source disagree", case.name);
    }
}

fn an_unknown_serial_is_not_found(case: &Case<'_>) {
    let factory = (case.make)();
    match factory.open("no such serial").err() {
        Some(CaptureError::NotFound { serial, available }) => {
            assert_eq!(serial, "no such serial");
            for there in serials(factory.as_ref()) {
                assert!(available.contains(&there), "{}: {available:?} lacks {there:?}", case.name);
            }
        }
        other => panic!("{}: {other:?} instead of NotFound", case.name),
    }
}

fn frames_are_consistent_and_in_order(case: &Case<'_>) {
    for mut source in open_all((case.make)().as_ref()) {
        let info = source.info().clone();
        let frames = read_all(case, source.as_mut());
        for frame in &frames {
            let size = (info.camera.width_px() as usize, info.camera.height_px() as usize);
            assert!(frame.is_consistent() && frame.depth_view().is_some(), "{}", case.name);
            assert_eq!((frame.width, frame.height), size, "{}", case.name);
            assert_eq!(frame.depth_unit_m.to_bits(), info.depth_unit_m.to_bits(), "{}", case.name);
        }
        for pair in frames.windows(2) {
            assert!(pair[0].stamp < pair[1].stamp, "{}: stamps do not increase", case.name);
            assert_eq!(pair[0].sequence + 1, pair[1].sequence, "{}: a frame is missing", case.name);
        }
        assert_eq!(source.info(), &info, "{}: the camera changed on the way", case.name);
    }
}

fn buffers_are_reused(case: &Case<'_>) {
    for mut source in open_all((case.make)().as_ref()) {
        let mut frame = RgbdFrame::default();
        next(case, source.as_mut(), &mut frame).expect("a first frame");
        let place = |frame: &RgbdFrame| {
            (frame.rgb.as_ptr(), frame.rgb.capacity(), frame.depth.as_ptr(), frame.depth.capacity())
        };
        let first = place(&frame);
        for _ in 1..case.length.unwrap_or(SAMPLE) {
            next(case, source.as_mut(), &mut frame).expect("a frame");
            assert_eq!(place(&frame), first, "{}: a buffer was allocated anew", case.name);
        }
    }
}

fn the_end_is_for_ever(case: &Case<'_>) {
    if case.length.is_none() {
        return;
    }
    for mut source in open_all((case.make)().as_ref()) {
        read_all(case, source.as_mut());
        let mut frame = RgbdFrame::default();
        for _ in 0..3 {
            let end = source.next_frame(&mut frame, TIMEOUT);
            assert!(matches!(end, Err(CaptureError::EndOfStream)), "{}: {end:?} behind the end", case.name);
            assert!(!frame.is_consistent(), "{}: an image behind the end", case.name);
        }
    }
}

fn two_openings_give_the_same_frames(case: &Case<'_>) {
    let factory = (case.make)();
    let (once, again) = (open_all(factory.as_ref()), open_all(factory.as_ref()));
    for (mut a, mut b) in once.into_iter().zip(again) {
        assert_same(case, &read_all(case, a.as_mut()), &read_all(case, b.as_mut()));
    }
}

fn threads_change_nothing(case: &Case<'_>) {
    let read_in_turn = |mut source: Box<dyn FrameSource>| read_all(case, source.as_mut());
    let in_turn: Vec<_> = open_all((case.make)().as_ref()).into_iter().map(read_in_turn).collect();
    let sources = open_all((case.make)().as_ref());
    let (length, name) = (case.length, case.name);
    let at_once: Vec<_> = thread::scope(|scope| {
        let start = |mut source: Box<dyn FrameSource>| {
            scope.spawn(move || {
                let nothing = || -> Box<dyn DeviceFactory> { unreachable!("no factory is made here") };
                read_all(&Case { name, make: &nothing, length }, source.as_mut())
            })
        };
        let threads: Vec<_> = sources.into_iter().map(start).collect();
        threads.into_iter().map(|thread| thread.join().expect("a reader")).collect()
    });
    for (a, b) in in_turn.iter().zip(&at_once) {
        assert_same(case, a, b);
    }
}

fn replay(recording: Recording, options: ReplayOptions) -> Box<dyn DeviceFactory> {
    Box::new(ReplayFactory::new(recording, options).expect("a whole recording"))
}

#[track_caller]
fn check_replay(options: ReplayOptions) {
    let fixture = Fixture::new(5);
    let length = if options.repeat { None } else { Some(5) };
    let name = format!("replay {options:?}");
    check_conformance(&Case { name: &name, make: &|| replay(fixture.open(), options), length });
}

#[test]
fn replay_as_fast_as_possible_conforms() {
    check_replay(ReplayOptions { pace: Pace::Unpaced, ..ReplayOptions::default() });
}

#[test]
fn replay_in_real_time_conforms() {
    check_replay(ReplayOptions { pace: Pace::RealTime, ..ReplayOptions::default() });
}

#[test]
fn preloaded_replay_conforms() {
    check_replay(ReplayOptions { pace: Pace::Unpaced, preload: true, repeat: false });
    check_replay(ReplayOptions { pace: Pace::RealTime, preload: true, repeat: false });
}

#[test]
fn repeated_replay_conforms() {
    check_replay(ReplayOptions { pace: Pace::Unpaced, preload: true, repeat: true });
    check_replay(ReplayOptions { pace: Pace::RealTime, preload: false, repeat: true });
}

#[test]
fn a_script_without_faults_conforms() {
    let fixture = Fixture::new(5);
    let options = ReplayOptions { pace: Pace::Unpaced, ..ReplayOptions::default() };
    let make = || -> Box<dyn DeviceFactory> {
        let factory = ScriptedFactory::new(replay(fixture.open(), options));
        Box::new(factory.with_script(SERIALS[0], FaultScript::with_seed(1)))
    };
    check_conformance(&Case { name: "scripted", make: &make, length: Some(5) });
}

/// Reads all cameras of a factory in step and writes what comes, without loss.
fn record(factory: &dyn DeviceFactory, n_sets: usize) -> (TempDir, Recording) {
    let folder = tempfile::tempdir().unwrap();
    let cameras = factory.list().unwrap();
    let mut sources = open_all(factory);
    let writer = RecordingWriter::create(folder.path(), &cameras, "a copy", "a test").unwrap();
    let mut writer = writer.with_color_format(ColorFormat::Png);
    let mut frames = vec![RgbdFrame::default(); cameras.len()];
    for _ in 0..n_sets {
        for (source, frame) in sources.iter_mut().zip(&mut frames) {
            source.next_frame(frame, TIMEOUT).unwrap();
        }
        writer.write_set(&frames).unwrap();
    }
    writer.finish().unwrap();
    let recording = Recording::open(folder.path()).unwrap();
    (folder, recording)
}

#[test]
fn a_record_of_a_replay_conforms_and_shows_the_same() {
    let fixture = Fixture::new(5);
    let options = ReplayOptions { pace: Pace::Unpaced, ..ReplayOptions::default() };
    let original = replay(fixture.open(), options);
    let (_folder, copy) = record(original.as_ref(), 5);
    let case = Case { name: "record of replay", make: &|| replay(copy.clone(), options), length: Some(5) };
    check_conformance(&case);
    for (mut a, mut b) in open_all(original.as_ref()).into_iter().zip(open_all((case.make)().as_ref())) {
        assert_same(&case, &read_all(&case, a.as_mut()), &read_all(&case, b.as_mut()));
    }
}

/// Two small rendered cameras, so that the suite's many frames take seconds.
fn synthetic(frame_sets: u64) -> Box<dyn DeviceFactory> {
    let pinhole = Pinhole { fx_px: 150.0, fy_px: 150.0, cx_px: 79.5, cy_px: 59.5 };
    let camera = Camera::try_new((160, 120), pinhole, Distortion::None).unwrap();
    let cameras = [("left", 0.0), ("right", 0.25)].map(|(name, x_m)| SyntheticCamera {
        info: CameraInfo {
            name: name.to_owned(),
            serial: format!("0{name}"),
            camera,
            depth_camera: None,
            depth_unit_m: 0.001,
            firmware: None,
        },
        reference_from_camera: Motion::translation(x_m, 0.0, 0.0),
    });
    let options = SyntheticOptions::new(5, cameras.into());
    Box::new(SyntheticFactory::new(SyntheticOptions { frame_sets: Some(frame_sets), ..options }))
}

#[test]
fn the_synthetic_back_end_conforms() {
    check_conformance(&Case { name: "synthetic", make: &|| synthetic(4), length: Some(4) });
}

#[test]
fn a_record_of_synthetic_cameras_conforms_and_shows_the_same() {
    let original = synthetic(4);
    let (_folder, copy) = record(original.as_ref(), 4);
    let options = ReplayOptions { pace: Pace::Unpaced, ..ReplayOptions::default() };
    let case = Case { name: "record of synthetic", make: &|| replay(copy.clone(), options), length: Some(4) };
    check_conformance(&case);
    for (mut a, mut b) in open_all(synthetic(4).as_ref()).into_iter().zip(open_all((case.make)().as_ref())) {
        assert_same(&case, &read_all(&case, a.as_mut()), &read_all(&case, b.as_mut()));
    }
}
