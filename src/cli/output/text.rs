//! The documents as text for people.

use std::fmt::Write as _;

use super::document::{CalibrationDocument, CameraEntry, EvaluatedRecording, EvaluationDocument, TimingMs};
use super::words;

/// A result as text, ending with a line break.
pub fn calibration(document: &CalibrationDocument) -> String {
    let mut text = format!("state       {}\n", document.state);
    if let Some(reason) = &document.reason {
        let _ = writeln!(text, "reason      {} ({})", reason.sentence, reason.code);
    }
    if let Some(provenance) = &document.provenance {
        let _ = writeln!(text, "made        {}", provenance.text());
    }
    let sets = &document.frame_sets;
    let _ = writeln!(text, "frame sets  {} seen, {} used, {} refused", sets.seen, sets.used, sets.refused);
    let times = timing(&document.timing_ms);
    // A live result has none: `status` tells them.
    if !times.is_empty() {
        let _ = writeln!(text, "time        {times}");
    }
    let _ = writeln!(text, "reference   {}\n", document.reference);
    let header = ["camera", "place from the reference", "direction", "sigma mm (x y z)", "sigma deg (x y z)"];
    text += &table(&header, &document.cameras.iter().map(camera_row).collect::<Vec<_>>());
    let told = document.reason.as_ref().map(|reason| reason.sentence.as_str());
    for missing in &document.missing {
        let why = missing.reason.as_ref().map(|reason| reason.sentence.as_str());
        // Of a rig of two the reason of the whole has said it.
        let Some(why) = why.filter(|why| !told.is_some_and(|told| why.ends_with(told))) else { continue };
        let _ = writeln!(text, "{} is missing: {why}", missing.name);
    }
    if !document.pairs.is_empty() {
        text.push('\n');
        let header = ["pair", "matches", "both sides", "one side", "lead", "residual px", "residual mm"];
        let rows = document.pairs.iter().map(|pair| {
            let name = format!("{} <- {}", pair.target, pair.source);
            let counts = [pair.matches, pair.full, pair.pnl].map(|count| count.to_string());
            let measures = [pair.lead, pair.residual_px, pair.residual_mm].map(number);
            [vec![name], counts.to_vec(), measures.to_vec()].concat()
        });
        text += &table(&header, &rows.collect::<Vec<_>>());
    }
    if let Some(truth) = &document.truth {
        text.push('\n');
        let rows = truth.iter().map(|entry| {
            vec![entry.camera.clone(), fine(entry.rotation_error_deg), number(entry.translation_error_mm)]
        });
        text += &table(&["camera", "off by deg", "off by mm"], &rows.collect::<Vec<_>>());
    }
    text
}

/// An evaluation as text, ending with a line break.
pub fn evaluation(document: &EvaluationDocument) -> String {
    let header = ["recording", "state", "errors", "sets used", "ms", "reason"];
    let mut text = table(&header, &document.recordings.iter().map(evaluation_row).collect::<Vec<_>>());
    let (converged, wrong) = (document.converged, document.wrong);
    let _ =
        writeln!(text, "\n{} recordings: {converged} converged, {wrong} wrong", document.recordings.len());
    text
}

fn evaluation_row(recording: &EvaluatedRecording) -> Vec<String> {
    let EvaluatedRecording { path, calibration } = recording;
    let errors = calibration.truth.iter().flatten().map(|entry| {
        let (deg, mm) = (fine(entry.rotation_error_deg), number(entry.translation_error_mm));
        format!("{}: {deg} deg {mm} mm", entry.camera)
    });
    vec![
        path.clone(),
        calibration.state.to_owned(),
        errors.collect::<Vec<_>>().join("; "),
        format!("{} of {}", calibration.frame_sets.used, calibration.frame_sets.seen),
        calibration.timing_ms.total.map_or_else(|| "-".to_owned(), |total| format!("{total:.0}")),
        calibration.reason.as_ref().map_or_else(String::new, |reason| reason.sentence.clone()),
    ]
}

fn camera_row(camera: &CameraEntry) -> Vec<String> {
    let place = camera.reference_from_camera.as_ref();
    let all = |sigma: Option<[Option<f64>; 3]>, one: fn(Option<f64>) -> String| {
        sigma.map_or_else(|| "-".to_owned(), |sigma| sigma.map(one).join(" "))
    };
    vec![
        camera.name.clone(),
        place.map_or_else(|| "unknown".to_owned(), words::position),
        place.map_or_else(|| "unknown".to_owned(), words::orientation),
        all(camera.sigma_mm, number),
        all(camera.sigma_deg, fine),
    ]
}

fn timing(timing_ms: &TimingMs) -> String {
    let TimingMs { detect, lift, associate, estimate, total } = *timing_ms;
    let parts = [
        ("detect", detect),
        ("lift", lift),
        ("associate", associate),
        ("estimate", estimate),
        ("total", total),
    ];
    let said = parts.iter().filter_map(|(name, time)| time.map(|time| format!("{name} {time:.0} ms")));
    said.collect::<Vec<_>>().join(", ")
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1}"))
}

fn fine(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"))
}

/// Columns as wide as their widest cell, two spaces between them.
pub fn table(header: &[&str], rows: &[Vec<String>]) -> String {
    let cell_width =
        |row: &Vec<String>, column: usize| row.get(column).map_or(0, |cell| cell.chars().count());
    let widths: Vec<usize> = header
        .iter()
        .enumerate()
        .map(|(column, title)| {
            rows.iter().map(|row| cell_width(row, column)).fold(title.chars().count(), usize::max)
        })
        .collect();
    let line = |cells: Vec<&str>| {
        let padded = cells.iter().zip(&widths).map(|(cell, &width)| format!("{cell:width$}"));
        format!("{}\n", padded.collect::<Vec<_>>().join("  ").trim_end())
    };
    let mut text = line(header.to_vec());
    for row in rows {
        text += &line(row.iter().map(String::as_str).collect());
    }
    text
}
