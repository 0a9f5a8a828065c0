//! How the frozen result stands: part of answers and of health.

use iceoryx2::prelude::ZeroCopySend;

use super::{MAX_CAMERAS, MAX_MOVED, WireError, count, count_wire, flag, index, not_negative, pair_indices};
use crate::solver::{Moved, WatchReport, Who};

/// How the frozen result stands, in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalWatchV3")]
pub struct WatchWire {
    /// 1 while there is a frozen result that is compared with what the cameras see.
    pub is_watching: u32,
    /// Moves in use; 0 while nothing shows that a camera was moved.
    pub n_moved: u32,
    /// Frame sets since the result was last confirmed.
    pub sets_since_confirmed: u64,
    /// 1 when lines seen since the watch began vouch for every camera.
    pub is_verified: u32,
    /// Zero.
    pub reserved: u32,
    /// What was moved.
    pub moved: [MovedWire; MAX_MOVED],
}

/// One move.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalMovedV3")]
pub struct MovedWire {
    /// Index of the camera.
    pub camera: u32,
    /// The same again; another index where nothing tells which of the two was moved.
    pub or_camera: u32,
    /// Turn, rad.
    pub rotation_rad: f64,
    /// Standard deviation, rad.
    pub sigma_rotation_rad: f64,
    /// Shift of the camera's centre, m.
    pub translation_m: f64,
    /// Standard deviation, m.
    pub sigma_translation_m: f64,
}

const NO_MOVE: MovedWire = MovedWire {
    camera: 0,
    or_camera: 0,
    rotation_rad: 0.0,
    sigma_rotation_rad: 0.0,
    translation_m: 0.0,
    sigma_translation_m: 0.0,
};

impl WatchWire {
    pub(super) fn encode(report: Option<&WatchReport>) -> Result<Self, WireError> {
        let mut wire = Self {
            is_watching: 0,
            n_moved: 0,
            sets_since_confirmed: 0,
            is_verified: 0,
            reserved: 0,
            moved: [NO_MOVE; MAX_MOVED],
        };
        let Some(report) = report else { return Ok(wire) };
        wire.is_watching = 1;
        wire.n_moved = count_wire("moves", report.moved.len().min(MAX_MOVED), MAX_MOVED)?;
        wire.sets_since_confirmed = report.sets_since_confirmed;
        wire.is_verified = u32::from(report.is_verified);
        for (slot, moved) in wire.moved.iter_mut().zip(&report.moved) {
            let (camera, or_camera) = match moved.who {
                Who::Camera(camera) => (camera, camera),
                Who::OneOf(camera, other) => (camera, other),
            };
            *slot = MovedWire {
                camera: count_wire("moved camera", camera, MAX_CAMERAS)?,
                or_camera: count_wire("moved camera", or_camera, MAX_CAMERAS)?,
                rotation_rad: moved.rotation_rad,
                sigma_rotation_rad: moved.sigma_rotation_rad,
                translation_m: moved.translation_m,
                sigma_translation_m: moved.sigma_translation_m,
            };
        }
        Ok(wire)
    }

    pub(super) fn decode(&self) -> Result<Option<WatchReport>, WireError> {
        let n_moved = count("moves", self.n_moved, MAX_MOVED)?;
        if !flag("is_watching", self.is_watching)? {
            return Ok(None);
        }
        let moved = self.moved.iter().take(n_moved).map(moved_of).collect::<Result<_, _>>()?;
        let is_verified = flag("is_verified", self.is_verified)?;
        Ok(Some(WatchReport { moved, sets_since_confirmed: self.sets_since_confirmed, is_verified }))
    }
}

fn moved_of(wire: &MovedWire) -> Result<Moved, WireError> {
    let who = if wire.camera == wire.or_camera {
        Who::Camera(index("moved camera", wire.camera, MAX_CAMERAS)?)
    } else {
        let (camera, other) = pair_indices([wire.camera, wire.or_camera], MAX_CAMERAS)?;
        Who::OneOf(camera, other)
    };
    Ok(Moved {
        who,
        rotation_rad: not_negative("moved rotation_rad", wire.rotation_rad)?,
        sigma_rotation_rad: not_negative("moved sigma_rotation_rad", wire.sigma_rotation_rad)?,
        translation_m: not_negative("moved translation_m", wire.translation_m)?,
        sigma_translation_m: not_negative("moved sigma_translation_m", wire.sigma_translation_m)?,
    })
}
