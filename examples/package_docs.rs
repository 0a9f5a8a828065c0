//! Writes what the package holds beside the programs: man pages and shell completions, made from the command lines themselves.
//!
//! `cargo run --example package_docs -- FOLDER`

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use pelical::cli::args::{ClientArgs, DaemonArgs};

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os().nth(1).context("usage: package_docs FOLDER")?;
    let folder = PathBuf::from(folder);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    man_pages(&folder, ClientArgs::command(), "1")?;
    man_pages(&folder, DaemonArgs::command(), "8")?;
    for mut command in [ClientArgs::command(), DaemonArgs::command()] {
        let name = command.get_name().to_owned();
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            clap_complete::generate_to(shell, &mut command, &name, &folder)?;
        }
    }
    Ok(())
}

/// One page for the program, and one for each of its commands that are shown.
fn man_pages(folder: &Path, command: Command, section: &str) -> anyhow::Result<()> {
    let name = command.get_name().to_owned();
    // Building hands the options of the whole program to each of its commands.
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let commands: Vec<Command> =
        command.get_subcommands().filter(|one| !one.is_hide_set()).cloned().collect();
    write_page(folder, command, &name, section)?;
    for one in commands {
        let page = format!("{name}-{}", one.get_name());
        write_page(folder, one.bin_name(page.replacen('-', " ", 1)), &page, section)?;
    }
    Ok(())
}

fn write_page(folder: &Path, command: Command, page: &str, section: &str) -> anyhow::Result<()> {
    let mut text = Vec::new();
    // clap names pages by text that lives as long as the program, which this one does.
    let name: &'static str = Box::leak(page.to_owned().into_boxed_str());
    clap_mangen::Man::new(command.name(name)).section(section).manual("PeLiCal").render(&mut text)?;
    let file = folder.join(format!("{page}.{section}"));
    fs::write(&file, text).with_context(|| file.display().to_string())
}
