//! Memory for everything this process shares, taken before it is needed: a write into a full memory file system does not fail, the
//! system kills the writer (SIGBUS).

use std::fs::{self, OpenOptions};
use std::path::Path;

use rustix::fs::{FallocateFlags, fallocate};
use rustix::io::Errno;

use super::services::Failure;

/// Takes the memory of every file below `place` that this process has mapped. Where a file system or a sandbox does not let it, nothing
/// is said: it is then taken when it is written.
pub(super) fn take(place: &Path) -> Result<(), Failure> {
    let Ok(maps) = fs::read_to_string("/proc/self/maps") else { return Ok(()) };
    for path in maps.lines().filter_map(mapped_file).filter(|path| path.starts_with(place)) {
        let Ok(file) = OpenOptions::new().read(true).write(true).open(path) else { continue };
        let Ok(found) = file.metadata() else { continue };
        if fallocate(&file, FallocateFlags::empty(), 0, found.len()) == Err(Errno::NOSPC) {
            return Err(Failure::NoRoom { free: free_bytes(place).unwrap_or(0), needed: found.len() });
        }
    }
    Ok(())
}

/// Whether so much is left where a folder lies. Where this cannot be found out, nothing is said.
pub(super) fn check(place: &Path, needed: u64) -> Result<(), Failure> {
    match free_bytes(place) {
        Some(free) if free < needed => Err(Failure::NoRoom { free, needed }),
        _ => Ok(()),
    }
}

fn free_bytes(place: &Path) -> Option<u64> {
    let found = rustix::fs::statvfs(place).ok()?;
    Some(found.f_bavail.saturating_mul(found.f_frsize))
}

/// The file of a line of `/proc/self/maps`: the sixth field, with whatever spaces it has.
fn mapped_file(line: &str) -> Option<&Path> {
    let at = line.find('/')?;
    Some(Path::new(&line[at..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_of_a_mapping_is_found_and_memory_without_a_file_has_none() {
        let line =
            "7f0c8e400000-7f0c8e600000 rw-s 00000000 00:1b 1234                       /dev/shm/iox2_a b.data";
        assert_eq!(mapped_file(line), Some(Path::new("/dev/shm/iox2_a b.data")));
        assert_eq!(mapped_file("7ffd2b5e0000-7ffd2b601000 rw-p 00000000 00:00 0          [stack]"), None);
    }

    #[test]
    fn too_little_room_is_told_with_what_is_left_and_an_unknown_place_is_not_refused() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        assert_eq!(check(folder.path(), 0), Ok(()));
        let needed = u64::MAX;
        assert!(
            matches!(check(folder.path(), needed), Err(Failure::NoRoom { free, needed: u64::MAX }) if free > 0)
        );
        assert_eq!(check(&folder.path().join("nowhere"), needed), Ok(()));
    }
}
