//! The section `watch`: from when on a camera counts as moved after a result, and what is done then.

use serde::{Deserialize, Serialize};

use super::convert::within;
use super::error::Refusal;
use crate::solver::WatchLimits;

/// `watch`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct WatchSection {
    /// What is done about a camera that was moved.
    pub on_moved: OnMoved,
    /// Least turn of a camera, beyond its uncertainty.
    pub min_moved_deg: f64,
    /// Least shift of a camera, beyond its uncertainty.
    pub min_moved_mm: f64,
}

impl Default for WatchSection {
    fn default() -> Self {
        let WatchLimits { min_rotation_rad, min_translation_m } = WatchLimits::default();
        // People write 0.3 degrees, not 0.30000000000000004.
        let rounded = |value: f64| (value * 1e3).round() / 1e3;
        Self {
            on_moved: OnMoved::Report,
            min_moved_deg: rounded(min_rotation_rad.to_degrees()),
            min_moved_mm: rounded(min_translation_m * 1e3),
        }
    }
}

/// What is done about a camera that was moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OnMoved {
    /// It is said; the result stays until somebody asks for another one.
    Report,
    /// It is said, and a new calibration begins; the result stays until that converges.
    Recalibrate,
}

/// The limits in internal units.
///
/// # Errors
/// Names the first value out of range.
pub(super) fn watch_limits(file: &WatchSection) -> Result<WatchLimits, Refusal> {
    within("watch.min_moved_deg", file.min_moved_deg, (0.01, 180.0))?;
    within("watch.min_moved_mm", file.min_moved_mm, (0.1, 10_000.0))?;
    Ok(WatchLimits {
        min_rotation_rad: file.min_moved_deg.to_radians(),
        min_translation_m: file.min_moved_mm * 1e-3,
    })
}
