//! The client: see `pelical --help`.

use std::process::ExitCode;

use clap::Parser;
use pelical::cli::args::{ClientArgs, Command};
use pelical::cli::exit::Exit;
use pelical::cli::talk::say;
use pelical::{cli, service};

fn main() -> ExitCode {
    let args = ClientArgs::parse();
    let exit = match &args.command {
        // The demo runs this program once more as its daemon.
        Command::DemoDaemon => match service::start_demo(args.daemon.instance) {
            Ok(()) => Exit::Done,
            Err(error) => {
                say(format_args!("pelical: {error}"));
                Exit::from(&error)
            }
        },
        command => cli::run(&args.daemon, command),
    };
    exit.into()
}
