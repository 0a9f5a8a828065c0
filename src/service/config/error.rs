//! What can be wrong with a config file; every message says file, line, key and what is allowed.

use std::path::PathBuf;

/// Why a config file was refused. All of them are for the user to fix; the process ends with exit code 78.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The operating system refused the file, or it is not text.
    #[error("{file}: cannot read the configuration: {source}")]
    Read {
        /// The config file.
        file: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The text is not the YAML that is expected: syntax, an unknown key, a wrong type.
    #[error("{file}:{line}: {what}")]
    Text {
        /// The config file.
        file: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong, with the key.
        what: String,
    },
    /// A value is outside what is allowed.
    #[error("{file}:{line}: {key}: {what}")]
    Value {
        /// The config file.
        file: PathBuf,
        /// Counted from 1.
        line: usize,
        /// Dotted path, as in `cameras.list[0].serial`.
        key: String,
        /// What is wrong and what is allowed.
        what: String,
    },
}

/// A value that was refused, before its place in the file is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Refusal {
    /// Dotted path, as in `cameras.list[0].serial`.
    pub key: String,
    /// What is wrong and what is allowed.
    pub what: String,
}

impl Refusal {
    /// The refusal of `key`.
    pub fn new(key: impl Into<String>, what: impl Into<String>) -> Self {
        Self { key: key.into(), what: what.into() }
    }
}
