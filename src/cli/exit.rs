//! Exit codes of both programs; a contract with scripts.

use std::process::ExitCode;

/// How a program ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum Exit {
    /// It did what was asked.
    Done = 0,
    /// It did not.
    Failed = 1,
    /// The command line is wrong.
    Usage = 2,
    /// There is no daemon under this instance name.
    NotReachable = 3,
    /// There is no converged result.
    NoResult = 4,
    /// The input data is not what its layout promises.
    BadData = 65,
    /// The config file is wrong.
    BadConfig = 78,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        ExitCode::from(exit as u8)
    }
}
