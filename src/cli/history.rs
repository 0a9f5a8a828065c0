//! `pelical history`, `pelical rollback ID`: the calibrations that a daemon has kept. They come over shared memory; nobody but the
//! daemon reads its files.

use super::address::Address;
use super::args::{Output, RollbackArgs};
use super::error::CliError;
use super::exit::Exit;
use super::online::{ANSWER_WITHIN, print_answer};
use super::output;
use super::output::history::HistoryDocument;
use super::output::time::now_ns;
use crate::ipc::{Archived, CalibrationMessage, Client};

/// Prints the history, newest first.
///
/// # Errors
/// When there is no daemon, or it keeps none.
pub fn list(daemon: &Address, output: Output) -> Result<Exit, CliError> {
    let mut client = daemon.connect()?;
    let snapshot = client.status(ANSWER_WITHIN)?.snapshot;
    let mut messages: Vec<CalibrationMessage> = Vec::new();
    let mut below = u64::MAX;
    while let Some(message) = below_id(&mut client, below)? {
        // Each is older than the one before: the client refuses anything else.
        below = message.provenance.id.unwrap_or(0);
        messages.push(message);
    }
    let document = HistoryDocument::new(&daemon.instance, &messages, (&snapshot, now_ns()));
    if output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&document.text())?;
    }
    Ok(Exit::Done)
}

/// The newest kept calibration with a smaller number.
///
/// # Errors
/// When there is no daemon, or it keeps none.
pub fn below_id(client: &mut Client, below: u64) -> Result<Option<CalibrationMessage>, CliError> {
    match client.archived_below(below, ANSWER_WITHIN)? {
        Archived::Found(message) => Ok(Some(*message)),
        Archived::NoOlder => Ok(None),
        Archived::NotKept { sentence } => Err(CliError::Failed(sentence)),
    }
}

/// Asks the daemon to go back to an older calibration.
///
/// # Errors
/// When there is no daemon.
pub fn roll_back(daemon: &Address, args: &RollbackArgs) -> Result<Exit, CliError> {
    let response = daemon.connect()?.rollback(args.id, ANSWER_WITHIN)?;
    print_answer(&response, args.output)
}
