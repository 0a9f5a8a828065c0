//! `recording.yaml` as text: its sections and what is allowed in them.
//!
//! Unknown keys are refused: a misspelled `distortion` must not turn into a rectified camera without a word.

use std::fmt;

use serde::Deserialize;
use serde::de::{self, Deserializer, Visitor};

use super::FORMAT;
use super::truth::{PoseSection, motion};
use crate::capture::nesting;
use crate::capture::{CameraInfo, StampNs};
use crate::geometry::camera::Pinhole;
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, DepthCamera, Distortion};

/// What `recording.yaml` says, checked.
#[derive(Debug)]
pub(super) struct ParsedRecording {
    pub(super) description: String,
    pub(super) source: String,
    pub(super) cameras: Vec<CameraInfo>,
    pub(super) frame_sets: Vec<Vec<StampNs>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "the keys of a recording")]
struct RecordingSection {
    format: String,
    #[serde(default)]
    description: String,
    #[serde(default)]
    source: String,
    cameras: Vec<CheckedCamera>,
    frame_sets: Vec<Vec<i64>>,
}

/// Only the key that says how to read the others.
#[derive(Deserialize)]
struct FormatSection {
    format: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "the keys of a camera")]
struct CameraSection {
    name: String,
    serial: QuotedString,
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: DistortionSection,
    depth_unit_m: f64,
    depth: Option<DepthSection>,
}

/// The imager of depth that is not registered.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "the keys of a depth imager")]
struct DepthSection {
    registered: bool,
    width: u32,
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: DistortionSection,
    color_from_depth: PoseSection,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "{model: ..., coeffs: [...]}")]
struct DistortionSection {
    model: String,
    coeffs: Vec<f64>,
}

/// Converted while the text is read, so that an error carries the camera's line.
#[derive(Deserialize)]
#[serde(try_from = "CameraSection")]
struct CheckedCamera(CameraInfo);

/// Reads and checks the text of `recording.yaml`; the error is a sentence with key, line where known, and what is allowed.
pub(super) fn parse_recording(text: &str) -> Result<ParsedRecording, String> {
    let text = nesting::checked(text)?;
    let section: RecordingSection = serde_yaml::from_str(text).map_err(|error| {
        // A newer format has other keys: name the format rather than the first key that differs.
        match serde_yaml::from_str::<FormatSection>(text) {
            Ok(other) if other.format != FORMAT => wrong_format(&other.format),
            _ => error.to_string(),
        }
    })?;
    if section.format != FORMAT {
        return Err(wrong_format(&section.format));
    }
    let cameras: Vec<CameraInfo> = section.cameras.into_iter().map(|camera| camera.0).collect();
    check_cameras(&cameras)?;
    check_frame_sets(&section.frame_sets, &cameras)?;
    let frame_sets = section.frame_sets.into_iter().map(|set| set.into_iter().map(StampNs).collect());
    Ok(ParsedRecording {
        description: section.description,
        source: section.source,
        cameras,
        frame_sets: frame_sets.collect(),
    })
}

fn wrong_format(found: &str) -> String {
    format!("format is \"{found}\"; this version reads \"{FORMAT}\"")
}

/// At least one camera, names that can be folders, nothing twice.
pub(in crate::capture) fn check_cameras(cameras: &[CameraInfo]) -> Result<(), String> {
    if cameras.is_empty() {
        return Err("cameras is empty: at least one camera is needed".into());
    }
    for (idx, camera) in cameras.iter().enumerate() {
        check_folder_name(&camera.name)?;
        let earlier = cameras.iter().take(idx);
        for other in earlier {
            if other.name == camera.name {
                return Err(format!(
                    "cameras[{idx}]: name \"{}\" is used twice: names are unique",
                    camera.name
                ));
            }
            if other.serial == camera.serial {
                let serial = &camera.serial;
                return Err(format!("cameras[{idx}]: serial \"{serial}\" is used twice: serials are unique"));
            }
        }
    }
    Ok(())
}

fn check_frame_sets(frame_sets: &[Vec<i64>], cameras: &[CameraInfo]) -> Result<(), String> {
    if frame_sets.is_empty() {
        return Err(
            "frame_sets is empty: an empty recording has nothing to show; at least one frame set is needed"
                .into(),
        );
    }
    let mut previous: Option<&Vec<i64>> = None;
    for (row, set) in frame_sets.iter().enumerate() {
        if set.len() != cameras.len() {
            let (stamps, cameras) = (set.len(), cameras.len());
            return Err(format!(
                "frame_sets[{row}] has {stamps} stamps; there are {cameras} cameras, one stamp each"
            ));
        }
        for (camera_idx, (&stamp, camera)) in set.iter().zip(cameras).enumerate() {
            if stamp < 0 {
                return Err(format!(
                    "frame_sets[{row}]: stamp {stamp} is negative; nanoseconds from 0 are allowed"
                ));
            }
            let before = previous.and_then(|set| set.get(camera_idx)).copied();
            if let Some(before) = before.filter(|&before| before >= stamp) {
                return Err(format!(
                    "frame_sets[{row}]: stamps out of order: camera \"{}\" has {stamp} after {before}; stamps \
                     increase within a camera",
                    camera.name
                ));
            }
        }
        previous = Some(set);
    }
    Ok(())
}

impl TryFrom<CameraSection> for CheckedCamera {
    type Error = String;

    fn try_from(section: CameraSection) -> Result<Self, String> {
        let CameraSection { name, serial: QuotedString(serial), fx, fy, cx, cy, depth_unit_m, .. } = section;
        check_folder_name(&name)?;
        if serial.is_empty() {
            return Err(format!("camera \"{name}\": serial is empty"));
        }
        if !(depth_unit_m.is_finite() && depth_unit_m > 0.0 && depth_unit_m <= 1.0) {
            return Err(format!(
                "camera \"{name}\": depth_unit_m is {depth_unit_m}: metres per depth count, above 0 and at most 1"
            ));
        }
        let in_camera = |what: String| format!("camera \"{name}\": {what}");
        let distortion = section.distortion.checked().map_err(in_camera)?;
        let pinhole = Pinhole { fx_px: fx, fy_px: fy, cx_px: cx, cy_px: cy };
        let camera = Camera::try_new((section.width, section.height), pinhole, distortion)
            .map_err(|error| in_camera(error.to_string()))?;
        let depth_camera = section.depth.map(|depth| depth.checked()).transpose();
        let depth_camera = depth_camera.map_err(|what| in_camera(format!("depth: {what}")))?;
        Ok(Self(CameraInfo { name, serial, camera, depth_camera, depth_unit_m, firmware: None }))
    }
}

/// A camera's name is its folder: it must stay inside the recording.
fn check_folder_name(name: &str) -> Result<(), String> {
    let is_plain = |letter: char| !letter.is_control() && !matches!(letter, '/' | '\\' | ':');
    if name.is_empty() || name.starts_with('.') || name.len() > 100 || !name.chars().all(is_plain) {
        return Err(format!(
            "name {name:?} cannot be a folder of the recording: 1 to 100 bytes, no \"/\", \"\\\" or \":\", no dot in front"
        ));
    }
    Ok(())
}

/// How far a depth imager may stand from its colour camera, m: they share a housing.
const MAX_DEPTH_BASELINE_M: f64 = 0.5;
/// And how far it may be turned, rad.
const MAX_DEPTH_TURN_RAD: f64 = 0.5;

impl DepthSection {
    fn checked(&self) -> Result<DepthCamera, String> {
        if self.registered {
            return Err(
                "registered is true; only false is allowed: leave the key `depth` out for registered depth"
                    .into(),
            );
        }
        let Self { width, height, fx, fy, cx, cy, .. } = *self;
        let pinhole = Pinhole { fx_px: fx, fy_px: fy, cx_px: cx, cy_px: cy };
        let camera = Camera::try_new((width, height), pinhole, self.distortion.checked()?)
            .map_err(|error| error.to_string())?;
        let color_from_depth =
            motion(&self.color_from_depth).map_err(|what| format!("color_from_depth: {what}"))?;
        check_housing(&color_from_depth)?;
        Ok(DepthCamera { camera, color_from_depth })
    }
}

/// Whether depth and colour imager can stand so in one housing.
pub(in crate::capture) fn check_housing(color_from_depth: &Motion) -> Result<(), String> {
    let (baseline_m, turn_rad) =
        (color_from_depth.translation.vector.norm(), color_from_depth.rotation.angle());
    if baseline_m > MAX_DEPTH_BASELINE_M || turn_rad > MAX_DEPTH_TURN_RAD {
        return Err(format!(
            "color_from_depth is a shift of {baseline_m:.3} m and a turn of {turn_rad:.3} rad; at most \
             {MAX_DEPTH_BASELINE_M} m and {MAX_DEPTH_TURN_RAD} rad are allowed: the two share a housing"
        ));
    }
    Ok(())
}

impl DistortionSection {
    fn checked(&self) -> Result<Distortion, String> {
        match (self.model.as_str(), self.coeffs.as_slice()) {
            ("none", coeffs) if coeffs.iter().all(|&coeff| coeff == 0.0) => Ok(Distortion::None),
            ("none", _) => Err("distortion.coeffs must be 0 with model none".into()),
            ("brown_conrady", &[k1, k2, p1, p2, k3]) => Ok(Distortion::BrownConrady { k1, k2, p1, p2, k3 }),
            ("brown_conrady", coeffs) => Err(format!(
                "distortion.coeffs has {} numbers; brown_conrady has 5: k1, k2, p1, p2, k3",
                coeffs.len()
            )),
            (model, _) => Err(format!("distortion.model is \"{model}\"; none and brown_conrady are allowed")),
        }
    }
}

/// A string that YAML did not take for a number.
struct QuotedString(String);

impl<'de> Deserialize<'de> for QuotedString {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        // `any`: asked for a string, the YAML reader would hand a number over as one.
        deserializer.deserialize_any(QuotedStringVisitor)
    }
}

struct QuotedStringVisitor;

impl QuotedStringVisitor {
    fn refuse<E: de::Error>(found: impl fmt::Display) -> Result<QuotedString, E> {
        Err(E::custom(format!(
            "serial is the unquoted number {found}; put it in quotes: a number would lose its leading zeros"
        )))
    }
}

impl Visitor<'_> for QuotedStringVisitor {
    type Value = QuotedString;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a serial number in quotes")
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<QuotedString, E> {
        Ok(QuotedString(value.to_owned()))
    }

    fn visit_u64<E: de::Error>(self, value: u64) -> Result<QuotedString, E> {
        Self::refuse(value)
    }

    fn visit_i64<E: de::Error>(self, value: i64) -> Result<QuotedString, E> {
        Self::refuse(value)
    }

    fn visit_f64<E: de::Error>(self, value: f64) -> Result<QuotedString, E> {
        Self::refuse(value)
    }
}
