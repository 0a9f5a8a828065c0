//! What the tests record: two cameras whose every pixel, stamp and sample is known.

use std::path::{Path, PathBuf};

use nalgebra::Vector3;

use crate::recorder::{Lens, Moment, Script, record};
use pelical::capture::RgbdFrame;
use pelical::capture::realsense::{Pace, RealsenseFactory, RealsenseOptions};
use pelical::capture::{CaptureError, DeviceFactory};
use realsense_sys as sys;
use std::time::Duration;

pub const COLOR: (usize, usize) = (160, 120);
pub const DEPTH: (usize, usize) = (106, 60);
pub const N_FRAMES: usize = 40;
pub const SERIALS: [&str; 2] = ["001622070123", "943222071556"];

/// A camera whose pictures differ from frame to frame, and from those of a camera with another seed.
pub fn script(serial: &str, seed: usize) -> Script {
    let lens = |size: (usize, usize), model| Lens {
        size: (i32::try_from(size.0).unwrap(), i32::try_from(size.1).unwrap()),
        pinhole: [0.95 * size.0 as f32, 0.96 * size.0 as f32, 0.49 * size.0 as f32, 0.51 * size.1 as f32],
        model,
        coeffs: [0.0; 5],
    };
    let (sin, cos) = (0.01f32.sin(), 0.01f32.cos());
    Script {
        serial: serial.to_owned(),
        color: Lens {
            coeffs: [-0.0565, 0.0682, 0.0004, 0.0007, -0.0218],
            ..lens(COLOR, sys::rs2_distortion_RS2_DISTORTION_INVERSE_BROWN_CONRADY)
        },
        depth: lens(DEPTH, sys::rs2_distortion_RS2_DISTORTION_BROWN_CONRADY),
        color_from_depth: ([cos, sin, 0.0, -sin, cos, 0.0, 0.0, 0.0, 1.0], [0.0149, 0.0001, -0.0002]),
        color_from_accel: Some(COLOR_FROM_ACCEL),
        depth_unit_m: 0.0005,
        rate_hz: 30,
        depth_late_ms: 0.0,
        frames: (0..N_FRAMES).map(|number| moment(number, seed)).collect(),
        usb: "3.2",
    }
}

pub fn stamp_ms(number: usize) -> f64 {
    5_000.0 + 33.25 * number as f64
}

/// Turns of one frame: the second of six samples is the fastest.
pub fn turn_rad_per_s(number: usize, seed: usize) -> f64 {
    0.5 + 0.01 * number as f64 + 0.1 * seed as f64
}

/// A quarter turn about z, by columns: the accelerometer's x axis is down in the image.
const COLOR_FROM_ACCEL: [f32; 9] = [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// A sample of a camera that is tilted from frame to frame, with noise, in the axes of the accelerometer.
fn accel_m_per_s2((number, seed): (usize, usize), sample: u8) -> [f32; 3] {
    let tilt_rad = 0.02 * number as f32 + 0.1 * seed as f32;
    let noise = [0.3, -0.1, 0.25][usize::from(sample)];
    [-9.81 * tilt_rad.cos() + noise, 0.5 * noise, 9.81 * tilt_rad.sin() - noise]
}

/// The mean of a frame's samples in the axes of colour.
pub fn force_m_per_s2(number: usize, seed: usize) -> Vector3<f64> {
    let samples = (0..3).map(|sample| accel_m_per_s2((number, seed), sample).map(f64::from));
    samples.map(|[x, y, z]| Vector3::new(-y, x, z)).sum::<Vector3<f64>>() / 3.0
}

fn moment(number: usize, seed: usize) -> Moment {
    let stamp_ms = stamp_ms(number);
    let gyro = (0..6u8).map(|sample| {
        let share = if sample == 1 { 1.0 } else { 0.25 };
        (stamp_ms - 30.0 + 5.0 * f64::from(sample), [0.0, (turn_rad_per_s(number, seed) * share) as f32, 0.0])
    });
    let accel = (0..3).map(|sample| {
        let felt = accel_m_per_s2((number, seed), sample);
        (stamp_ms - 30.0 + 10.0 * f64::from(sample), felt)
    });
    Moment {
        stamp_ms,
        rgb: (0..3 * COLOR.0 * COLOR.1).map(|at| (at * 7 + number * 13 + seed * 101) as u8).collect(),
        depth: (0..DEPTH.0 * DEPTH.1).map(|at| (at * 11 + number * 17 + seed * 1009) as u16).collect(),
        gyro: gyro.collect(),
        accel: accel.collect(),
    }
}

/// Records both cameras.
pub fn two_cameras(folder: &Path) -> [PathBuf; 2] {
    [0, 1].map(|seed| {
        let path = folder.join(format!("{}.bag", SERIALS[seed]));
        record(&script(SERIALS[seed], seed), &path);
        path
    })
}

pub fn factory(playback: &[PathBuf]) -> RealsenseFactory {
    let playback = playback.to_vec();
    RealsenseFactory::new(RealsenseOptions { playback, pace: Pace::Unpaced, ..RealsenseOptions::default() })
}

/// Every frame of one camera.
pub fn all_frames(factory: &dyn DeviceFactory, serial: &str) -> Vec<RgbdFrame> {
    let mut source = factory.open(serial).unwrap();
    let (mut frames, mut n_vain) = (Vec::new(), 0);
    loop {
        let mut frame = RgbdFrame::default();
        match source.next_frame(&mut frame, Duration::from_millis(100)) {
            Ok(()) => frames.push(frame),
            Err(CaptureError::Timeout(_)) if n_vain < 100 => n_vain += 1,
            Err(CaptureError::EndOfStream) => return frames,
            Err(error) => panic!("{serial}: {error}"),
        }
    }
}
