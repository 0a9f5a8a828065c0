//! The daemon: see `pelicald --help`.

use std::process::ExitCode;

use clap::Parser;
use pelical::cli::args::DaemonArgs;
use pelical::cli::exit::Exit;
use pelical::cli::talk::say;
use pelical::service::{self, ServiceError};

fn main() -> ExitCode {
    let args = DaemonArgs::parse();
    if args.check_config {
        return exit(service::check(&args.config)).into();
    }
    // A camera's thread may be left behind in its driver.
    exit(service::start(&args.config)).leave()
}

fn exit(ended: Result<(), ServiceError>) -> Exit {
    match ended {
        Ok(()) => Exit::Done,
        Err(error) => {
            say(format_args!("pelicald: {error}"));
            Exit::from(&error)
        }
    }
}
