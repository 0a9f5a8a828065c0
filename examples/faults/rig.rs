//! The rig of the campaign: three synthetic cameras with small pictures, so that two loaded cores follow, recorded once with its truth.

use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};
use nalgebra::Vector3;
use pelical::capture::synthetic::{SyntheticCamera, SyntheticFactory, SyntheticOptions};
use pelical::capture::writer::RecordingWriter;
use pelical::capture::{CameraInfo, DeviceFactory, RgbdFrame};
use pelical::geometry::camera::Pinhole;
use pelical::geometry::motion::Motion;
use pelical::geometry::{Camera, Distortion};

/// Cameras by serial number and name, with place in m and turn to the right in deg.
pub const CAMERAS: [(&str, &str, [f64; 3], f64); 3] = [
    ("mock-1", "front", [0.0, 0.0, 0.0], 0.0),
    ("mock-2", "left", [-0.15, 0.01, -0.04], -17.0),
    ("mock-3", "right", [0.16, -0.01, -0.03], 16.0),
];
/// How often frames come.
pub const RATE_HZ: f64 = 5.0;
/// Noise of one reading of inverse depth at this resolution, 1/m, for the config.
pub const SIGMA_INVERSE_DEPTH_PER_M: f64 = 0.0079;
/// Frame sets of the recording, which is played again and again.
const SETS: u64 = 20;
const SIZE_PX: (u32, u32) = (424, 240);
const FOCAL_PX: f64 = 401.0;

/// Renders and writes the recording; the truth, `reference_from_camera` by camera.
pub fn record(folder: &Path, seed: u64) -> Result<Vec<Motion>> {
    let cameras = CAMERAS.iter().map(camera).collect::<Result<Vec<_>>>()?;
    let truth: Vec<Motion> = cameras.iter().map(|camera| camera.reference_from_camera).collect();
    let infos: Vec<CameraInfo> = cameras.iter().map(|camera| camera.info.clone()).collect();
    let period = Duration::from_secs_f64(1.0 / RATE_HZ);
    let options = SyntheticOptions { frame_sets: Some(SETS), period, ..SyntheticOptions::new(seed, cameras) };
    let factory = SyntheticFactory::new(options);
    let mut sources = infos.iter().map(|info| factory.open(&info.serial)).collect::<Result<Vec<_>, _>>()?;
    let mut writer = RecordingWriter::create(folder, &infos, "", "fault campaign")?;
    writer.write_ground_truth(&truth)?;
    let mut frames = vec![RgbdFrame::default(); infos.len()];
    for _ in 0..SETS {
        for (source, frame) in sources.iter_mut().zip(&mut frames) {
            source.next_frame(frame, Duration::from_secs(60))?;
        }
        writer.write_set(&frames)?;
    }
    writer.finish()?;
    Ok(truth)
}

fn camera((serial, name, at_m, right_deg): &(&str, &str, [f64; 3], f64)) -> Result<SyntheticCamera> {
    let (cx_px, cy_px) = (f64::from(SIZE_PX.0) / 2.0 - 0.3, f64::from(SIZE_PX.1) / 2.0 + 0.4);
    let pinhole = Pinhole { fx_px: FOCAL_PX, fy_px: FOCAL_PX, cx_px, cy_px };
    let camera = Camera::try_new(SIZE_PX, pinhole, Distortion::None).context("intrinsics")?;
    let info = CameraInfo {
        name: (*name).to_owned(),
        serial: (*serial).to_owned(),
        camera,
        depth_camera: None,
        firmware: None,
        depth_unit_m: 0.001,
    };
    let turn = Vector3::y() * right_deg.to_radians();
    Ok(SyntheticCamera { info, reference_from_camera: Motion::new(Vector3::from(*at_m), turn) })
}
