//! One RGB-D frame and what is fixed about the camera it comes from.

use crate::geometry::{Camera, DepthCamera};
use crate::image::DepthView;

/// Nanoseconds of the clock that stamps the frames (of the recording or of the device).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct StampNs(pub i64);

/// What is fixed about one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraInfo {
    /// Name in the rig ("left"); unique in a rig.
    pub name: String,
    /// Serial number as the maker prints it; a string, leading zeros count.
    pub serial: String,
    /// Intrinsics of the colour image.
    pub camera: Camera,
    /// What measures depth; `None` where depth is registered to the colour image.
    pub depth_camera: Option<DepthCamera>,
    /// Metres per depth count.
    pub depth_unit_m: f64,
    /// Version of the firmware as the maker prints it; `None` where the device does not say.
    pub firmware: Option<String>,
}

/// Turn rates of a camera between its previous frame and this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnRate {
    /// Largest norm of the gyro's samples since the previous frame, in the camera's own clock; finite and not negative.
    pub max_rad_per_s: f64,
}

/// Whose clock a frame's stamp is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StampClock {
    /// The recording's or the renderer's.
    #[default]
    Source,
    /// The camera's own; that of another camera has nothing in common with it.
    Device,
    /// The camera's own, translated to the host's.
    Translated,
    /// The host's, when the image arrived.
    Host,
}

/// Where a frame's stamp comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FrameTiming {
    /// Whose clock the stamp is of.
    pub clock: StampClock,
    /// Arrival at this host, since the Unix epoch; `None` where the frame is not live.
    pub arrival_ns: Option<i64>,
}

impl FrameTiming {
    /// Whether the stamp tells nothing of when other cameras took theirs. What was recorded may have been brought to one clock since.
    pub fn is_of_own_clock(&self) -> bool {
        self.clock == StampClock::Device && self.arrival_ns.is_some()
    }
}

/// Colour and depth of one moment. Buffers are reused from frame to frame.
#[derive(Debug, Clone, Default)]
pub struct RgbdFrame {
    /// When the image was taken.
    pub stamp: StampNs,
    /// Counts up by one per frame of the source; gaps are lost frames.
    pub sequence: u64,
    /// px.
    pub width: usize,
    /// px.
    pub height: usize,
    /// 8-bit RGB, row-major, `3 * width * height` long.
    pub rgb: Vec<u8>,
    /// Depth counts, row-major, of the size of the colour image or of `depth_camera`; 0 is "no reading".
    pub depth: Vec<u16>,
    /// What measured depth; `None` where it is registered to the colour image.
    pub depth_camera: Option<DepthCamera>,
    /// Metres per depth count.
    pub depth_unit_m: f64,
    /// How fast the camera turned; `None` where there is no gyro, or it said nothing since the previous frame.
    pub turn_rate: Option<TurnRate>,
    /// Where the stamp comes from.
    pub timing: FrameTiming,
}

impl RgbdFrame {
    /// A view of the depth image; `None` when the frame is empty or inconsistent.
    pub fn depth_view(&self) -> Option<DepthView<'_>> {
        let (width, height) = self.depth_size_px();
        let view = DepthView::try_new(&self.depth, (width, height), width, self.depth_unit_m)?;
        Some(match self.depth_camera {
            Some(imager) => view.measured_by(imager),
            None => view,
        })
    }

    /// Width and height of the depth image, px.
    pub fn depth_size_px(&self) -> (usize, usize) {
        match &self.depth_camera {
            Some(imager) => (imager.camera.width_px() as usize, imager.camera.height_px() as usize),
            None => (self.width, self.height),
        }
    }

    /// Whether the buffers have the sizes that the frame promises.
    pub fn is_consistent(&self) -> bool {
        let pixels = self.width * self.height;
        let (depth_width, depth_height) = self.depth_size_px();
        pixels > 0 && self.rgb.len() == 3 * pixels && self.depth.len() == depth_width * depth_height
    }

    /// Whether it is a whole frame of this camera.
    pub fn is_of(&self, camera: &Camera) -> bool {
        let size = (camera.width_px() as usize, camera.height_px() as usize);
        self.is_consistent() && (self.width, self.height) == size
    }
}
