//! Writes a recording (layout `rgbd-rig/1`), frame set by frame set.
//!
//! Decides what survives a crash: images are written before `recording.yaml` names them, and that file is replaced as a whole
//! (temporary file, then rename) at the first frame set, about once a second, and at the end. Whenever the process is killed,
//! the folder holds a readable recording of all but the last second. Nothing that exists is ever overwritten.

use std::fmt::Write as _;
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, ImageResult};

use super::recording::{
    COLOR_FOLDER, DEPTH_FOLDER, FORMAT, GROUND_TRUTH_FILE, RECORDING_FILE, check_cameras, turn_rates,
};
use super::{CameraInfo, CaptureError, RgbdFrame, StampNs};
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, Distortion};

/// What a crash may cost.
const REWRITE_INTERVAL: Duration = Duration::from_secs(1);
/// Of 100; blocks of JPEG do not show in the edges at this quality.
const JPEG_QUALITY: u8 = 95;

/// How colour images are stored; depth is always 16-bit PNG.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorFormat {
    /// JPEG of quality 95: a quarter of the size, nearly the same edges.
    #[default]
    Jpeg,
    /// PNG: bit for bit.
    Png,
}

/// A recording being written; [`Self::finish`] ends it.
#[derive(Debug)]
pub struct RecordingWriter {
    folder: PathBuf,
    cameras: Vec<CameraInfo>,
    color_format: ColorFormat,
    /// Text of `recording.yaml` so far; each frame set adds its line.
    text: String,
    /// Text of each camera's turn rates so far; empty without a gyro.
    turn_rates: Vec<String>,
    last_stamps: Option<Vec<StampNs>>,
    last_rewrite: Option<Instant>,
    /// Encoded depth, reused.
    depth_bytes: Vec<u8>,
}

impl RecordingWriter {
    /// Makes the folders of a new recording; `folder` must not exist or be empty.
    ///
    /// # Errors
    /// When the folder holds anything, when cameras cannot be told apart, or when the system refuses.
    pub fn create(
        folder: &Path,
        cameras: &[CameraInfo],
        description: &str,
        source: &str,
    ) -> Result<Self, CaptureError> {
        check_cameras(cameras).map_err(|what| CaptureError::bad_data(folder, what))?;
        refuse_contents(folder)?;
        let make = |folder: &Path| fs::create_dir(folder).map_err(|error| CaptureError::io(folder, error));
        fs::create_dir_all(folder).map_err(|error| CaptureError::io(folder, error))?;
        for camera in cameras {
            // Fails where it exists: somebody else has begun to write here since the folder was found empty.
            let camera_folder = folder.join(&camera.name);
            make(&camera_folder)?;
            make(&camera_folder.join(COLOR_FOLDER))?;
            make(&camera_folder.join(DEPTH_FOLDER))?;
        }
        Ok(Self {
            folder: folder.to_path_buf(),
            cameras: cameras.to_vec(),
            color_format: ColorFormat::default(),
            text: head_text(cameras, description, source),
            turn_rates: vec![String::new(); cameras.len()],
            last_stamps: None,
            last_rewrite: None,
            depth_bytes: Vec::new(),
        })
    }

    /// Chooses how colour is stored from now on.
    #[must_use]
    pub fn with_color_format(mut self, color_format: ColorFormat) -> Self {
        self.color_format = color_format;
        self
    }

    /// Writes one frame of each camera, in the order of the cameras.
    ///
    /// # Errors
    /// When a frame does not fit its camera or comes before the last one; nothing is written then. When the system refuses.
    pub fn write_set(&mut self, frames: &[RgbdFrame]) -> Result<(), CaptureError> {
        self.check_set(frames).map_err(|what| CaptureError::bad_data(&self.folder, what))?;
        for camera_idx in 0..frames.len() {
            self.write_images(camera_idx, frames)?;
        }
        for (text, frame) in self.turn_rates.iter_mut().zip(frames) {
            if let Some(rate) = frame.turn_rate {
                text.push_str(&turn_rates::line(frame.stamp, rate));
            }
        }
        let stamps: Vec<StampNs> = frames.iter().map(|frame| frame.stamp).collect();
        let row: Vec<String> = stamps.iter().map(|stamp| stamp.0.to_string()).collect();
        let _ = writeln!(self.text, "  - [{}]", row.join(", "));
        self.last_stamps = Some(stamps);
        if self.last_rewrite.is_none_or(|at| at.elapsed() >= REWRITE_INTERVAL) {
            self.rewrite()?;
        }
        Ok(())
    }

    /// Writes where the cameras truly are, in the order of the cameras. Whatever the reference is, the file holds the motions
    /// into the first camera's frame.
    ///
    /// # Errors
    /// When there is not one finite motion per camera, or when the system refuses.
    pub fn write_ground_truth(&self, reference_from_camera: &[Motion]) -> Result<(), CaptureError> {
        let file = self.folder.join(GROUND_TRUTH_FILE);
        let (n_motions, n_cameras) = (reference_from_camera.len(), self.cameras.len());
        let is_finite = |motion: &Motion| motion.to_homogeneous().iter().all(|value| value.is_finite());
        let first = reference_from_camera.first().filter(|_| n_motions == n_cameras);
        let Some(first) = first.filter(|_| reference_from_camera.iter().all(is_finite)) else {
            let what =
                format!("{n_motions} motions for {n_cameras} cameras; one finite motion each is needed");
            return Err(CaptureError::bad_data(&file, what));
        };
        let first_from_reference = first.inverse();
        let mut text = String::from("poses:\n");
        for (camera, motion) in self.cameras.iter().zip(reference_from_camera) {
            let first_from_camera = first_from_reference * motion;
            let [x, y, z]: [f64; 3] = first_from_camera.translation.vector.into();
            let [i, j, k, w]: [f64; 4] = first_from_camera.rotation.coords.into();
            let name = quoted(&camera.name);
            let _ = writeln!(text, "  {name}:\n    translation_m: [{x}, {y}, {z}]");
            let _ = writeln!(text, "    quaternion_xyzw: [{i}, {j}, {k}, {w}]");
        }
        replace_file(&file, text.as_bytes())
    }

    /// Ends the recording; without a frame set nothing readable was written, and the folders are left empty.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn finish(mut self) -> Result<(), CaptureError> {
        if self.last_stamps.is_some() { self.rewrite() } else { Ok(()) }
    }

    fn rewrite(&mut self) -> Result<(), CaptureError> {
        for (camera, lines) in
            self.cameras.iter().zip(&self.turn_rates).filter(|(_, lines)| !lines.is_empty())
        {
            let file = self.folder.join(&camera.name).join(turn_rates::FILE);
            replace_file(&file, format!("{}\n{lines}", turn_rates::HEADER).as_bytes())?;
        }
        replace_file(&self.folder.join(RECORDING_FILE), self.text.as_bytes())?;
        self.last_rewrite = Some(Instant::now());
        Ok(())
    }

    fn check_set(&self, frames: &[RgbdFrame]) -> Result<(), String> {
        if frames.len() != self.cameras.len() {
            return Err(format!("a frame set of {} frames for {} cameras", frames.len(), self.cameras.len()));
        }
        for (camera_idx, (frame, camera)) in frames.iter().zip(&self.cameras).enumerate() {
            let (name, stamp) = (&camera.name, frame.stamp.0);
            if !frame.is_of(&camera.camera) {
                let (width, height) = (camera.camera.width_px(), camera.camera.height_px());
                return Err(format!(
                    "frame {stamp} of camera \"{name}\" is not a whole {width} x {height} image"
                ));
            }
            if frame.depth_camera != camera.depth_camera {
                return Err(format!(
                    "frame {stamp} of camera \"{name}\" has another depth imager than its camera"
                ));
            }
            if frame.depth_unit_m != camera.depth_unit_m {
                return Err(format!(
                    "frame {stamp} of camera \"{name}\" has another depth unit than its camera"
                ));
            }
            let before = self.last_stamps.as_ref().and_then(|stamps| stamps.get(camera_idx)).map(|at| at.0);
            if stamp < 0 || before.is_some_and(|before| before >= stamp) {
                let before = before.unwrap_or(-1);
                return Err(format!(
                    "frame {stamp} of camera \"{name}\" comes after {before}: stamps increase"
                ));
            }
        }
        Ok(())
    }

    fn write_images(&mut self, camera_idx: usize, frames: &[RgbdFrame]) -> Result<(), CaptureError> {
        let (Some(camera), Some(frame)) = (self.cameras.get(camera_idx), frames.get(camera_idx)) else {
            return Ok(());
        };
        let folder = self.folder.join(&camera.name);
        let size = (camera.camera.width_px(), camera.camera.height_px());
        let color = folder.join(COLOR_FOLDER).join(frame.stamp.0.to_string());
        match self.color_format {
            ColorFormat::Jpeg => write_image(&color.with_extension("jpg"), |file| {
                let encoder = JpegEncoder::new_with_quality(file, JPEG_QUALITY);
                encoder.write_image(&frame.rgb, size.0, size.1, ExtendedColorType::Rgb8)
            })?,
            ColorFormat::Png => write_image(&color.with_extension("png"), |file| {
                png(file).write_image(&frame.rgb, size.0, size.1, ExtendedColorType::Rgb8)
            })?,
        }
        self.depth_bytes.clear();
        self.depth_bytes.extend(frame.depth.iter().flat_map(|count| count.to_ne_bytes()));
        let (depth_width, depth_height) = frame.depth_size_px();
        let depth = folder.join(DEPTH_FOLDER).join(format!("{}.png", frame.stamp.0));
        write_image(&depth, |file| {
            let size = (depth_width as u32, depth_height as u32);
            png(file).write_image(&self.depth_bytes, size.0, size.1, ExtendedColorType::L16)
        })
    }
}

/// The fast setting: three cameras at 30 frames per second have to fit on one core.
fn png<W: std::io::Write>(file: W) -> PngEncoder<W> {
    PngEncoder::new_with_quality(file, CompressionType::Fast, FilterType::Up)
}

/// Writes a new image file; refuses to overwrite one.
fn write_image(
    file: &Path,
    encode: impl FnOnce(&mut BufWriter<File>) -> ImageResult<()>,
) -> Result<(), CaptureError> {
    let failed = |error| CaptureError::io(file, error);
    let mut writer =
        BufWriter::new(OpenOptions::new().write(true).create_new(true).open(file).map_err(failed)?);
    encode(&mut writer).map_err(|error| CaptureError::io(file, std::io::Error::other(error)))?;
    writer.flush().map_err(failed)
}

/// Replaces a file as a whole: a reader sees the old text or the new one, also after a crash.
fn replace_file(file: &Path, bytes: &[u8]) -> Result<(), CaptureError> {
    let temporary = file.with_extension("yaml.tmp");
    let write = || -> std::io::Result<()> {
        let mut writer = File::create(&temporary)?;
        writer.write_all(bytes)?;
        writer.sync_all()?;
        fs::rename(&temporary, file)
    };
    write().map_err(|error| CaptureError::io(file, error))
}

fn refuse_contents(folder: &Path) -> Result<(), CaptureError> {
    let mut entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(CaptureError::io(folder, error)),
    };
    if entries.next().is_none() {
        return Ok(());
    }
    let what = "the folder is not empty, and nothing stored is overwritten: name a new folder";
    Err(CaptureError::bad_data(folder, what))
}

/// Everything above the rows of `frame_sets`.
fn head_text(cameras: &[CameraInfo], description: &str, source: &str) -> String {
    let mut text = format!(
        "format: {FORMAT}\ndescription: {}\nsource: {}\ncameras:\n",
        quoted(description),
        quoted(source)
    );
    for CameraInfo { name, serial, camera, depth_camera, depth_unit_m, .. } in cameras {
        let _ = writeln!(text, "  - name: {}\n    serial: {}", quoted(name), quoted(serial));
        for entry in intrinsics_entries(camera) {
            let _ = writeln!(text, "    {entry}");
        }
        let _ = writeln!(text, "    depth_unit_m: {depth_unit_m}");
        if let Some(imager) = depth_camera {
            let [x, y, z] = imager.color_from_depth.translation.vector.into();
            let [qx, qy, qz, qw] = imager.color_from_depth.rotation.coords.into();
            let _ = writeln!(text, "    depth:\n      registered: false");
            for entry in intrinsics_entries(&imager.camera) {
                let _ = writeln!(text, "      {entry}");
            }
            let _ = writeln!(text, "      color_from_depth:\n        translation_m: [{x}, {y}, {z}]");
            let _ = writeln!(text, "        quaternion_xyzw: [{qx}, {qy}, {qz}, {qw}]");
        }
    }
    text + "frame_sets:\n"
}

/// Size, pinhole and lens as lines of YAML.
fn intrinsics_entries(camera: &Camera) -> [String; 7] {
    let pinhole = camera.pinhole();
    let (model, coeffs) = match camera.distortion() {
        Distortion::None => ("none", [0.0; 5]),
        Distortion::BrownConrady { k1, k2, p1, p2, k3 } => ("brown_conrady", [k1, k2, p1, p2, k3]),
    };
    let coeffs = coeffs.map(|coeff| coeff.to_string()).join(", ");
    [
        format!("width: {}", camera.width_px()),
        format!("height: {}", camera.height_px()),
        format!("fx: {}", pinhole.fx_px),
        format!("fy: {}", pinhole.fy_px),
        format!("cx: {}", pinhole.cx_px),
        format!("cy: {}", pinhole.cy_px),
        format!("distortion: {{model: {model}, coeffs: [{coeffs}]}}"),
    ]
}

/// A string of JSON is a double-quoted string of YAML.
fn quoted(text: &str) -> String {
    serde_json::Value::from(text).to_string()
}
