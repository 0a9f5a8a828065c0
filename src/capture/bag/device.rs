//! What a bag says of its devices: one pass over all messages, which keeps where the images are but none of them.

use std::collections::BTreeMap;

use nalgebra::UnitQuaternion;

use super::file::{BagFile, Place};
use super::message::{self, AccelSample, GyroSample, Image};
use super::topic::{Part, Stream, Topic};
use crate::capture::realsense::depth_unit::depth_unit_m;
use crate::capture::recording::check_housing;
use crate::capture::{CameraInfo, CaptureError};
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, DepthCamera};

/// m; what registered depth may be away from colour by rounding.
const NO_SHIFT: f64 = 1e-9;
/// Images and samples of gyros and accelerometers in one bag, of each of which a few dozen bytes are kept: two hours of a camera at 60 frames per second
/// with its gyro at 400 Hz and its accelerometer at 63 Hz. Packed, many more fit into a small file.
const MAX_STAMPED: usize = 4_000_000;
/// Bytes; serial numbers and versions have a dozen.
const MAX_ABOUT_BYTES: usize = 256;

/// One device of a bag.
#[derive(Debug, Default)]
pub(super) struct Device {
    serial: Option<String>,
    firmware: Option<String>,
    /// m, by sensor, as the SDK tells them.
    depth_units: BTreeMap<u32, f32>,
    pub(super) color: ImageStream,
    pub(super) depth: ImageStream,
    pub(super) gyro: Vec<(Place, GyroSample)>,
    pub(super) accel: Vec<(Place, AccelSample)>,
    /// Group and rotation into the accelerometer's axes.
    accel_from_group: Option<(u32, UnitQuaternion<f64>)>,
}

/// One stream of images.
#[derive(Debug, Default)]
pub(super) struct ImageStream {
    sensor: u32,
    /// As it was asked for; `None` where the bag does not say.
    pub(super) rate_hz: Option<u32>,
    camera: Option<Camera>,
    /// Group and motion into this stream's frame.
    stream_from_group: Option<(u32, Motion)>,
    /// In the order of the bag.
    pub(super) images: Vec<Stamped>,
    /// Whether the device's own clock made the stamps.
    pub(super) is_hardware_clock: bool,
}

/// Where an image is, and when it was taken.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stamped {
    pub(super) place: Place,
    pub(super) stamp_ns: i64,
    /// When it came to the host; `None` where the bag does not say.
    pub(super) arrival_ns: Option<i64>,
}

/// Reads every message of a bag once; the devices in their order.
///
/// # Errors
/// When the bag is damaged, or a message that counts cannot be read.
pub(super) fn read_devices(file: &BagFile) -> Result<Vec<Device>, CaptureError> {
    let mut devices: BTreeMap<u32, Device> = BTreeMap::new();
    let mut n_stamped = 0;
    let read = file.each_message(|place, topic, message| {
        let is_sample = matches!(topic, Topic::Gyro { .. } | Topic::Accel { .. });
        n_stamped += usize::from(is_sample || matches!(topic, Topic::Image { part: Part::Data, .. }));
        check_stamped(n_stamped)?;
        let (Topic::Device { device }
        | Topic::DepthUnit { device, .. }
        | Topic::Image { device, .. }
        | Topic::Gyro { device }
        | Topic::Accel { device }
        | Topic::AccelExtrinsics { device, .. }) = topic;
        devices.entry(device).or_default().take(place, topic, message)
    });
    read.map_err(|what| CaptureError::bad_data(file.path(), what))?;
    Ok(devices.into_values().collect())
}

fn check_stamped(n_stamped: usize) -> Result<(), String> {
    if n_stamped > MAX_STAMPED {
        return Err(format!(
            "holds more than {MAX_STAMPED} images and samples of gyros and accelerometers; record less into one bag, or split it with `rosbag filter`"
        ));
    }
    Ok(())
}

/// What a device says of itself; `None` where it is empty.
fn about(key: &str, value: &str) -> Result<Option<String>, String> {
    if value.len() > MAX_ABOUT_BYTES {
        let len = value.len();
        return Err(format!("{key} of a device has {len} bytes; at most {MAX_ABOUT_BYTES} are allowed"));
    }
    Ok(Some(value.to_owned()).filter(|value| !value.is_empty()))
}

impl Device {
    fn take(&mut self, place: Place, topic: Topic, message: &[u8]) -> Result<(), String> {
        match topic {
            Topic::Device { .. } => {
                let (key, value) = message::key_value(message)?;
                match key {
                    "Serial Number" => self.serial = about(key, value)?,
                    "Firmware Version" => self.firmware = about(key, value)?,
                    _ => {}
                }
            }
            Topic::DepthUnit { sensor, .. } => {
                self.depth_units.insert(sensor, message::number(message)?);
            }
            Topic::Gyro { .. } => self.gyro.push((place, GyroSample::parse(message)?)),
            Topic::Accel { .. } => {
                self.accel.extend(AccelSample::parse(message)?.map(|sample| (place, sample)));
            }
            // What is no motion says nothing, as it does not with the SDK: no frame needs it.
            Topic::AccelExtrinsics { group, .. } => {
                self.accel_from_group = message::motion(message).ok().map(|motion| (group, motion.rotation));
            }
            Topic::Image { sensor, stream, part, .. } => {
                let stream = match stream {
                    Stream::Depth => &mut self.depth,
                    Stream::Color => &mut self.color,
                };
                stream.sensor = sensor;
                stream.take(place, part, message)?;
            }
        }
        Ok(())
    }

    /// What is fixed about the camera; `name` also stands for a serial that the bag does not tell.
    pub(super) fn camera_info(&self, name: &str) -> Result<CameraInfo, String> {
        let of = |stream: &ImageStream, what: &str| {
            stream.camera.filter(|_| !stream.images.is_empty()).ok_or_else(|| {
                format!("camera \"{name}\" has no {what} images; depth and colour have to be recorded")
            })
        };
        let (color, depth) = (of(&self.color, "colour")?, of(&self.depth, "depth")?);
        let depth_unit = self.depth_units.get(&self.depth.sensor).copied().ok_or_else(|| {
            format!(
                "camera \"{name}\" has no depth unit: the option Depth Units of its depth sensor is missing"
            )
        })?;
        Ok(CameraInfo {
            name: name.to_owned(),
            serial: self.serial().unwrap_or(name).to_owned(),
            camera: color,
            depth_camera: self
                .depth_camera(&color, depth)
                .map_err(|what| format!("camera \"{name}\": {what}"))?,
            depth_unit_m: depth_unit_m(depth_unit).map_err(|what| format!("camera \"{name}\" has {what}"))?,
            firmware: self.firmware.clone(),
        })
    }

    pub(super) fn serial(&self) -> Option<&str> {
        self.serial.as_deref()
    }

    /// `None` where depth is registered to colour.
    fn depth_camera(&self, color: &Camera, camera: Camera) -> Result<Option<DepthCamera>, String> {
        let Some(color_from_depth) = self.color_from_depth() else {
            // No two imagers are alike: only aligned depth has the intrinsics of colour.
            return if camera == *color {
                Ok(None)
            } else {
                Err("the extrinsics between depth and colour are missing".into())
            };
        };
        let shift = color_from_depth.translation.vector.norm().max(color_from_depth.rotation.angle());
        if shift < NO_SHIFT && camera == *color {
            return Ok(None);
        }
        check_housing(&color_from_depth)?;
        Ok(Some(DepthCamera { camera, color_from_depth }))
    }

    /// How the accelerometer is turned against colour; `None` where the bag does not say.
    pub(super) fn color_from_accel(&self) -> Option<UnitQuaternion<f64>> {
        let (color_group, color_from_group) = self.color.stream_from_group?;
        let (accel_group, accel_from_group) = self.accel_from_group?;
        (color_group == accel_group).then(|| color_from_group.rotation * accel_from_group.inverse())
    }

    /// `None` where the two streams do not refer to the same third.
    fn color_from_depth(&self) -> Option<Motion> {
        let (color_group, color_from_group) = self.color.stream_from_group?;
        let (depth_group, depth_from_group) = self.depth.stream_from_group?;
        (color_group == depth_group).then(|| color_from_group * depth_from_group.inverse())
    }
}

impl ImageStream {
    fn take(&mut self, place: Place, part: Part, message: &[u8]) -> Result<(), String> {
        match part {
            Part::Info => self.rate_hz = Some(message::rate_hz(message)?),
            Part::CameraInfo => self.camera = Some(message::camera(message)?),
            Part::Extrinsics { group } => {
                self.stream_from_group = Some((group, message::motion(message)?));
            }
            Part::Data => {
                let stamp_ns = Image::stamp_ns(message)?;
                self.images.push(Stamped { place, stamp_ns, arrival_ns: None });
            }
            Part::Metadata => match message::key_value(message)? {
                ("timestamp_domain", domain) => self.is_hardware_clock = domain == "Hardware Clock",
                ("Time Of Arrival", ms) => {
                    if let (Some(image), Ok(ms)) = (self.images.last_mut(), ms.parse::<i64>()) {
                        image.arrival_ns = ms.checked_mul(1_000_000).filter(|&ns| ns > 0);
                    }
                }
                _ => {}
            },
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::stamps;
    use super::*;
    use nalgebra::Vector3;

    fn header(ms: u32) -> Vec<u8> {
        let header = [0, ms / 1000, ms % 1000 * 1_000_000, 0].map(u32::to_le_bytes);
        header.concat()
    }

    fn numbers(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|value| value.to_le_bytes()).collect()
    }

    /// A device that takes a frame of colour and depth every 33 ms, whose colour camera is a quarter turn about z away from the origin of the
    /// extrinsics, as is `accel_xyzw` of the accelerometer.
    fn device(group: u32, accel_xyzw: [f64; 4]) -> Device {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let mut device = Device::default();
        let mut take = |topic, message: Vec<u8>| {
            device.take(Place::default(), topic, &message).expect("a message");
        };
        let color = |part| Topic::Image { device: 0, sensor: 1, stream: Stream::Color, part };
        let depth = |part| Topic::Image { device: 0, sensor: 0, stream: Stream::Depth, part };
        let motion = |xyzw: [f64; 4]| [numbers(&[0.0, 0.01, 0.0]), numbers(&xyzw)].concat();
        take(color(Part::Extrinsics { group: 1 }), motion([0.0, 0.0, half, half]));
        take(Topic::AccelExtrinsics { device: 0, group }, motion(accel_xyzw));
        for ms in [1000, 1033, 1066] {
            take(color(Part::Data), header(ms));
            take(depth(Part::Data), header(ms));
        }
        for (ms, x, y) in
            [(900, 99.0, 99.0), (990, 1.0, 9.0), (1000, 3.0, 9.0), (1010, 0.0, f64::NAN), (1020, 8.0, 2.0)]
        {
            let felt = numbers(&[x, y, 0.5]);
            take(Topic::Accel { device: 0 }, [header(ms), vec![0; 25 * 8], felt].concat());
        }
        device
    }

    fn forces(device: &Device) -> Vec<Option<Vector3<f64>>> {
        let frames = stamps::frames(device);
        frames.iter().map(|frame| frame.specific_force.map(|force| force.mean_m_per_s2)).collect()
    }

    #[test]
    fn a_frame_has_the_mean_force_since_the_one_before_in_the_axes_of_colour() {
        let found = forces(&device(1, [0.0, 0.0, 0.0, 1.0]));
        // x of the accelerometer is y of colour. What was felt long before the first frame, or is no number, does not count.
        let expected = [Some([-9.0, 2.0, 0.5]), Some([-2.0, 8.0, 0.5]), None];
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(expected.map(|force| force.map(Vector3::from))) {
            let gap = found.zip(expected).map_or(0.0, |(found, expected)| (found - expected).norm());
            assert!(found.is_some() == expected.is_some() && gap < 1e-9, "{found:?}, not {expected:?}");
        }
    }

    #[test]
    fn an_accelerometer_of_another_group_or_without_a_rotation_says_nothing() {
        assert_eq!(forces(&device(2, [0.0, 0.0, 0.0, 1.0])), [None; 3]);
        assert_eq!(forces(&device(1, [0.0; 4])), [None; 3], "never set");
    }
}
