//! A tiny recording made in code, valid until a test breaks it: two cameras of 64 x 48 px, colour as PNG and as JPEG.

use std::fs;
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageBuffer, Luma, Rgb};
use pelical::capture::recording::Recording;
use tempfile::TempDir;

pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 48;
/// Between frame sets.
pub const INTERVAL_NS: i64 = 20_000_000;
pub const FIRST_STAMP_NS: i64 = 1_700_000_000_000_000_000;
/// How much later the right camera takes its frame.
pub const SKEW_NS: i64 = 150_000;
pub const SERIALS: [&str; 2] = ["018322070001", "left's"];

/// A recording in a folder of its own, removed in the end.
pub struct Fixture {
    folder: TempDir,
}

impl Fixture {
    /// A valid recording of so many frame sets; the left camera stores PNG, the right one JPEG.
    pub fn new(n_sets: usize) -> Self {
        let fixture = Self { folder: tempfile::tempdir().unwrap() };
        for (camera_idx, name) in ["left", "right"].into_iter().enumerate() {
            for kind in ["color", "depth"] {
                fs::create_dir_all(fixture.path().join(name).join(kind)).unwrap();
            }
            for set_idx in 0..n_sets {
                let seed = 1000 * camera_idx as u64 + set_idx as u64;
                color(seed).save(fixture.color_file(camera_idx, set_idx)).unwrap();
                depth(seed).save(fixture.depth_file(camera_idx, set_idx)).unwrap();
            }
        }
        fixture.write("recording.yaml", valid_text(n_sets));
        fixture.write("ground_truth.yaml", VALID_TRUTH);
        fixture
    }

    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    pub fn open(&self) -> Recording {
        Recording::open(self.path()).unwrap()
    }

    pub fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        fs::write(self.path().join(name), text).unwrap();
    }

    pub fn color_file(&self, camera_idx: usize, set_idx: usize) -> PathBuf {
        let (name, ending) = [("left", "png"), ("right", "jpg")][camera_idx];
        self.path().join(format!("{name}/color/{}.{ending}", stamp_ns(camera_idx, set_idx)))
    }

    pub fn depth_file(&self, camera_idx: usize, set_idx: usize) -> PathBuf {
        let name = ["left", "right"][camera_idx];
        self.path().join(format!("{name}/depth/{}.png", stamp_ns(camera_idx, set_idx)))
    }
}

pub fn stamp_ns(camera_idx: usize, set_idx: usize) -> i64 {
    FIRST_STAMP_NS + set_idx as i64 * INTERVAL_NS + camera_idx as i64 * SKEW_NS
}

/// `recording.yaml` of the fixture.
pub fn valid_text(n_sets: usize) -> String {
    let mut text = String::from(
        "format: rgbd-rig/1\n\
         description: tiny\n\
         source: made by a test\n\
         cameras:\n",
    );
    for (name, serial) in ["left", "right"].into_iter().zip(SERIALS) {
        text += &format!(
            "  - name: {name}\n    serial: \"{serial}\"\n    width: {WIDTH}\n    height: {HEIGHT}\n    \
             fx: 60.5\n    fy: 60.25\n    cx: 31.5\n    cy: 23.5\n    \
             distortion: {{model: none, coeffs: [0, 0, 0, 0, 0]}}\n    depth_unit_m: 0.001\n"
        );
    }
    text += "frame_sets:\n";
    for set_idx in 0..n_sets {
        text += &format!("  - [{}, {}]\n", stamp_ns(0, set_idx), stamp_ns(1, set_idx));
    }
    text
}

pub const VALID_TRUTH: &str = "poses:\n  \
    left: {translation_m: [0, 0, 0], quaternion_xyzw: [0, 0, 0, 1]}\n  \
    right: {translation_m: [0.3, 0, 0], quaternion_xyzw: [0, 0.17, 0, 0.98]}\n";

/// Smooth enough for JPEG, different for each seed.
pub fn color(seed: u64) -> DynamicImage {
    let shift = mixed(seed) as u32;
    let pixel = |x: u32, y: u32| Rgb([x * 3, y * 4, x + y].map(|v| v.wrapping_add(shift) as u8 / 2));
    DynamicImage::ImageRgb8(ImageBuffer::from_fn(WIDTH, HEIGHT, pixel))
}

/// Noise over the whole range of depth, different for each seed.
pub fn depth(seed: u64) -> DynamicImage {
    let pixel = |x: u32, y: u32| Luma([mixed(seed << 32 | u64::from(y * WIDTH + x)) as u16]);
    DynamicImage::ImageLuma16(ImageBuffer::from_fn(WIDTH, HEIGHT, pixel))
}

/// One step of splitmix64.
pub fn mixed(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
