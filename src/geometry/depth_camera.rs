//! The imager that measures depth, where its images are not registered to the colour image.

use nalgebra::Point3;

use super::camera::{Camera, PixelPoint};
use super::motion::Motion;

/// A depth imager beside a colour camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthCamera {
    /// Its own intrinsics.
    pub camera: Camera,
    /// From its optical frame to that of the colour camera.
    pub color_from_depth: Motion,
}

impl DepthCamera {
    /// The point that a depth pixel shows, in the colour camera's frame, m.
    pub fn point_in_color(&self, pixel: PixelPoint, depth_m: f64) -> Point3<f64> {
        self.color_from_depth * self.camera.ray_from_pixel(pixel).at_inverse_depth(1.0 / depth_m)
    }
}
