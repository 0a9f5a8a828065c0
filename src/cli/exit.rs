//! Exit codes of both programs; a contract with scripts.

use std::process::ExitCode;

use crate::capture::CaptureError;
use crate::service::ServiceError;
use crate::service::config::RigError;

/// How a program ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// It did what was asked.
    Done = 0,
    /// It did not.
    Failed = 1,
    /// The command line is wrong; the parser of the command line ends the program with it.
    Usage = 2,
    /// There is no daemon under this instance name, or it does not answer or admit this client.
    NotReachable = 3,
    /// There is no converged result.
    NoResult = 4,
    /// The input data is not what its layout promises.
    BadData = 65,
    /// A camera hangs in its driver; a new process can open it again.
    CameraHangs = 74,
    /// The config file is wrong.
    BadConfig = 78,
}

impl Exit {
    /// Ends the process now, without its destructors of static objects: a thread that hangs in a camera's driver would keep those of
    /// the driver from their end, and with them the exit code from whoever waits for it. Nothing of ours is left to be written then.
    pub fn leave(self) -> ! {
        signal_hook::low_level::exit(self as i32)
    }
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        ExitCode::from(exit as u8)
    }
}

impl From<&CaptureError> for Exit {
    fn from(error: &CaptureError) -> Self {
        match error {
            CaptureError::BadData { .. } => Exit::BadData,
            _ => Exit::Failed,
        }
    }
}

impl From<&RigError> for Exit {
    fn from(error: &RigError) -> Self {
        match error {
            RigError::Capture(error) => Exit::from(error),
            RigError::NoCamera { .. } => Exit::Failed,
            RigError::Reference { .. } | RigError::TooLong { .. } | RigError::OneCamera { .. } => {
                Exit::BadConfig
            }
        }
    }
}

impl From<&ServiceError> for Exit {
    fn from(error: &ServiceError) -> Self {
        match error {
            ServiceError::Config(_) => Exit::BadConfig,
            ServiceError::Rig(error) => Exit::from(error),
            ServiceError::CameraHangs { .. } => Exit::CameraHangs,
            ServiceError::Server(_)
            | ServiceError::Start(_)
            | ServiceError::System { .. }
            | ServiceError::Bug { .. } => Exit::Failed,
        }
    }
}
