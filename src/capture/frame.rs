//! One RGB-D frame and what is fixed about the camera it comes from.

use nalgebra::{UnitQuaternion, Vector3};

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

/// What a camera's accelerometer felt between its previous frame and this one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpecificForce {
    /// Mean of the samples, in the axes of the colour camera (x right, y down, z forward); finite. At rest it points up and is as long
    /// as [`SpecificForce::AT_REST_M_PER_S2`].
    pub mean_m_per_s2: Vector3<f64>,
}

impl SpecificForce {
    /// What the ground holds against gravity; nowhere on it 0.5 % more or less.
    pub const AT_REST_M_PER_S2: f64 = 9.81;

    /// The mean of samples in the accelerometer's axes; `None` where there is none.
    pub fn mean(
        samples: impl Iterator<Item = Vector3<f64>>,
        color_from_accel: &UnitQuaternion<f64>,
    ) -> Option<Self> {
        let add = |(sum, n): (Vector3<f64>, u32), sample| (sum + sample, n + 1);
        let (sum, n) = samples.fold((Vector3::zeros(), 0), add);
        (n > 0).then(|| Self { mean_m_per_s2: color_from_accel * (sum / f64::from(n)) })
    }
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
    /// What the accelerometer felt; `None` where there is none, where it said nothing since the previous frame, or where nobody knows how
    /// it is turned against the colour camera.
    pub specific_force: Option<SpecificForce>,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_turned_into_the_axes_of_colour() {
        // The accelerometer lies with its x axis up, where colour has y down.
        let quarter = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -std::f64::consts::FRAC_PI_2);
        let samples = [[9.7, 0.2, 1.0], [9.9, -0.2, 2.0]].map(Vector3::from);
        let force = SpecificForce::mean(samples.into_iter(), &quarter).expect("two samples");
        let expected = Vector3::new(0.0, -9.8, 1.5);
        assert!((force.mean_m_per_s2 - expected).norm() < 1e-12, "{force:?}");
        assert_eq!(SpecificForce::mean(std::iter::empty(), &quarter), None);
    }
}
