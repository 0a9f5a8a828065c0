//! The YAML of a file as it is written: units in the key names, cameras by name, quaternions xyzw, covariances ordered
//! x y z rx ry rz. Reading trusts nothing: what could not be published is refused with the key.

use nalgebra::{Matrix6, Quaternion, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

use super::entry::{FrameSets, Restored, StoredCalibration, StoredCamera};
use crate::geometry::motion::Motion;
use crate::solver::{CameraPose, LineResidual, PairEstimate, Reason, ReasonCode, RigCalibration, State};

/// Far above rounding in double precision.
const NORM_TOLERANCE: f64 = 1e-9;

/// The whole text.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Document {
    id: u64,
    /// ns since 1970.
    made_ns: u64,
    restored: Option<RestoredEntry>,
    version: String,
    config_sha256: String,
    frame_sets: FrameSetsEntry,
    /// Name of the camera in whose frame the others are told.
    reference: String,
    cameras: Vec<CameraEntry>,
    pairs: Vec<PairEntry>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RestoredEntry {
    from: u64,
    at_ns: u64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct FrameSetsEntry {
    seen: u64,
    used: u64,
    refused: u64,
    dropped: u64,
    /// Those whose lines the result is made of.
    in_result: u64,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraEntry {
    name: String,
    serial: String,
    firmware: Option<String>,
    reference_from_camera: MotionEntry,
    covariance: [[f64; 6]; 6],
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MotionEntry {
    translation_m: [f64; 3],
    rotation_xyzw: [f64; 4],
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PairEntry {
    target: String,
    source: String,
    /// Name of the pair's own verdict, and why it is not converged.
    state: String,
    reason: Option<ReasonEntry>,
    matches: usize,
    full: usize,
    pnl: usize,
    lead: Option<f64>,
    residual_px: f64,
    residual_m: f64,
    target_from_source: Option<MotionEntry>,
    /// Of each match that both sides lifted: px, m.
    line_residuals: Vec<(f64, f64)>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ReasonEntry {
    code: String,
    sentence: String,
}

impl From<&StoredCalibration> for Document {
    fn from(entry: &StoredCalibration) -> Self {
        let name = |index: usize| entry.cameras.get(index).map_or_else(String::new, |c| c.name.clone());
        let FrameSets { seen, used, refused, dropped } = entry.frame_sets;
        let rig = &entry.calibration;
        let places = entry.cameras.iter().zip(&rig.cameras);
        Self {
            id: entry.id,
            made_ns: entry.made_ns,
            restored: entry.restored.map(|Restored { from, at_ns }| RestoredEntry { from, at_ns }),
            version: entry.version.clone(),
            config_sha256: entry.config_hash.clone(),
            frame_sets: FrameSetsEntry {
                seen,
                used,
                refused,
                dropped,
                in_result: rig.frame_sets_used as u64,
            },
            reference: name(rig.reference),
            cameras: places.filter_map(|(camera, pose)| camera_entry(camera, pose.as_ref()?)).collect(),
            pairs: rig.pairs.iter().map(|pair| pair_entry(pair, &name)).collect(),
        }
    }
}

fn camera_entry(camera: &StoredCamera, pose: &CameraPose) -> Option<CameraEntry> {
    let rows = std::array::from_fn(|row| std::array::from_fn(|column| pose.covariance[(row, column)]));
    Some(CameraEntry {
        name: camera.name.clone(),
        serial: camera.serial.clone(),
        firmware: camera.firmware.clone(),
        reference_from_camera: MotionEntry::from(&pose.reference_from_camera),
        covariance: rows,
    })
}

fn pair_entry(pair: &PairEstimate, name: &dyn Fn(usize) -> String) -> PairEntry {
    let lines = pair.line_residuals.iter();
    PairEntry {
        target: name(pair.target),
        source: name(pair.source),
        state: pair.state.name().to_owned(),
        reason: pair.reason.as_ref().map(|reason| ReasonEntry {
            code: reason.code.name().to_owned(),
            sentence: reason.sentence.clone(),
        }),
        matches: pair.matches,
        full: pair.full,
        pnl: pair.pnl,
        lead: pair.lead,
        residual_px: pair.residual_px,
        residual_m: pair.residual_m,
        target_from_source: pair.target_from_source.as_ref().map(MotionEntry::from),
        line_residuals: lines.map(|line| (line.offset_px, line.distance_m)).collect(),
    }
}

impl From<&Motion> for MotionEntry {
    fn from(to_from_from: &Motion) -> Self {
        Self {
            translation_m: to_from_from.translation.vector.into(),
            rotation_xyzw: to_from_from.rotation.into_inner().coords.into(),
        }
    }
}

impl TryFrom<Document> for StoredCalibration {
    type Error = String;

    fn try_from(document: Document) -> Result<Self, String> {
        let index = |key: &str, name: &str| {
            let position = document.cameras.iter().position(|camera| camera.name == name);
            position.ok_or_else(|| format!("{key}: {name:?} is not among the cameras"))
        };
        let mut cameras = Vec::new();
        let mut poses = Vec::new();
        for (number, camera) in document.cameras.iter().enumerate() {
            if index("cameras", &camera.name)? != number {
                return Err(format!("cameras: {:?} stands there twice", camera.name));
            }
            cameras.push(StoredCamera {
                name: camera.name.clone(),
                serial: camera.serial.clone(),
                firmware: camera.firmware.clone(),
            });
            poses.push(Some(camera.pose()?));
        }
        if cameras.len() < 2 {
            return Err("cameras: a calibration has at least two".to_owned());
        }
        let pair =
            |pair: &PairEntry| pair.estimate(index("pairs", &pair.target)?, index("pairs", &pair.source)?);
        let FrameSetsEntry { seen, used, refused, dropped, in_result } = document.frame_sets;
        Ok(Self {
            id: document.id,
            made_ns: document.made_ns,
            restored: document
                .restored
                .as_ref()
                .map(|&RestoredEntry { from, at_ns }| Restored { from, at_ns }),
            frame_sets: FrameSets { seen, used, refused, dropped },
            calibration: RigCalibration {
                state: State::Converged,
                reason: None,
                reference: index("reference", &document.reference)?,
                cameras: poses,
                pairs: document.pairs.iter().map(pair).collect::<Result<_, String>>()?,
                frame_sets_used: in_result as usize,
            },
            version: document.version,
            config_hash: document.config_sha256,
            cameras,
        })
    }
}

impl CameraEntry {
    fn pose(&self) -> Result<CameraPose, String> {
        let covariance = Matrix6::from_fn(|row, column| self.covariance[row][column]);
        let asymmetry = (covariance - covariance.transpose()).amax();
        let is_finite = covariance.iter().all(|value| value.is_finite());
        if !is_finite || asymmetry > NORM_TOLERANCE * covariance.amax() || covariance.diagonal().min() < 0.0 {
            return Err(format!(
                "covariance of {:?}: must be finite and symmetric, no variance negative",
                self.name
            ));
        }
        let motion = self.reference_from_camera.motion();
        let reference_from_camera =
            motion.ok_or_else(|| format!("reference_from_camera of {:?}: {NO_MOTION}", self.name))?;
        Ok(CameraPose { reference_from_camera, covariance })
    }
}

const NO_MOTION: &str = "must be a finite translation and a unit quaternion";

impl MotionEntry {
    /// To the bit what was written; `None` where it is no motion.
    fn motion(&self) -> Option<Motion> {
        let quaternion = Quaternion::from(self.rotation_xyzw);
        let is_motion = (quaternion.norm() - 1.0).abs() <= NORM_TOLERANCE
            && self.translation_m.iter().all(|value| value.is_finite());
        is_motion.then(|| {
            Motion::from_parts(
                Translation3::from(self.translation_m),
                UnitQuaternion::new_unchecked(quaternion),
            )
        })
    }
}

impl ReasonEntry {
    fn reason(&self) -> Result<Reason, String> {
        let code = ReasonCode::ALL.into_iter().find(|code| code.name() == self.code);
        let code = code.ok_or_else(|| format!("reason: unknown code {:?}", self.code))?;
        Ok(Reason { code, sentence: self.sentence.clone() })
    }
}

impl PairEntry {
    fn state(&self) -> Result<State, String> {
        const STATES: [State; 5] =
            [State::Collecting, State::Converged, State::Degenerate, State::Ambiguous, State::Failed];
        let state = STATES.into_iter().find(|state| state.name() == self.state);
        state.ok_or_else(|| format!("state of a pair: unknown name {:?}", self.state))
    }

    fn estimate(&self, target: usize, source: usize) -> Result<PairEstimate, String> {
        let is_good = |value: f64| value.is_finite() && value >= 0.0;
        let lines = self.line_residuals.iter();
        let numbers = lines.clone().flat_map(|&(px, m)| [px, m]).chain([self.residual_px, self.residual_m]);
        if target == source || !numbers.chain(self.lead).all(is_good) {
            return Err(format!(
                "pair of {:?} and {:?}: must be two cameras with finite residuals and lead, none negative",
                self.target, self.source
            ));
        }
        let motion = self.target_from_source.as_ref().map(|motion| motion.motion().ok_or(NO_MOTION));
        Ok(PairEstimate {
            target,
            source,
            state: self.state()?,
            reason: self.reason.as_ref().map(ReasonEntry::reason).transpose()?,
            target_from_source: motion.transpose().map_err(|what| format!("target_from_source: {what}"))?,
            matches: self.matches,
            full: self.full,
            pnl: self.pnl,
            lead: self.lead,
            residual_px: self.residual_px,
            residual_m: self.residual_m,
            line_residuals: lines
                .map(|&(offset_px, distance_m)| LineResidual { offset_px, distance_m })
                .collect(),
        })
    }
}
