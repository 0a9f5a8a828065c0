//! `pelical evaluate`: every recording with ground truth below some folders; says how many converged, and how many of these
//! are wrong.

use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

use super::args::EvaluateArgs;
use super::associations;
use super::calibrate::calibrate;
use super::error::CliError;
use super::exit::Exit;
use super::output;
use super::output::document::{EvaluatedRecording, EvaluationDocument};
use super::paper;
use super::talk::say;
use crate::capture::recording::{GROUND_TRUTH_FILE, RECORDING_FILE, Recording, is_recording};
use crate::service::config;

/// A converged result further from the truth than this is wrong, deg.
pub(super) const WRONG_BEYOND_DEG: f64 = 0.5;
/// See [`WRONG_BEYOND_DEG`]; mm.
pub(super) const WRONG_BEYOND_MM: f64 = 15.0;

/// Calibrates from every recording and prints the errors. A recording that cannot be read does not stop the others.
///
/// # Errors
/// When the config or a folder is not usable, or when there is no recording.
pub fn run(args: &EvaluateArgs) -> Result<Exit, CliError> {
    let options = config::load_or_default(args.config.as_deref())?.pipeline;
    if args.paper {
        return paper::run(args, &options);
    }
    let mut folders = Vec::new();
    for folder in &args.folders {
        let failed = |error| CliError::BadInput(format!("{}: cannot be searched: {error}", folder.display()));
        find_recordings(folder, &mut folders).map_err(failed)?;
    }
    // One recording counts once, however it was reached.
    folders.sort();
    let mut known = BTreeSet::new();
    folders.retain(|folder| known.insert(folder.canonicalize().unwrap_or_else(|_| folder.clone())));
    if folders.is_empty() {
        let what = format!("no folder below holds a recording and {GROUND_TRUTH_FILE}");
        return Err(CliError::BadInput(what));
    }
    if !args.association.is_empty() {
        return associations::run(&folders, args, &options);
    }
    let (mut recordings, mut bad) = (Vec::new(), 0);
    for (index, folder) in folders.iter().enumerate() {
        say(format_args!("{} of {}: {}", index + 1, folders.len(), folder.display()));
        match Recording::open(folder).map_err(CliError::from).and_then(|it| calibrate(&it, &options)) {
            Ok(calibration) => {
                recordings.push(EvaluatedRecording { path: folder.display().to_string(), calibration });
            }
            Err(error) => {
                say(format_args!("pelical: {error}"));
                bad += 1;
            }
        }
    }
    let document = evaluation(recordings);
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::text::evaluation(&document))?;
    }
    if bad > 0 {
        return Err(CliError::BadInput(format!("{bad} of {} recordings could not be read", folders.len())));
    }
    Ok(if document.wrong == 0 { Exit::Done } else { Exit::Failed })
}

fn evaluation(recordings: Vec<EvaluatedRecording>) -> EvaluationDocument {
    let is_wrong =
        |recording: &&EvaluatedRecording| recording.calibration.is_wrong(WRONG_BEYOND_DEG, WRONG_BEYOND_MM);
    EvaluationDocument {
        schema: "pelical.evaluation/1",
        converged: recordings.iter().filter(|recording| recording.calibration.is_converged()).count(),
        wrong: recordings.iter().filter(is_wrong).count(),
        recordings,
    }
}

/// Folders with a recording and its truth, at any depth. What lies inside a recording is not searched; a link is
/// followed only to a recording, so that a loop of links cannot catch the search.
fn find_recordings(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    let is_usable = folder.join(GROUND_TRUTH_FILE).is_file() && is_recording(folder);
    if is_usable {
        found.push(folder.to_owned());
    }
    if is_usable || folder.join(RECORDING_FILE).is_file() {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() || is_recording(&entry.path()) {
            find_recordings(&entry.path(), found)?;
        }
    }
    Ok(())
}
