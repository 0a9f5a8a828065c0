//! `ground_truth.yaml` as text: the pose of every camera in the first camera's frame.
//!
//! Decides what counts as truth: one pose per camera, finite, the first camera at the origin.

use std::collections::BTreeMap;

use nalgebra::{Quaternion, Translation3, UnitQuaternion};
use serde::Deserialize;

use crate::capture::nesting;
use crate::geometry::motion::Motion;

/// A quaternion is typed with few digits at times; more than this is no rounding.
const MAX_NORM_GAP: f64 = 0.01;
/// m and rad; the first camera is the frame of all others.
const MAX_FIRST_GAP: f64 = 1e-6;

/// Where the cameras truly are.
#[derive(Debug, Clone, PartialEq)]
pub struct GroundTruth {
    /// Per camera, in the recording's order; the reference is the first camera, so the first one is the identity.
    pub reference_from_camera: Vec<Motion>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "poses")]
struct TruthSection {
    poses: BTreeMap<String, PoseSection>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "{translation_m: [...], quaternion_xyzw: [...]}")]
pub(super) struct PoseSection {
    translation_m: [f64; 3],
    quaternion_xyzw: [f64; 4],
}

/// Reads and checks the text of `ground_truth.yaml` for cameras of these names; the error is a sentence.
pub(super) fn parse_ground_truth(text: &str, names: &[&str]) -> Result<GroundTruth, String> {
    let section = read(text)?;
    if let Some(unknown) = section.poses.keys().find(|name| !names.contains(&name.as_str())) {
        return Err(format!("poses.{unknown}: no such camera; the recording has {}", names.join(", ")));
    }
    let reference_from_camera = poses(&section, names)?;
    if let Some(first) = reference_from_camera.first() {
        let gap = first.translation.vector.norm().max(first.rotation.angle());
        if gap > MAX_FIRST_GAP {
            let name = names.first().copied().unwrap_or_default();
            return Err(format!(
                "poses.{name}: the first camera is the reference, so its pose is the identity"
            ));
        }
    }
    Ok(GroundTruth { reference_from_camera })
}

/// As [`parse_ground_truth`], for cameras that may be some of those in the text and in another order; `None` when the text names
/// none of them.
pub(super) fn parse_for_some(text: &str, names: &[&str]) -> Result<Option<GroundTruth>, String> {
    let section = read(text)?;
    if !names.iter().any(|name| section.poses.contains_key(*name)) {
        return Ok(None);
    }
    let first_from_camera = poses(&section, names)?;
    let reference_from_first = first_from_camera.first().map(Motion::inverse).unwrap_or_default();
    let reference_from_camera =
        first_from_camera.iter().map(|motion| reference_from_first * motion).collect();
    Ok(Some(GroundTruth { reference_from_camera }))
}

fn read(text: &str) -> Result<TruthSection, String> {
    serde_yaml::from_str(nesting::checked(text)?).map_err(|error| error.to_string())
}

/// The motions of these cameras.
fn poses(section: &TruthSection, names: &[&str]) -> Result<Vec<Motion>, String> {
    let pose = |name: &&str| {
        let pose = section.poses.get(*name).ok_or_else(|| {
            format!("poses has no camera \"{name}\"; every camera of the recording is needed")
        })?;
        motion(pose).map_err(|what| format!("poses.{name}: {what}"))
    };
    names.iter().map(pose).collect()
}

/// The motion that a section names; the error says which number is not usable.
pub(super) fn motion(pose: &PoseSection) -> Result<Motion, String> {
    if let Some(value) = pose.translation_m.iter().find(|value| !value.is_finite()) {
        return Err(format!("translation_m holds {value}; three finite numbers are allowed"));
    }
    let [x, y, z, w] = pose.quaternion_xyzw;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if !norm.is_finite() || (norm - 1.0).abs() > MAX_NORM_GAP {
        return Err(format!("quaternion_xyzw has norm {norm}; 1 is allowed, within {MAX_NORM_GAP}"));
    }
    let [x, y, z] = pose.translation_m;
    Ok(Motion::from_parts(Translation3::new(x, y, z), UnitQuaternion::new_normalize(quaternion)))
}
