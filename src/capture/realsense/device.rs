//! A device as the SDK lists it: what it is called, which of its streams are taken, and its calibration.

use std::collections::BTreeSet;
use std::ffi::c_int;

use nalgebra::UnitQuaternion;
use realsense_rust::device::Device;
use realsense_rust::kind::{Rs2CameraInfo, Rs2Format, Rs2Option, Rs2StreamKind};
use realsense_rust::stream_profile::StreamProfile;

use super::depth_unit::depth_unit_m;
use super::extrinsics::{self, color_from_depth};
use super::lens::{self, Intrinsics};
use super::obstacle::Obstacle;
use super::options::{RealsenseOptions, VideoMode};
use super::raw::{DeviceSensor, ProfileList};
use crate::capture::CameraInfo;
use crate::geometry::camera::Pinhole;
use crate::geometry::{Camera, DepthCamera};

/// Streams of one sensor that are opened together.
pub(super) struct SensorPlan {
    pub(super) sensor: DeviceSensor,
    pub(super) profiles: ProfileList,
    /// Their places in the list.
    pub(super) chosen: Vec<c_int>,
    pub(super) kinds: Vec<Rs2StreamKind>,
}

/// What is opened of a device.
pub(super) struct DevicePlan {
    pub(super) info: CameraInfo,
    pub(super) sensors: Vec<SensorPlan>,
    pub(super) rate_hz: f64,
    /// How the accelerometer is turned against colour; `None` where none is read.
    pub(super) color_from_accel: Option<UnitQuaternion<f64>>,
}

/// One stream of a device that is wanted.
struct Wanted {
    kind: Rs2StreamKind,
    format: Rs2Format,
    /// `None`: whatever there is, as in a recording.
    mode: Option<VideoMode>,
}

/// Where a chosen stream is.
struct Found {
    sensor: usize,
    index: c_int,
    profile: StreamProfile,
}

/// What the SDK says of a device; empty where it says nothing.
pub(super) fn text(device: &Device, info: Rs2CameraInfo) -> String {
    device.info(info).map(|text| text.to_string_lossy().into_owned()).unwrap_or_default()
}

/// The serial number of a device.
pub(super) fn serial(device: &Device) -> String {
    text(device, Rs2CameraInfo::SerialNumber)
}

/// Looks at a device without starting it.
pub(super) fn plan(device: &Device, options: &RealsenseOptions) -> Result<DevicePlan, Obstacle> {
    let sensors = DeviceSensor::all(device).map_err(Obstacle::told)?;
    let lists = sensors.iter().map(DeviceSensor::profiles).collect::<Result<Vec<ProfileList>, _>>();
    let lists = lists.map_err(Obstacle::told)?;
    let find = |lists: &[ProfileList], wanted: &Wanted| find(lists, wanted).map_err(Obstacle::Refusal);
    let is_live = options.playback.is_empty();
    let video = |kind, format, mode| Wanted { kind, format, mode: is_live.then_some(mode) };
    let color = find(&lists, &video(Rs2StreamKind::Color, Rs2Format::Rgb8, options.color))?;
    let depth = find(&lists, &video(Rs2StreamKind::Depth, Rs2Format::Z16, options.depth))?;
    let motion = |kind| find(&lists, &Wanted { kind, format: Rs2Format::MotionXyz32F, mode: None }).ok();
    let gyro = options.gyro.then(|| motion(Rs2StreamKind::Gyro)).flatten();
    let accel = options.accel.then(|| motion(Rs2StreamKind::Accel)).flatten();
    let color_from_accel = accel.as_ref().and_then(|accel| color_from(&accel.profile, &color.profile));
    let accel = accel.filter(|_| color_from_accel.is_some());
    let unit =
        sensors.get(depth.sensor).and_then(|sensor| sensor.options().get_option(Rs2Option::DepthUnits));
    let unit = unit.ok_or_else(|| Obstacle::Failure("it does not say what a depth count is".to_owned()))?;
    let info = camera_info(device, (&color.profile, &depth.profile), unit)?;
    let rate_hz = f64::from(color.profile.framerate().max(1));
    let found: Vec<Found> = [Some(color), Some(depth), gyro, accel].into_iter().flatten().collect();
    Ok(DevicePlan { info, sensors: by_sensor(sensors, lists, &found), rate_hz, color_from_accel })
}

/// How the accelerometer is turned against colour; `None` where the device does not say.
fn color_from(accel: &StreamProfile, color: &StreamProfile) -> Option<UnitQuaternion<f64>> {
    let rotation = accel.extrinsics(color).ok().and_then(|found| extrinsics::rotation(found.rotation()));
    if rotation.is_none() {
        tracing::debug!("accelerometer is not read: the camera does not say how it is turned against colour");
    }
    rotation
}

/// Sensors without a wanted stream are left out.
fn by_sensor(sensors: Vec<DeviceSensor>, lists: Vec<ProfileList>, found: &[Found]) -> Vec<SensorPlan> {
    let plan = |(at, (sensor, profiles)): (usize, (DeviceSensor, ProfileList))| {
        let here = || found.iter().filter(|found| found.sensor == at);
        let chosen: Vec<c_int> = here().map(|found| found.index).collect();
        let kinds = here().map(|found| found.profile.kind()).collect();
        (!chosen.is_empty()).then_some(SensorPlan { sensor, profiles, chosen, kinds })
    };
    sensors.into_iter().zip(lists).enumerate().filter_map(plan).collect()
}

/// The wanted stream; of several with one mode the slowest, which for a motion sensor is fast enough.
fn find(lists: &[ProfileList], wanted: &Wanted) -> Result<Found, String> {
    let mut best: Option<Found> = None;
    let mut others = BTreeSet::new();
    for (sensor, list) in lists.iter().enumerate() {
        for index in 0..list.n_profiles() {
            let Some(profile) = list.profile(index).filter(|profile| profile.kind() == wanted.kind) else {
                continue;
            };
            if profile.format() == wanted.format
                && wanted.mode.is_none_or(|mode| mode_of(&profile) == Some(mode))
            {
                if best.as_ref().is_none_or(|best| profile.framerate() < best.profile.framerate()) {
                    best = Some(Found { sensor, index, profile });
                }
            } else if let Some(mode) = mode_of(&profile) {
                others.insert(format!("{}x{} at {} Hz", mode.width_px, mode.height_px, mode.rate_hz));
            }
        }
    }
    best.ok_or_else(|| {
        let asked = wanted.mode.map_or(String::new(), |mode| {
            format!(" of {}x{} at {} Hz", mode.width_px, mode.height_px, mode.rate_hz)
        });
        let others = if others.is_empty() { "none".to_owned() } else { Vec::from_iter(others).join(", ") };
        format!(
            "it has no {:?} stream{asked} as {:?}; there are {others} (a camera on USB 2 has fewer modes)",
            wanted.kind, wanted.format
        )
    })
}

fn mode_of(profile: &StreamProfile) -> Option<VideoMode> {
    let intrinsics = profile.intrinsics().ok()?;
    let rate_hz = usize::try_from(profile.framerate()).ok()?;
    Some(VideoMode { width_px: intrinsics.width(), height_px: intrinsics.height(), rate_hz })
}

fn camera_info(
    device: &Device,
    (color, depth): (&StreamProfile, &StreamProfile),
    depth_unit: f32,
) -> Result<CameraInfo, Obstacle> {
    let serial = serial(device);
    if serial.is_empty() {
        return Err(Obstacle::Refusal("it has no serial number".to_owned()));
    }
    let extrinsics = depth.extrinsics(color).map_err(Obstacle::told)?;
    let color_from_depth = color_from_depth(extrinsics.rotation(), extrinsics.translation());
    let depth_camera = DepthCamera {
        camera: camera(depth).map_err(|obstacle| obstacle.about("depth"))?,
        color_from_depth: color_from_depth.map_err(Obstacle::Refusal)?,
    };
    let firmware = text(device, Rs2CameraInfo::FirmwareVersion);
    Ok(CameraInfo {
        name: name(&text(device, Rs2CameraInfo::Name), &serial),
        serial,
        camera: camera(color).map_err(|obstacle| obstacle.about("colour"))?,
        depth_camera: Some(depth_camera),
        depth_unit_m: depth_unit_m(depth_unit).map_err(Obstacle::Refusal)?,
        firmware: (!firmware.is_empty()).then_some(firmware),
    })
}

/// "Intel RealSense D435I" with serial 012345 is "d435i-012345".
fn name(model: &str, serial: &str) -> String {
    let last = model.split_whitespace().next_back().unwrap_or("camera");
    format!("{}-{serial}", last.to_lowercase())
}

fn camera(profile: &StreamProfile) -> Result<Camera, Obstacle> {
    let intrinsics = profile.intrinsics().map_err(Obstacle::told)?;
    let side = |px: usize| u32::try_from(px).unwrap_or(u32::MAX);
    let found = Intrinsics {
        size_px: (side(intrinsics.width()), side(intrinsics.height())),
        pinhole: Pinhole {
            fx_px: f64::from(intrinsics.fx()),
            fy_px: f64::from(intrinsics.fy()),
            cx_px: f64::from(intrinsics.ppx()),
            cy_px: f64::from(intrinsics.ppy()),
        },
        // Not `distortion()`, which panics at a model that it does not know.
        model: intrinsics.0.model,
        coeffs: intrinsics.0.coeffs.map(f64::from),
    };
    lens::camera(&found).map_err(|error| Obstacle::Refusal(error.to_string()))
}
