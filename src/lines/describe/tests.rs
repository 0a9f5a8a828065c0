use super::*;
use crate::geometry::{DepthFit, EdgeSide, PixelPoint, RayPoint, Segment};
use nalgebra::Matrix2;

const SIZE: (usize, usize) = (320, 240);
const FOCAL_PX: f64 = 600.0;

fn picture(colour: impl Fn(f64, f64) -> [u8; 3]) -> Vec<u8> {
    (0..SIZE.0 * SIZE.1).flat_map(|i| colour((i % SIZE.0) as f64, (i / SIZE.0) as f64)).collect()
}

fn line([x0, y0, x1, y1]: [f64; 4], inverse_depth_per_m: Option<f64>) -> LineObservation {
    let [start, end] = [PixelPoint { x: x0, y: y0 }, PixelPoint { x: x1, y: y1 }];
    let ends = [start, end].map(|end| RayPoint { x: end.x / FOCAL_PX, y: end.y / FOCAL_PX });
    let depth = inverse_depth_per_m.map(|inverse_depth_per_m| DepthFit {
        inverse_depth_per_m: [inverse_depth_per_m; 2],
        covariance_per_m2: Matrix2::identity() * 1e-6,
        inlier_ratio: 1.0,
        n_inliers: 100,
        side: EdgeSide::Both,
    });
    let segment = Segment { start, end, sigma_across_px: 0.1 };
    LineObservation { segment, ends, sigma_across: 0.1 / FOCAL_PX, depth }
}

/// Upright at x = 150, brighter side on the right.
fn upright(inverse_depth_per_m: Option<f64>) -> LineObservation {
    line([150.0, 200.0, 150.0, 40.0], inverse_depth_per_m)
}

fn described(pixels: &[u8], line: LineObservation) -> LineDescriptor {
    let image = RgbView::try_new(pixels, SIZE, 3 * SIZE.0).expect("fits");
    let mut looks = Vec::new();
    Describer::new().describe(&image, &[line], &mut looks);
    looks[0]
}

#[test]
fn each_side_sees_its_own_surface_only() {
    let pixels = picture(|x, _| if x < 150.0 { [20, 40, 80] } else { [200, 180, 160] });
    let other = picture(|x, _| if x < 150.0 { [90, 20, 20] } else { [200, 180, 160] });
    let [a, b] = [pixels, other].map(|pixels| described(&pixels, upright(None)));
    assert_eq!(a.whole[1], b.whole[1]);
    assert!(a.whole[0].red_green[0] < -0.3 && b.whole[0].red_green[0] > 0.5, "{a:?} {b:?}");
    assert!(a.whole[0].light[0] < a.whole[1].light[0]);
}

#[test]
fn the_same_surface_looks_the_same_from_twice_as_far() {
    // Stripes along the edge, 12 px wide at 1 m and 6 px at 2 m.
    let stripes = |width_px: f64| {
        picture(move |x, _| if ((x - 150.0) / width_px).rem_euclid(2.0) < 1.0 { [60; 3] } else { [180; 3] })
    };
    let near = described(&stripes(12.0), upright(Some(0.5)));
    let far = described(&stripes(6.0), upright(Some(0.25)));
    let unknown = described(&stripes(6.0), upright(None));
    let gap = |a: &LineDescriptor, b: &LineDescriptor| -> f32 {
        let [a, b] = [a, b].map(|look| look.whole[0].light);
        a.iter().zip(&b).map(|(a, b)| (a - b).abs()).sum()
    };
    assert!(3.0 * gap(&near, &far) < gap(&near, &unknown), "{} {}", gap(&near, &far), gap(&near, &unknown));
}

#[test]
fn exposure_adds_a_constant_to_light_and_nothing_to_colour() {
    // Linear light of 0.4, 0.2, 0.1 and half of it, after the tone curve of sRGB.
    let bright = described(&picture(|_, _| [170, 124, 89]), upright(None));
    let dark = described(&picture(|_, _| [124, 89, 63]), upright(None));
    let half = std::f32::consts::LN_2;
    for band in 0..BANDS {
        let gap = bright.whole[0].light[band] - dark.whole[0].light[band];
        assert!((gap - half).abs() < 0.15, "{gap}");
    }
    assert!((bright.whole[0].red_green[1] - dark.whole[0].red_green[1]).abs() < 0.12);
}

#[test]
fn what_changes_along_the_edge_is_in_its_pieces() {
    let pixels = picture(|_, y| if y < 120.0 { [200; 3] } else { [50; 3] });
    let look = described(&pixels, upright(None));
    let light: Vec<f32> =
        look.pieces[..usize::from(look.n_pieces)].iter().map(|piece| piece[0].light[0]).collect();
    // The edge runs upwards: from the dark half into the bright one.
    assert!(light.len() == MAX_PIECES && light[0] < light[7] - 1.0, "{light:?}");
    assert!(look.whole[0].spread[0] > 0.5 && look.pieces[0][0].spread[0] < 1e-3);
}

#[test]
fn a_side_beyond_the_border_is_not_seen() {
    let pixels = picture(|_, _| [100; 3]);
    let look = described(&pixels, line([0.0, 200.0, 0.0, 40.0], None));
    assert!(look.whole[0].seen < 0.1 && look.whole[1].seen > 0.95, "{look:?}");
}

#[test]
fn what_is_no_line_has_no_looks_and_does_no_harm() {
    let pixels = picture(|_, _| [100; 3]);
    for ends in [[f64::NAN; 4], [50.0; 4], [1e9, 0.0, -1e9, 0.0], [f64::INFINITY, 0.0, 1.0, 1.0]] {
        assert_eq!(described(&pixels, line(ends, Some(0.5))).n_pieces, 0, "{ends:?}");
    }
    for inverse_depth_per_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        described(&pixels, upright(Some(inverse_depth_per_m)));
    }
    let outside = described(&pixels, line([-500.0, 900.0, -400.0, 700.0], None));
    assert_eq!(outside.whole[0].seen, 0.0);
}

#[test]
fn a_second_image_reuses_the_memory() {
    let pixels = picture(|x, y| [x as u8, y as u8, 100]);
    let image = RgbView::try_new(&pixels, SIZE, 3 * SIZE.0).expect("fits");
    let lines = vec![upright(Some(0.5)); 40];
    let (mut describer, mut looks) = (Describer::new(), Vec::new());
    describer.describe(&image, &lines, &mut looks);
    let before = (looks.as_ptr(), looks.capacity(), describer.inverse_depths_per_m.capacity());
    describer.describe(&image, &lines[..30], &mut looks);
    assert_eq!(before, (looks.as_ptr(), looks.capacity(), describer.inverse_depths_per_m.capacity()));
    assert_eq!(looks.len(), 30);
}
