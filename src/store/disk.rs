//! The few calls by which the store touches the file system, behind a trait: tests let each of them fail or be the last one.

use std::fs;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Longest file that is read, bytes; a stored calibration of 8 cameras has less than a tenth of it.
const MAX_BYTES: u64 = 4 << 20;

/// A file system as far as the store needs one. Each function is one call that can fail by itself.
pub trait Disk: Send {
    /// An open file.
    type File;

    /// Makes a folder in one that is there; no error when it is there too.
    fn make_folder(&self, folder: &Path) -> io::Result<()>;
    /// The files in a folder, in any order.
    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>>;
    /// What is in a file, up to a bound.
    fn read(&self, file: &Path) -> io::Result<Vec<u8>>;
    /// A new, empty file in place of one that may be there.
    fn create(&self, file: &Path) -> io::Result<Self::File>;
    /// Appends all bytes.
    fn write(&self, file: &mut Self::File, bytes: &[u8]) -> io::Result<()>;
    /// Returns when the file's content is on the disk.
    fn sync(&self, file: &Self::File) -> io::Result<()>;
    /// Gives a file the name of another, which is replaced at once.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Returns when the names in a folder are on the disk.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;
    /// Removes a file.
    fn remove(&self, file: &Path) -> io::Result<()>;
}

/// The system's own.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemDisk;

impl Disk for SystemDisk {
    type File = fs::File;

    fn make_folder(&self, folder: &Path) -> io::Result<()> {
        match fs::create_dir(folder) {
            // Not every file system says so in the same way.
            Err(_) if folder.is_dir() => Ok(()),
            made => made,
        }
    }

    fn list(&self, folder: &Path) -> io::Result<Vec<PathBuf>> {
        fs::read_dir(folder)?.map(|entry| entry.map(|entry| entry.path())).collect()
    }

    fn read(&self, file: &Path) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        fs::File::open(file)?.take(MAX_BYTES).read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn create(&self, file: &Path) -> io::Result<fs::File> {
        fs::File::create(file)
    }

    fn write(&self, file: &mut fs::File, bytes: &[u8]) -> io::Result<()> {
        file.write_all(bytes)
    }

    fn sync(&self, file: &fs::File) -> io::Result<()> {
        file.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        fs::File::open(folder)?.sync_all()
    }

    fn remove(&self, file: &Path) -> io::Result<()> {
        fs::remove_file(file)
    }
}
