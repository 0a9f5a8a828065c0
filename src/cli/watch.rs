//! `pelical watch`: every result, every camera that was moved and, at most once a second, how collecting goes, until Ctrl-C. With
//! `--json` one document a line.

use std::time::{Duration, Instant};

use super::address::Address;
use super::args::Output;
use super::error::CliError;
use super::exit::Exit;
use super::export;
use super::interrupt::Interrupt;
use super::online::GLANCE;
use super::output::moved::MovedDocument;
use super::output::{self, status};
use super::talk::say;
use crate::ipc::CalibrationMessage;

/// Progress comes with every frame set; nobody reads 30 lines a second.
const INTERVAL: Duration = Duration::from_secs(1);

/// Prints what the daemon publishes.
///
/// # Errors
/// When there is no daemon, or it ends.
pub fn run(daemon: &Address, output: Output) -> Result<Exit, CliError> {
    let interrupt = Interrupt::register()?;
    let mut client = daemon.connect()?;
    let mut told: Option<Instant> = None;
    let mut moved = MovedDocument { schema: "", moved: Vec::new() };
    while !interrupt.is_set() {
        if let Some(message) = client.wait_calibration(GLANCE)? {
            print_calibration(&message, output)?;
        }
        if let Some(now) = client.latest_health()?.map(MovedDocument::new).filter(|now| !now.is_same(&moved))
        {
            if output.json {
                output::print_json_line(&now)?
            } else {
                output::print_text(&now.text())?
            }
            moved = now;
        }
        while let Some(progress) = client.next_progress(Duration::ZERO)? {
            if !output.json && told.is_none_or(|told| told.elapsed() >= INTERVAL) {
                told = Some(Instant::now());
                say(status::progress_line(&progress));
            }
        }
    }
    Ok(Exit::Done)
}

fn print_calibration(message: &CalibrationMessage, output: Output) -> Result<(), CliError> {
    let document = export::document(message);
    if output.json {
        return output::print_json_line(&document);
    }
    output::print_text(&format!("result {}\n{}\n", message.sequence, output::text::calibration(&document)))
}
