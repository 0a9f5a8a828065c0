//! A coarse picture of the surfaces a camera sees: one inverse depth per cell, only where the cell lies on one surface.
use crate::geometry::{Camera, DepthCamera, PixelPoint, SurfaceSample};
use crate::image::DepthView;

/// Cells along x and along y.
const CELLS: [i64; 2] = [40, 30];
/// Side of the window read in a cell, px; small, so that few windows lie on a depth edge.
const WINDOW_PX: i64 = 5;
/// Readings of a window.
const N_WINDOW: usize = (WINDOW_PX * WINDOW_PX) as usize;
/// Least readings of a window.
const MIN_READINGS: usize = 15;
/// Largest spread of a window's middle four fifths: stereo noise (1/m) and, as a share, a tilted surface.
const MAX_SPREAD_PER_M: f64 = 0.02;
const MAX_SPREAD_RELATIVE: f64 = 0.03;

/// Replaces `samples` by the median inverse depths on a grid over the image of `camera`, row by row.
pub fn sample_surface(depth: &DepthView<'_>, camera: &Camera, samples: &mut Vec<SurfaceSample>) {
    samples.clear();
    samples.reserve((CELLS[0] * CELLS[1]) as usize);
    let (width, height) = (depth.width() as i64, depth.height() as i64);
    for row in 0..CELLS[1] {
        let y = (2 * row + 1) * height / (2 * CELLS[1]);
        for column in 0..CELLS[0] {
            let x = (2 * column + 1) * width / (2 * CELLS[0]);
            let Some(inverse_depth_per_m) = window_median(depth, (x, y)) else { continue };
            let pixel = PixelPoint { x: x as f64, y: y as f64 };
            samples.extend(match depth.imager() {
                None => Some(SurfaceSample { pixel, inverse_depth_per_m }),
                Some(imager) => carried(depth, (camera, imager), (pixel, inverse_depth_per_m)),
            });
        }
    }
}

/// Steps on the way from a point to the colour camera; the way crosses few tens of pixels of the depth image.
const STEPS: usize = 24;
/// The way is behind a surface where that is nearer by this share.
const HIDDEN_SHARE: f64 = 0.05;

/// What a depth pixel shows, in the colour image; `None` outside of it and where something nearer hides it from the colour camera.
fn carried(
    depth: &DepthView<'_>,
    (camera, imager): (&Camera, &DepthCamera),
    (pixel, inverse_depth_per_m): (PixelPoint, f64),
) -> Option<SurfaceSample> {
    let point = imager.point_in_color(pixel, 1.0 / inverse_depth_per_m);
    let in_color = camera.project(&point).filter(|pixel| camera.contains(*pixel, 0.0))?;
    let depth_from_color = imager.color_from_depth.inverse();
    let is_behind = |share: f64| {
        let on_way = depth_from_color * nalgebra::Point3::from(point.coords * share);
        let Some(PixelPoint { x, y }) = imager.camera.project(&on_way) else { return false };
        let seen_m = depth.depth_m(x.round() as i64, y.round() as i64);
        seen_m.is_some_and(|seen_m| seen_m < (1.0 - HIDDEN_SHARE) * on_way.z)
    };
    // Equal steps in inverse depth are about equal steps in the image; four times nearer is near enough.
    let is_hidden = (1..=STEPS).any(|step| is_behind(1.0 / (1.0 + 3.0 * step as f64 / STEPS as f64)));
    (!is_hidden).then(|| SurfaceSample { pixel: in_color, inverse_depth_per_m: 1.0 / point.z })
}

/// Median inverse depth of the window around a pixel; `None` with holes or on a depth edge.
fn window_median(depth: &DepthView<'_>, (x, y): (i64, i64)) -> Option<f64> {
    let mut depths_m = [0.0; N_WINDOW];
    let mut n = 0;
    let half = WINDOW_PX / 2;
    for v in y - half..=y + half {
        for u in x - half..=x + half {
            if let Some(depth_m) = depth.depth_m(u, v) {
                depths_m[n] = depth_m;
                n += 1;
            }
        }
    }
    if n < MIN_READINGS {
        return None;
    }
    let depths_m = &mut depths_m[..n];
    depths_m.sort_unstable_by(f64::total_cmp);
    let [near, middle, far] = [n / 10, n / 2, n - 1 - n / 10].map(|idx| 1.0 / depths_m[idx]);
    (near - far <= MAX_SPREAD_PER_M + MAX_SPREAD_RELATIVE * middle).then_some(middle)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Distortion, camera::Pinhole};

    fn camera() -> Camera {
        let pinhole = Pinhole { fx_px: 600.0, fy_px: 600.0, cx_px: 320.0, cy_px: 240.0 };
        Camera::try_new((640, 480), pinhole, Distortion::None).expect("valid intrinsics")
    }

    #[test]
    fn a_step_is_sampled_on_both_sides_but_not_across() {
        let counts: Vec<u16> = (0..640 * 480).map(|i| if i % 640 < 200 { 1000 } else { 2000 }).collect();
        let depth = DepthView::try_new(&counts, (640, 480), 640, 0.001).expect("fits");
        let mut samples = Vec::new();
        sample_surface(&depth, &camera(), &mut samples);
        assert!(samples.len() > 1100, "{} samples", samples.len());
        for sample in &samples {
            let expected = if sample.pixel.x < 200.0 { 1.0 } else { 0.5 };
            assert!((sample.inverse_depth_per_m - expected).abs() < 1e-9, "{sample:?}");
        }
    }

    #[test]
    fn holes_give_no_sample_and_the_second_frame_no_allocation() {
        let counts = vec![0; 640 * 480];
        let depth = DepthView::try_new(&counts, (640, 480), 640, 0.001).expect("fits");
        let mut samples = Vec::new();
        sample_surface(&depth, &camera(), &mut samples);
        let before = (samples.as_ptr(), samples.capacity());
        sample_surface(&depth, &camera(), &mut samples);
        assert!(samples.is_empty() && (samples.as_ptr(), samples.capacity()) == before);
    }
}
