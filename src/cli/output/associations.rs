//! `pelical.associations/1`, and the same as text.

use serde::Serialize;

use super::document::{CalibrationDocument, TruthEntry};
use super::text::table;

/// `pelical.associations/1`.
#[derive(Debug, Serialize)]
pub struct AssociationsDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// In the order of the arguments.
    pub summaries: Vec<Summary>,
    /// Every recording with every source, recording by recording.
    pub evaluated: Vec<Evaluated>,
}

/// One source over all recordings.
#[derive(Debug, Serialize)]
pub struct Summary {
    /// The source.
    pub association: &'static str,
    /// Recordings that converged.
    pub converged: usize,
    /// Of these, wrong ones.
    pub wrong: usize,
    /// Sum of the frame sets needed, over the recordings that converged with all sources.
    pub frame_sets: usize,
    /// Sum of the times needed, over the same, ms.
    pub ms: f64,
}

/// One recording with one source.
#[derive(Debug, Serialize)]
pub struct Evaluated {
    /// The recording's folder.
    pub path: String,
    /// The source.
    pub association: &'static str,
    /// Whether it says converged, but the truth is elsewhere.
    pub is_wrong: bool,
    /// When a growing number of frame sets was enough for the first time; null when never.
    pub needed: Option<Needed>,
    /// The calibration from all frame sets, with truth.
    pub calibration: CalibrationDocument,
}

/// What the first converged result took.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Needed {
    /// Frame sets.
    pub frame_sets: usize,
    /// Lines, scores and one solution, ms.
    pub ms: f64,
}

impl Summary {
    /// Of one source, among what was evaluated with all.
    pub fn of(association: &'static str, evaluated: &[Evaluated]) -> Self {
        let own = || evaluated.iter().filter(|entry| entry.association == association);
        let everywhere = |path: &str| {
            evaluated.iter().filter(|entry| entry.path == path).all(|entry| entry.needed.is_some())
        };
        let needed = || own().filter(|entry| everywhere(&entry.path)).filter_map(|entry| entry.needed);
        Self {
            association,
            converged: own().filter(|entry| entry.calibration.is_converged()).count(),
            wrong: own().filter(|entry| entry.is_wrong).count(),
            frame_sets: needed().map(|needed| needed.frame_sets).sum(),
            ms: needed().map(|needed| needed.ms).sum(),
        }
    }
}

/// A line per recording and source, and one per source.
pub fn text(document: &AssociationsDocument) -> String {
    let header = ["recording", "association", "state", "off by deg", "off by mm", "sets needed", "ms needed"];
    let mut text = table(&header, &document.evaluated.iter().map(row).collect::<Vec<_>>());
    let header = ["association", "converged", "wrong", "sets needed where all converge", "ms"];
    let rows: Vec<Vec<String>> = document.summaries.iter().map(summary_row).collect();
    text.push('\n');
    text += &table(&header, &rows);
    text
}

fn row(entry: &Evaluated) -> Vec<String> {
    let worst = |pick: fn(&TruthEntry) -> Option<f64>| {
        let errors = entry.calibration.truth.iter().flatten().map(pick);
        let worst = errors.reduce(|a, b| Some(a?.max(b?))).flatten();
        worst.map_or_else(|| "-".to_owned(), |worst| format!("{worst:.3}"))
    };
    let name = entry.path.rsplit('/').next().unwrap_or(&entry.path);
    vec![
        name.to_owned(),
        entry.association.to_owned(),
        entry.calibration.state.to_owned(),
        worst(|truth| truth.rotation_error_deg),
        worst(|truth| truth.translation_error_mm),
        entry.needed.map_or_else(|| "-".to_owned(), |needed| needed.frame_sets.to_string()),
        entry.needed.map_or_else(|| "-".to_owned(), |needed| format!("{:.0}", needed.ms)),
    ]
}

fn summary_row(summary: &Summary) -> Vec<String> {
    vec![
        summary.association.to_owned(),
        summary.converged.to_string(),
        summary.wrong.to_string(),
        summary.frame_sets.to_string(),
        format!("{:.0}", summary.ms),
    ]
}
