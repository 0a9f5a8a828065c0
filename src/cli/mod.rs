//! The client's commands: each does one thing, prints one document, and ends with one exit code.

mod address;
pub mod args;
pub mod association_choice;
mod associations;
mod bench;
mod calibrate;
mod canvas;
mod demo;
mod devices;
mod doctor;
mod error;
mod evaluate;
pub mod exit;
mod export;
mod gate;
mod history;
mod interrupt;
mod matching;
mod online;
mod output;
mod pairs_file;
mod paper;
mod progress;
mod record;
mod replay;
mod solve;
pub mod talk;
mod watch;

pub use address::Address;
use args::Command;
use error::CliError;
use exit::Exit;

/// Runs a command to its end; what went wrong is said on stderr.
pub fn run(daemon: &Address, command: &Command) -> Exit {
    match dispatch(daemon, command) {
        Ok(exit) => exit,
        Err(error) => {
            talk::say(format_args!("pelical: {error}"));
            error.exit()
        }
    }
}

fn dispatch(daemon: &Address, command: &Command) -> Result<Exit, CliError> {
    match command {
        Command::Calibrate(args) => calibrate::run(args),
        Command::Evaluate(args) => evaluate::run(args),
        Command::Solve(args) => solve::run(args),
        Command::Match(args) => matching::run(args).map(|()| Exit::Done),
        Command::Bench(args) => bench::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Record(args) => record::run(args).map(|()| Exit::Done),
        Command::Devices(args) => devices::run(args).map(|()| Exit::Done),
        Command::Doctor(args) => doctor::run(daemon, args),
        Command::Status(output) => online::status(daemon, *output),
        Command::Watch(output) => watch::run(daemon, *output),
        Command::Recalibrate(args) => online::recalibrate(daemon, args),
        Command::Cancel(output) => online::cancel(daemon, *output),
        Command::History(output) => history::list(daemon, *output),
        Command::Rollback(args) => history::roll_back(daemon, args),
        Command::Export(args) => export::run(daemon, args),
        Command::Demo(output) => demo::run(*output),
        // Belongs to the program, not to the client: see src/bin/pelical.rs.
        Command::DemoDaemon => Err(CliError::Failed("this is no command of the client".to_owned())),
    }
}
