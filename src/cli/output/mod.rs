//! What the client prints: JSON documents for scripts, text for people. stdout is for these alone.

pub mod associations;
pub mod bench;
pub mod document;
pub mod export;
pub mod history;
pub mod intake;
pub mod matching;
pub mod matching_text;
pub mod moved;
pub mod solve;
pub mod status;
#[cfg(test)]
mod tests;
pub mod text;
pub mod time;
pub mod words;

use std::io::{self, Write};

use serde::Serialize;

use super::error::CliError;

/// Prints one JSON document.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_json(document: &impl Serialize) -> Result<(), CliError> {
    let text = serde_json::to_string_pretty(document).map_err(|error| CliError::Failed(error.to_string()))?;
    print_text(&format!("{text}\n"))
}

/// Prints one JSON document on one line.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_json_line(document: &impl Serialize) -> Result<(), CliError> {
    let text = serde_json::to_string(document).map_err(|error| CliError::Failed(error.to_string()))?;
    print_text(&format!("{text}\n"))
}

/// Prints text as it is.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_text(text: &str) -> Result<(), CliError> {
    let mut stdout = io::stdout().lock();
    let written = stdout.write_all(text.as_bytes()).and_then(|()| stdout.flush());
    written.map_err(CliError::system("cannot write to stdout"))
}
