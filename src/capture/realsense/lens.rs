//! Intrinsics as the SDK gives them, as a camera of this library. Unknown models are refused: a wrong lens is worse than none.
//!
//! What counts is what the SDK itself does with a model (its functions `rs2_project_point_to_pixel` and
//! `rs2_deproject_pixel_to_point`, to which a test holds this), not its name: `inverse_brown_conrady`, the model of the colour
//! cameras of the D400 family, is projected like `modified_brown_conrady`, by Brown-Conrady with the tangential terms taken at the
//! radially distorted point. Here such a lens becomes the plain Brown-Conrady lens nearest to it, which real coefficients miss
//! by less than a hundredth of a pixel.

use nalgebra::{Matrix5, SMatrix, Vector2, Vector5};

use crate::geometry::camera::{CameraError, Pinhole, RayPoint};
use crate::geometry::{Camera, Distortion};

/// Columns and rows of pixels that the nearest lens is fitted to.
const FIT_GRID: (u32, u32) = (17, 13);
/// Largest difference of the nearest lens that is accepted, px: below the noise of a detected edge.
const MAX_MISS_PX: f64 = 0.05;

/// Models of lenses of the SDK.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LensModel {
    /// Rectified.
    None,
    /// Brown-Conrady.
    BrownConrady,
    /// The same with the tangential terms at the radially distorted point.
    ModifiedBrownConrady,
    /// By name its inverse; see the head of this module.
    InverseBrownConrady,
}

/// Intrinsics of one stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Width and height, px.
    pub size_px: (u32, u32),
    /// px.
    pub pinhole: Pinhole,
    /// Number of the model in the SDK.
    pub model: u32,
    /// k1 k2 p1 p2 k3.
    pub coeffs: [f64; 5],
}

/// Why intrinsics were refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LensError {
    /// A model for which there is nothing here.
    #[error(
        "its lens model is number {model} of the SDK ({name}); none, brown_conrady, modified_brown_conrady and \
         inverse_brown_conrady are supported"
    )]
    Model {
        /// Number in the SDK.
        model: u32,
        /// Name, where it has one.
        name: &'static str,
    },
    /// Values that no camera has.
    #[error("its intrinsics are not usable: {0}")]
    Intrinsics(#[from] CameraError),
    /// Coefficients beyond those of any real lens of the family.
    #[error(
        "its lens coefficients {coeffs:?} bend the image so much that no Brown-Conrady lens comes nearer than {miss_px:.2} px; \
         {MAX_MISS_PX} px are allowed"
    )]
    Miss {
        /// k1 k2 p1 p2 k3.
        coeffs: [f64; 5],
        /// px.
        miss_px: f64,
    },
}

impl LensModel {
    /// The model of this number in the SDK.
    ///
    /// # Errors
    /// For models that are not supported.
    pub fn from_number(model: u32) -> Result<Self, LensError> {
        match model {
            0 => Ok(Self::None),
            1 => Ok(Self::ModifiedBrownConrady),
            2 => Ok(Self::InverseBrownConrady),
            4 => Ok(Self::BrownConrady),
            3 => Err(LensError::Model { model, name: "ftheta" }),
            5 => Err(LensError::Model { model, name: "kannala_brandt4" }),
            _ => Err(LensError::Model { model, name: "unknown to this version" }),
        }
    }
}

/// The camera with these intrinsics.
///
/// # Errors
/// When the model is not supported or a value is not usable.
pub fn camera(intrinsics: &Intrinsics) -> Result<Camera, LensError> {
    let Intrinsics { size_px, pinhole, coeffs, .. } = *intrinsics;
    let model = LensModel::from_number(intrinsics.model)?;
    let [k1, k2, p1, p2, k3] = coeffs;
    let plain = Distortion::BrownConrady { k1, k2, p1, p2, k3 };
    if model == LensModel::None || coeffs == [0.0; 5] {
        return Ok(Camera::try_new(size_px, pinhole, Distortion::None)?);
    }
    let camera = Camera::try_new(size_px, pinhole, plain)?;
    let has_tangential_terms = p1 != 0.0 || p2 != 0.0;
    if model == LensModel::BrownConrady || !has_tangential_terms {
        return Ok(camera);
    }
    nearest(&camera, coeffs)
}

/// The plain lens nearest to the modified one with the coefficients of `start`.
fn nearest(start: &Camera, coeffs: [f64; 5]) -> Result<Camera, LensError> {
    let miss = |miss_px: f64| LensError::Miss { coeffs, miss_px };
    let pairs = || rays(start).map(|ray| (ray, modified(ray, &coeffs)));
    let (mut normal, mut right) = (Matrix5::<f64>::zeros(), Vector5::<f64>::zeros());
    for (ray, shown) in pairs() {
        let terms = terms(ray);
        normal += terms.transpose() * terms;
        right += terms.transpose() * Vector2::new(shown.x - ray.x, shown.y - ray.y);
    }
    let fitted = normal.cholesky().ok_or_else(|| miss(f64::INFINITY))?.solve(&right);
    let [k1, k2, p1, p2, k3] = fitted.into();
    let lens = Distortion::BrownConrady { k1, k2, p1, p2, k3 };
    let camera = Camera::try_new((start.width_px(), start.height_px()), start.pinhole(), lens)?;
    let Pinhole { fx_px, fy_px, cx_px, cy_px } = start.pinhole();
    let misses = pairs().map(|(ray, shown)| {
        let pixel = camera.pixel_from_ray(ray);
        (pixel.x - fx_px * shown.x - cx_px).hypot(pixel.y - fy_px * shown.y - cy_px)
    });
    let miss_px = misses.fold(0.0, f64::max);
    if miss_px > MAX_MISS_PX { Err(miss(miss_px)) } else { Ok(camera) }
}

/// Rays through a grid of the image, as the plain lens has them.
fn rays(camera: &Camera) -> impl Iterator<Item = RayPoint> {
    let (columns, rows) = FIT_GRID;
    let at = |index: u32, n: u32, size_px: u32| f64::from(index) / f64::from(n - 1) * f64::from(size_px - 1);
    (0..rows * columns).map(move |index| {
        let (x, y) =
            (at(index % columns, columns, camera.width_px()), at(index / columns, rows, camera.height_px()));
        camera.ray_from_pixel(crate::geometry::PixelPoint { x, y })
    })
}

/// What the coefficients k1 k2 p1 p2 k3 of the plain lens are multiplied with, for x and y.
fn terms(RayPoint { x, y }: RayPoint) -> SMatrix<f64, 2, 5> {
    let r2 = x * x + y * y;
    let (r4, xy) = (r2 * r2, 2.0 * x * y);
    SMatrix::<f64, 2, 5>::new(
        x * r2,
        x * r4,
        xy,
        r2 + 2.0 * x * x,
        x * r4 * r2, //
        y * r2,
        y * r4,
        r2 + 2.0 * y * y,
        xy,
        y * r4 * r2,
    )
}

/// Where the modified lens shows a ray: tangential terms at the radially distorted point.
fn modified(RayPoint { x, y }: RayPoint, &[k1, k2, p1, p2, k3]: &[f64; 5]) -> RayPoint {
    let r2 = x * x + y * y;
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let (x, y) = (x * radial, y * radial);
    RayPoint {
        x: x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y: y + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn intrinsics(model: u32, coeffs: [f64; 5]) -> Intrinsics {
        let pinhole = Pinhole { fx_px: 382.0, fy_px: 381.5, cx_px: 321.0, cy_px: 239.0 };
        Intrinsics { size_px: (640, 480), pinhole, model, coeffs }
    }

    /// As a D455 has them, with tangential terms five times as large.
    const WIDE: [f64; 5] = [-0.0565, 0.0682, 0.00183, 0.00346, -0.0218];

    #[test]
    fn an_inverse_lens_shows_rays_where_the_modified_one_does() {
        for model in [1, 2] {
            let camera = camera(&intrinsics(model, WIDE)).expect("a real lens");
            for (x, y) in [(0.0, 0.0), (0.7, 0.5), (-0.7, 0.4), (0.3, -0.55), (-0.8, -0.6)] {
                let ray = RayPoint { x, y };
                let (pixel, shown) = (camera.pixel_from_ray(ray), modified(ray, &WIDE));
                let expected = (382.0 * shown.x + 321.0, 381.5 * shown.y + 239.0);
                let miss_px = (pixel.x - expected.0).hypot(pixel.y - expected.1);
                assert!(miss_px < 0.05, "model {model} misses ({x}, {y}) by {miss_px} px");
            }
        }
    }

    #[test]
    fn without_tangential_terms_the_models_are_one() {
        let radial = [-0.05, 0.06, 0.0, 0.0, -0.02];
        let plain = camera(&intrinsics(4, radial)).expect("plain");
        assert_eq!(camera(&intrinsics(2, radial)), Ok(plain));
        let [k1, k2, p1, p2, k3] = radial;
        assert_eq!(plain.distortion(), Distortion::BrownConrady { k1, k2, p1, p2, k3 });
    }

    #[test]
    fn coefficients_of_zero_are_no_distortion_whatever_the_model() {
        for model in [0, 1, 2, 4] {
            let camera = camera(&intrinsics(model, [0.0; 5])).expect("rectified");
            assert_eq!(camera.distortion(), Distortion::None);
        }
    }

    #[test]
    fn unknown_models_are_refused_with_zero_coefficients_too() {
        for model in [3, 5, 6, u32::MAX] {
            let refused = camera(&intrinsics(model, [0.0; 5]));
            assert!(matches!(refused, Err(LensError::Model { model: found, .. }) if found == model));
        }
        let said = camera(&intrinsics(5, [0.0; 5])).expect_err("fish-eye").to_string();
        assert!(said.contains("kannala_brandt4") && said.contains("inverse_brown_conrady"), "{said}");
    }

    #[test]
    fn coefficients_that_no_lens_has_are_refused() {
        let wild = camera(&intrinsics(2, [0.5, -0.9, 0.3, -0.4, 0.7]));
        assert!(matches!(wild, Err(LensError::Miss { miss_px, .. }) if miss_px > MAX_MISS_PX), "{wild:?}");
        let nan = camera(&intrinsics(2, [f64::NAN, 0.0, 0.0, 0.0, 0.0]));
        assert!(matches!(nan, Err(LensError::Intrinsics(_))), "{nan:?}");
    }
}
