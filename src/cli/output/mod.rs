//! What the client prints: JSON documents for scripts, text for people. stdout is for these alone.

pub mod document;
pub mod text;
pub mod words;
#[cfg(test)]
mod tests;

use std::io::{self, Write};

use serde::Serialize;

/// Prints one JSON document.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_json(document: &impl Serialize) -> io::Result<()> {
    let mut stdout = io::stdout().lock();
    serde_json::to_writer_pretty(&mut stdout, document)?;
    writeln!(stdout)
}

/// Prints text as it is.
///
/// # Errors
/// When stdout cannot be written.
pub fn print_text(text: &str) -> io::Result<()> {
    io::stdout().lock().write_all(text.as_bytes())
}
