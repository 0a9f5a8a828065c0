//! Bodies of messages: the serialisation of ROS 1, little-endian, without padding, strings and lists with their length in front.
//!
//! Every length is checked against the bytes that are there; what is behind the last field that counts is not looked at.

use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};

use crate::capture::realsense::lens::{self, Intrinsics};
use crate::geometry::Camera;
use crate::geometry::camera::Pinhole;
use crate::geometry::motion::Motion;

/// The SDK computes in f32; more than this is no rounding.
const MAX_NORM_GAP: f64 = 1e-3;

/// A message that is read from its front.
struct Fields<'a>(&'a [u8]);

/// `sensor_msgs/Image`.
#[derive(Debug)]
pub(super) struct Image<'a> {
    pub(super) width_px: u32,
    pub(super) height_px: u32,
    pub(super) encoding: &'a str,
    pub(super) is_bigendian: bool,
    /// Bytes from row to row.
    pub(super) stride: usize,
    pub(super) data: &'a [u8],
}

/// `sensor_msgs/Imu` of an accelerometer.
#[derive(Debug, Clone, Copy)]
pub(super) struct AccelSample {
    pub(super) stamp_ns: i64,
    /// In the accelerometer's axes.
    pub(super) m_per_s2: [f32; 3],
}

/// `sensor_msgs/Imu` of a gyro.
#[derive(Debug, Clone, Copy)]
pub(super) struct GyroSample {
    pub(super) stamp_ns: i64,
    pub(super) rad_per_s: f64,
}

impl<'a> Image<'a> {
    pub(super) fn parse(message: &'a [u8]) -> Result<Self, String> {
        let mut fields = Fields(message);
        fields.header()?;
        let (height_px, width_px) = (fields.u32()?, fields.u32()?);
        let encoding = fields.string()?;
        let [endian] = fields.array()?;
        let stride = fields.u32()? as usize;
        let is_bigendian = endian != 0;
        Ok(Self { width_px, height_px, encoding, is_bigendian, stride, data: fields.bytes()? })
    }

    /// When it was taken; all that is read of an image before it is asked for.
    pub(super) fn stamp_ns(message: &[u8]) -> Result<i64, String> {
        Fields(message).header()
    }
}

/// `realsense_msgs/StreamInfo`: the rate that the stream was asked for, Hz.
pub(super) fn rate_hz(message: &[u8]) -> Result<u32, String> {
    Fields(message).u32()
}

/// `sensor_msgs/CameraInfo`: size, K and D, which the SDK fills for every lens.
pub(super) fn camera(message: &[u8]) -> Result<Camera, String> {
    let mut fields = Fields(message);
    fields.header()?;
    let (height_px, width_px) = (fields.u32()?, fields.u32()?);
    let model = fields.string()?;
    let n_coeffs = fields.u32()?;
    let mut coeffs = [0.0; 5];
    if n_coeffs as usize > coeffs.len() {
        return Err(format!(
            "the lens has {n_coeffs} coefficients; at most 5 are allowed: k1, k2, p1, p2, k3"
        ));
    }
    for coeff in coeffs.iter_mut().take(n_coeffs as usize) {
        *coeff = fields.f64()?;
    }
    let [fx_px, skew, cx_px] = fields.vector()?;
    let [_, fy_px, cy_px] = fields.vector()?;
    if skew != 0.0 {
        return Err(format!("the intrinsics have a skew of {skew}; 0 is allowed"));
    }
    let pinhole = Pinhole { fx_px, fy_px, cx_px, cy_px };
    let intrinsics =
        Intrinsics { size_px: (width_px, height_px), pinhole, model: model_number(model)?, coeffs };
    lens::camera(&intrinsics).map_err(|error| error.to_string())
}

/// Number in the SDK of the model that it writes under this name; ROS's own names count as the SDK's plain ones.
fn model_number(name: &str) -> Result<u32, String> {
    let known = [
        "None",
        "Modified Brown Conrady",
        "Inverse Brown Conrady",
        "Ftheta",
        "Brown Conrady",
        "Kannala Brandt4",
    ];
    let name = match name {
        "" => "None",
        "plumb_bob" => "Brown Conrady",
        name => name,
    };
    let number = (0..).zip(known).find(|(_, known)| *known == name).map(|(number, _)| number);
    number.ok_or_else(|| format!("the distortion model is \"{name}\"; allowed are {}", known.join(", ")))
}

/// `geometry_msgs/Transform`.
pub(super) fn motion(message: &[u8]) -> Result<Motion, String> {
    let mut fields = Fields(message);
    let translation_m = Vector3::from(fields.vector()?);
    let [x, y, z] = fields.vector()?;
    let quaternion = Quaternion::new(fields.f64()?, x, y, z);
    let norm = quaternion.norm();
    if !(translation_m.iter().all(|value| value.is_finite()) && (norm - 1.0).abs() < MAX_NORM_GAP) {
        return Err(format!(
            "the extrinsics of a stream are no motion: translation {:?}, quaternion of norm {norm}",
            translation_m.as_slice()
        ));
    }
    let rotation = UnitQuaternion::new_normalize(quaternion);
    Ok(Motion::from_parts(Translation3::from(translation_m), rotation))
}

/// `diagnostic_msgs/KeyValue`.
pub(super) fn key_value(message: &[u8]) -> Result<(&str, &str), String> {
    let mut fields = Fields(message);
    Ok((fields.string()?, fields.string()?))
}

/// `std_msgs/Float32`.
pub(super) fn number(message: &[u8]) -> Result<f32, String> {
    Fields(message).array().map(f32::from_le_bytes)
}

impl GyroSample {
    pub(super) fn parse(message: &[u8]) -> Result<Self, String> {
        let mut fields = Fields(message);
        let stamp_ns = fields.header()?;
        // Orientation and its covariance, which no gyro knows.
        fields.take(13 * 8)?;
        let rad_per_s = Vector3::from(fields.vector()?).norm();
        if !rad_per_s.is_finite() {
            return Err("a sample of the gyro is not a finite number".into());
        }
        Ok(Self { stamp_ns, rad_per_s })
    }
}

impl AccelSample {
    /// `None` where the sample is no number, as one that the SDK gives is left out then.
    pub(super) fn parse(message: &[u8]) -> Result<Option<Self>, String> {
        let mut fields = Fields(message);
        let stamp_ns = fields.header()?;
        // Orientation and turn rate with their covariances, which no accelerometer knows.
        fields.take(25 * 8)?;
        // The SDK has them in single precision, and so has every camera.
        let m_per_s2 = fields.vector()?.map(|value| value as f32);
        let is_finite = m_per_s2.iter().all(|value| value.is_finite());
        Ok(is_finite.then_some(Self { stamp_ns, m_per_s2 }))
    }
}

impl<'a> Fields<'a> {
    fn take(&mut self, len: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.0.split_at_checked(len).ok_or("a message is cut short")?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        self.take(N)?.try_into().map_err(|_| "a message is cut short".to_owned())
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Result<f64, String> {
        self.array().map(f64::from_le_bytes)
    }

    fn vector(&mut self) -> Result<[f64; 3], String> {
        Ok([self.f64()?, self.f64()?, self.f64()?])
    }

    fn bytes(&mut self) -> Result<&'a [u8], String> {
        let len = self.u32()?;
        self.take(len as usize)
    }

    fn string(&mut self) -> Result<&'a str, String> {
        std::str::from_utf8(self.bytes()?).map_err(|_| "a name in a message is not UTF-8".to_owned())
    }

    /// `std_msgs/Header`: a number, seconds and nanoseconds, a frame; the stamp, ns.
    fn header(&mut self) -> Result<i64, String> {
        self.u32()?;
        let (seconds, ns) = (i64::from(self.u32()?), i64::from(self.u32()?));
        self.bytes()?;
        Ok(seconds * 1_000_000_000 + ns)
    }
}
