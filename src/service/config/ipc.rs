//! The section `ipc`: through what clients reach the daemon.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::error::Refusal;
use crate::ipc::Transport;
use crate::ipc::transport::INSTALLED_DIRECTORY;

/// `ipc`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct IpcSection {
    /// What carries the messages.
    pub variant: IpcVariant,
    /// Folder of the variant `file`; who may enter it may connect.
    pub directory: PathBuf,
}

impl Default for IpcSection {
    fn default() -> Self {
        Self { variant: IpcVariant::Default, directory: INSTALLED_DIRECTORY.into() }
    }
}

/// What carries the messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IpcVariant {
    /// iceoryx2's shared memory, open to every process of the machine.
    Default,
    /// Files in a folder, open to whoever may enter it.
    File,
}

/// The transport that was chosen.
///
/// # Errors
/// Says what is wrong with the folder.
pub(super) fn transport(file: &IpcSection) -> Result<Transport, Refusal> {
    let transport = match file.variant {
        IpcVariant::Default => Transport::SharedMemory,
        IpcVariant::File => Transport::files(&file.directory),
    };
    transport.check().map_err(|what| Refusal::new("ipc.directory", what))?;
    Ok(transport)
}
