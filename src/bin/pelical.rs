//! The client: see `pelical --help`.

use std::process::ExitCode;

use clap::Parser;
use pelical::cli;
use pelical::cli::args::ClientArgs;

fn main() -> ExitCode {
    let args = ClientArgs::parse();
    cli::run(&args.command).into()
}
