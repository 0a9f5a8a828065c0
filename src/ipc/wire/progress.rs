//! `pelical/<instance>/v3/progress`: how collecting goes.

use iceoryx2::prelude::ZeroCopySend;

use super::parts::{FrameSetsWire, state_code, state_of};
use super::{
    MAX_CAMERAS, VERSION, WireError, check_version, code_of, count, count_wire, flag, not_negative,
    pair_indices, value_of,
};
use crate::ipc::message::{BestPair, CameraLines, ProgressMessage, Skew, TurnSense, Turning};

/// How collecting goes, in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalProgressV3")]
pub struct ProgressWire {
    /// [`VERSION`].
    pub version: u32,
    /// Verdict: 1 collecting, 2 converged, 3 degenerate, 4 ambiguous, 5 failed, 6 stored.
    pub state: u32,
    /// Counts the progress messages of this daemon, from 1.
    pub sequence: u64,
    /// Stamp of the newest frame, ns of the cameras' clock.
    pub newest_frame_ns: i64,
    /// ns of `CLOCK_MONOTONIC`.
    pub published_ns: u64,
    /// Newest frame's arrival to sending, ns.
    pub latency_ns: u64,
    /// What became of the frame sets.
    pub frame_sets: FrameSetsWire,
    /// Skew of the newest set, ns.
    pub skew_last_ns: u64,
    /// Largest skew, ns.
    pub skew_max_ns: u64,
    /// How fast the rig turns, rad/s; 0 where nothing tells.
    pub turn_rad_per_s: f64,
    /// Cameras in use.
    pub n_cameras: u32,
    /// 1 where the best pair is known.
    pub has_best_pair: u32,
    /// Target camera of the best pair.
    pub best_target: u32,
    /// Source camera of the best pair.
    pub best_source: u32,
    /// Its agreeing matches.
    pub best_matches: u32,
    /// 1 when a camera was moved since the result was made.
    pub is_moved: u32,
    /// What tells how fast the rig turns: 1 gyro, 2 image; 0 nothing.
    pub turn_by: u32,
    /// Zero.
    pub reserved: u32,
    /// Lines of the newest frame set.
    pub cameras: [CameraLinesWire; MAX_CAMERAS],
}

/// Lines of one camera.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalCameraLinesV3")]
pub struct CameraLinesWire {
    /// Straight segments.
    pub lines: u32,
    /// Of these, with depth.
    pub lifted: u32,
}

impl TryFrom<&ProgressMessage> for ProgressWire {
    type Error = WireError;

    fn try_from(message: &ProgressMessage) -> Result<Self, WireError> {
        let best = message.best_pair.unwrap_or(BestPair { target: 0, source: 0, matches: 0 });
        let mut wire = ProgressWire {
            version: VERSION,
            state: state_code(message.state),
            sequence: message.sequence,
            newest_frame_ns: message.newest_frame_ns,
            published_ns: message.published_ns,
            latency_ns: message.latency_ns,
            frame_sets: message.frame_sets.into(),
            skew_last_ns: message.skew.last_ns,
            skew_max_ns: message.skew.max_ns,
            turn_rad_per_s: message.turning.map_or(0.0, |turning| turning.rad_per_s),
            n_cameras: count_wire("cameras", message.cameras.len(), MAX_CAMERAS)?,
            has_best_pair: u32::from(message.best_pair.is_some()),
            best_target: count_wire("best pair target", best.target, MAX_CAMERAS)?,
            best_source: count_wire("best pair source", best.source, MAX_CAMERAS)?,
            best_matches: count_wire("best pair matches", best.matches, u32::MAX as usize)?,
            is_moved: u32::from(message.is_moved),
            turn_by: message.turning.map_or(0, |turning| code_of(&TurnSense::ALL, &turning.sense)),
            reserved: 0,
            cameras: [CameraLinesWire { lines: 0, lifted: 0 }; MAX_CAMERAS],
        };
        for (slot, camera) in wire.cameras.iter_mut().zip(&message.cameras) {
            *slot = CameraLinesWire { lines: camera.lines, lifted: camera.lifted };
        }
        ProgressMessage::try_from(&wire)?;
        Ok(wire)
    }
}

impl TryFrom<&ProgressWire> for ProgressMessage {
    type Error = WireError;

    fn try_from(wire: &ProgressWire) -> Result<Self, WireError> {
        check_version(wire.version)?;
        let n_cameras = count("cameras", wire.n_cameras, MAX_CAMERAS)?;
        let lines = |camera: &CameraLinesWire| CameraLines { lines: camera.lines, lifted: camera.lifted };
        Ok(Self {
            sequence: wire.sequence,
            newest_frame_ns: wire.newest_frame_ns,
            published_ns: wire.published_ns,
            latency_ns: wire.latency_ns,
            state: state_of(wire.state, "state")?,
            is_moved: flag("is_moved", wire.is_moved)?,
            frame_sets: wire.frame_sets.into(),
            cameras: wire.cameras.iter().take(n_cameras).map(lines).collect(),
            best_pair: best_pair_of(wire, n_cameras)?,
            skew: Skew { last_ns: wire.skew_last_ns, max_ns: wire.skew_max_ns },
            turning: turning_of(wire)?,
        })
    }
}

fn turning_of(wire: &ProgressWire) -> Result<Option<Turning>, WireError> {
    if wire.turn_by == 0 {
        return Ok(None);
    }
    let rad_per_s = not_negative("turn_rad_per_s", wire.turn_rad_per_s)?;
    Ok(Some(Turning { rad_per_s, sense: value_of(&TurnSense::ALL, wire.turn_by, "turn_by")? }))
}

fn best_pair_of(wire: &ProgressWire, n_cameras: usize) -> Result<Option<BestPair>, WireError> {
    if !flag("has_best_pair", wire.has_best_pair)? {
        return Ok(None);
    }
    let (target, source) = pair_indices([wire.best_target, wire.best_source], n_cameras)?;
    Ok(Some(BestPair { target, source, matches: wire.best_matches as usize }))
}
