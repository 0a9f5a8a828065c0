//! Why something could not be kept or read, and what to do about it.

use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::format::FormatError;

/// A step that the system refused; the store goes on with what it has.
#[derive(Debug, thiserror::Error)]
#[error("cannot {what} {path}: {source}{cure}")]
pub struct StoreError {
    what: &'static str,
    path: PathBuf,
    source: io::Error,
    cure: &'static str,
}

impl StoreError {
    /// For `map_err`: what was tried, and where.
    pub(super) fn at(what: &'static str, path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self { what, path, cure: cure(source.kind()), source }
    }

    /// A calibration that no reader would take; a bug.
    pub(super) fn unwritable(path: &Path, error: &FormatError) -> Self {
        Self::at("write", path)(io::Error::other(error.to_string()))
    }
}

fn cure(kind: ErrorKind) -> &'static str {
    match kind {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => "; free some space there",
        ErrorKind::ReadOnlyFilesystem => "; mount it writable, or set store.directory to another place",
        ErrorKind::PermissionDenied => {
            "; let the daemon's user write there, or set store.directory to another place"
        }
        ErrorKind::NotADirectory | ErrorKind::AlreadyExists => "; set store.directory to a folder",
        _ => "",
    }
}
