//! Exact depth images with known planes, and seeded noise with the correlations of a stereo camera.
use super::*;
use crate::geometry::{DepthCamera, Distortion, PixelPoint, camera::Pinhole, motion::Motion};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
/// Fine enough that quantisation does not show.
const UNIT_M: f64 = 1e-4;

fn camera() -> Camera {
    let pinhole = Pinhole { fx_px: 605.0, fy_px: 606.0, cx_px: 321.0, cy_px: 242.0 };
    Camera::try_new((WIDTH as u32, HEIGHT as u32), pinhole, Distortion::None).expect("valid intrinsics")
}

fn segment(start: (f64, f64), end: (f64, f64)) -> Segment {
    Segment {
        start: PixelPoint { x: start.0, y: start.1 },
        end: PixelPoint { x: end.0, y: end.1 },
        sigma_across_px: 0.1,
    }
}

/// Depth counts from inverse depth (1/m); zero or less is a hole.
fn depth_image(inverse_depth_per_m: impl Fn(f64, f64) -> f64) -> Vec<u16> {
    let counts = |rho: f64| if rho > 0.0 { (1.0 / (rho * UNIT_M)).round() as u16 } else { 0 };
    (0..WIDTH * HEIGHT).map(|i| counts(inverse_depth_per_m((i % WIDTH) as f64, (i / WIDTH) as f64))).collect()
}

fn lift_one(segment: Segment, counts: &[u16]) -> Option<DepthFit> {
    let depth = DepthView::try_new(counts, (WIDTH, HEIGHT), WIDTH, UNIT_M).expect("fits");
    let mut lines = Vec::new();
    Lifter::new(LiftOptions::default()).lift(&[segment], &depth, &camera(), &mut lines);
    lines[0].depth
}

/// Downwards: the right hand is the image's left.
const DOWN: ((f64, f64), (f64, f64)) = ((300.0, 120.0), (318.0, 300.0));

/// x of the segment `DOWN` at y.
fn edge_x(y: f64) -> f64 {
    300.0 + 0.1 * (y - 120.0)
}

#[test]
fn a_marking_on_a_tilted_plane_has_the_planes_depth_at_its_ends() {
    let plane = |x: f64, y: f64| 0.4 + 0.0005 * x - 0.0004 * y;
    let depth = lift_one(segment(DOWN.0, DOWN.1), &depth_image(plane)).expect("full depth");
    assert_eq!(depth.side, EdgeSide::Both);
    assert!((depth.inverse_depth_per_m[0] - plane(300.0, 120.0)).abs() < 1e-4);
    assert!((depth.inverse_depth_per_m[1] - plane(318.0, 300.0)).abs() < 1e-4);
    assert!(depth.inlier_ratio > 0.99);
}

#[test]
fn the_lifted_line_passes_through_both_ends() {
    let counts = depth_image(|_, y| 0.5 + 0.001 * y);
    let depth = DepthView::try_new(&counts, (WIDTH, HEIGHT), WIDTH, UNIT_M).expect("fits");
    let (camera, mut lines) = (camera(), Vec::new());
    Lifter::new(LiftOptions::default()).lift(&[segment(DOWN.0, DOWN.1)], &depth, &camera, &mut lines);
    let line = lines[0].line().expect("lifted");
    for (x, y) in [DOWN.0, DOWN.1] {
        let point = camera.ray_from_pixel(PixelPoint { x, y }).at_inverse_depth(0.5 + 0.001 * y);
        assert!(line.distance_m(&point) < 1e-3, "{} m off", line.distance_m(&point));
    }
}

#[test]
fn the_nearer_side_owns_a_step_even_where_its_depth_bleeds_over() {
    let near = |y: f64| 0.9 + 0.0005 * y;
    for bleed_px in [0.0, 2.5] {
        // Near on the image's left, which is the right hand of a segment that runs down.
        let step = depth_image(|x, y| if x < edge_x(y) + bleed_px { near(y) } else { 0.4 });
        let depth = lift_one(segment(DOWN.0, DOWN.1), &step).expect("near depth");
        assert_eq!(depth.side, EdgeSide::Right, "bleeding {bleed_px} px");
        assert!((depth.inverse_depth_per_m[0] - near(120.0)).abs() < 2e-4);
        assert!((depth.inverse_depth_per_m[1] - near(300.0)).abs() < 2e-4);
        let turned = lift_one(segment(DOWN.1, DOWN.0), &step).expect("near depth");
        assert_eq!(turned.side, EdgeSide::Left);
    }
}

#[test]
fn a_crease_between_steep_planes_is_lifted_without_bias() {
    let ridge = depth_image(|x, y| 0.7 + 0.0003 * y - 0.002 * (x - edge_x(y)).abs());
    let depth = lift_one(segment(DOWN.0, DOWN.1), &ridge).expect("full depth");
    assert_eq!(depth.side, EdgeSide::Both);
    for (inverse_depth_per_m, y) in depth.inverse_depth_per_m.into_iter().zip([120.0, 300.0]) {
        assert!((inverse_depth_per_m - 0.7 - 0.0003 * y).abs() < 3e-4, "{inverse_depth_per_m} at row {y}");
    }
}

#[test]
fn a_hole_on_one_side_leaves_the_other() {
    let half = depth_image(|x, y| if x > edge_x(y) { 0.6 } else { 0.0 });
    let depth = lift_one(segment(DOWN.0, DOWN.1), &half).expect("one side");
    assert_eq!(depth.side, EdgeSide::Left);
    assert!((depth.inverse_depth_per_m[0] - 0.6).abs() < 1e-4);
}

#[test]
fn too_little_depth_gives_no_line() {
    let down = segment(DOWN.0, DOWN.1);
    assert_eq!(lift_one(down, &depth_image(|_, _| 0.0)), None);
    assert_eq!(lift_one(down, &depth_image(|_, y| if y < 180.0 { 0.6 } else { 0.0 })), None, "a third only");
    let clutter =
        depth_image(|x, y| 0.3 + 0.1 * (((x * 12.9898 + y * 78.233).sin() * 43758.5453).fract() + 1.0));
    assert_eq!(lift_one(down, &clutter), None, "readings that agree on nothing");
}

#[test]
fn strange_segments_are_observed_without_depth() {
    let counts = depth_image(|_, _| 0.5);
    for (start, end) in
        [((9.0, 9.0), (9.0, 9.0)), ((f64::NAN, 0.0), (50.0, 50.0)), ((-500.0, -50.0), (-20.0, -50.0))]
    {
        assert_eq!(lift_one(segment(start, end), &counts), None, "{start:?} {end:?}");
    }
}

#[test]
fn a_distorted_lens_changes_neither_ends_nor_depth() {
    let lens = Distortion::BrownConrady { k1: 0.2, k2: -0.3, p1: 0.001, p2: -0.001, k3: 0.0 };
    let camera = Camera::try_new((WIDTH as u32, HEIGHT as u32), camera().pinhole(), lens).expect("valid");
    let plane = |ray: crate::geometry::RayPoint| 0.6 + 0.3 * ray.x - 0.2 * ray.y;
    let counts = depth_image(|x, y| plane(camera.ray_from_pixel(PixelPoint { x, y })));
    let depth = DepthView::try_new(&counts, (WIDTH, HEIGHT), WIDTH, UNIT_M).expect("fits");
    let mut lines = Vec::new();
    let short = segment((40.0, 30.0), (160.0, 60.0));
    Lifter::new(LiftOptions::default()).lift(&[short], &depth, &camera, &mut lines);
    let lifted = lines[0].depth.expect("full depth").inverse_depth_per_m;
    for (inverse_depth_per_m, ray) in lifted.into_iter().zip(lines[0].ends) {
        assert!((inverse_depth_per_m - plane(ray)).abs() < 1e-3, "{inverse_depth_per_m} at {ray:?}");
    }
}

/// Noise of unit variance with the correlations measured on a D435i model: most of it over 1.8 px, some over 14 px.
fn stereo_noise(seed: u64) -> Vec<f64> {
    let quick = smoothed_noise(seed, 1.8);
    let slow = smoothed_noise(seed + 1, 14.0);
    quick.iter().zip(&slow).map(|(quick, slow)| 0.92 * quick + 0.39 * slow).collect()
}

/// White noise (splitmix64, uniform) through a Gaussian filter, scaled to unit variance.
fn smoothed_noise(seed: u64, sigma_px: f64) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0xD134_2543_DE82_EF95);
    let white = (0..WIDTH * HEIGHT).map(|_| {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        12.0_f64.sqrt() * (((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5)
    });
    let mut image: Vec<f64> = white.collect();
    let reach = (3.0 * sigma_px).ceil() as i64;
    let taps: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma_px).powi(2)).exp()).collect();
    let norm = taps.iter().map(|tap| tap * tap).sum::<f64>().sqrt();
    for (step, length) in [(1, WIDTH), (WIDTH, HEIGHT)] {
        let source = image.clone();
        for (i, value) in image.iter_mut().enumerate() {
            let position = (i / step % length) as i64;
            let base = i as i64 - position * step as i64;
            // The field is wrapped round at the borders.
            let tap = |(k, tap): (i64, &f64)| {
                tap * source[(base + (position + k).rem_euclid(length as i64) * step as i64) as usize]
            };
            *value = (-reach..=reach).zip(&taps).map(tap).sum::<f64>() / norm;
        }
    }
    image
}

/// Mean square of whitened errors (1 where the covariance is honest), over segments all over noisy images.
fn whitened_mean_square(length_px: f64, truth: impl Fn(f64) -> (f64, f64)) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for seed in 0..3 {
        let noise = stereo_noise(100 + 7 * seed);
        let segments: Vec<Segment> = (0..9)
            .flat_map(|row| (0..6).map(move |column| (row, column)))
            .map(|(row, column)| (20.0 + f64::from(column) * 104.0, 30.0 + 50.0 * f64::from(row)))
            .filter(|(x, _)| x + length_px < 630.0)
            .map(|(x, y)| segment((x, y), (x + length_px, y)))
            .collect();
        // Rows repeat every 50 px: `truth` gives inverse depth above and below each edge.
        let counts = depth_image(|x, y| {
            let from_edge_px = (y - 30.0 + 25.0).rem_euclid(50.0) - 25.0;
            let (above, below) = truth(from_edge_px);
            let exact = if from_edge_px < 0.0 { above } else { below };
            exact + 0.0052 * noise[y as usize * WIDTH + x as usize]
        });
        let depth = DepthView::try_new(&counts, (WIDTH, HEIGHT), WIDTH, UNIT_M).expect("fits");
        let mut lines = Vec::new();
        // Without the allowance for systematic errors, which this noise does not have.
        let options = LiftOptions { relative_systematic: 0.0, ..LiftOptions::default() };
        Lifter::new(options).lift(&segments, &depth, &camera(), &mut lines);
        let at_edge = truth(0.0).0.max(truth(0.0).1);
        for line in &lines {
            let depth = line.depth.expect("noise alone loses no line");
            let error = nalgebra::Vector2::from(depth.inverse_depth_per_m.map(|value| value - at_edge));
            let information = depth.covariance_per_m2.try_inverse().expect("positive definite");
            sum += error.dot(&(information * error)) / 2.0;
            n += 1.0;
        }
    }
    sum / n
}

#[test]
fn the_covariance_is_honest_for_markings_creases_and_steps() {
    type Surface = fn(f64) -> (f64, f64);
    let surfaces: [(&str, Surface); 3] = [
        ("marking", |_| (0.5, 0.5)),
        ("crease", |t| (0.5 + 0.003 * t, 0.5 - 0.003 * t)),
        ("step", |t| (0.5, 0.8 + 0.0005 * t)),
    ];
    for length_px in [40.0, 90.0, 240.0] {
        for (name, truth) in surfaces {
            let mean_square = whitened_mean_square(length_px, truth);
            // A scale within 20 %.
            assert!((0.64..1.44).contains(&mean_square), "{name} of {length_px} px: {mean_square}");
        }
    }
}

/// Inverse depth of a step whose near side spreads by `bleed_px`, with holes of `hole_px` behind it.
fn bled_step(near_is_left: bool, bleed_px: f64, hole_px: f64) -> Vec<u16> {
    depth_image(move |x, y| {
        let behind_px = if near_is_left { x - edge_x(y) } else { edge_x(y) - x };
        match behind_px {
            px if px < bleed_px => 0.9 + 0.0005 * y + 0.0008 * px.min(0.0),
            px if px < bleed_px + hole_px => 0.0,
            _ => 0.4,
        }
    })
}

#[test]
fn bleeding_and_holes_along_a_step_do_not_bias_the_nearer_side() {
    for near_is_left in [true, false] {
        for (bleed_px, hole_px) in [(1.0, 0.0), (2.4, 2.0), (4.0, 0.0), (4.0, 3.0)] {
            let depth = lift_one(segment(DOWN.0, DOWN.1), &bled_step(near_is_left, bleed_px, hole_px));
            let case = format!("near on the left {near_is_left}, {bleed_px} px bled, {hole_px} px of holes");
            let depth = depth.expect("near depth");
            // The right hand of a segment that runs down is the image's left.
            assert_eq!(depth.side, if near_is_left { EdgeSide::Right } else { EdgeSide::Left }, "{case}");
            for (inverse_depth_per_m, y) in depth.inverse_depth_per_m.into_iter().zip([120.0, 300.0]) {
                let error = inverse_depth_per_m - 0.9 - 0.0005 * y;
                assert!(error.abs() < 5e-4, "{case}: {error} at row {y}");
            }
        }
    }
}

#[test]
fn a_thin_bar_before_a_wall_is_the_owner_of_its_edges() {
    for (width_px, bleed_px) in [(3.0, 0.0), (3.0, 2.4), (5.0, 1.0), (6.0, 4.0)] {
        let bar = depth_image(|x, y| {
            let px = x - edge_x(y);
            if (-bleed_px..width_px + bleed_px).contains(&px) { 0.9 + 0.0003 * y } else { 0.4 }
        });
        let depth = lift_one(segment(DOWN.0, DOWN.1), &bar).expect("the bar's depth");
        assert_eq!(depth.side, EdgeSide::Left, "{width_px} px wide, {bleed_px} px bled");
        for (inverse_depth_per_m, y) in depth.inverse_depth_per_m.into_iter().zip([120.0, 300.0]) {
            let error = inverse_depth_per_m - 0.9 - 0.0003 * y;
            assert!(error.abs() < 2e-3, "{width_px} px wide, {bleed_px} px bled: {error}");
        }
    }
}

#[test]
fn a_strip_of_depth_between_holes_is_enough() {
    let strip =
        depth_image(|x, y| if (0.0..5.0).contains(&(x - edge_x(y))) { 0.6 + 0.0004 * y } else { 0.0 });
    let depth = lift_one(segment(DOWN.0, DOWN.1), &strip).expect("the strip");
    assert_eq!(depth.side, EdgeSide::Left);
    assert!((depth.inverse_depth_per_m[0] - 0.648).abs() < 1e-3, "{:?}", depth.inverse_depth_per_m);
}

#[test]
fn a_marking_beside_something_nearer_belongs_to_the_wall() {
    // The nearer surface begins four pixels from the edge.
    let beside = depth_image(|x, y| if x < edge_x(y) - 4.0 { 0.8 } else { 0.5 + 0.0002 * y });
    let depth = lift_one(segment(DOWN.0, DOWN.1), &beside).expect("the wall");
    assert_eq!(depth.side, EdgeSide::Both);
    assert!((depth.inverse_depth_per_m[0] - 0.524).abs() < 2e-3, "{:?}", depth.inverse_depth_per_m);
}

#[test]
fn a_surface_that_does_not_reach_the_edge_is_not_taken_for_its_owner() {
    let apart = depth_image(|x, y| if x > edge_x(y) + 3.5 { 0.8 } else { 0.0 });
    assert_eq!(lift_one(segment(DOWN.0, DOWN.1), &apart), None);
}

/// An imager of another size and lens, beside the colour camera and slightly turned.
fn imager() -> DepthCamera {
    let pinhole = Pinhole { fx_px: 390.0, fy_px: 391.0, cx_px: 318.0, cy_px: 238.0 };
    let lens = Distortion::BrownConrady { k1: 0.05, k2: -0.05, p1: 0.0005, p2: 0.0, k3: 0.0 };
    let camera = Camera::try_new((WIDTH as u32, HEIGHT as u32), pinhole, lens).expect("valid intrinsics");
    let turn = nalgebra::UnitQuaternion::from_euler_angles(0.004, -0.006, 0.01);
    DepthCamera { camera, color_from_depth: Motion::from_parts([-0.05, 0.001, 0.002].into(), turn) }
}

/// What the imager sees of a board, 1 m from the colour camera and left of x = 0.05 m, before a tilted wall.
fn unregistered_counts() -> Vec<u16> {
    let imager = imager();
    let origin = imager.color_from_depth * nalgebra::Point3::origin();
    (0..WIDTH * HEIGHT)
        .map(|i| {
            let pixel = PixelPoint { x: (i % WIDTH) as f64, y: (i / WIDTH) as f64 };
            let direction = imager.point_in_color(pixel, 1.0) - origin;
            let to_board = (1.0 - origin.z) / direction.z;
            let to_wall = (2.0 - origin.z - 0.3 * origin.x) / (direction.z + 0.3 * direction.x);
            let depth_m = if origin.x + to_board * direction.x < 0.05 { to_board } else { to_wall };
            (depth_m / UNIT_M).round() as u16
        })
        .collect()
}

fn lift_unregistered(ends: [nalgebra::Point3<f64>; 2], counts: &[u16]) -> Option<DepthFit> {
    let depth = DepthView::try_new(counts, (WIDTH, HEIGHT), WIDTH, UNIT_M).expect("fits");
    let [start, end] = ends.map(|end| camera().project(&end).expect("in front"));
    let mut lines = Vec::new();
    let segment = Segment { start, end, sigma_across_px: 0.1 };
    Lifter::new(LiftOptions::default()).lift(&[segment], &depth.measured_by(imager()), &camera(), &mut lines);
    lines[0].depth
}

#[test]
fn depth_of_an_imager_of_its_own_is_looked_up_through_its_geometry() {
    let counts = unregistered_counts();
    let board = [(0.05, -0.3), (0.05, 0.25)].map(|(x, y)| nalgebra::Point3::new(x, y, 1.0));
    let depth = lift_unregistered(board, &counts).expect("the board");
    // The segment runs down, and the board is on the image's left.
    assert_eq!(depth.side, EdgeSide::Right);
    for inverse_depth_per_m in depth.inverse_depth_per_m {
        assert!((inverse_depth_per_m - 1.0).abs() < 1e-3, "{inverse_depth_per_m}");
    }
    let wall = [(0.4, -0.2), (0.7, 0.3)].map(|(x, y)| nalgebra::Point3::new(x, y, 2.0 - 0.3 * x));
    let depth = lift_unregistered(wall, &counts).expect("the wall");
    assert_eq!(depth.side, EdgeSide::Both);
    for (inverse_depth_per_m, end) in depth.inverse_depth_per_m.into_iter().zip(wall) {
        assert!((inverse_depth_per_m * end.z - 1.0).abs() < 1e-3, "{inverse_depth_per_m} at {end}");
    }
}

#[test]
fn what_only_the_depth_imager_sees_behind_an_edge_is_hidden() {
    // The imager stands on the left: to the right of the board's edge it sees less of the wall than the colour camera; to the
    // left of the edge the colour camera sees the board, whatever the wall's readings land there.
    let counts = unregistered_counts();
    let depth = DepthView::try_new(&counts, (WIDTH, HEIGHT), WIDTH, UNIT_M).expect("fits");
    let mut samples = Vec::new();
    crate::lines::sample_surface(&depth.measured_by(imager()), &camera(), &mut samples);
    assert!(samples.len() > 400, "{} samples", samples.len());
    for sample in &samples {
        let ray = camera().ray_from_pixel(sample.pixel);
        let expected = if ray.x < 0.05 { 1.0 } else { (1.0 + 0.3 * ray.x) / 2.0 };
        assert!((sample.inverse_depth_per_m - expected).abs() < 0.01, "{sample:?}, expected {expected}");
    }
}
