//! Writes what the package holds beside the programs: man pages and shell completions, made from the command lines themselves.
//!
//! `cargo run --example package_docs -- FOLDER`

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Command, CommandFactory};
use clap_complete::Shell;
use clap_mangen::roff::{Roff, bold, roman};
use pelical::cli::args::{ClientArgs, DaemonArgs};

/// A section that the command lines do not have: its title, and terms with what they mean.
type Section = (&'static str, &'static [(&'static str, &'static str)]);

const CLIENT_SECTIONS: [Section; 2] = [
    (
        "EXIT STATUS",
        &[
            ("0", "done"),
            ("1", "failed; the message says why"),
            ("2", "wrong command line"),
            ("3", "no daemon under this instance name, or it does not answer"),
            ("4", "no converged result"),
            ("65", "bad input data; the message names the file"),
            ("78", "bad config; the message names file, line, key and what is allowed"),
        ],
    ),
    ("ENVIRONMENT", &[("PELICAL_IPC_DIRECTORY", "folder where the daemon is looked for first")]),
];

const DAEMON_SECTIONS: [Section; 4] = [
    (
        "EXIT STATUS",
        &[
            ("0", "stopped by a signal"),
            ("1", "failed; the message says why"),
            ("2", "wrong command line"),
            ("65", "bad recording; the message names the file"),
            (
                "74",
                "a camera hangs in its driver, and a new process can open it again: start it anew, as the unit does",
            ),
            (
                "78",
                "bad config; the message names file, line, key and what is allowed. The unit does not start it again",
            ),
        ],
    ),
    (
        "SIGNALS",
        &[
            ("SIGTERM, SIGINT", "stop"),
            (
                "SIGHUP",
                "read the config file again: all of it or nothing. log.level, service.ready_when and watch.on_moved may change; of other \
                 keys the log says that they need a restart",
            ),
        ],
    ),
    (
        "ENVIRONMENT",
        &[
            (
                "STATE_DIRECTORY",
                "folder where calibrations are kept, where the config file names none (systemd sets it)",
            ),
            ("NOTIFY_SOCKET, WATCHDOG_USEC", "where systemd is told of readiness, status and progress"),
        ],
    ),
    (
        "FILES",
        &[
            ("/etc/pelical/pelicald.yaml", "the config of the installed service"),
            ("/usr/share/doc/pelical/pelicald.yaml", "every key with its default and what it does"),
            ("/var/lib/pelical", "kept calibrations of the installed service"),
            ("/run/pelical", "where its clients meet it"),
        ],
    ),
];

fn main() -> anyhow::Result<()> {
    let folder = std::env::args_os().nth(1).context("usage: package_docs FOLDER")?;
    let folder = PathBuf::from(folder);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    man_pages(&folder, ClientArgs::command(), ("1", &CLIENT_SECTIONS))?;
    man_pages(&folder, DaemonArgs::command(), ("8", &DAEMON_SECTIONS))?;
    for mut command in [ClientArgs::command(), DaemonArgs::command()] {
        let name = command.get_name().to_owned();
        for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
            clap_complete::generate_to(shell, &mut command, &name, &folder)?;
        }
    }
    Ok(())
}

/// One page for the program, and one for each of its commands that are shown.
fn man_pages(folder: &Path, command: Command, (section, more): (&str, &[Section])) -> anyhow::Result<()> {
    let name = command.get_name().to_owned();
    // Building hands the options of the whole program to each of its commands.
    let mut command = command.disable_help_subcommand(true);
    command.build();
    let commands: Vec<Command> =
        command.get_subcommands().filter(|one| !one.is_hide_set()).cloned().collect();
    write_page(folder, command, &name, (section, more))?;
    for one in commands {
        let page = format!("{name}-{}", one.get_name());
        write_page(folder, one.bin_name(page.replacen('-', " ", 1)), &page, (section, more))?;
    }
    Ok(())
}

fn write_page(
    folder: &Path,
    command: Command,
    page: &str,
    (section, more): (&str, &[Section]),
) -> anyhow::Result<()> {
    let mut text = Vec::new();
    // clap names pages by text that lives as long as the program, which this one does.
    let name: &'static str = Box::leak(page.to_owned().into_boxed_str());
    clap_mangen::Man::new(command.name(name)).section(section).manual("PeLiCal").render(&mut text)?;
    for (title, terms) in more {
        let mut part = Roff::new();
        part.control("SH", [*title]);
        for (term, meaning) in *terms {
            part.control("TP", []).text([bold(*term)]).text([roman(*meaning)]);
        }
        part.to_writer(&mut text)?;
    }
    let file = folder.join(format!("{page}.{section}"));
    fs::write(&file, text).with_context(|| file.display().to_string())
}
