//! The list `cameras.synthetic.moves`: cameras that are moved in the rig on the way.

use serde::{Deserialize, Serialize};

use super::error::Refusal;
use super::sections::SyntheticSection;
use super::serial::Serial;
use crate::capture::synthetic::{CameraMove, SyntheticOptions};

/// Largest move along an axis, mm, and about one, deg.
const MAX_MOVE: (f64, f64) = (1_000.0, 180.0);

/// One move of one camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a move: {serial: \"...\", at_frame: ..., by_mm: [x, y, z]}")]
pub struct MoveEntry {
    /// Serial number of the camera.
    pub serial: Serial,
    /// The first frame for which it stands elsewhere, counted from 0.
    pub at_frame: u64,
    /// Right, down and forward, as the camera looks.
    #[serde(default)]
    pub by_mm: [f64; 3],
    /// Pitch, yaw and roll.
    #[serde(default)]
    pub turn_deg: [f64; 3],
}

/// The moves of a section for the cameras of a rig.
///
/// # Errors
/// Names the first value that is not allowed.
pub(super) fn moves(file: &SyntheticSection, rig: &SyntheticOptions) -> Result<Vec<CameraMove>, Refusal> {
    if file.render_ahead.is_some() && !file.moves.is_empty() {
        let what = "cannot be combined with render_ahead, whose frames are the same for ever";
        return Err(Refusal::new("cameras.synthetic.moves", what));
    }
    file.moves.iter().enumerate().map(|(index, entry)| one_move(index, entry, rig)).collect()
}

fn one_move(index: usize, entry: &MoveEntry, rig: &SyntheticOptions) -> Result<CameraMove, Refusal> {
    let key = |key: &str| format!("cameras.synthetic.moves[{index}].{key}");
    for (name, values, limit) in
        [("by_mm", entry.by_mm, MAX_MOVE.0), ("turn_deg", entry.turn_deg, MAX_MOVE.1)]
    {
        for value in values {
            super::convert::within(&key(name), value, (-limit, limit))?;
        }
    }
    let serials = || rig.cameras.iter().map(|camera| camera.info.serial.as_str());
    let camera = serials().position(|serial| serial == entry.serial.0).ok_or_else(|| {
        let known: Vec<&str> = serials().collect();
        let what =
            format!("{:?} is not a camera of the rig; allowed are {}", entry.serial.0, known.join(", "));
        Refusal::new(key("serial"), what)
    })?;
    Ok(CameraMove::by((camera, entry.at_frame), entry.by_mm.map(|mm| mm * 1e-3), entry.turn_deg))
}
