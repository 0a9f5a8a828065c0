//! Why the daemon did not start, or ended by itself.

use super::config::{ConfigError, RigError};
use crate::ipc::ServerError;
use crate::pipeline::StartError;

/// Every way the daemon can fail as a whole; a failing camera is none of them.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// The config file is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The config asks for cameras that cannot form a rig here.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// The instance name is taken, or shared memory is not to be had.
    #[error(transparent)]
    Server(#[from] ServerError),
    /// The pipeline has no threads.
    #[error(transparent)]
    Start(#[from] StartError),
    /// The system refused something else.
    #[error("{what}: {source}")]
    System {
        /// What was tried.
        what: &'static str,
        /// What the system said.
        source: std::io::Error,
    },
    /// A camera's driver does not come back: only the end of the process frees what it holds.
    #[error(
        "thread \"{thread}\" hangs in the driver of its camera: leaving, so that a new process can open it again \
         (cameras.recovery.leave_after_s)"
    )]
    CameraHangs {
        /// The thread.
        thread: String,
    },
    /// The pipeline failed again and again: a bug.
    #[error(
        "thread \"{thread}\" panicked again after {restarts} restarts: giving up; the log says where, please report it"
    )]
    Bug {
        /// The last thread that panicked.
        thread: String,
        /// How often the pipeline was restarted.
        restarts: u32,
    },
}
