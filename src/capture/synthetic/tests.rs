use std::time::Duration;

use nalgebra::{Point3, Vector3};

use super::board::Checkerboard;
use super::noise_picture::NoisePicture;
use super::options::{CameraMove, Noise, Pace, SyntheticOptions};
use super::raycast::Raycaster;
use super::scene::{Builder, FreeSpace, Lamp, Part, Scene, turned};
use super::shade::Shaded;
use super::trajectory::rig_radius_m;
use super::{SyntheticFactory, room, room_of};
use crate::capture::{CaptureError, DeviceFactory, FrameSource, RgbdFrame};
use crate::geometry::camera::Pinhole;
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, Distortion, PixelPoint};

fn pair(noise: Noise, seed: u64) -> SyntheticOptions {
    SyntheticOptions { noise, ..SyntheticOptions::pair(25.0, 0.2, seed) }
}

fn d435i() -> Noise {
    Noise::D435i { disparity_sigma_px: 0.1 }
}

/// The first frames of the camera at this place of the list.
fn frames(options: &SyntheticOptions, camera: usize, count: usize) -> Vec<RgbdFrame> {
    let factory = SyntheticFactory::new(options.clone());
    let serial = factory.list().expect("a list")[camera].serial.clone();
    take(factory.open(&serial).expect("an open camera").as_mut(), count)
}

fn take(source: &mut dyn FrameSource, count: usize) -> Vec<RgbdFrame> {
    (0..count)
        .map(|_| {
            let mut frame = RgbdFrame::default();
            source.next_frame(&mut frame, Duration::from_secs(5)).expect("a frame");
            frame
        })
        .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn depth_of_one_camera_carried_with_the_truth_lies_on_the_depth_of_the_other() {
    let options = pair(Noise::Off, 4);
    let cameras = options.cameras.clone();
    let (left, right) = (frames(&options, 0, 3), frames(&options, 1, 3));
    let right_from_left = cameras[1].reference_from_camera.inverse() * cameras[0].reference_from_camera;
    let mut gaps_m = Vec::new();
    for (left, right) in left.iter().zip(&right) {
        let (from, to) = (left.depth_view().expect("depth"), right.depth_view().expect("depth"));
        for i in (0..left.depth.len()).step_by(7) {
            let (x, y) = ((i % left.width) as i64, (i / left.width) as i64);
            let Some(depth_m) = from.depth_m(x, y) else { continue };
            let ray = cameras[0].info.camera.ray_from_pixel(PixelPoint { x: x as f64, y: y as f64 });
            let point = right_from_left * ray.at_inverse_depth(1.0 / depth_m);
            let Some(pixel) = cameras[1].info.camera.project(&point) else { continue };
            // The nearest pixel is up to half a pixel away, which slanted surfaces show: interpolate.
            if let Some(seen_m) = bilinear_m(&to, pixel) {
                gaps_m.push((seen_m - point.z).abs());
            }
        }
    }
    let common = gaps_m.len();
    let median_m = median(gaps_m);
    assert!(common > 20_000 && median_m < 0.001, "median {median_m} m at {common} points");
}

fn bilinear_m(depth: &crate::image::DepthView<'_>, pixel: PixelPoint) -> Option<f64> {
    let (x, y) = (pixel.x.floor(), pixel.y.floor());
    let (u, v) = (pixel.x - x, pixel.y - y);
    let at = |dx: i64, dy: i64| depth.depth_m(x as i64 + dx, y as i64 + dy);
    let (top, bottom) = (at(0, 0)? * (1.0 - u) + at(1, 0)? * u, at(0, 1)? * (1.0 - u) + at(1, 1)? * u);
    Some(top * (1.0 - v) + bottom * v)
}

/// A room of plain gray with one turned dark box.
fn simple_scene() -> Scene {
    let mut builder = Builder::new(1);
    let grain = super::texture::Grain { contrast: 0.0, per_m: [1.0, 1.0] };
    let bright = builder.material([0.8; 3], super::texture::Pattern::Plain, grain);
    let dark = builder.material([0.0; 3], super::texture::Pattern::Plain, grain);
    let shell = Part { center_m: [2.0, 2.0, 1.25], size_m: [4.0, 4.0, 2.5], material: bright };
    builder.add(&Motion::identity(), shell);
    let cube = Part { center_m: [0.0; 3], size_m: [0.5, 0.4, 0.6], material: dark };
    builder.add(&turned([2.6, 2.1, 1.2], 0.4), cube);
    let lamp = |x: f64| Lamp { at_m: Point3::new(x, 2.0, 2.3), strength: 1.0 };
    let free = FreeSpace { center_m: [2.0; 2], radii_m: [1.0; 2], heights_m: [0.5, 1.5] };
    let lamps = [lamp(1.0), lamp(2.0), lamp(3.0)];
    Scene { blocks: builder.blocks, materials: builder.materials, lamps, noise: NoisePicture::new(1), free }
}

fn camera(distortion: Distortion) -> Camera {
    let pinhole = Pinhole { fx_px: 600.0, fy_px: 604.0, cx_px: 318.3, cy_px: 241.7 };
    Camera::try_new((640, 480), pinhole, distortion).expect("valid intrinsics")
}

/// Looks along +x from one side of the room, rolled a little.
fn world_from_camera() -> Motion {
    let rows = nalgebra::Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0);
    let level = nalgebra::UnitQuaternion::from_matrix(&rows);
    let roll = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.13);
    Motion::from_parts(nalgebra::Translation3::new(0.6, 2.0, 1.3), level * roll)
}

/// Where rows of the image cross the left outline of the dark box, against the projected edge.
#[track_caller]
fn check_edge_in_rows(distortion: Distortion) {
    let (scene, camera, pose) = (simple_scene(), camera(distortion), world_from_camera());
    let mut rays = Raycaster::new(&camera, scene.blocks.len());
    rays.cast(&scene, &pose);
    let mut shaded = Shaded::new(640 * 480, &scene);
    shaded.shade(&scene, &rays);
    let upright = scene.blocks[1].edges_m().filter(|[a, b]| (a.z - b.z).abs() > 0.5);
    // The projected edge that lies furthest to the left is an outline.
    let project = |p: Point3<f64>| camera.project(&pose.inverse_transform_point(&p)).expect("in front");
    let [a, b] = upright.min_by(|a, b| project(a[0]).x.total_cmp(&project(b[0]).x)).expect("four edges");
    let mut gaps_px = Vec::new();
    for step in 5..95 {
        let expected = project(a + (b - a) * (f64::from(step) / 100.0));
        let row = expected.y.round();
        // Carries the place on the edge to the row's height.
        let other = project(a + (b - a) * (f64::from(step) / 100.0 + 1e-4));
        let x = expected.x + (row - expected.y) * (other.x - expected.x) / (other.y - expected.y);
        let line = &shaded.planes[0][row as usize * 640..(row as usize + 1) * 640];
        let from = x.round() as usize - 6;
        // The light on the wall changes evenly.
        let wall =
            |i: usize| f64::from(line[from]) + (i as f64 / 4.0) * f64::from(line[from] - line[from - 4]);
        // Bright up to the edge and black after it: the sum says how far the bright part reaches.
        let bright: f64 = (0..12).map(|i| f64::from(line[from + i]) / wall(i)).sum();
        gaps_px.push(from as f64 - 0.5 + bright - x);
    }
    let worst = gaps_px.iter().fold(0.0f64, |worst, gap| worst.max(gap.abs()));
    let mean = gaps_px.iter().sum::<f64>() / gaps_px.len() as f64;
    let rms = (gaps_px.iter().map(|gap| gap * gap).sum::<f64>() / gaps_px.len() as f64).sqrt();
    let all = format!("worst {worst:.3} px, mean {mean:.4} px, rms {rms:.3} px");
    assert!(worst < 0.1 && mean.abs() < 0.01 && rms < 0.05, "{all}");
}

#[test]
fn an_edge_of_a_box_lies_where_it_projects() {
    check_edge_in_rows(Distortion::None);
}

#[test]
fn an_edge_of_a_box_lies_where_it_projects_through_a_distorting_lens() {
    check_edge_in_rows(Distortion::BrownConrady { k1: 0.12, k2: -0.2, p1: 0.001, p2: -0.0005, k3: 0.0 });
}

#[test]
fn depth_at_the_pixel_centre_is_exact() {
    let (scene, camera, pose) = (simple_scene(), camera(Distortion::None), world_from_camera());
    let mut rays = Raycaster::new(&camera, scene.blocks.len());
    rays.cast(&scene, &pose);
    let eye = Point3::from(pose.translation.vector);
    for i in (0..640 * 480).step_by(101) {
        let [x, y] = rays.rays[i].map(f64::from);
        let direction = pose * Vector3::new(x, y, 1.0);
        let exact_m = scene.first_hit(&eye, &direction).expect("a closed room");
        assert!((f64::from(rays.z_m[i]) - exact_m).abs() < 1e-5, "pixel {i}: {} for {exact_m}", rays.z_m[i]);
    }
}

#[test]
fn depth_noise_at_a_metre_is_five_millimetres_for_a_tenth_of_a_pixel() {
    let (clean, noisy) = (frames(&pair(Noise::Off, 2), 0, 4), frames(&pair(d435i(), 2), 0, 4));
    let mut errors_mm = Vec::new();
    for (clean, noisy) in clean.iter().zip(&noisy) {
        for (z_mm, with_noise_mm) in clean.depth.iter().zip(&noisy.depth) {
            if (800..1300).contains(z_mm) && *with_noise_mm > 0 {
                let z_m = f64::from(*z_mm) / 1000.0;
                // Error of z grows with z².
                errors_mm.push((f64::from(*with_noise_mm) - f64::from(*z_mm)) / (z_m * z_m));
            }
        }
    }
    let count = errors_mm.len();
    let center_mm = median(errors_mm.clone());
    let sigma_mm = 1.4826 * median(errors_mm.iter().map(|e| (e - center_mm).abs()).collect());
    assert!(count > 10_000 && (sigma_mm / 5.2 - 1.0).abs() < 0.3, "sigma {sigma_mm} mm of {count}");
    assert!(center_mm.abs() < 1.0, "bias {center_mm} mm");
}

#[test]
fn depth_has_holes_but_not_too_many() {
    let frames = frames(&pair(d435i(), 3), 1, 4);
    let holes = frames.iter().flat_map(|frame| &frame.depth).filter(|counts| **counts == 0).count();
    let share = holes as f64 / (4.0 * 640.0 * 480.0);
    assert!((0.03..0.3).contains(&share), "holes {share}");
}

#[test]
fn the_same_seed_gives_the_same_bits_and_another_seed_others() {
    let first = frames(&pair(d435i(), 5), 0, 2);
    let (again, other) = (frames(&pair(d435i(), 5), 0, 2), frames(&pair(d435i(), 6), 0, 2));
    for i in 0..2 {
        assert!(first[i].rgb == again[i].rgb && first[i].depth == again[i].depth);
        assert!(first[i].rgb != other[i].rgb && first[i].depth != other[i].depth);
    }
}

#[test]
fn the_order_of_opening_changes_nothing() {
    let factory = SyntheticFactory::new(pair(d435i(), 7));
    let open = |serial: &str| factory.open(serial).expect("an open camera");
    let (mut right, mut left) = (open("synthetic-02"), open("synthetic-01"));
    let right_first = (take(right.as_mut(), 2), take(left.as_mut(), 2));
    let (left, right) = (frames(&pair(d435i(), 7), 0, 2), frames(&pair(d435i(), 7), 1, 2));
    for i in 0..2 {
        assert!(right_first.0[i].rgb == right[i].rgb && right_first.0[i].depth == right[i].depth);
        assert!(right_first.1[i].rgb == left[i].rgb && right_first.1[i].depth == left[i].depth);
    }
}

#[test]
fn no_two_consecutive_views_are_equal() {
    for view_step in [1.0, 0.02] {
        let options = SyntheticOptions { view_step, ..pair(Noise::Off, 8) };
        let frames = frames(&options, 0, 4);
        assert!(frames.windows(2).all(|two| two[0].depth != two[1].depth && two[0].rgb != two[1].rgb));
    }
}

#[test]
fn a_standing_rig_sees_the_same_until_it_steps() {
    let frames = frames(&SyntheticOptions { frames_per_view: 2, ..pair(Noise::Off, 8) }, 0, 4);
    assert!(frames[0].depth == frames[1].depth && frames[2].depth == frames[3].depth);
    assert!(frames[1].depth != frames[2].depth);
}

/// No camera is inside or too close to a block, nor outside the room, anywhere on the path.
#[track_caller]
fn check_path(options: SyntheticOptions) {
    let factory = SyntheticFactory::new(SyntheticOptions { view_step: 0.25, ..options });
    let world = &factory.world;
    for view in 0..600 {
        for camera in 0..world.options.cameras.len() {
            let place = Point3::from(world.world_from_camera(camera, view).translation.vector);
            assert!((0.2..2.1).contains(&place.z), "view {view}: camera {camera} at height {}", place.z);
            for (i, block) in world.scene.blocks.iter().enumerate() {
                let inside = block.world_from_block.inverse_transform_point(&place);
                let gap_m = (0..3).map(|k| inside[k].abs() - block.half_m[k]).fold(f64::MIN, f64::max);
                let clear = if i == 0 { gap_m < -0.15 } else { gap_m > 0.15 };
                assert!(clear, "view {view}: camera {camera} is {gap_m} m from block {i}");
            }
        }
    }
}

#[test]
fn the_demo_rig_never_runs_into_anything() {
    check_path(SyntheticOptions::demo());
}

#[test]
fn pairs_never_run_into_anything() {
    for seed in 0..6 {
        check_path(SyntheticOptions::pair(70.0, 0.15 + 0.15 * seed as f64, seed));
    }
}

#[test]
fn a_larger_rig_gets_a_larger_room() {
    let apart = |x: f64| [Motion::identity(), Motion::translation(x, 0.0, 0.0)];
    let (small, large) = (rig_radius_m(&apart(0.2)), rig_radius_m(&apart(3.0)));
    assert!((small - 0.1).abs() < 1e-12 && (large - 1.5).abs() < 1e-12);
    let width = |radius_m: f64| room::furnished_room(1, radius_m).blocks[0].half_m.x;
    assert!(width(large) > width(small) + 1.0);
}

#[test]
fn frames_rendered_ahead_repeat_with_rising_stamps() {
    let options = SyntheticOptions { render_ahead: Some(2), ..pair(d435i(), 9) };
    let frames = frames(&options, 0, 5);
    assert!(frames[0].rgb == frames[2].rgb && frames[2].depth == frames[4].depth);
    assert!(frames[0].rgb != frames[1].rgb);
    assert!(
        frames.windows(2).all(|two| two[0].stamp < two[1].stamp && two[1].sequence == two[0].sequence + 1)
    );
}

#[test]
fn the_stream_ends_typed_and_stays_ended() {
    let options = SyntheticOptions { frame_sets: Some(1), ..pair(d435i(), 10) };
    let factory = SyntheticFactory::new(options);
    let mut source = factory.open("synthetic-01").expect("an open camera");
    take(source.as_mut(), 1);
    for _ in 0..2 {
        let end = source.next_frame(&mut RgbdFrame::default(), Duration::ZERO);
        assert!(matches!(end, Err(CaptureError::EndOfStream)), "{end:?}");
    }
}

#[test]
fn in_real_time_the_next_frame_is_waited_for() {
    let period = Duration::from_secs(3600);
    let options = SyntheticOptions { pace: Pace::RealTime, period, ..pair(d435i(), 11) };
    let factory = SyntheticFactory::new(options);
    let mut source = factory.open("synthetic-01").expect("an open camera");
    take(source.as_mut(), 1);
    let early = source.next_frame(&mut RgbdFrame::default(), Duration::from_millis(1));
    assert!(matches!(early, Err(CaptureError::Timeout(_))), "{early:?}");
}

#[test]
fn in_real_time_frames_that_nobody_took_are_lost() {
    let period = Duration::from_micros(10);
    let options = SyntheticOptions { pace: Pace::RealTime, period, ..pair(Noise::Off, 12) };
    // Rendering takes far longer than the period.
    let frames = frames(&options, 0, 2);
    assert!(frames[1].sequence > frames[0].sequence + 1);
    assert_eq!(frames[1].stamp.0, frames[1].sequence as i64 * 10_000);
}

#[test]
fn an_unknown_serial_is_told_what_there_is() {
    let error = SyntheticFactory::new(pair(d435i(), 13)).open("7").map(|_| ()).expect_err("no such camera");
    assert!(error.to_string().contains("\"synthetic-01\", \"synthetic-02\""), "{error}");
}

#[test]
fn a_moved_camera_stands_elsewhere_from_its_frame_on_and_the_others_stay() {
    let still = pair(Noise::Off, 4);
    let knock = CameraMove::by((1, 1), [0.02, 0.0, 0.0], [0.0, 3.0, 0.0]);
    let moved = SyntheticOptions { moves: vec![knock.clone()], ..still.clone() };
    let depths = |options, camera| frames(options, camera, 2).into_iter().map(|frame| frame.depth);
    assert!(depths(&moved, 0).eq(depths(&still, 0)), "the other camera sees something else");
    let is_same: Vec<bool> = depths(&still, 1).zip(depths(&moved, 1)).map(|(a, b)| a == b).collect();
    assert_eq!(is_same, [true, false]);
    let factory = SyntheticFactory::new(moved);
    let place = |frame_set| factory.world.world_from_camera(1, frame_set);
    let standing = SyntheticFactory::new(still).world.world_from_camera(1, 5);
    let expected = standing * knock.before_from_after;
    assert!((place(5).to_homogeneous() - expected.to_homogeneous()).amax() < 1e-12);
    let (turn, shift) =
        (knock.before_from_after.rotation.angle(), knock.before_from_after.translation.vector);
    assert!((turn.to_degrees() - 3.0).abs() < 1e-9 && (shift.norm() - 0.02).abs() < 1e-12);
}

#[test]
fn another_noise_seed_changes_the_noise_alone() {
    // Views of a board are planned at once, paths through the room are not.
    let board = Some(Checkerboard { squares: [9, 7], square_m: 0.108 });
    let with = |noise, noise_seed| {
        let options = SyntheticOptions { noise_seed, board, ..pair(noise, 14) };
        frames(&options, 0, 1).remove(0)
    };
    let (first, second) = (with(d435i(), None), with(d435i(), Some(15)));
    assert!(first.rgb != second.rgb && first.depth != second.depth);
    assert!(with(d435i(), Some(14)).rgb == first.rgb, "without its own seed the noise has that of the room");
    assert!(with(Noise::Off, None).rgb == with(Noise::Off, Some(15)).rgb);
}

#[test]
fn rigs_of_different_sizes_can_stand_in_one_room() {
    let blocks = |baseline_m: f64, least_rig_radius_m: f64| {
        let options =
            SyntheticOptions { least_rig_radius_m, ..SyntheticOptions::exact_pair(0.0, baseline_m, 16) };
        let blocks = room_of(&options).blocks;
        blocks.iter().map(|block| (block.world_from_block, block.half_m)).collect::<Vec<_>>()
    };
    assert!(blocks(0.2, 0.225) == blocks(0.45, 0.225));
    assert!(blocks(0.2, 0.0) != blocks(0.45, 0.0));
}

#[test]
fn an_exact_pair_stands_as_protractor_and_ruler_say() {
    let right = SyntheticOptions::exact_pair(40.0, 0.35, 17).cameras[1].reference_from_camera;
    let forward = right * Vector3::z();
    assert!((forward.x.atan2(forward.z).to_degrees() - 40.0).abs() < 1e-9 && forward.y.abs() < 1e-12);
    assert!((right.translation.vector - Vector3::new(0.35, 0.0, 0.0)).norm() < 1e-12);
}

#[test]
fn a_gyro_tells_the_turn_between_two_frames_and_only_where_there_is_one() {
    let board = Some(Checkerboard { squares: [9, 7], square_m: 0.108 });
    let options = SyntheticOptions { board, view_step: 0.1, ..pair(Noise::Off, 18) };
    let rates = |options: &SyntheticOptions| -> Vec<Option<f64>> {
        frames(options, 1, 4).iter().map(|frame| frame.turn_rate.map(|rate| rate.max_rad_per_s)).collect()
    };
    assert_eq!(rates(&options), [None; 4]);
    let with_gyro = SyntheticOptions { has_gyro: true, ..options };
    let world = SyntheticFactory::new(with_gyro.clone()).world;
    let turn = |number: u64| {
        let before_from_after =
            world.world_from_camera(1, number - 1).inv_mul(&world.world_from_camera(1, number));
        before_from_after.rotation.angle() / with_gyro.period.as_secs_f64()
    };
    let found = rates(&with_gyro);
    assert_eq!(found[0], None, "nothing was before the first frame");
    for (number, rate) in (1..).zip(found.iter().skip(1)) {
        let rate = rate.expect("a rate");
        assert!(rate > 0.001 && (rate - turn(number)).abs() < 1e-9, "{rate} instead of {}", turn(number));
    }
}

#[test]
fn frames_repeated_from_memory_have_the_turn_rate_of_what_they_show() {
    let board = Some(Checkerboard { squares: [9, 7], square_m: 0.108 });
    let ahead = SyntheticOptions { board, render_ahead: Some(2), has_gyro: true, ..pair(Noise::Off, 19) };
    let rates =
        frames(&ahead, 0, 5).into_iter().skip(1).map(|frame| frame.turn_rate.expect("a rate").max_rad_per_s);
    let rates: Vec<f64> = rates.collect();
    assert!(rates.iter().all(|rate| *rate > 0.1 && (rate - rates[0]).abs() < 1e-9), "{rates:?}");
}

#[test]
fn an_accelerometer_feels_up_in_the_axes_of_its_camera_and_only_where_there_is_one() {
    let board = Some(Checkerboard { squares: [9, 7], square_m: 0.108 });
    let options = SyntheticOptions { board, ..pair(Noise::Off, 20) };
    assert!(frames(&options, 0, 2).iter().all(|frame| frame.specific_force.is_none()));
    let with_accel = SyntheticOptions { has_accel: true, ..options };
    let right_from_left = with_accel.cameras[1].reference_from_camera.inverse();
    let felt = |camera| frames(&with_accel, camera, 2).remove(1).specific_force.expect("felt").mean_m_per_s2;
    let (left, right) = (felt(0), felt(1));
    assert!((left.norm() - 9.81).abs() < 1e-9 && left.y < -5.0, "y is down: {left}");
    assert!((right_from_left.rotation * left - right).norm() < 1e-9, "{left} {right}");
}
