//! The config, the cameras its back end lists, and the daemon: is there one, and what does it say?

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::finding::Finding;
use super::system::System;
use crate::capture::realsense;
use crate::capture::{CameraInfo, CaptureError};
use crate::cli::address::Address;
use crate::cli::online::ANSWER_WITHIN;
use crate::ipc::{ClientError, InstanceName, Response, Snapshot, Transport};
use crate::service::config::{self, BackendConfig, CamerasConfig, Config, ConfigError, INSTALLED_CONFIG};

/// Reads the config that was named, else that of the installed service, else the defaults; the defaults too where it is wrong.
///
/// # Errors
/// Never, unless the defaults were broken before this program was built.
pub fn config(system: &System, named: Option<&Path>) -> Result<(Config, Finding), ConfigError> {
    const CHECK: &str = "config";
    let installed = || Some(PathBuf::from(INSTALLED_CONFIG)).filter(|file| system.exists(file));
    let file = named.map(Path::to_owned).or_else(|| installed().map(|file| system.path(file)));
    let Some(file) = file else {
        let finding = Finding::ok(CHECK, format!("no {INSTALLED_CONFIG}: the defaults are looked at"));
        return Ok((config::load_or_default(None)?, finding));
    };
    match config::load(&file) {
        Ok((_, config)) => Ok((config, Finding::ok(CHECK, format!("{} is valid", file.display())))),
        Err(error) => {
            let why = (error.to_string(), cure_of_config(&error));
            let finding = format!("{} cannot be used; the rest is judged by the defaults", file.display());
            Ok((config::load_or_default(None)?, Finding::problem(CHECK, finding, why)))
        }
    }
}

fn cure_of_config(error: &ConfigError) -> String {
    match error {
        ConfigError::Read { file, source } => match source.kind() {
            ErrorKind::NotFound | ErrorKind::NotADirectory => {
                "name a file that is there with --config, or write one: `{}` in it means every default".to_owned()
            }
            ErrorKind::PermissionDenied => format!("sudo chmod a+r {}, or ask with sudo", file.display()),
            ErrorKind::InvalidData => "save it as text in UTF-8".to_owned(),
            _ => "name a text file that can be read with --config".to_owned(),
        },
        ConfigError::Value { key, .. } if key == "cameras.backend" && !realsense::IS_BUILT_IN => {
            "build it with them as docs/realsense.md says, or set cameras.backend to replay or synthetic".to_owned()
        }
        ConfigError::Text { .. } | ConfigError::Value { .. } => {
            "correct that line; config/pelicald.yaml (/usr/share/doc/pelical) shows every key with what is allowed".to_owned()
        }
    }
}

/// Whether the back end is the one for RealSense cameras.
pub fn needs_realsense(cameras: &CamerasConfig) -> bool {
    match &cameras.backend {
        BackendConfig::Realsense(options) => options.playback.is_empty(),
        BackendConfig::Replay(..) | BackendConfig::Synthetic(_) => false,
    }
}

/// Whether the back end has the cameras of the rig.
pub fn back_end(cameras: &CamerasConfig) -> Finding {
    const CHECK: &str = "devices";
    // Planning its path takes seconds, which the names of its cameras do not need.
    let listed: Result<(&'static str, Vec<CameraInfo>), CaptureError> = match &cameras.backend {
        BackendConfig::Synthetic(options) => {
            Ok(("synthetic", options.cameras.iter().map(|camera| camera.info.clone()).collect()))
        }
        _ => cameras.factory().and_then(|factory| Ok((factory.name(), factory.list()?))),
    };
    let (name, listed) = match listed {
        Ok(listed) => listed,
        Err(error) => {
            let why = (error.to_string(), cure_of_back_end(&cameras.backend));
            return Finding::problem(CHECK, "the back end of the config cannot be used", why);
        }
    };
    let missing: Vec<String> = cameras
        .list
        .iter()
        .filter(|choice| listed.iter().all(|info| info.serial != choice.serial))
        .map(|choice| format!("{} ({})", choice.name, choice.serial))
        .collect();
    let serials: Vec<&str> = listed.iter().map(|info| info.serial.as_str()).collect();
    let there = if serials.is_empty() { "none".to_owned() } else { serials.join(", ") };
    if !missing.is_empty() {
        let why = (
            format!(
                "cameras.list names serial numbers that the back end {name} does not have; it has {there}"
            ),
            "plug them in, or correct the serial numbers (`pelical devices`, with the same --config, shows them)",
        );
        return Finding::problem(CHECK, format!("not there: {}", missing.join(", ")), why);
    }
    if listed.len() < 2 {
        let why = ("a rig has at least two cameras", "plug in the others");
        return Finding::problem(CHECK, format!("the back end {name} has {} cameras", listed.len()), why);
    }
    Finding::ok(CHECK, format!("the back end {name} has {there}"))
}

fn cure_of_back_end(back_end: &BackendConfig) -> &'static str {
    match back_end {
        BackendConfig::Replay(..) => {
            "name a recording that can be read in cameras.replay.recording, or set another cameras.backend"
        }
        BackendConfig::Synthetic(_) => "correct cameras.synthetic",
        BackendConfig::Realsense(_) => {
            "see what the checks `versions` and `permissions` say, and docs/realsense.md"
        }
    }
}

/// Where the daemon of a config is, unless the command line says so itself.
pub fn address_of(address: &Address, config: &Config) -> Address {
    let is_named = address.instance != InstanceName::default();
    let of_config = match &config.transport {
        Transport::Files { directory } => Some(directory.clone()),
        Transport::SharedMemory => None,
    };
    Address {
        instance: if is_named { address.instance.clone() } else { config.instance.clone() },
        ipc_directory: address.ipc_directory.clone().or(of_config),
    }
}

/// Asks the daemon how it is.
///
/// # Errors
/// When it is not there, does not let this user in, or does not answer.
pub fn ask(address: &Address) -> Result<Response, ClientError> {
    address.connect().and_then(|mut client| client.status(ANSWER_WITHIN))
}

/// Whether there is a daemon, whatever it answered.
pub fn is_there(answered: &Result<Response, ClientError>) -> bool {
    !matches!(answered, Err(ClientError::NotRunning { .. }))
}

/// Whether the daemon answers, and what it is at.
pub fn daemon(
    instance: &InstanceName,
    answered: &Result<Response, ClientError>,
    is_installed: bool,
) -> Finding {
    const CHECK: &str = "daemon";
    let cause = match answered {
        Ok(response) => return answering(CHECK, &response.snapshot),
        Err(error) => error,
    };
    let what = format!("the daemon '{instance}' does not answer");
    let why = |cure: &str| (cause.to_string(), cure.to_owned());
    match cause {
        ClientError::NotRunning { .. } if !is_installed => Finding::warning(
            CHECK,
            what,
            why("pelicald --config FILE, or install the package; `pelical demo` tries it out"),
        ),
        ClientError::NotRunning { .. } => Finding::problem(
            CHECK,
            what,
            why("sudo systemctl start pelicald; see what the check `unit` says"),
        ),
        ClientError::Denied { .. } => Finding::problem(CHECK, what, why("see what the check `group` says")),
        ClientError::NoRoom { .. } => {
            Finding::problem(CHECK, what, why("see what the check `shared_memory` says"))
        }
        ClientError::TooManyClients { .. } => {
            Finding::problem(CHECK, what, why("end a program that is connected, such as a `pelical watch`"))
        }
        _ => Finding::problem(CHECK, what, why("sudo systemctl restart pelicald")),
    }
}

fn answering(check: &'static str, daemon: &Snapshot) -> Finding {
    let found = format!(
        "{}, {}; {} of {} cameras stream",
        daemon.activity.name(),
        daemon.state.name(),
        daemon.cameras_streaming,
        daemon.cameras
    );
    if let Some(fault) = &daemon.store_fault {
        let why = (fault.clone(), "see what the check `state_directory` says");
        return Finding::problem(check, format!("{found}; calibrations are not kept"), why);
    }
    if daemon.cameras_streaming < daemon.cameras {
        let why =
            ("a camera is not plugged in, stalled or failed", "`pelical status` says which one and why");
        return Finding::warning(check, found, why);
    }
    Finding::ok(check, found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_daemon_of_the_config_is_asked_unless_the_command_line_names_one() {
        let mut config = config::load_or_default(None).expect("the defaults");
        config.instance = "rig2".parse().expect("a name");
        config.transport = Transport::files("/run/rig2");
        let named = |instance: &str, directory: Option<&str>| {
            let address = Address {
                instance: instance.parse().expect("a name"),
                ipc_directory: directory.map(PathBuf::from),
            };
            let found = address_of(&address, &config);
            (found.instance.to_string(), found.ipc_directory)
        };
        let default = InstanceName::default().to_string();
        assert_eq!(named(&default, None), ("rig2".to_owned(), Some("/run/rig2".into())));
        assert_eq!(named("rig3", Some("/run/x")), ("rig3".to_owned(), Some("/run/x".into())));
        config.transport = Transport::SharedMemory;
        let found = address_of(&Address { instance: InstanceName::default(), ipc_directory: None }, &config);
        assert_eq!(found.ipc_directory, None);
    }
}
