//! `pelical evaluate --association`: every recording with several sources of candidate matches, side by side.

use std::path::{Path, PathBuf};

use super::args::EvaluateArgs;
use super::association_choice::AssociationChoice;
use super::calibrate::calibrate;
use super::error::CliError;
use super::evaluate::{WRONG_BEYOND_DEG, WRONG_BEYOND_MM};
use super::exit::Exit;
use super::output;
use super::output::associations::{AssociationsDocument, Evaluated, Needed, Summary};
use super::talk::say;
use crate::capture::recording::Recording;
use crate::pipeline::PipelineOptions;
use crate::pipeline::offline::{RecordedSets, first_converged};

/// Calibrates from every recording with every source and prints errors, frame sets and time needed.
///
/// # Errors
/// The first recording that is not usable.
pub fn run(folders: &[PathBuf], args: &EvaluateArgs, options: &PipelineOptions) -> Result<Exit, CliError> {
    let mut evaluated = Vec::new();
    for (index, folder) in folders.iter().enumerate() {
        for &choice in &args.association {
            say(format_args!("{} of {}: {}: {}", index + 1, folders.len(), folder.display(), choice.name()));
            evaluated.push(evaluate(folder, choice, options)?);
        }
    }
    let summaries: Vec<Summary> =
        args.association.iter().map(|choice| Summary::of(choice.name(), &evaluated)).collect();
    let wrong: usize = summaries.iter().map(|summary| summary.wrong).sum();
    let document = AssociationsDocument { schema: "pelical.associations/1", summaries, evaluated };
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::associations::text(&document))?;
    }
    Ok(if wrong == 0 { Exit::Done } else { Exit::Failed })
}

fn evaluate(
    folder: &Path,
    choice: AssociationChoice,
    options: &PipelineOptions,
) -> Result<Evaluated, CliError> {
    let mut options = options.clone();
    options.associate.association = choice.into();
    let recording = Recording::open(folder)?;
    let calibration = calibrate(&recording, &options)?;
    let needed = if calibration.is_converged() {
        let mut sets = RecordedSets::new(&recording);
        let rig = sets.rig();
        first_converged(&mut sets, &rig, &options)?
    } else {
        None
    };
    Ok(Evaluated {
        path: folder.display().to_string(),
        association: choice.name(),
        is_wrong: calibration.is_wrong(WRONG_BEYOND_DEG, WRONG_BEYOND_MM),
        needed: needed.map(|needed| Needed { frame_sets: needed.frame_sets, ms: needed.ms }),
        calibration,
    })
}
