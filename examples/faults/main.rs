//! The fault campaign: the real daemon with mock cameras suffers one fault after the other, is watched through the real client, and
//! the table of what was expected and seen is written as docs/faults.md.
//!
//! `cargo build --release && cargo run --release --example faults -- [--kills 200] [--minutes 0] [--output docs/faults.md]`. Everything
//! happens in a temporary folder with instances of its own. The same seed gives the same recording, faults and moments.

mod audit;
mod cameras;
mod clients;
mod clock;
mod daemon;
mod disk;
mod driver;
mod kills;
mod memory;
mod private;
mod random;
mod rig;
mod row;
mod rows;
mod site;
mod soak;
mod table;

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::Parser;
use pelical::ipc::{InstanceName, Transport};

use crate::site::Site;
use crate::table::{Row, markdown};

/// What the campaign does.
#[derive(Parser)]
pub struct Arguments {
    /// Seed of the recording, the faults and the moments.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// How often the daemon is killed with SIGKILL, half of the times over files, half over shared memory.
    #[arg(long, default_value_t = 200)]
    pub kills: u32,
    /// Length of the soak with random faults, minutes; 0: none.
    #[arg(long, default_value_t = 0.0)]
    pub minutes: f64,
    /// Only rows whose name has this in it; may be given several times.
    #[arg(long)]
    pub only: Vec<String>,
    /// Where the table goes; without it, to stdout.
    #[arg(long)]
    pub output: Option<PathBuf>,
    /// Folder of pelicald and pelical; without it, that of this program's build.
    #[arg(long)]
    pub programs: Option<PathBuf>,
    /// A client that asks until it is killed; the campaign starts it.
    #[arg(long, hide = true)]
    pub ask_for_ever: Option<InstanceName>,
    /// Where that client finds the daemon.
    #[arg(long, hide = true)]
    pub ipc_directory: Option<PathBuf>,
}

fn main() -> Result<ExitCode> {
    let arguments = Arguments::parse();
    if let Some(instance) = &arguments.ask_for_ever {
        let transport = arguments.ipc_directory.as_ref().map_or(Transport::SharedMemory, Transport::files);
        clients::ask_for_ever(instance, &transport)?;
    }
    let programs = match &arguments.programs {
        Some(programs) => programs.clone(),
        None => built_programs()?,
    };
    let site = Site::new(programs, arguments.seed)?;
    let rows = rows::run(&site, &arguments);
    let text = page(&arguments, &rows);
    match &arguments.output {
        Some(path) => std::fs::write(path, text).with_context(|| path.display().to_string())?,
        None => print!("{text}"),
    }
    let failed = rows.iter().filter(|row| row.verdict() == "FAILED").count();
    eprintln!("{} rows, {failed} failed", rows.len());
    Ok(if failed == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// `target/release` of `target/release/examples/faults`.
fn built_programs() -> Result<PathBuf> {
    let this = std::env::current_exe()?;
    let folder = this.parent().and_then(|examples| examples.parent()).context("an example in its folder")?;
    anyhow::ensure!(
        folder.join("pelicald").exists(),
        "{}: run `cargo build --release` first",
        folder.display()
    );
    Ok(folder.to_owned())
}

fn page(arguments: &Arguments, rows: &[Row]) -> String {
    let minutes =
        if arguments.minutes > 0.0 { format!(" --minutes {}", arguments.minutes) } else { String::new() };
    format!(
        include_str!("page.md"),
        version = env!("CARGO_PKG_VERSION"),
        seed = arguments.seed,
        kills = arguments.kills,
        minutes = minutes,
        table = markdown(rows)
    )
}
