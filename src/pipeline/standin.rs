//! Stand-ins until `image::gray` and `lines::surface` are merged.

use crate::geometry::{PixelPoint, SurfaceSample};
use crate::image::DepthView;

/// Luma of 8-bit RGB (BT.601, in 1/256).
pub(super) fn gray_from_rgb(rgb: &[u8], gray: &mut Vec<u8>) {
    gray.clear();
    gray.extend(rgb.chunks_exact(3).map(|rgb| {
        let [r, g, b] = [u32::from(rgb[0]), u32::from(rgb[1]), u32::from(rgb[2])];
        ((77 * r + 150 * g + 29 * b) >> 8) as u8
    }));
}

/// Depth at every 16th pixel.
pub(super) fn surface_samples(depth: &DepthView<'_>, surface: &mut Vec<SurfaceSample>) {
    surface.clear();
    for y in (8..depth.height()).step_by(16) {
        for x in (8..depth.width()).step_by(16) {
            if let Some(depth_m) = depth.depth_m(x as i64, y as i64) {
                let pixel = PixelPoint { x: x as f64, y: y as f64 };
                surface.push(SurfaceSample { pixel, inverse_depth_per_m: 1.0 / depth_m });
            }
        }
    }
}
