//! `pelical/<instance>/v3/calibration`: the newest calibration.

use iceoryx2::prelude::ZeroCopySend;
use nalgebra::Matrix6;

use super::parts::{FixedText, MotionWire, ReasonWire, state_code, state_of};
use super::{
    MAX_CAMERAS, MAX_HASH_BYTES, MAX_NAME_BYTES, MAX_PAIRS, VERSION, WireError, check_version, count,
    count_wire, flag, index, not_negative, pair_indices,
};
use crate::ipc::message::{CalibrationMessage, CameraIdentity, Provenance};
use crate::solver::{CameraPose, PairEstimate, RigCalibration, State};

/// The newest calibration in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalCalibrationV3")]
pub struct CalibrationWire {
    /// [`VERSION`].
    pub version: u32,
    /// Verdict: 1 collecting, 2 converged, 3 degenerate, 4 ambiguous, 5 failed, 6 stored.
    pub state: u32,
    /// Counts the calibrations of this daemon, from 1.
    pub sequence: u64,
    /// ns since 1970.
    pub stamp_ns: u64,
    /// Frame sets that were taken into account.
    pub frame_sets_used: u64,
    /// Index of the reference camera.
    pub reference: u32,
    /// Cameras in use.
    pub n_cameras: u32,
    /// Pairs in use.
    pub n_pairs: u32,
    /// Zero.
    pub reserved: u32,
    /// Its number in the daemon's history; 0 where it is not kept.
    pub id: u64,
    /// The number of the older one that somebody went back to; 0 for none.
    pub restored_from: u64,
    /// Version of the program that made it.
    pub made_by: FixedText<MAX_NAME_BYTES>,
    /// SHA-256 of the config it was made with, hex; empty where unknown.
    pub config_hash: FixedText<MAX_HASH_BYTES>,
    /// Why it is not converged.
    pub reason: ReasonWire,
    /// The cameras.
    pub cameras: [CameraWire; MAX_CAMERAS],
    /// The pairs.
    pub pairs: [PairWire; MAX_PAIRS],
}

/// One camera of a calibration.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalCameraV3")]
pub struct CameraWire {
    /// Name from the config.
    pub name: FixedText<MAX_NAME_BYTES>,
    /// Serial number.
    pub serial: FixedText<MAX_NAME_BYTES>,
    /// Firmware version; empty where unknown.
    pub firmware: FixedText<MAX_NAME_BYTES>,
    /// 1 where the pose is known, 0 where the evidence does not reach.
    pub has_pose: u32,
    /// The camera's frame in the reference camera's frame.
    pub reference_from_camera: MotionWire,
    /// Row-major 6x6, ordered x y z rx ry rz, m and rad.
    pub covariance: [f64; 36],
}

/// One pair of a calibration.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalPairV3")]
pub struct PairWire {
    /// Index of the target camera.
    pub target: u32,
    /// Index of the source camera.
    pub source: u32,
    /// Verdict, as in the calibration.
    pub state: u32,
    /// 1 where `target_from_source` is known.
    pub has_motion: u32,
    /// Independent matches that agree.
    pub matches: u32,
    /// Of these, lifted on both sides.
    pub full: u32,
    /// Of these, lifted on one side.
    pub pnl: u32,
    /// Zero.
    pub reserved: u32,
    /// px.
    pub residual_px: f64,
    /// m.
    pub residual_m: f64,
    /// How many times the score of the best really different pose the best one has; 0 without any other.
    pub lead: f64,
    /// The best pose so far.
    pub target_from_source: MotionWire,
    /// Why the pair is not converged.
    pub reason: ReasonWire,
}

const NO_CAMERA: CameraWire = CameraWire {
    name: FixedText::EMPTY,
    serial: FixedText::EMPTY,
    firmware: FixedText::EMPTY,
    has_pose: 0,
    reference_from_camera: MotionWire::NONE,
    covariance: [0.0; 36],
};

const NO_PAIR: PairWire = PairWire {
    target: 0,
    source: 0,
    state: 0,
    has_motion: 0,
    matches: 0,
    full: 0,
    pnl: 0,
    reserved: 0,
    residual_px: 0.0,
    residual_m: 0.0,
    lead: 0.0,
    target_from_source: MotionWire::NONE,
    reason: ReasonWire::NONE,
};

impl CalibrationWire {
    /// Where there is no calibration: zeros, which no reader takes for one.
    pub(super) const EMPTY: Self = Self {
        version: 0,
        state: 0,
        sequence: 0,
        stamp_ns: 0,
        frame_sets_used: 0,
        reference: 0,
        n_cameras: 0,
        n_pairs: 0,
        reserved: 0,
        id: 0,
        restored_from: 0,
        made_by: FixedText::EMPTY,
        config_hash: FixedText::EMPTY,
        reason: ReasonWire::NONE,
        cameras: [NO_CAMERA; MAX_CAMERAS],
        pairs: [NO_PAIR; MAX_PAIRS],
    };
}

impl TryFrom<&CalibrationMessage> for CalibrationWire {
    type Error = WireError;

    fn try_from(message: &CalibrationMessage) -> Result<Self, WireError> {
        let rig = &message.calibration;
        let n_cameras = count_wire("cameras", rig.cameras.len(), MAX_CAMERAS)?;
        if message.cameras.len() != rig.cameras.len() {
            return Err(WireError::Value { field: "cameras", allowed: "as many names as poses" });
        }
        let mut wire = CalibrationWire {
            version: VERSION,
            state: state_code(rig.state),
            sequence: message.sequence,
            stamp_ns: message.stamp_ns,
            frame_sets_used: rig.frame_sets_used as u64,
            reference: count_wire("reference", rig.reference, MAX_CAMERAS)?,
            n_cameras,
            n_pairs: count_wire("pairs", rig.pairs.len(), MAX_PAIRS)?,
            id: message.provenance.id.unwrap_or(0),
            restored_from: message.provenance.restored_from.unwrap_or(0),
            made_by: FixedText::exact("made_by", &message.provenance.version)?,
            config_hash: FixedText::exact("config_hash", &message.provenance.config_hash)?,
            reason: ReasonWire::encode(rig.reason.as_ref()),
            ..Self::EMPTY
        };
        let known = message.cameras.iter().zip(&rig.cameras);
        for (slot, (identity, pose)) in wire.cameras.iter_mut().zip(known) {
            *slot = camera_wire(identity, pose.as_ref())?;
        }
        for (slot, pair) in wire.pairs.iter_mut().zip(&rig.pairs) {
            *slot = pair_wire(pair)?;
        }
        CalibrationMessage::try_from(&wire)?;
        Ok(wire)
    }
}

fn camera_wire(identity: &CameraIdentity, pose: Option<&CameraPose>) -> Result<CameraWire, WireError> {
    let mut wire = NO_CAMERA;
    wire.name = FixedText::exact("camera name", &identity.name)?;
    wire.serial = FixedText::exact("camera serial", &identity.serial)?;
    wire.firmware = FixedText::cut(identity.firmware.as_deref().unwrap_or(""));
    if let Some(pose) = pose {
        wire.has_pose = 1;
        wire.reference_from_camera = MotionWire::encode(&pose.reference_from_camera);
        // Symmetric, so that nalgebra's column order is the row order.
        for (to, from) in wire.covariance.iter_mut().zip(pose.covariance.iter()) {
            *to = *from;
        }
    }
    Ok(wire)
}

fn pair_wire(pair: &PairEstimate) -> Result<PairWire, WireError> {
    let limit = u32::MAX as usize;
    Ok(PairWire {
        target: count_wire("pair target", pair.target, MAX_CAMERAS)?,
        source: count_wire("pair source", pair.source, MAX_CAMERAS)?,
        state: state_code(pair.state),
        has_motion: u32::from(pair.target_from_source.is_some()),
        matches: count_wire("pair matches", pair.matches, limit)?,
        full: count_wire("pair full", pair.full, limit)?,
        pnl: count_wire("pair pnl", pair.pnl, limit)?,
        reserved: 0,
        residual_px: pair.residual_px,
        residual_m: pair.residual_m,
        lead: pair.lead.unwrap_or(0.0),
        target_from_source: pair.target_from_source.as_ref().map_or(MotionWire::NONE, MotionWire::encode),
        reason: ReasonWire::encode(pair.reason.as_ref()),
    })
}

impl TryFrom<&CalibrationWire> for CalibrationMessage {
    type Error = WireError;

    fn try_from(wire: &CalibrationWire) -> Result<Self, WireError> {
        check_version(wire.version)?;
        let n_cameras = count("cameras", wire.n_cameras, MAX_CAMERAS)?;
        let n_pairs = count("pairs", wire.n_pairs, MAX_PAIRS)?;
        let mut cameras = Vec::with_capacity(n_cameras);
        let mut poses = Vec::with_capacity(n_cameras);
        for camera in wire.cameras.iter().take(n_cameras) {
            let name = camera.name.text("camera name")?;
            let firmware = Some(camera.firmware.text("camera firmware")?).filter(|text| !text.is_empty());
            cameras.push(CameraIdentity { name, serial: camera.serial.text("camera serial")?, firmware });
            poses.push(pose_of(camera)?);
        }
        let calibration = RigCalibration {
            state: state_of(wire.state, "state")?,
            reason: wire.reason.decode("reason")?,
            reference: index("reference", wire.reference, n_cameras)?,
            cameras: poses,
            pairs: wire
                .pairs
                .iter()
                .take(n_pairs)
                .map(|pair| pair_of(pair, n_cameras))
                .collect::<Result<_, _>>()?,
            frame_sets_used: wire.frame_sets_used as usize,
        };
        let is_complete = matches!(calibration.state, State::Converged | State::Stored);
        if is_complete && calibration.cameras.iter().any(Option::is_none) {
            return Err(WireError::Value { field: "cameras", allowed: "all with a pose when converged" });
        }
        let provenance = Provenance {
            id: Some(wire.id).filter(|id| *id > 0),
            restored_from: Some(wire.restored_from).filter(|id| *id > 0),
            version: wire.made_by.text("made_by")?,
            config_hash: wire.config_hash.text("config_hash")?,
        };
        Ok(Self { sequence: wire.sequence, stamp_ns: wire.stamp_ns, provenance, cameras, calibration })
    }
}

fn pose_of(camera: &CameraWire) -> Result<Option<CameraPose>, WireError> {
    if !flag("camera has_pose", camera.has_pose)? {
        return Ok(None);
    }
    let covariance = Matrix6::from_row_slice(&camera.covariance);
    let is_finite = covariance.iter().all(|x| x.is_finite());
    let asymmetry = (covariance - covariance.transpose()).amax();
    if !is_finite || asymmetry > 1e-9 * covariance.amax() || covariance.diagonal().min() < 0.0 {
        let allowed = "finite and symmetric, without negative variances";
        return Err(WireError::Value { field: "camera covariance", allowed });
    }
    let reference_from_camera = camera.reference_from_camera.decode("camera pose")?;
    Ok(Some(CameraPose { reference_from_camera, covariance }))
}

fn pair_of(pair: &PairWire, n_cameras: usize) -> Result<PairEstimate, WireError> {
    let has_motion = flag("pair has_motion", pair.has_motion)?;
    let (target, source) = pair_indices([pair.target, pair.source], n_cameras)?;
    Ok(PairEstimate {
        target,
        source,
        state: state_of(pair.state, "pair state")?,
        reason: pair.reason.decode("pair reason")?,
        target_from_source: has_motion.then(|| pair.target_from_source.decode("pair motion")).transpose()?,
        matches: pair.matches as usize,
        full: pair.full as usize,
        pnl: pair.pnl as usize,
        residual_px: not_negative("pair residual_px", pair.residual_px)?,
        residual_m: not_negative("pair residual_m", pair.residual_m)?,
        line_residuals: Vec::new(),
        lead: Some(not_negative("pair lead", pair.lead)?).filter(|lead| *lead > 0.0),
    })
}
