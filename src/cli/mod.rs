//! The client's commands: each does one thing, prints one document, and ends with one exit code.

pub mod args;
mod calibrate;
mod devices;
mod error;
mod evaluate;
pub mod exit;
mod interrupt;
mod output;
mod progress;
mod record;

use args::Command;
use error::CliError;
use exit::Exit;

/// Runs a command to its end; what went wrong is said on stderr.
pub fn run(command: &Command) -> Exit {
    match dispatch(command) {
        Ok(exit) => exit,
        Err(error) => {
            eprintln!("pelical: {error}");
            error.exit()
        }
    }
}

fn dispatch(command: &Command) -> Result<Exit, CliError> {
    match command {
        Command::Calibrate(args) => calibrate::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Record(args) => record::run(args).map(|()| Exit::Done),
        Command::Devices(args) => devices::run(args).map(|()| Exit::Done),
        _ => Err(CliError::Failed("not yet".into())),
    }
}
