//! Which daemon a command talks to, and the way there.

use std::path::PathBuf;

use clap::Args;

use crate::ipc::{Client, ClientError, InstanceName, Transport};

/// Which daemon, and where it is.
#[derive(Debug, Clone, Args)]
pub struct Address {
    /// Name of the daemon to talk to.
    #[arg(long, global = true, default_value_t, value_name = "NAME")]
    pub instance: InstanceName,
    /// Folder of the daemon's files (`ipc.directory` of its config); without it, where PELICAL_IPC_DIRECTORY says, else the
    /// installed service's folder, then shared memory.
    #[arg(long, global = true, value_name = "DIR", value_parser = directory)]
    pub ipc_directory: Option<PathBuf>,
}

fn directory(text: &str) -> Result<PathBuf, String> {
    Transport::files(text).check().map(|()| text.into())
}

impl Address {
    /// Joins the daemon.
    ///
    /// # Errors
    /// When it is not there, or does not let this user in.
    pub fn connect(&self) -> Result<Client, ClientError> {
        match &self.ipc_directory {
            Some(directory) => Client::connect_over(&Transport::files(directory), &self.instance),
            None => Client::connect(&self.instance),
        }
    }
}
