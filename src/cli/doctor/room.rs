//! Room: shared memory for clients, and a state directory that can be written.

use std::path::{Path, PathBuf};

use super::finding::Finding;
use super::system::System;
use crate::ipc::{MIN_CLIENT_ROOM_BYTES, MIN_ROOM_BYTES, Transport};

const KIB: u64 = 1 << 10;
const MIB: u64 = 1 << 20;
/// A calibration of eight cameras is 0.3 MB as a file, and 50 are kept.
const STATE_BYTES: u64 = 16 << 20;
/// Where the installed service keeps its state.
pub const INSTALLED_STATE: &str = "/var/lib/pelical";

/// Whether the messages to clients find room: a daemon takes its own when it starts, and then a client's is needed.
pub fn shared_memory(system: &System, transport: &Transport, is_daemon_there: bool) -> Finding {
    const CHECK: &str = "shared_memory";
    let place = match transport {
        Transport::SharedMemory => Path::new("/dev/shm"),
        Transport::Files { directory } => directory,
    };
    let shown = place.display();
    if !system.exists(place) {
        let why = match transport {
            Transport::SharedMemory => (
                "no memory file system is mounted there, as in a bare container",
                "mount one: `--shm-size 256m` for a container, `mount -t tmpfs tmpfs /dev/shm` else",
            ),
            Transport::Files { .. } => (
                "the service makes it when it starts, so it does not run, or ipc.directory names another folder than the service's",
                "sudo systemctl start pelicald, or set ipc.directory to a folder that the daemon may make",
            ),
        };
        let finding = format!("{shown} is not there");
        return match transport {
            Transport::SharedMemory => Finding::problem(CHECK, finding, why),
            Transport::Files { .. } => Finding::warning(CHECK, finding, why),
        };
    }
    let Some(space) = (system.space)(&system.path(place)) else {
        let why = ("the system does not tell", "look at `df -h` yourself");
        return Finding::warning(CHECK, format!("{shown}: its free space is not known"), why);
    };
    let (who, needed) =
        if is_daemon_there { ("a client", MIN_CLIENT_ROOM_BYTES) } else { ("the daemon", MIN_ROOM_BYTES) };
    let (free, total) = (space.free / MIB, space.total / MIB);
    if space.free >= needed {
        return Finding::ok(CHECK, format!("{shown} has {free} of {total} MiB free"));
    }
    let (free, needed) = (space.free / KIB, needed / KIB);
    Finding::problem(
        CHECK,
        format!("{shown} has {free} KiB of {total} MiB free, {who} needs {needed} KiB"),
        (
            "other programs have filled it, or left files of killed processes behind",
            format!(
                "remove what nobody uses there (`ls -l {shown}`), or make it larger (`mount -o remount,size=256m`)"
            ),
        ),
    )
}

/// Whether calibrations can be kept.
pub fn state_directory(system: &System, configured: Option<&PathBuf>) -> Finding {
    const CHECK: &str = "state_directory";
    let installed = PathBuf::from(INSTALLED_STATE);
    let Some(folder) = configured.or(Some(&installed).filter(|folder| system.exists(folder))) else {
        return Finding::warning(
            CHECK,
            "calibrations are not kept",
            (
                "store.directory is null, and no service is installed whose state directory takes its place",
                "set store.directory to a folder that the daemon may write",
            ),
        );
    };
    let (shown, user) = (folder.display(), system.daemon_user());
    let Some(rights) = system.rights(folder) else {
        let why = (
            "nobody has made it yet, or the folder above it cannot be entered by you",
            format!("the daemon makes it when it may; else sudo install -d -o {} -m 0750 {shown}", user.name),
        );
        return Finding::warning(CHECK, format!("{shown} is not there"), why);
    };
    if system.may_use(&user, folder) == Some(false) {
        let why = (
            format!("it belongs to user {} and group {}, mode {:04o}", rights.uid, rights.gid, rights.mode),
            format!("sudo chown {} {shown} && sudo chmod 0750 {shown}", user.name),
        );
        return Finding::problem(CHECK, format!("{shown} cannot be written by {}", user.name), why);
    }
    match (system.space)(&system.path(folder)) {
        Some(space) if space.free < STATE_BYTES => Finding::problem(
            CHECK,
            format!("{shown} has {} MiB free", space.free / MIB),
            (
                "its file system is full: new calibrations would be lost at the next start",
                format!("make room: {} MiB are enough for the whole history", STATE_BYTES / MIB),
            ),
        ),
        Some(space) => Finding::ok(CHECK, format!("{shown} can be written, {} MiB free", space.free / MIB)),
        None => Finding::ok(CHECK, format!("{shown} can be written")),
    }
}
