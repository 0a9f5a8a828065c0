//! x
#![allow(unsafe_code)]
mod recorder;
use recorder::*;
use realsense_rust::{context::Context, pipeline::InactivePipeline, config::Config, frame::*, kind::*};
use std::time::Duration;
#[test]
fn experiment() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.bag");
    let lens = Lens { size: (320, 240), pinhole: [300.0, 301.0, 160.0, 120.0], model: 2, coeffs: [0.1, 0.0, 0.0, 0.0, 0.0] };
    let dl = Lens { size: (212, 120), model: 4, coeffs: [0.0; 5], ..lens };
    let frames = (0..20).map(|i| { let t = 1000.0 + 33.0 * i as f64; Moment { stamp_ms: t, rgb: (0..320*240*3).map(|k| (k + i) as u8).collect(), depth: (0..212*120).map(|k| (k + i) as u16).collect(),
        gyro: (0..6).map(|j| (t - 33.0 + 5.0 * j as f64, [i as f32, j as f32, 0.0])).collect(), accel: (0..3).map(|j| (t - 33.0 + 10.0 * j as f64, [i as f32, j as f32, 9.8])).collect() }}).collect();
    let s = Script { serial: "0123".into(), color: lens, depth: dl, color_from_depth: ([1.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,1.0],[0.015,0.0,0.0]), depth_unit_m: 0.001, frames, usb: "3.2" };
    record(&s, &path);
    let mut ctx = Context::new().unwrap();
    let dev = ctx.add_device(&path).unwrap();
    for i in [Rs2CameraInfo::Name, Rs2CameraInfo::SerialNumber, Rs2CameraInfo::FirmwareVersion, Rs2CameraInfo::UsbTypeDescriptor] { eprintln!("{i:?} {:?}", dev.info(i)); }
    let p: *mut realsense_sys::rs2_device = unsafe { *(&raw const dev).cast() };
    unsafe { let mut e = std::ptr::null_mut(); realsense_sys::rs2_playback_device_set_real_time(p, 0, &mut e); assert!(e.is_null()); }
    for s in dev.sensors() { eprintln!("sensor {:?} unit {:?}", s.info(Rs2CameraInfo::Name), s.get_option(Rs2Option::DepthUnits)); for p in s.stream_profiles() { eprintln!("  {:?} {:?} {:?}", p.kind(), p.format(), p.intrinsics()); } }
    let pipe = InactivePipeline::try_from(&ctx).unwrap();
    let mut config = Config::new();
    if std::env::var_os("FILE").is_some() { config.enable_device_from_file(&path, false).unwrap(); } else { config.enable_device_from_serial(c"0123").unwrap(); }
    config.enable_stream(Rs2StreamKind::Color, None, 0, 0, Rs2Format::Rgb8, 0).unwrap();
    config.enable_stream(Rs2StreamKind::Depth, None, 0, 0, Rs2Format::Z16, 0).unwrap();
    if std::env::var_os("NOGYRO").is_none() { config.enable_stream(Rs2StreamKind::Gyro, None, 0, 0, Rs2Format::MotionXyz32F, 0).unwrap(); }
    eprintln!("resolve {}", pipe.can_resolve(&config));
    let mut act = pipe.start(Some(config)).unwrap();
    let mut n = 0;
    loop {
        match act.wait(Some(Duration::from_millis(300))) {
            Ok(set) => { n += 1;
                let c = set.frames_of_type::<ColorFrame>(); let d = set.frames_of_type::<DepthFrame>(); let g = set.frames_of_type::<GyroFrame>();
                eprintln!("{n}: {} frames; c {:?} d {:?} g {:?}", set.count(), c.iter().map(|f| (f.timestamp(), f.frame_number(), f.timestamp_domain())).collect::<Vec<_>>(), d.iter().map(|f| (f.timestamp(), f.stride())).collect::<Vec<_>>(), g.iter().map(|f| (f.timestamp(), *f.rotational_velocity())).collect::<Vec<_>>());
            }
            Err(e) => { eprintln!("{e}"); break }
        }
    }
    unsafe { let mut e = std::ptr::null_mut(); eprintln!("status {}", realsense_sys::rs2_playback_device_get_current_status(p, &mut e)); }
}
