//! Why a command did not do what was asked, and the exit code that says so.

use super::exit::Exit;
use crate::capture::CaptureError;
use crate::ipc::ClientError;
use crate::service::config::{ConfigError, RigError};

/// Every way a command can fail.
#[derive(Debug, thiserror::Error)]
pub enum CliError {
    /// The config file is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A camera or recording is not usable.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The config asks for cameras that are not there.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// stdout or a file cannot be written, or a process not started.
    #[error("{what}: {source}")]
    System {
        /// What was tried.
        what: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The daemon is not there, or does not answer.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The input is not what it should be, told in a sentence.
    #[error("{0}")]
    BadInput(String),
    /// Anything else, told in a sentence.
    #[error("{0}")]
    Failed(String),
}

impl CliError {
    /// The exit code for scripts.
    pub fn exit(&self) -> Exit {
        match self {
            CliError::Rig(error) => Exit::from(error),
            CliError::Capture(error) => Exit::from(error),
            CliError::Config(_) => Exit::BadConfig,
            CliError::BadInput(_) => Exit::BadData,
            CliError::Client(ClientError::Wire(_) | ClientError::Failed { .. }) => Exit::Failed,
            CliError::Client(_) => Exit::NotReachable,
            CliError::System { .. } | CliError::Failed(_) => Exit::Failed,
        }
    }

    /// For `map_err`: what was tried when the system refused.
    pub fn system(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> Self {
        let what = what.into();
        move |source| Self::System { what, source }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::ipc::InstanceName;

    #[test]
    fn a_daemon_that_cannot_be_asked_is_not_reachable_whatever_the_reason() {
        let instance = InstanceName::default();
        for error in [
            ClientError::NotRunning { instance: instance.clone() },
            ClientError::NoAnswer { instance: instance.clone(), waited: Duration::ZERO },
            ClientError::Denied { instance: instance.clone() },
            ClientError::NoRoom { instance: instance.clone(), free: 0, needed: 1 },
            ClientError::TooManyClients { instance: instance.clone() },
            ClientError::OtherRelease { instance },
        ] {
            assert_eq!(CliError::from(error).exit(), Exit::NotReachable);
        }
    }
}
