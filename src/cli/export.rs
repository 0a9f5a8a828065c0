//! `pelical export`: a calibration in the forms that other programs read.

use super::address::Address;
use super::args::{ExportArgs, ExportFormat};
use super::error::CliError;
use super::exit::Exit;
use super::history::below_id;
use super::online::ANSWER_WITHIN;
use super::output;
use super::output::document::{CalibrationDocument, Findings, FrameSets, TimingMs};
use super::output::export::{self, Placed};
use super::output::history::ProvenanceEntry;
use super::output::time::now_ns;
use super::talk::say;
use crate::ipc::{CalibrationMessage, Client};
use crate::solver::State;

/// Prints the published calibration, or one of the history.
///
/// # Errors
/// When there is no daemon, or its cameras have names that the form cannot tell apart.
pub fn run(daemon: &Address, args: &ExportArgs) -> Result<Exit, CliError> {
    let mut client = daemon.connect()?;
    let found = match args.id {
        None => published(&mut client)?,
        Some(id) => {
            below_id(&mut client, id.saturating_add(1))?.filter(|found| found.provenance.id == Some(id))
        }
    };
    let is_good =
        |message: &CalibrationMessage| matches!(message.calibration.state, State::Converged | State::Stored);
    let Some(message) = found.filter(is_good) else {
        say(match args.id {
            Some(id) => format!("pelical: the history has no calibration {id}: `pelical history` lists those it has"),
            None => "pelical: no converged calibration is published: see `pelical status`, or take one of `pelical history` \
                     with --id"
                .to_owned(),
        });
        return Ok(Exit::NoResult);
    };
    if message.calibration.state == State::Stored {
        say("pelical: this calibration is not verified against live lines yet");
    }
    print(&message, args)?;
    Ok(Exit::Done)
}

/// The newest calibration that is published. A daemon that hangs hands out none, which is not the same as having none.
fn published(client: &mut Client) -> Result<Option<CalibrationMessage>, CliError> {
    if client.latest_calibration()?.is_none() {
        client.status(ANSWER_WITHIN)?;
    }
    Ok(client.latest_calibration()?.cloned())
}

fn print(message: &CalibrationMessage, args: &ExportArgs) -> Result<(), CliError> {
    let placed = || Placed::of(message, args.frame).map_err(CliError::Failed);
    match args.format {
        ExportFormat::Json => output::print_json(&document(message)),
        ExportFormat::Yaml => output::print_text(&export::yaml(message)),
        ExportFormat::RosTf => output::print_text(&export::ros_tf(message, &placed()?)),
        ExportFormat::Urdf => output::print_text(&export::urdf(message, &placed()?)),
    }
}

/// The JSON document of a published calibration.
pub fn document(message: &CalibrationMessage) -> CalibrationDocument {
    let used = message.calibration.frame_sets_used as u64;
    CalibrationDocument::new(&Findings {
        cameras: &message.cameras,
        calibration: &message.calibration,
        frame_sets: FrameSets { seen: used, used, ..FrameSets::default() },
        pair_skews: &[],
        timing_ms: TimingMs::default(),
        truth: None,
        provenance: Some(ProvenanceEntry::new(message, now_ns())),
    })
}
