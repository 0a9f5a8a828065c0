//! Recordings as cameras: listed and opened by serial, with their calibration, every byte, stamp and turn.

use std::thread;
use std::time::Duration;

use pelical::capture::realsense::{Pace, RealsenseFactory, RealsenseOptions};
use pelical::capture::{CaptureError, DeviceFactory, RgbdFrame, StampClock, StampNs};
use pelical::geometry::Distortion;
use tempfile::tempdir;

use crate::recorder::{Script, record};
use crate::scenes::{
    COLOR, DEPTH, N_FRAMES, SERIALS, all_frames, factory, force_m_per_s2, script, stamp_ms, turn_rad_per_s,
    two_cameras,
};

/// The recorded frames are the last of what is played: before them stand those that the recorder may lose.
fn recorded(frames: &[RgbdFrame]) -> &[RgbdFrame] {
    let n_warm_up = frames.len().checked_sub(N_FRAMES).unwrap_or_else(|| {
        panic!("{:?}", frames.iter().map(|f| (f.sequence, f.stamp.0 / 1000000)).collect::<Vec<_>>())
    });
    assert!(n_warm_up <= 3, "{} frames are played", frames.len());
    &frames[n_warm_up..]
}

fn check_frames(frames: &[RgbdFrame], script: &Script, seed: usize) {
    for (number, (frame, moment)) in recorded(frames).iter().zip(&script.frames).enumerate() {
        assert_eq!((frame.width, frame.height), COLOR);
        assert_eq!(frame.depth_size_px(), DEPTH);
        assert_eq!(frame.rgb, moment.rgb, "colour of frame {number}");
        assert_eq!(frame.depth, moment.depth, "depth of frame {number}");
        assert_eq!(frame.stamp, StampNs((stamp_ms(number) * 1e6) as i64));
        assert_eq!(frame.timing.clock, StampClock::Device);
        assert_eq!(frame.depth_unit_m, 0.0005);
        let rate = frame.turn_rate.expect("a gyroscope").max_rad_per_s;
        assert!((rate - turn_rad_per_s(number, seed)).abs() < 1e-6, "frame {number}: {rate} rad/s");
        let force = frame.specific_force.expect("an accelerometer").mean_m_per_s2;
        let gap_m_per_s2 = (force - force_m_per_s2(number, seed)).norm();
        assert!(gap_m_per_s2 < 1e-5, "frame {number}: {force} m/s², {gap_m_per_s2} off");
    }
    let numbers: Vec<u64> = recorded(frames).iter().map(|frame| frame.sequence).collect();
    assert!(numbers.windows(2).all(|pair| pair[1] == pair[0] + 1), "{numbers:?}");
}

#[test]
fn two_recordings_play_at_once_byte_for_byte() {
    let folder = tempdir().unwrap();
    let factory = factory(&two_cameras(folder.path()));
    thread::scope(|scope| {
        for (seed, serial) in SERIALS.into_iter().enumerate() {
            let factory = &factory;
            scope.spawn(move || check_frames(&all_frames(factory, serial), &script(serial, seed), seed));
        }
    });
}

#[test]
fn the_list_has_serials_firmware_and_calibration_of_the_device() {
    let folder = tempdir().unwrap();
    let cameras = factory(&two_cameras(folder.path())).list().unwrap();
    let serials: Vec<&str> = cameras.iter().map(|info| info.serial.as_str()).collect();
    assert_eq!(serials, SERIALS);
    for info in &cameras {
        assert_eq!(info.name, format!("d435i-{}", info.serial));
        assert_eq!(info.firmware.as_deref(), Some("5.15.1.0"));
        assert_eq!(info.depth_unit_m, 0.0005);
        let pinhole = info.camera.pinhole();
        assert_eq!((pinhole.fx_px as f32, pinhole.fy_px as f32), (0.95 * 160.0, 0.96 * 160.0));
        assert_eq!((pinhole.cx_px as f32, pinhole.cy_px as f32), (0.49 * 160.0, 0.51 * 120.0));
        assert!(
            matches!(info.camera.distortion(), Distortion::BrownConrady { k1, .. } if (k1 + 0.0565).abs() < 1e-3)
        );
        let imager = info.depth_camera.expect("depth is not registered");
        assert_eq!((imager.camera.width_px(), imager.camera.height_px()), (106, 60));
        assert_eq!(imager.camera.distortion(), Distortion::None, "coefficients of zero");
        let shift = imager.color_from_depth.translation.vector;
        assert!((shift - nalgebra::Vector3::new(0.0149, 0.0001, -0.0002)).norm() < 1e-8, "{shift}");
        let turn = imager.color_from_depth.rotation.scaled_axis();
        assert!((turn - nalgebra::Vector3::new(0.0, 0.0, 0.01)).norm() < 1e-6, "{turn}");
    }
}

#[test]
fn a_source_can_be_dropped_and_opened_again_in_the_middle() {
    let folder = tempdir().unwrap();
    let factory = factory(&two_cameras(folder.path()));
    for n_taken in [0, 1, 7] {
        let mut source = factory.open(SERIALS[0]).unwrap();
        let mut frame = RgbdFrame::default();
        for _ in 0..n_taken {
            source.next_frame(&mut frame, Duration::from_secs(5)).unwrap();
        }
    }
    check_frames(&all_frames(&factory, SERIALS[0]), &script(SERIALS[0], 0), 0);
}

#[test]
fn buffers_are_used_again_and_an_end_stays_an_end() {
    let folder = tempdir().unwrap();
    let factory = factory(&two_cameras(folder.path())[..1]);
    let mut source = factory.open(SERIALS[0]).unwrap();
    let mut frame = RgbdFrame::default();
    source.next_frame(&mut frame, Duration::from_secs(5)).unwrap();
    let buffers = (frame.rgb.as_ptr(), frame.depth.as_ptr());
    let mut n_ends = 0;
    for _ in 0..500 {
        match source.next_frame(&mut frame, Duration::from_millis(50)) {
            Ok(()) => assert_eq!(buffers, (frame.rgb.as_ptr(), frame.depth.as_ptr())),
            Err(CaptureError::EndOfStream) => n_ends += 1,
            Err(CaptureError::Timeout(_)) => assert_eq!(n_ends, 0),
            Err(error) => panic!("{error}"),
        }
        if n_ends == 3 {
            return;
        }
    }
    panic!("no end");
}

#[test]
fn a_serial_that_was_not_recorded_is_not_found() {
    let folder = tempdir().unwrap();
    let factory = factory(&two_cameras(folder.path()));
    match factory.open("1622070123").err() {
        Some(CaptureError::NotFound { serial, available }) => {
            assert_eq!(serial, "1622070123", "the zeros in front count");
            assert_eq!(available, format!("\"{}\", \"{}\"", SERIALS[0], SERIALS[1]));
        }
        other => panic!("{other:?}"),
    }
    assert!(!matches!(factory.reset(SERIALS[0]), Ok(true)), "a recording cannot be reset");
}

#[test]
fn the_clock_is_unwrapped_at_its_end() {
    const WRAP_MS: f64 = 4_294_967.296;
    let folder = tempdir().unwrap();
    let path = folder.path().join("wrap.bag");
    let mut script = script(SERIALS[0], 0);
    let true_ms = |number: usize| WRAP_MS - 20.0 * 33.25 + 33.25 * number as f64;
    for (number, moment) in script.frames.iter_mut().enumerate() {
        let shift_ms = true_ms(number) - moment.stamp_ms;
        moment.stamp_ms = true_ms(number) % WRAP_MS;
        for (stamp_ms, _) in moment.gyro.iter_mut().chain(&mut moment.accel) {
            *stamp_ms = (*stamp_ms + shift_ms) % WRAP_MS;
        }
    }
    record(&script, &path);
    let frames = all_frames(&factory(&[path]), SERIALS[0]);
    let stamps: Vec<i64> = frames.iter().map(|frame| frame.stamp.0).collect();
    assert!(
        stamps.windows(2).all(|pair| pair[1] - pair[0] > 30_000_000 && pair[1] - pair[0] < 40_000_000),
        "{stamps:?}"
    );
    let newest_ns = stamps.last().expect("frames");
    assert!((newest_ns - (true_ms(N_FRAMES - 1) * 1e6) as i64).abs() < 1_000, "{newest_ns}");
}

#[test]
fn files_that_are_no_recording_are_refused_by_their_name() {
    let folder = tempdir().unwrap();
    let junk = folder.path().join("junk.bag");
    std::fs::write(&junk, "not a recording").unwrap();
    for path in [junk, folder.path().join("missing.bag")] {
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let refused = factory(&[path]).list().expect_err("no recording").to_string();
        assert!(refused.contains(&name), "{refused}");
    }
}

#[test]
fn a_lens_that_is_not_known_is_refused() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("fisheye.bag");
    let mut script = script(SERIALS[0], 0);
    script.color.model = realsense_sys::rs2_distortion_RS2_DISTORTION_KANNALA_BRANDT4;
    record(&script, &path);
    let refused = factory(&[path]).open(SERIALS[0]).err().expect("a fish-eye").to_string();
    assert!(refused.contains("kannala_brandt4") && refused.contains(SERIALS[0]), "{refused}");
}

#[test]
fn an_accelerometer_that_nobody_can_place_or_nobody_wants_is_not_read_and_the_gyroscope_is() {
    let folder = tempdir().unwrap();
    let path = folder.path().join("unplaced.bag");
    record(&Script { color_from_accel: None, ..script(SERIALS[0], 0) }, &path);
    let placed = two_cameras(folder.path())[0].clone();
    for (path, accel) in [(path, true), (placed, false)] {
        let options = RealsenseOptions {
            playback: vec![path],
            pace: Pace::Unpaced,
            accel,
            ..RealsenseOptions::default()
        };
        let frames = all_frames(&RealsenseFactory::new(options), SERIALS[0]);
        for frame in recorded(&frames) {
            assert_eq!(frame.specific_force, None);
            assert!(frame.turn_rate.is_some());
        }
    }
}
