//! A recording on disk, read at any position, in any order: a folder of images (layout `rgbd-rig/1`), or bags of RealSense cameras.
//!
//! Decides what counts as a usable recording: everything is checked when it is opened, except the images, which are checked
//! when they are read. Ground truth is never read unless [`Recording::ground_truth`] is called.

mod images;
mod place;
mod sections;
#[cfg(test)]
mod tests;
mod truth;
pub(super) mod turn_rates;

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::bag::{BAG_EXTENSION, Bags};
use super::{CameraInfo, CaptureError, FrameTiming, RgbdFrame, StampNs, TurnRate};
use place::Place;

pub(super) use images::{COLOR_FOLDER, DEPTH_FOLDER};
pub use place::is_recording;
pub(super) use sections::{check_cameras, check_housing};
pub use truth::GroundTruth;

/// Value of the key `format` of the recordings that this version reads and writes.
pub const FORMAT: &str = "rgbd-rig/1";
/// Name of the file that describes a recording.
pub const RECORDING_FILE: &str = "recording.yaml";
/// Name of the file that holds the truth.
pub const GROUND_TRUTH_FILE: &str = "ground_truth.yaml";
/// Bytes; a day of three cameras at 30 frames per second needs 200 MB, anything longer is not a text of ours.
const MAX_TEXT_BYTES: u64 = 256 << 20;
/// Bytes; a camera needs a hundred.
const MAX_TRUTH_BYTES: u64 = 1 << 20;

/// A checked recording: cameras and the stamps of its frame sets.
#[derive(Debug, Clone)]
pub struct Recording {
    path: PathBuf,
    description: String,
    source: String,
    cameras: Vec<CameraInfo>,
    frame_sets: Vec<Vec<StampNs>>,
    /// Per camera, by stamp; empty without a gyro, and for bags, whose frames bring theirs.
    turn_rates: Vec<Vec<(StampNs, TurnRate)>>,
    store: Store,
}

/// Where the images are.
#[derive(Debug, Clone)]
enum Store {
    /// Files in the recording's folder.
    Images,
    Bags(Bags),
}

impl Recording {
    /// Opens a recording: a folder with `recording.yaml`, a folder with bags, or one bag. Of a folder only `recording.yaml` and what the
    /// gyros said is checked; of bags everything but the pixels. Reads no ground truth.
    ///
    /// # Errors
    /// [`CaptureError::BadData`] names the file, the line or key, and what is allowed; [`CaptureError::Io`] otherwise.
    pub fn open(path: &Path) -> Result<Self, CaptureError> {
        Self::open_all(&[path])
    }

    /// As [`Self::open`], also for several bags of cameras that recorded at the same time.
    ///
    /// # Errors
    /// As [`Self::open`]; when there is anything but bags beside others.
    pub fn open_all<P: AsRef<Path>>(paths: &[P]) -> Result<Self, CaptureError> {
        match place::find(paths)? {
            Place::Folder(folder) => Self::open_folder(folder),
            Place::Bags { path, files } => Self::open_bags(path, &files),
        }
    }

    fn open_folder(folder: &Path) -> Result<Self, CaptureError> {
        let file = folder.join(RECORDING_FILE);
        let text = read_text(&file, MAX_TEXT_BYTES)?
            .ok_or_else(|| CaptureError::bad_data(&file, missing_file(folder)))?;
        let parsed = sections::parse_recording(&text).map_err(|what| CaptureError::bad_data(&file, what))?;
        let of_camera = |info: &CameraInfo| turn_rates::read(&folder.join(&info.name));
        let turn_rates = parsed.cameras.iter().map(of_camera).collect::<Result<_, _>>()?;
        Ok(Self {
            path: folder.to_path_buf(),
            description: parsed.description,
            source: parsed.source,
            cameras: parsed.cameras,
            frame_sets: parsed.frame_sets,
            turn_rates,
            store: Store::Images,
        })
    }

    fn open_bags(path: &Path, files: &[PathBuf]) -> Result<Self, CaptureError> {
        let bags = Bags::open(files)?;
        Ok(Self {
            path: path.to_path_buf(),
            description: String::new(),
            source: "RealSense bags".to_owned(),
            cameras: bags.cameras.clone(),
            frame_sets: bags.frame_sets.clone(),
            turn_rates: Vec::new(),
            store: Store::Bags(bags),
        })
    }

    /// The folder or the first bag that it was opened from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// One line about what was recorded; may be empty.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// Where the frames come from, and their licence; may be empty.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// The cameras, at least one, in the order of the file; the first one is the frame of the ground truth.
    pub fn cameras(&self) -> &[CameraInfo] {
        &self.cameras
    }

    /// Per frame set the stamp of each camera's frame, in the order of [`Self::cameras`]; never empty, stamps increase.
    pub fn frame_sets(&self) -> &[Vec<StampNs>] {
        &self.frame_sets
    }

    /// Overwrites `frame` with the frame that a camera took at `stamp`, one of those in [`Self::frame_sets`]; its sequence is
    /// the number of the frame set, from 0. Buffers are reused; after an error `frame` holds no image.
    ///
    /// # Errors
    /// [`CaptureError::BadData`] names the image file or bag, what was found and what is allowed.
    pub fn read_frame(
        &self,
        camera_idx: usize,
        stamp: StampNs,
        frame: &mut RgbdFrame,
    ) -> Result<(), CaptureError> {
        (frame.width, frame.height) = (0, 0);
        let (info, set_idx) = self.find(camera_idx, stamp)?;
        match &self.store {
            Store::Images => {
                let camera_folder = self.path.join(&info.name);
                images::read_color(&camera_folder, stamp, &info.camera, &mut frame.rgb)?;
                let depth_camera = info.depth_camera.as_ref().map_or(&info.camera, |imager| &imager.camera);
                images::read_depth(&camera_folder, stamp, depth_camera, &mut frame.depth)?;
                (frame.turn_rate, frame.specific_force) = (self.turn_rate(camera_idx, stamp), None);
            }
            Store::Bags(bags) => bags.read_images(camera_idx, stamp, frame)?,
        }
        (frame.stamp, frame.timing) = (stamp, FrameTiming::default());
        frame.sequence = set_idx as u64;
        frame.depth_unit_m = info.depth_unit_m;
        frame.depth_camera = info.depth_camera;
        (frame.width, frame.height) = images::size_px(&info.camera);
        Ok(())
    }

    /// The truth that lies in the recording's folder, or beside bags; `None` when there is no such file, or, beside bags, when it
    /// names none of their cameras.
    ///
    /// # Errors
    /// When the file is there but not usable: names the file, the camera, and what is allowed.
    pub fn ground_truth(&self) -> Result<Option<GroundTruth>, CaptureError> {
        let file = match &self.store {
            Store::Bags(_) if !self.path.is_dir() => self.path.with_file_name(GROUND_TRUTH_FILE),
            _ => self.path.join(GROUND_TRUTH_FILE),
        };
        let Some(text) = read_text(&file, MAX_TRUTH_BYTES)? else { return Ok(None) };
        let names: Vec<&str> = self.cameras.iter().map(|info| info.name.as_str()).collect();
        let truth = match &self.store {
            Store::Images => truth::parse_ground_truth(&text, &names).map(Some),
            Store::Bags(_) => truth::parse_for_some(&text, &names),
        };
        truth.map_err(|what| CaptureError::bad_data(&file, what))
    }

    fn turn_rate(&self, camera_idx: usize, stamp: StampNs) -> Option<TurnRate> {
        let rates = self.turn_rates.get(camera_idx)?;
        rates.binary_search_by_key(&stamp, |(stamp, _)| *stamp).ok().map(|idx| rates[idx].1)
    }

    fn find(&self, camera_idx: usize, stamp: StampNs) -> Result<(&CameraInfo, usize), CaptureError> {
        let file = || match &self.store {
            Store::Images => self.path.join(RECORDING_FILE),
            Store::Bags(_) => self.path.clone(),
        };
        let Some(info) = self.cameras.get(camera_idx) else {
            let what =
                format!("has {} cameras, so there is no camera number {camera_idx}", self.cameras.len());
            return Err(CaptureError::bad_data(&file(), what));
        };
        let set_idx = self.frame_sets.binary_search_by_key(&Some(stamp), |set| set.get(camera_idx).copied());
        set_idx.map(|idx| (info, idx)).map_err(|_| {
            let what = format!("camera \"{}\" has no frame with stamp {}", info.name, stamp.0);
            CaptureError::bad_data(&file(), what)
        })
    }
}

/// The text of a file of at most `max_bytes`; `None` when there is no such file.
fn read_text(file: &Path, max_bytes: u64) -> Result<Option<String>, CaptureError> {
    let bytes = match read_file(file, max_bytes)? {
        Some(bytes) => bytes,
        None => return Ok(None),
    };
    // An editor's byte order mark is no part of the first key.
    let text = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(&bytes);
    match std::str::from_utf8(text) {
        Ok(text) => Ok(Some(text.to_owned())),
        Err(error) => Err(CaptureError::bad_data(file, format!("is not a text: {error}; UTF-8 is allowed"))),
    }
}

/// The bytes of a file of at most `max_bytes`; `None` when there is no such file.
fn read_file(file: &Path, max_bytes: u64) -> Result<Option<Vec<u8>>, CaptureError> {
    let metadata = match fs::metadata(file) {
        Ok(metadata) => metadata,
        Err(error) if is_nowhere(&error) => return Ok(None),
        Err(error) => return Err(CaptureError::io(file, error)),
    };
    if !metadata.is_file() {
        return Err(CaptureError::bad_data(file, "is not a file"));
    }
    if metadata.len() > max_bytes {
        let what = format!("has {} bytes; at most {max_bytes} are allowed here", metadata.len());
        return Err(CaptureError::bad_data(file, what));
    }
    fs::read(file).map(Some).map_err(|error| CaptureError::io(file, error))
}

/// Whether the system says that there is nothing at a path, rather than that it cannot tell; links that go round lead nowhere too.
fn is_nowhere(error: &std::io::Error) -> bool {
    let is_loop = error.raw_os_error() == Some(rustix::io::Errno::LOOP.raw_os_error());
    is_loop
        || matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::InvalidFilename)
}

fn missing_file(folder: &Path) -> String {
    let hint = match fs::metadata(folder) {
        Ok(metadata) if metadata.is_dir() => "the folder is not a recording",
        Ok(_) => "that is a file, not a folder",
        Err(_) => "there is no such folder",
    };
    format!(
        "no such file: {hint}; a recording is a folder that holds {RECORDING_FILE}, or .{BAG_EXTENSION} files"
    )
}
