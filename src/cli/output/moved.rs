//! A camera that was moved since the result was made, as document and text.

use serde::Serialize;

use super::document::ReasonEntry;
use crate::ipc::HealthMessage;
use crate::solver::{Moved, Who};

/// The state of a rig with a camera that was moved.
pub const STATE: &str = "moved";

/// `pelical.moved/1`: said when cameras were moved, and when they are back.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MovedDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// What was moved; empty when every camera stands again as calibrated.
    pub moved: Vec<MovedEntry>,
}

impl MovedDocument {
    /// What a daemon's word about its health says of moves.
    pub fn new(health: &HealthMessage) -> Self {
        let moved = health.watch.iter().flat_map(|watch| &watch.moved);
        let name = |camera| camera_name(Some(health), camera);
        Self { schema: "pelical.moved/1", moved: moved.map(|moved| MovedEntry::new(moved, &name)).collect() }
    }

    /// One line for people.
    pub fn text(&self) -> String {
        match reason(&self.moved) {
            Some(reason) => format!("{STATE}: {}\n", reason.sentence),
            None => "no camera is said to be moved any more\n".to_owned(),
        }
    }

    /// Whether another document says the same but for the amounts.
    pub fn is_same(&self, other: &Self) -> bool {
        self.moved.iter().map(|moved| &moved.cameras).eq(other.moved.iter().map(|moved| &moved.cameras))
    }
}

/// The name of a camera as far as the daemon has told it.
pub fn camera_name(health: Option<&HealthMessage>, camera: usize) -> String {
    let known = health.and_then(|health| health.cameras.get(camera));
    known.map_or_else(|| format!("camera {camera}"), |camera| camera.name.clone())
}

/// One move.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MovedEntry {
    /// The camera; two where nothing tells which of them was moved.
    pub cameras: Vec<String>,
    /// Turn.
    pub rotation_deg: f64,
    /// Standard deviation of the turn.
    pub sigma_deg: f64,
    /// Shift of the camera's centre.
    pub translation_mm: f64,
    /// Standard deviation of the shift.
    pub sigma_mm: f64,
}

impl MovedEntry {
    /// The entry of a move, with the cameras' names.
    pub fn new(moved: &Moved, name: &dyn Fn(usize) -> String) -> Self {
        let cameras = match moved.who {
            Who::Camera(camera) => vec![name(camera)],
            Who::OneOf(a, b) => vec![name(a), name(b)],
        };
        Self {
            cameras,
            rotation_deg: moved.rotation_rad.to_degrees(),
            sigma_deg: moved.sigma_rotation_rad.to_degrees(),
            translation_mm: 1e3 * moved.translation_m,
            sigma_mm: 1e3 * moved.sigma_translation_m,
        }
    }

    /// For people: "left was moved by 3.00 deg (sigma 0.04) and 20.1 mm (sigma 1.2)".
    fn sentence(&self) -> String {
        let Self { rotation_deg, sigma_deg, translation_mm, sigma_mm, .. } = self;
        let who = self.cameras.join(" or ");
        format!(
            "{who} was moved by {rotation_deg:.2} deg (sigma {sigma_deg:.2}) and {translation_mm:.1} mm (sigma {sigma_mm:.1})"
        )
    }
}

/// Why a converged result no longer holds; `None` when nothing was moved.
pub fn reason(moved: &[MovedEntry]) -> Option<ReasonEntry> {
    if moved.is_empty() {
        return None;
    }
    let moves: Vec<String> = moved.iter().map(MovedEntry::sentence).collect();
    let sentence = format!(
        "{}: the published result no longer holds for it; put it back, or calibrate again with `pelical recalibrate`",
        moves.join("; ")
    );
    Some(ReasonEntry { code: "camera_moved", sentence })
}
