//! Calibrations on disk, one file each, so that none is lost and the last good one is there at the next start.
//!
//! A file appears under its name only when all of it is on the disk (written beside, synced, renamed, folder synced, and before it the
//! one above) and is never changed again. What does not hold what its checksum promises is passed over, never half taken. Going back to an older
//! calibration adds a file that says so: the newest file is always the one that counts. docs/state.md has it for users.

mod disk;
mod document;
mod entry;
mod error;
mod format;
mod history;
#[cfg(test)]
mod tests;
mod writer;

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

pub use disk::{Disk, SystemDisk};
pub use entry::{FrameSets, OtherRig, Restored, StoredCalibration, StoredCamera};
pub use error::StoreError;
pub use format::{FormatError, decode, encode, sha256_hex};
pub use history::History;
pub use writer::{Report, Writer};

/// What a file is called while it is being written.
const UNFINISHED: &str = "new";

/// The folder of one daemon's calibrations.
#[derive(Debug, Clone)]
pub struct Store<D = SystemDisk> {
    disk: D,
    folder: PathBuf,
}

/// What a folder holds.
#[derive(Debug, Default)]
pub struct Loaded {
    /// Every calibration that could be read.
    pub history: History,
    /// Files that are none, and why.
    pub damaged: Vec<(PathBuf, String)>,
}

impl Store {
    /// The store in a folder of the system's disk; the folder is made when something is saved.
    pub fn in_folder(folder: PathBuf) -> Self {
        Self::on(SystemDisk, folder)
    }
}

impl<D: Disk> Store<D> {
    /// The store in a folder of a disk.
    pub fn on(disk: D, folder: PathBuf) -> Self {
        Self { disk, folder }
    }

    /// Where the files are.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Reads every file; a folder that is not there is empty.
    ///
    /// # Errors
    /// When the folder cannot be read.
    pub fn load(&self) -> Result<Loaded, StoreError> {
        let mut loaded = Loaded::default();
        for (id, file) in self.files()? {
            let read = self.disk.read(&file).map_err(|error| error.to_string());
            let decoded = read.and_then(|bytes| decode(&bytes).map_err(|error| error.to_string()));
            let is_meant = |entry: &StoredCalibration| entry.id == id;
            match decoded {
                Ok(entry) if is_meant(&entry) => loaded.history.add(entry),
                Ok(entry) => {
                    let what = format!("it is calibration {} under the name of another", entry.id);
                    loaded.damaged.push((file, what));
                }
                Err(what) => loaded.damaged.push((file, what)),
            }
            // Not even the number of a damaged file is used again.
            loaded.history.note_id(id);
        }
        Ok(loaded)
    }

    /// Writes a calibration; when this returns it survives a loss of power.
    ///
    /// # Errors
    /// Says which step failed. What was there before is still there, unchanged.
    pub fn save(&self, entry: &StoredCalibration) -> Result<(), StoreError> {
        let file = self.folder.join(file_name(entry.id));
        let unfinished = file.with_extension(UNFINISHED);
        let text = encode(entry).map_err(|error| StoreError::unwritable(&file, &error))?;
        let disk = &self.disk;
        self.make_folder(&self.folder).map_err(StoreError::at("make the folder", &self.folder))?;
        let written = disk.create(&unfinished).and_then(|mut open| {
            disk.write(&mut open, text.as_bytes())?;
            disk.sync(&open)
        });
        let renamed = written.and_then(|()| disk.rename(&unfinished, &file));
        if let Err(error) = renamed {
            // Of no use to anybody; if this fails too, a later save removes it.
            let _ = disk.remove(&unfinished);
            return Err(StoreError::at("write", &file)(error));
        }
        disk.sync_folder(&self.folder).map_err(StoreError::at("sync the folder", &self.folder))
    }

    /// Removes files with a number below `oldest_kept`, and what an earlier daemon did not finish.
    ///
    /// # Errors
    /// At the first file that cannot be removed.
    pub fn remove_old(&self, oldest_kept: u64) -> Result<(), StoreError> {
        let listed = self.disk.list(&self.folder).map_err(StoreError::at("list", &self.folder))?;
        let is_unfinished = |file: &Path| file.extension().is_some_and(|extension| extension == UNFINISHED);
        let is_old = |file: &Path| {
            is_unfinished(file) && id_of(&file.with_extension("yaml")).is_some()
                || id_of(file).is_some_and(|id| id < oldest_kept)
        };
        for file in listed.iter().filter(|file| is_old(file)) {
            self.disk.remove(file).map_err(StoreError::at("remove", file))?;
        }
        Ok(())
    }

    /// Makes a folder and those above it that are missing. The one above is synced also when nothing is made: an earlier daemon may
    /// have been killed before it did so.
    fn make_folder(&self, folder: &Path) -> io::Result<()> {
        let above = match folder.parent() {
            None => return Ok(()),
            Some(above) if above == Path::new("") => Path::new("."),
            Some(above) => above,
        };
        match self.disk.make_folder(folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => {
                self.make_folder(above)?;
                self.disk.make_folder(folder)?;
            }
            made => made?,
        }
        self.disk.sync_folder(above)
    }

    /// The files of the store by their numbers.
    fn files(&self) -> Result<Vec<(u64, PathBuf)>, StoreError> {
        let listed = match self.disk.list(&self.folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            listed => listed.map_err(StoreError::at("list", &self.folder))?,
        };
        let mut files: Vec<_> = listed.into_iter().filter_map(|file| Some((id_of(&file)?, file))).collect();
        files.sort();
        Ok(files)
    }
}

fn file_name(id: u64) -> String {
    format!("calibration-{id:06}.yaml")
}

/// The number of a file of the store; `None` for any other file.
fn id_of(file: &Path) -> Option<u64> {
    let name = file.file_name()?.to_str()?;
    let id = name.strip_prefix("calibration-")?.strip_suffix(".yaml")?.parse().ok()?;
    // No other spelling of the number, and none that leaves no room for the next.
    (file_name(id) == name && id < u64::MAX).then_some(id)
}
