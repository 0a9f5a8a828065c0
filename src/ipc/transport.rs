//! Through what daemon and clients of one machine meet: iceoryx2's shared memory, or files in a folder whose permissions decide
//! who may connect.
//!
//! Both have the same layout and the same speed; the files live in a memory file system such as `/run`. Where nobody says which,
//! clients look in the places that [`Transport::candidates`] lists.

use std::fs;
use std::io::ErrorKind;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};

use iceoryx2::prelude::{Config, SemanticString};
use rustix::fs::Access;
use rustix::io::Errno;

use super::services::Failure;

/// Where the installed service keeps the files of its clients: made by its unit.
pub const INSTALLED_DIRECTORY: &str = "/run/pelical";
/// Names the folder for every client that is not told otherwise.
pub const DIRECTORY_VARIABLE: &str = "PELICAL_IPC_DIRECTORY";
/// Inside the folder, because its own permissions are those of its maker.
const ROOT: &str = "ipc";
/// Longer ones leave no room for the names of sockets, which end at 107 bytes.
pub const MAX_DIRECTORY_BYTES: usize = 48;
/// What a daemon and a few clients need (26 MB, half of it for answers with older calibrations), with some to spare.
pub const MIN_ROOM_BYTES: u64 = 32 << 20;
/// What a client needs (50 kB), with some to spare.
pub const MIN_CLIENT_ROOM_BYTES: u64 = 256 << 10;

/// Through what daemon and clients meet.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum Transport {
    /// iceoryx2's own shared memory (`/dev/shm` and `/tmp/iceoryx2`): open to every process of the machine.
    #[default]
    SharedMemory,
    /// Files and sockets below a folder: open to whoever may enter that folder.
    Files {
        /// The folder, absolute.
        directory: PathBuf,
    },
}

impl Transport {
    /// Files below a folder.
    pub fn files(directory: impl Into<PathBuf>) -> Self {
        Self::Files { directory: directory.into() }
    }

    /// Where a client looks that was told no transport: in the folder of the environment variable `PELICAL_IPC_DIRECTORY`, else in
    /// that of the installed service if there is one, and then in shared memory.
    pub fn candidates() -> Vec<Self> {
        match std::env::var_os(DIRECTORY_VARIABLE) {
            Some(directory) if !directory.is_empty() => vec![Self::files(directory)],
            _ if Path::new(INSTALLED_DIRECTORY).is_dir() => {
                vec![Self::files(INSTALLED_DIRECTORY), Self::SharedMemory]
            }
            _ => vec![Self::SharedMemory],
        }
    }

    /// Whether the folder of the files can be used at all; shared memory always can.
    ///
    /// # Errors
    /// Says what is allowed instead.
    pub fn check(&self) -> Result<(), String> {
        let Self::Files { directory } = self else { return Ok(()) };
        let bytes = directory.as_os_str().len();
        if !directory.is_absolute() || bytes > MAX_DIRECTORY_BYTES || directory.to_str().is_none() {
            let (directory, default) = (directory.display(), INSTALLED_DIRECTORY);
            return Err(format!(
                "{directory}: allowed is an absolute path of at most {MAX_DIRECTORY_BYTES} bytes, such as {default}"
            ));
        }
        Ok(())
    }

    /// iceoryx2's configuration: its defaults, whatever files lie in the working directory, and our root.
    pub(super) fn config(&self) -> Result<Config, Failure> {
        let mut config = Config::default();
        if let Self::Files { directory } = self {
            self.check().map_err(Failure::Other)?;
            let root = directory.join(ROOT);
            let root = iceoryx2::prelude::Path::new(root.as_os_str().as_encoded_bytes());
            config.global.set_root_path(&root.map_err(|error| Failure::Other(format!("{error:?}")))?);
        }
        Ok(config)
    }

    /// The daemon's side: makes the folders.
    pub(super) fn prepare(&self) -> Result<(), Failure> {
        let place = self.place();
        if *self == Self::SharedMemory && enter(&shared_root()) == Err(Failure::Denied) {
            return Err(Failure::Denied);
        }
        if let Self::Files { directory } = self {
            self.check().map_err(Failure::Other)?;
            let refused = |error: std::io::Error| Failure::Folder {
                folder: directory.clone(),
                detail: error.to_string(),
            };
            fs::DirBuilder::new().recursive(true).mode(0o750).create(directory).map_err(refused)?;
            match fs::create_dir(&place) {
                // Whoever may enter the folder above makes files here; the umask has no say in that.
                Ok(()) => fs::set_permissions(&place, fs::Permissions::from_mode(0o777)).map_err(refused)?,
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                Err(error) => return Err(refused(error)),
            }
        }
        Ok(())
    }

    /// Where the memory lies that is shared.
    pub(super) fn place(&self) -> PathBuf {
        match self {
            Self::SharedMemory => PathBuf::from("/dev/shm"),
            Self::Files { directory } => directory.join(ROOT),
        }
    }

    /// The client's side: makes nothing, and tells a missing daemon from a closed door.
    pub(super) fn look(&self) -> Result<(), Failure> {
        match self {
            // Looking there through iceoryx2 would make what it never removes again.
            Self::SharedMemory => enter(&shared_root())?,
            Self::Files { directory } => {
                self.check().map_err(Failure::Other)?;
                fs::read_dir(self.place()).map_err(|error| match error.kind() {
                    ErrorKind::NotFound => Failure::Missing,
                    _ => failure(&error, directory),
                })?;
            }
        }
        Ok(())
    }
}

/// Where iceoryx2 keeps the names of its own shared memory, and sockets.
fn shared_root() -> PathBuf {
    Config::default().global.root_path().to_string().into()
}

/// Whether this user may make files in a folder; iceoryx2 would only call it an internal error.
fn enter(folder: &Path) -> Result<(), Failure> {
    match rustix::fs::access(folder, Access::READ_OK | Access::WRITE_OK | Access::EXEC_OK) {
        Err(Errno::NOENT) => Err(Failure::Missing),
        Err(Errno::ACCESS) => Err(Failure::Denied),
        _ => Ok(()),
    }
}

fn failure(error: &std::io::Error, directory: &Path) -> Failure {
    match error.kind() {
        ErrorKind::PermissionDenied => Failure::Denied,
        _ => Failure::Other(format!("{}: {error}", directory.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_that_leaves_no_room_for_sockets_or_depends_on_where_one_stands_is_refused() {
        let long = format!("/{}", "x".repeat(MAX_DIRECTORY_BYTES));
        for bad in ["relative", "", long.as_str()] {
            let said = Transport::files(bad).check().expect_err(bad);
            assert!(said.contains("absolute path"), "{said}");
        }
        assert_eq!(Transport::files(INSTALLED_DIRECTORY).check(), Ok(()));
        assert_eq!(Transport::SharedMemory.check(), Ok(()));
    }

    #[test]
    fn a_client_makes_nothing_where_no_daemon_was() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let transport = Transport::files(folder.path());
        assert_eq!(transport.look(), Err(Failure::Missing));
        assert_eq!(fs::read_dir(folder.path()).expect("readable").count(), 0);
        transport.prepare().expect("the daemon makes it");
        assert_eq!(transport.look(), Ok(()));
    }

    #[test]
    fn a_folder_of_another_user_is_a_closed_door_and_none_is_an_empty_house() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(enter(folder.path()), Ok(()));
        assert_eq!(enter(&folder.path().join("none")), Err(Failure::Missing));
        fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o500)).expect("set");
        let is_root = rustix::process::geteuid().is_root();
        assert_eq!(enter(folder.path()), if is_root { Ok(()) } else { Err(Failure::Denied) });
    }

    #[test]
    fn a_daemon_without_room_for_its_folder_is_told_why() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("file");
        fs::write(&file, "no folder").expect("written");
        let refused = Transport::files(file.join("x")).prepare();
        assert!(
            matches!(&refused, Err(Failure::Folder { folder, .. }) if *folder == file.join("x")),
            "{refused:?}"
        );
    }
}
