//! Which files a recording is made of, by the paths that it is asked for.

use std::fs;
use std::path::{Path, PathBuf};

use super::{RECORDING_FILE, is_nowhere};
use crate::capture::CaptureError;
use crate::capture::bag::BAG_EXTENSION;

/// What was found.
pub(super) enum Place<'a> {
    /// A folder of images.
    Folder(&'a Path),
    /// Bags, in the order of their cameras.
    Bags {
        /// What was asked for first.
        path: &'a Path,
        /// At least one.
        files: Vec<PathBuf>,
    },
}

/// Whether a folder holds a recording.
pub fn is_recording(folder: &Path) -> bool {
    folder.join(RECORDING_FILE).is_file() || bags_in(folder).is_ok_and(|bags| !bags.is_empty())
}

/// One folder of images; or bags, by their names or those of their folders.
pub(super) fn find<P: AsRef<Path>>(paths: &[P]) -> Result<Place<'_>, CaptureError> {
    let first = paths.first().map_or(Path::new(""), AsRef::as_ref);
    let mut files = Vec::new();
    for path in paths {
        let path = path.as_ref();
        let found = bags_at(path)?;
        if found.is_empty() && paths.len() > 1 {
            let what = format!("is no .{BAG_EXTENSION} file: only these can be opened beside each other");
            return Err(CaptureError::bad_data(path, what));
        }
        files.extend(found);
    }
    Ok(if files.is_empty() { Place::Folder(first) } else { Place::Bags { path: first, files } })
}

/// The bag of this name, or those in the folder of this name; empty for a folder of images and whatever else.
fn bags_at(path: &Path) -> Result<Vec<PathBuf>, CaptureError> {
    if path.is_dir() {
        let is_images = path.join(RECORDING_FILE).is_file();
        return if is_images {
            Ok(Vec::new())
        } else {
            bags_in(path).map_err(|error| CaptureError::io(path, error))
        };
    }
    if !is_bag(path) {
        return Ok(Vec::new());
    }
    match fs::metadata(path) {
        Ok(metadata) if metadata.is_file() => Ok(vec![path.to_path_buf()]),
        // Opening a pipe would wait for whoever writes it, for ever.
        Ok(_) => Err(CaptureError::bad_data(path, "is no regular file, but a pipe, a socket or a device")),
        Err(error) if is_nowhere(&error) => Err(CaptureError::bad_data(path, "there is no such file")),
        Err(error) => Err(CaptureError::io(path, error)),
    }
}

/// By name.
fn bags_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut bags = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if is_bag(&path) && path.is_file() {
            bags.push(path);
        }
    }
    bags.sort();
    Ok(bags)
}

fn is_bag(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(BAG_EXTENSION))
}
