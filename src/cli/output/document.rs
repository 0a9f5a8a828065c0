//! The JSON documents of `--json`: a contract with scripts. Every number is finite or null.

use nalgebra::Matrix6;
use serde::Serialize;

use super::history::ProvenanceEntry;
use super::intake::{RefusedFor, SkewEntry};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::ipc::CameraIdentity;
use crate::pipeline::PairSkew;
use crate::solver::{CameraPose, PairEstimate, Reason, RigCalibration};

/// Everything that goes into a [`CalibrationDocument`].
#[derive(Debug)]
pub struct Findings<'a> {
    /// One per camera, in the order of the calibration.
    pub cameras: &'a [CameraIdentity],
    /// The result.
    pub calibration: &'a RigCalibration,
    /// What became of the frame sets.
    pub frame_sets: FrameSets,
    /// How far apart the frames of each two cameras are; empty where it is not known.
    pub pair_skews: &'a [PairSkew],
    /// Totals over the run.
    pub timing_ms: TimingMs,
    /// Where the cameras truly are, in the frame of the first one; the estimator has never seen it.
    pub truth: Option<&'a [Motion]>,
    /// Where a daemon's result comes from.
    pub provenance: Option<ProvenanceEntry>,
}

/// `pelical.calibration/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CalibrationDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// Name of the verdict.
    pub state: &'static str,
    /// Why it is not converged.
    pub reason: Option<ReasonEntry>,
    /// Name of the reference camera.
    pub reference: String,
    /// Every camera but the reference.
    pub cameras: Vec<CameraEntry>,
    /// Cameras without a place, and what each of them lacks; left out when every camera has one.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<MissingEntry>,
    /// Every pair of cameras.
    pub pairs: Vec<PairEntry>,
    /// What became of the frame sets.
    pub frame_sets: FrameSets,
    /// Totals over the run.
    pub timing_ms: TimingMs,
    /// Errors against the ground truth, where it is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<Vec<TruthEntry>>,
    /// Of a daemon's result.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub provenance: Option<ProvenanceEntry>,
}

/// Why a state is not converged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReasonEntry {
    /// One of a closed list.
    pub code: &'static str,
    /// For people.
    pub sentence: String,
}

/// Where one camera is; null where the evidence does not reach.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraEntry {
    /// Name in the rig.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// Its place.
    pub reference_from_camera: Option<MotionEntry>,
    /// Ordered x y z rx ry rz, m and rad.
    pub covariance: Option<[[Option<f64>; 6]; 6]>,
    /// Standard deviation of x y z.
    pub sigma_mm: Option<[Option<f64>; 3]>,
    /// Standard deviation of rx ry rz.
    pub sigma_deg: Option<[Option<f64>; 3]>,
}

/// A camera without a place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MissingEntry {
    /// Name in the rig.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// What it lacks; null where nothing is known of it at all.
    pub reason: Option<ReasonEntry>,
}

/// A rigid motion.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MotionEntry {
    /// x y z.
    pub translation_m: [f64; 3],
    /// Unit quaternion.
    pub rotation_xyzw: [f64; 4],
}

/// The evidence between two cameras.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PairEntry {
    /// Name of the target camera.
    pub target: String,
    /// Name of the source camera.
    pub source: String,
    /// Independent matches that agree.
    pub matches: usize,
    /// Of these, lifted on both sides.
    pub full: usize,
    /// Of these, lifted on one side.
    pub pnl: usize,
    /// How many times the score of the best really different pose the best one has; null without any other.
    pub lead: Option<f64>,
    /// Root mean square; null without matches.
    pub residual_px: Option<f64>,
    /// Root mean square; null without matches.
    pub residual_mm: Option<f64>,
    /// How far apart the frames of the two cameras are; left out where it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub skew: Option<SkewEntry>,
}

/// What became of the frame sets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct FrameSets {
    /// Complete sets.
    pub seen: u64,
    /// Taken as evidence.
    pub used: u64,
    /// Not taken.
    pub refused: u64,
    /// Why; left out where it is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused_for: Option<RefusedFor>,
}

/// Times over a whole run, ms; null where it was not measured.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct TimingMs {
    /// Segments in images.
    pub detect: Option<f64>,
    /// Segments to lines.
    pub lift: Option<f64>,
    /// Lines to candidates.
    pub associate: Option<f64>,
    /// Candidates to a verdict.
    pub estimate: Option<f64>,
    /// From start to end, reading included.
    pub total: Option<f64>,
}

/// How far one camera is from the truth; null where it has no place.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TruthEntry {
    /// Name of the camera.
    pub camera: String,
    /// Angle of the relative rotation.
    pub rotation_error_deg: Option<f64>,
    /// Length of the difference of the translations.
    pub translation_error_mm: Option<f64>,
}

/// `pelical.evaluation/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EvaluationDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// One per recording that could be read, by path.
    pub recordings: Vec<EvaluatedRecording>,
    /// How many converged.
    pub converged: usize,
    /// How many converged on a wrong answer.
    pub wrong: usize,
}

/// One recording of an evaluation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EvaluatedRecording {
    /// Its folder.
    pub path: String,
    /// Its calibration, with truth.
    pub calibration: CalibrationDocument,
}

impl CalibrationDocument {
    /// The document of a result; angles and lengths in the user's units.
    pub fn new(findings: &Findings<'_>) -> Self {
        let Findings { cameras, calibration, frame_sets, timing_ms, truth, .. } = *findings;
        let name = |index: usize| cameras.get(index).map_or_else(String::new, |camera| camera.name.clone());
        let others = || (0..cameras.len()).filter(|&index| index != calibration.reference);
        let place = |index: usize| calibration.cameras.get(index).and_then(Option::as_ref);
        let skew = |pair: &PairEstimate| {
            let cameras = (pair.target.min(pair.source), pair.target.max(pair.source));
            findings.pair_skews.iter().find(|skew| (skew.first, skew.second) == cameras).map(SkewEntry::from)
        };
        Self {
            schema: "pelical.calibration/1",
            state: calibration.state.name(),
            reason: calibration.reason.as_ref().map(ReasonEntry::from),
            reference: name(calibration.reference),
            cameras: others().map(|index| camera_entry(&cameras[index], place(index))).collect(),
            missing: others()
                .filter(|&index| place(index).is_none())
                .map(|index| missing_entry(&cameras[index], (calibration, index), name))
                .collect(),
            pairs: calibration.pairs.iter().map(|pair| pair_entry(pair, name, skew(pair))).collect(),
            frame_sets,
            timing_ms,
            truth: truth.map(|first_from_camera| {
                let error = |index| {
                    truth_entry(name(index), place(index), calibration.reference, (index, first_from_camera))
                };
                others().map(error).collect()
            }),
            provenance: findings.provenance.clone(),
        }
    }

    /// Whether every test was passed.
    pub fn is_converged(&self) -> bool {
        self.state == "converged"
    }

    /// Whether it says converged, but a camera is further from the truth than `limit_deg` or `limit_mm`, or has no place.
    pub fn is_wrong(&self, limit_deg: f64, limit_mm: f64) -> bool {
        let beyond = |error: Option<f64>, limit: f64| error.is_none_or(|error| error > limit);
        let is_off = |entry: &TruthEntry| {
            beyond(entry.rotation_error_deg, limit_deg) || beyond(entry.translation_error_mm, limit_mm)
        };
        self.is_converged() && self.truth.iter().flatten().any(is_off)
    }
}

impl From<&Reason> for ReasonEntry {
    fn from(reason: &Reason) -> Self {
        Self { code: reason.code.name(), sentence: reason.sentence.clone() }
    }
}

fn camera_entry(camera: &CameraIdentity, place: Option<&CameraPose>) -> CameraEntry {
    let sigma = |place: &CameraPose, first: usize, scale: f64| {
        [0, 1, 2].map(|axis| finite(place.covariance[(first + axis, first + axis)].sqrt() * scale))
    };
    CameraEntry {
        name: camera.name.clone(),
        serial: camera.serial.clone(),
        reference_from_camera: place.map(|place| MotionEntry::from(&place.reference_from_camera)),
        covariance: place.map(|place| rows(&place.covariance)),
        sigma_mm: place.map(|place| sigma(place, 0, 1e3)),
        sigma_deg: place.map(|place| sigma(place, 3, 1f64.to_degrees())),
    }
}

fn missing_entry(
    camera: &CameraIdentity,
    (calibration, index): (&RigCalibration, usize),
    name: impl Fn(usize) -> String,
) -> MissingEntry {
    let link = calibration.missing_link(index);
    let reason =
        link.and_then(|link| Some((link, link.reason.as_ref()?))).map(|(link, reason)| ReasonEntry {
            code: reason.code.name(),
            sentence: format!("{} from {}: {}", name(link.source), name(link.target), reason.sentence),
        });
    MissingEntry { name: camera.name.clone(), serial: camera.serial.clone(), reason }
}

impl From<&Motion> for MotionEntry {
    fn from(to_from_from: &Motion) -> Self {
        let rotation = to_from_from.rotation.coords;
        Self {
            translation_m: to_from_from.translation.vector.into(),
            rotation_xyzw: [rotation.x, rotation.y, rotation.z, rotation.w],
        }
    }
}

fn rows(covariance: &Matrix6<f64>) -> [[Option<f64>; 6]; 6] {
    std::array::from_fn(|row| std::array::from_fn(|column| finite(covariance[(row, column)])))
}

fn pair_entry(pair: &PairEstimate, name: impl Fn(usize) -> String, skew: Option<SkewEntry>) -> PairEntry {
    let residual = |value: f64| if pair.matches > 0 { finite(value) } else { None };
    PairEntry {
        target: name(pair.target),
        source: name(pair.source),
        matches: pair.matches,
        full: pair.full,
        pnl: pair.pnl,
        lead: pair.lead.and_then(finite),
        residual_px: residual(pair.residual_px),
        residual_mm: residual(pair.residual_m * 1e3),
        skew,
    }
}

/// The truth is told in the frame of the first camera, the result in that of the reference.
fn truth_entry(
    camera: String,
    place: Option<&CameraPose>,
    reference: usize,
    (index, first_from_camera): (usize, &[Motion]),
) -> TruthEntry {
    let truth = first_from_camera.get(reference).zip(first_from_camera.get(index));
    let truth = truth
        .map(|(first_from_reference, first_from_camera)| first_from_reference.inverse() * first_from_camera);
    let found = place.map(|place| place.reference_from_camera);
    let both = found.zip(truth);
    TruthEntry {
        camera,
        rotation_error_deg: both
            .and_then(|(found, truth)| finite(rotation_gap_rad(&found, &truth).to_degrees())),
        translation_error_mm: both.and_then(|(found, truth)| finite(translation_gap_m(&found, &truth) * 1e3)),
    }
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
