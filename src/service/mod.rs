//! The daemon's life: configuration, log, state, and the run from start to a clean stop.

mod apart;
pub mod config;
mod daemon;
mod error;
pub mod logging;
mod manager;
mod plumb;
mod reload;
mod rig;
mod state;
mod stop;
mod storing;
mod supervisor;
mod telling;

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};

pub use daemon::run;
pub use error::ServiceError;
pub use stop::Stop;

use crate::ipc::InstanceName;
use config::{Config, LogLevel};
use logging::LogHandle;
use manager::ServiceManager;
use reload::Reloader;

/// What a daemon is tied to besides its config; nothing, where it runs within another program.
#[derive(Debug, Default)]
struct Attachments {
    /// Who started it.
    manager: ServiceManager,
    /// The config file, to be read again when asked to, and the log whose level it says.
    reloader: Option<(Reloader, LogHandle)>,
}

/// Runs the daemon of a config file until a signal asks it to stop.
///
/// # Errors
/// When the config is wrong, the daemon cannot start, or it gives up.
pub fn start(file: &Path) -> Result<(), ServiceError> {
    let (sections, mut config) = config::load(file)?;
    if config.store.directory.is_none() {
        config.store.directory = state_directory(std::env::var_os("STATE_DIRECTORY"));
    }
    let reloader = Reloader::on_signal(file, sections)?;
    run_process(&config, Some(reloader))
}

/// The folder that systemd has made for this service; the first where it has made several.
fn state_directory(variable: Option<OsString>) -> Option<PathBuf> {
    let directories = variable?;
    let first = std::env::split_paths(&directories).next()?;
    first.is_absolute().then_some(first)
}

/// Runs the daemon of the demo under the given name; it ends with the process that started it.
///
/// # Errors
/// As [`start`].
pub fn start_demo(instance: InstanceName) -> Result<(), ServiceError> {
    let mut config = config::demo()?;
    config.instance = instance;
    // The terminal belongs to the demo's progress.
    config.log.level = LogLevel::Warn;
    let system = |error: rustix::io::Errno| ServiceError::System {
        what: "cannot tie the demo's daemon to its client",
        source: error.into(),
    };
    rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::TERM)).map_err(system)?;
    run_process(&config, None)
}

fn run_process(config: &Config, reloader: Option<Reloader>) -> Result<(), ServiceError> {
    let log = logging::start(&config.log);
    log_panics();
    let stop = Stop::on_signals()?;
    let reloader = reloader.map(|reloader| (reloader, log));
    daemon::run_attached(config, &stop, Attachments { manager: ServiceManager::from_environment(), reloader })
}

/// A panic is a bug; it shall stand in the log wherever that goes, not only on stderr.
fn log_panics() {
    std::panic::set_hook(Box::new(|panic| {
        let thread = std::thread::current().name().unwrap_or("?").to_owned();
        tracing::error!(thread, "{panic}");
    }));
}

/// Prints the effective values of a config file as YAML on stdout.
///
/// # Errors
/// When the config is wrong, or stdout cannot be written.
pub fn check(file: &Path) -> Result<(), ServiceError> {
    let (sections, _) = config::load(file)?;
    let system = |source| ServiceError::System { what: "cannot write to stdout", source };
    let text = serde_yaml::to_string(&sections).map_err(|error| system(std::io::Error::other(error)))?;
    std::io::stdout().lock().write_all(text.as_bytes()).map_err(system)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_the_state_directories_the_first_is_taken_and_a_relative_one_is_none() {
        let taken = |text: &str| state_directory(Some(OsString::from(text)));
        assert_eq!(taken("/var/lib/pelical"), Some(PathBuf::from("/var/lib/pelical")));
        assert_eq!(taken("/var/lib/a:/var/lib/b"), Some(PathBuf::from("/var/lib/a")));
        assert_eq!((taken(""), taken("pelical"), state_directory(None)), (None, None, None));
    }
}
