//! The section `store`: where calibrations are kept, and how many.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::convert::within;
use super::error::Refusal;

/// `store`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct StoreSection {
    /// Folder for the calibrations of all instances; `null` means `$STATE_DIRECTORY`.
    pub directory: Option<PathBuf>,
    /// Calibrations that are kept.
    pub keep: u64,
}

impl Default for StoreSection {
    fn default() -> Self {
        Self { directory: None, keep: 50 }
    }
}

/// Where calibrations are kept, and how many.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoreConfig {
    /// Folder for the calibrations of all instances; `None`: they are not kept.
    pub directory: Option<PathBuf>,
    /// Calibrations that are kept.
    pub keep: usize,
}

impl TryFrom<&StoreSection> for StoreConfig {
    type Error = Refusal;

    fn try_from(file: &StoreSection) -> Result<Self, Refusal> {
        // One to serve and one to go back to at least.
        within("store.keep", file.keep as f64, (2.0, 1_000.0))?;
        if file.directory.as_ref().is_some_and(|directory| directory.as_os_str().is_empty()) {
            let what = "is empty: name a folder, or leave it null for $STATE_DIRECTORY";
            return Err(Refusal::new("store.directory", what));
        }
        Ok(Self { directory: file.directory.clone(), keep: file.keep as usize })
    }
}
