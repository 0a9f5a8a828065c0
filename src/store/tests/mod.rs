//! Calibrations to keep, and what becomes of them.

mod crash;
mod folder;
mod format;
mod rig;

use nalgebra::{Matrix6, Vector3};

use super::*;
use crate::geometry::motion::Motion;
use crate::solver::{CameraPose, LineResidual, PairEstimate, Reason, ReasonCode, RigCalibration, State};

fn camera(name: &str, serial: &str) -> StoredCamera {
    StoredCamera { name: name.to_owned(), serial: serial.to_owned(), firmware: None }
}

/// A calibration of three cameras with everything in it, other numbers for each id.
fn stored(id: u64) -> StoredCalibration {
    let turn = 0.1 + id as f64 / 7.0;
    let motion =
        |part: f64| Motion::new(Vector3::new(0.3 * part, -turn, 1e-17), Vector3::new(part, turn, -0.4));
    let mut covariance = Matrix6::from_diagonal_element(1e-6 / 3.0);
    covariance[(0, 4)] = -2e-7;
    covariance[(4, 0)] = -2e-7;
    let pose = |motion| Some(CameraPose { reference_from_camera: motion, covariance });
    let pair = |target, source, state, reason: Option<Reason>| PairEstimate {
        target,
        source,
        state,
        target_from_source: reason.is_none().then(|| motion(0.7)),
        reason,
        matches: 73,
        full: 60,
        pnl: 13,
        lead: Some(2.5),
        residual_px: 0.6,
        residual_m: 0.004,
        line_residuals: (0..4).map(line_residual).collect(),
    };
    let ambiguous =
        Reason { code: ReasonCode::RunnerUpTooClose, sentence: "9 against 8: \"two\" # ü".to_owned() };
    StoredCalibration {
        id,
        made_ns: 1_800_000_000_000_000_001 + id,
        restored: id.is_multiple_of(2).then_some(Restored { from: 1, at_ns: u64::MAX }),
        version: "0.1.0".to_owned(),
        config_hash: sha256_hex(b"config"),
        frame_sets: FrameSets { seen: 90, used: 12, refused: 70, dropped: 3 },
        cameras: vec![
            camera("left", "0123"),
            StoredCamera { firmware: Some("5.16.0.1".to_owned()), ..camera("rechts: ü", "1e5") },
            camera("- top #", ""),
        ],
        calibration: RigCalibration {
            state: State::Converged,
            reason: None,
            reference: 0,
            cameras: vec![pose(Motion::identity()), pose(motion(1.0)), pose(motion(-0.5))],
            pairs: vec![
                pair(0, 1, State::Converged, None),
                pair(0, 2, State::Converged, None),
                pair(1, 2, State::Ambiguous, Some(ambiguous)),
            ],
            frame_sets_used: 12,
        },
    }
}

fn line_residual(line: u32) -> LineResidual {
    LineResidual { offset_px: 0.1 + f64::from(line) / 97.0, distance_m: f64::from(line) * 1e-4 / 3.0 }
}

/// The numbers of a history.
fn ids(history: &History) -> Vec<u64> {
    history.entries().iter().map(|entry| entry.id).collect()
}
