//! One RGB-D frame and what is fixed about the camera it comes from.

use crate::geometry::Camera;
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
    /// Intrinsics of the colour image, to which depth is registered.
    pub camera: Camera,
    /// Metres per depth count.
    pub depth_unit_m: f64,
}

/// Colour and registered depth of one moment. Buffers are reused from frame to frame.
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
    /// Depth counts registered to the colour image, row-major, `width * height` long; 0 is "no reading".
    pub depth: Vec<u16>,
    /// Metres per depth count.
    pub depth_unit_m: f64,
}

impl RgbdFrame {
    /// A view of the depth image; `None` when the frame is empty or inconsistent.
    pub fn depth_view(&self) -> Option<DepthView<'_>> {
        DepthView::try_new(&self.depth, (self.width, self.height), self.width, self.depth_unit_m)
    }

    /// Whether the buffers have the size that `width` and `height` promise.
    pub fn is_consistent(&self) -> bool {
        let pixels = self.width * self.height;
        pixels > 0 && self.rgb.len() == 3 * pixels && self.depth.len() == pixels
    }

    /// Whether it is a whole frame of this camera.
    pub fn is_of(&self, camera: &Camera) -> bool {
        let size = (camera.width_px() as usize, camera.height_px() as usize);
        self.is_consistent() && (self.width, self.height) == size
    }
}
