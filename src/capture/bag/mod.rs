//! RealSense recordings (`.bag`) read without the SDK: one camera a file, or several devices in one.
//!
//! Decides what of a bag is a camera, which images form a frame, and which frames a set. When bags are opened, every chunk is
//! looked at once; then frames are read from the file one by one, so that a bag may be larger than the memory.

mod device;
mod file;
mod guard;
mod message;
mod pixels;
mod stamps;
mod topic;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::recording::check_cameras;
use super::{CameraInfo, CaptureError, RgbdFrame, StampNs};
use device::Device;
use file::BagFile;
use message::Image;
use stamps::BagFrame;

/// Ending of the files.
pub const BAG_EXTENSION: &str = "bag";

/// Some bags as one recording.
#[derive(Debug, Clone)]
pub(super) struct Bags {
    pub(super) cameras: Vec<CameraInfo>,
    pub(super) frame_sets: Vec<Vec<StampNs>>,
    streams: Vec<CameraStream>,
}

/// The frames of one camera.
#[derive(Debug, Clone)]
struct CameraStream {
    file: Arc<BagFile>,
    /// Increasing.
    frames: Arc<[BagFrame]>,
}

impl Bags {
    /// Opens bags, whose cameras stand in the order of the files. A camera has the name of its file where that tells it from all
    /// others, else its serial number.
    ///
    /// # Errors
    /// When a bag is not usable, or the cameras have no moment in common.
    pub(super) fn open(paths: &[PathBuf]) -> Result<Self, CaptureError> {
        let mut devices = Vec::new();
        for path in paths {
            let file = Arc::new(BagFile::open(path)?);
            let in_file = device::read_devices(&file)?;
            if in_file.is_empty() {
                return Err(CaptureError::bad_data(
                    path,
                    "holds nothing that a RealSense camera has recorded",
                ));
            }
            devices.extend(in_file.into_iter().map(|device| (Arc::clone(&file), device)));
        }
        check_serials(&devices)?;
        let names = names(&devices);
        let is_rig = devices.len() > 1;
        let (mut cameras, mut streams) = (Vec::new(), Vec::new());
        for ((file, mut device), name) in devices.into_iter().zip(names) {
            let bad = |what: String| CaptureError::bad_data(file.path(), what);
            cameras.push(device.camera_info(&name).map_err(bad)?);
            stamps::unwrap(&mut device);
            let mut frames = stamps::frames(&device);
            if frames.is_empty() {
                return Err(bad(format!("camera \"{name}\" has no colour image with depth near it in time")));
            }
            // A clock of its own tells one camera's frames apart, but not what other cameras did then.
            let offset_ns = stamps::host_offset_ns(&device).filter(|_| is_rig).unwrap_or(0);
            frames.iter_mut().for_each(|frame| frame.stamp_ns = frame.stamp_ns.saturating_add(offset_ns));
            streams.push(CameraStream { frames: frames.into(), file });
        }
        let path = paths.first().map_or(Path::new(""), PathBuf::as_path);
        check_cameras(&cameras).map_err(|what| CaptureError::bad_data(path, what))?;
        let frame_sets = frame_sets(&streams).map_err(|what| CaptureError::bad_data(path, what))?;
        Ok(Self { cameras, frame_sets, streams })
    }

    /// Overwrites the images of `frame` with those that a camera took at `stamp`; the rest of the frame is up to the caller.
    ///
    /// # Errors
    /// When an image is not whole, or not of the promised kind and size.
    pub(super) fn read_images(
        &self,
        camera_idx: usize,
        stamp: StampNs,
        frame: &mut RgbdFrame,
    ) -> Result<(), CaptureError> {
        let (Some(stream), Some(info)) = (self.streams.get(camera_idx), self.cameras.get(camera_idx)) else {
            return Err(CaptureError::bad_data(Path::new(""), format!("there is no camera {camera_idx}")));
        };
        let bad = |what: String| {
            CaptureError::bad_data(
                stream.file.path(),
                format!("frame {} of \"{}\": {what}", stamp.0, info.name),
            )
        };
        let found = stream.frames.binary_search_by_key(&stamp.0, |frame| frame.stamp_ns);
        let found = found.ok().and_then(|idx| stream.frames.get(idx));
        let BagFrame { color, depth, turn_rate, specific_force, .. } =
            *found.ok_or_else(|| bad("there is none".into()))?;
        let depth_camera = info.depth_camera.map_or(info.camera, |imager| imager.camera);
        let read_color =
            |message: &[u8]| pixels::read_color(&Image::parse(message)?, &info.camera, &mut frame.rgb);
        stream.file.read_message(color, read_color).map_err(bad)?;
        let read_depth =
            |message: &[u8]| pixels::read_depth(&Image::parse(message)?, &depth_camera, &mut frame.depth);
        stream.file.read_message(depth, read_depth).map_err(bad)?;
        (frame.turn_rate, frame.specific_force) = (turn_rate, specific_force);
        Ok(())
    }
}

/// Refuses two devices of one serial number, by the names of their files.
fn check_serials(devices: &[(Arc<BagFile>, Device)]) -> Result<(), CaptureError> {
    for (idx, (file, device)) in devices.iter().enumerate() {
        let Some(serial) = device.serial() else { continue };
        if let Some((other, _)) = devices[..idx].iter().find(|(_, other)| other.serial() == Some(serial)) {
            let other = other.path().display();
            let what = format!(
                "is the same file as {other}, or of the same camera, {serial}: a camera has one bag in a rig"
            );
            return Err(CaptureError::bad_data(file.path(), what));
        }
    }
    Ok(())
}

/// The name of the file for the only camera of the only file of this name; else the serial number.
fn names(devices: &[(Arc<BagFile>, Device)]) -> Vec<String> {
    let stem = |file: &BagFile| file.path().file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let stems: Vec<String> = devices.iter().map(|(file, _)| stem(file)).collect();
    let name = |(idx, (stem, (_, device))): (usize, (&String, &(Arc<BagFile>, Device)))| {
        if stems.iter().filter(|other| *other == stem).count() == 1 {
            return stem.clone();
        }
        device.serial().map_or_else(|| format!("{stem}-{idx}"), str::to_owned)
    };
    stems.iter().zip(devices).enumerate().map(name).collect()
}

fn frame_sets(streams: &[CameraStream]) -> Result<Vec<Vec<StampNs>>, String> {
    let stamps = |stream: &CameraStream| stream.frames.iter().map(|frame| frame.stamp_ns).collect();
    let stamps: Vec<Vec<i64>> = streams.iter().map(stamps).collect();
    let sets = stamps::frame_sets(&stamps);
    if sets.is_empty() {
        let first = |stamps: &Vec<i64>| stamps.first().map_or_else(String::new, i64::to_string);
        let first: Vec<String> = stamps.iter().map(first).collect();
        return Err(format!(
            "the cameras have no moment in common: their first frames have the stamps {} ns; record them at the same time, \
             with global time enabled",
            first.join(", ")
        ));
    }
    Ok(sets.into_iter().map(|set| set.into_iter().map(StampNs).collect()).collect())
}
