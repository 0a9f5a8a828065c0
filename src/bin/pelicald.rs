//! The daemon: see `pelicald --help`.

use std::process::ExitCode;

use clap::Parser;
use pelical::cli::args::DaemonArgs;
use pelical::cli::exit::Exit;
use pelical::cli::talk::say;
use pelical::service;

fn main() -> ExitCode {
    let args = DaemonArgs::parse();
    let ended = if args.check_config { service::check(&args.config) } else { service::start(&args.config) };
    match ended {
        Ok(()) => Exit::Done.into(),
        Err(error) => {
            say(format_args!("pelicald: {error}"));
            Exit::from(&error).into()
        }
    }
}
