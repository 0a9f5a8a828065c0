//! The pinhole camera with Brown-Conrady distortion: pixels to rays and back.
//!
//! Decides what counts as usable intrinsics; everything downstream may rely on finite, positive values.

use nalgebra::Point3;

/// A position in an image, px; (0, 0) is the centre of the top-left pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelPoint {
    /// Column, px, to the right.
    pub x: f64,
    /// Row, px, down.
    pub y: f64,
}

/// A viewing ray as its point on the plane z = 1 of the optical frame; free of lens distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayPoint {
    /// x / z, no unit.
    pub x: f64,
    /// y / z, no unit.
    pub y: f64,
}

impl RayPoint {
    /// The point on this ray with the given inverse depth, in the camera's frame, m.
    pub fn at_inverse_depth(self, inverse_depth_per_m: f64) -> Point3<f64> {
        let z_m = 1.0 / inverse_depth_per_m;
        Point3::new(self.x * z_m, self.y * z_m, z_m)
    }
}

/// Lens distortion of the image a camera delivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// Rectified image.
    None,
    /// Brown-Conrady: radial k1, k2, k3 and tangential p1, p2 (OpenCV's `plumb_bob`).
    BrownConrady {
        /// Radial, second order.
        k1: f64,
        /// Radial, fourth order.
        k2: f64,
        /// Tangential.
        p1: f64,
        /// Tangential.
        p2: f64,
        /// Radial, sixth order.
        k3: f64,
    },
}

/// Intrinsics of one colour camera, to which depth is registered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    width_px: u32,
    height_px: u32,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    distortion: Distortion,
}

/// Why intrinsics were refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CameraError {
    /// Width or height is zero or larger than any sensor.
    #[error("image size {width_px} x {height_px} is not usable: each side must be 16 to 16384 px")]
    Size {
        /// px.
        width_px: u32,
        /// px.
        height_px: u32,
    },
    /// A focal length, principal point or coefficient is not a finite number in its range.
    #[error("{name} is {value}: {allowed}")]
    Value {
        /// Which intrinsic.
        name: &'static str,
        /// What it was.
        value: f64,
        /// What would be accepted.
        allowed: &'static str,
    },
}

/// `fx fy cx cy`, px.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole {
    /// Focal length along x, px.
    pub fx_px: f64,
    /// Focal length along y, px.
    pub fy_px: f64,
    /// Principal point, column, px.
    pub cx_px: f64,
    /// Principal point, row, px.
    pub cy_px: f64,
}

impl Camera {
    /// Checks and takes intrinsics: finite, focal lengths positive, sides of 16 to 16384 px.
    ///
    /// # Errors
    /// Names the first value that is not usable.
    pub fn try_new(
        (width_px, height_px): (u32, u32),
        pinhole: Pinhole,
        distortion: Distortion,
    ) -> Result<Self, CameraError> {
        if !(16..=16384).contains(&width_px) || !(16..=16384).contains(&height_px) {
            return Err(CameraError::Size { width_px, height_px });
        }
        let Pinhole { fx_px, fy_px, cx_px, cy_px } = pinhole;
        for (name, value) in [("fx", fx_px), ("fy", fy_px)] {
            if !(value.is_finite() && value > 1.0) {
                return Err(CameraError::Value { name, value, allowed: "a finite number of pixels above 1" });
            }
        }
        for (name, value) in [("cx", cx_px), ("cy", cy_px)] {
            if !value.is_finite() {
                return Err(CameraError::Value { name, value, allowed: "a finite number of pixels" });
            }
        }
        if let Distortion::BrownConrady { k1, k2, p1, p2, k3 } = distortion {
            for (name, value) in [("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)] {
                if !value.is_finite() {
                    return Err(CameraError::Value { name, value, allowed: "a finite coefficient" });
                }
            }
        }
        Ok(Self { width_px, height_px, fx_px, fy_px, cx_px, cy_px, distortion })
    }

    /// Image width, px.
    pub fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Image height, px.
    pub fn height_px(&self) -> u32 {
        self.height_px
    }

    /// `fx fy cx cy`.
    pub fn pinhole(&self) -> Pinhole {
        Pinhole { fx_px: self.fx_px, fy_px: self.fy_px, cx_px: self.cx_px, cy_px: self.cy_px }
    }

    /// Lens distortion of the delivered image.
    pub fn distortion(&self) -> Distortion {
        self.distortion
    }

    /// One focal length for converting small angles and pixels, px.
    pub fn mean_focal_px(&self) -> f64 {
        0.5 * (self.fx_px + self.fy_px)
    }

    /// The undistorted ray through a pixel.
    pub fn ray_from_pixel(&self, pixel: PixelPoint) -> RayPoint {
        let distorted =
            RayPoint { x: (pixel.x - self.cx_px) / self.fx_px, y: (pixel.y - self.cy_px) / self.fy_px };
        undistort(distorted, &self.distortion)
    }

    /// Where the image shows a ray, distortion included; may lie outside the image.
    pub fn pixel_from_ray(&self, ray: RayPoint) -> PixelPoint {
        let distorted = distort(ray, &self.distortion);
        PixelPoint { x: self.fx_px * distorted.x + self.cx_px, y: self.fy_px * distorted.y + self.cy_px }
    }

    /// Where the image shows a point of the camera's frame, m; `None` behind or within 1 mm of the camera.
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<PixelPoint> {
        if point_in_camera.z < 1e-3 {
            return None;
        }
        let ray =
            RayPoint { x: point_in_camera.x / point_in_camera.z, y: point_in_camera.y / point_in_camera.z };
        Some(self.pixel_from_ray(ray))
    }

    /// Whether a pixel position lies in the image, at least `margin_px` from its border.
    pub fn contains(&self, pixel: PixelPoint, margin_px: f64) -> bool {
        let (right, bottom) = (f64::from(self.width_px) - 1.0, f64::from(self.height_px) - 1.0);
        pixel.x >= margin_px
            && pixel.y >= margin_px
            && pixel.x <= right - margin_px
            && pixel.y <= bottom - margin_px
    }
}

/// Brown-Conrady, forward: `x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)`, y alike.
fn distort(ray: RayPoint, distortion: &Distortion) -> RayPoint {
    let Distortion::BrownConrady { k1, k2, p1, p2, k3 } = *distortion else { return ray };
    let RayPoint { x, y } = ray;
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    RayPoint {
        x: x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y: y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    }
}

/// Inverse of [`distort`] by fixed-point iteration; 20 rounds bring common lenses below 1e-9.
fn undistort(distorted: RayPoint, distortion: &Distortion) -> RayPoint {
    if *distortion == Distortion::None {
        return distorted;
    }
    let mut ray = distorted;
    for _ in 0..20 {
        let again = distort(ray, distortion);
        ray = RayPoint { x: ray.x + distorted.x - again.x, y: ray.y + distorted.y - again.y };
    }
    ray
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinect() -> Camera {
        let pinhole = Pinhole { fx_px: 517.3, fy_px: 516.5, cx_px: 318.6, cy_px: 255.3 };
        let lens = Distortion::BrownConrady { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633 };
        Camera::try_new((640, 480), pinhole, lens).expect("valid intrinsics")
    }

    #[test]
    fn a_pixel_survives_the_way_to_its_ray_and_back() {
        let camera = kinect();
        for (x, y) in [(0.0, 0.0), (639.0, 0.0), (100.5, 400.25), (639.0, 479.0), (318.6, 255.3)] {
            let back = camera.pixel_from_ray(camera.ray_from_pixel(PixelPoint { x, y }));
            assert!(
                (back.x - x).abs() < 1e-4 && (back.y - y).abs() < 1e-4,
                "({x}, {y}) came back as {back:?}"
            );
        }
    }

    #[test]
    fn nan_and_zero_intrinsics_are_refused_by_name() {
        let good = kinect().pinhole();
        let nan = Camera::try_new((640, 480), Pinhole { fx_px: f64::NAN, ..good }, Distortion::None);
        assert!(matches!(nan, Err(CameraError::Value { name: "fx", .. })));
        let zero = Camera::try_new((640, 480), Pinhole { fy_px: 0.0, ..good }, Distortion::None);
        assert!(matches!(zero, Err(CameraError::Value { name: "fy", .. })));
        assert!(matches!(Camera::try_new((0, 480), good, Distortion::None), Err(CameraError::Size { .. })));
    }

    #[test]
    fn a_point_behind_the_camera_has_no_pixel() {
        assert!(kinect().project(&Point3::new(0.0, 0.0, -1.0)).is_none());
    }
}
