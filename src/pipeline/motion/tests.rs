use super::*;
use crate::capture::DeviceFactory;
use crate::capture::RgbdFrame;
use crate::capture::synthetic::{Checkerboard, Noise, SyntheticFactory, SyntheticOptions};
use crate::image::GrayView;
use std::time::Duration;

const LIMIT_RAD_PER_S: f64 = 1.0;

fn test() -> MotionTest {
    MotionTest::new(2, MotionOptions { max_turn_rad_per_s: LIMIT_RAD_PER_S })
}

/// Frames of both cameras at a moment, with what their gyros say.
fn set<'a>(
    stamp_ms: i64,
    thumbnails: [&'a Thumbnail; 2],
    gyros: [Option<f64>; 2],
) -> impl Iterator<Item = SeenFrame<'a>> {
    (0..2).map(move |camera| SeenFrame {
        camera,
        stamp: StampNs(stamp_ms * 1_000_000),
        focal_px: 600.0,
        thumbnail: thumbnails[camera],
        turn_rate: gyros[camera].map(|max_rad_per_s| TurnRate { max_rad_per_s }),
    })
}

/// Waves, shifted to the left.
fn waves(shift_px: f64) -> Thumbnail {
    let level = |i: usize| {
        let (x, y) = ((i % 640) as f64 + shift_px, (i / 640) as f64);
        (120.0 + 50.0 * (x / 40.0).sin() + 30.0 * (y / 55.0).cos()).round() as u8
    };
    let pixels: Vec<u8> = (0..640 * 480).map(level).collect();
    Thumbnail::of(&GrayView::try_new(&pixels, (640, 480), 640).expect("whole image"))
}

#[test]
fn the_fastest_gyro_decides() {
    let (mut test, still) = (test(), waves(0.0));
    let turn = test.turn(set(0, [&still; 2], [Some(0.2), Some(1.2)]));
    assert_eq!(turn, Some(Turn { rad_per_s: 1.2, sense: TurnSense::Gyro }));
    assert_eq!(test.refuses(turn), Some(TurnSense::Gyro));
    let turn = test.turn(set(33, [&still; 2], [Some(1.0), Some(0.9)]));
    assert_eq!(test.refuses(turn), None, "at the limit is not beyond it");
}

#[test]
fn a_gyro_that_is_at_rest_is_believed_over_images_that_move() {
    let (mut test, still, moved) = (test(), waves(0.0), waves(30.0));
    test.turn(set(0, [&still; 2], [None, Some(0.0)]));
    let turn = test.turn(set(33, [&moved; 2], [None, Some(0.0)]));
    assert_eq!(turn, Some(Turn { rad_per_s: 0.0, sense: TurnSense::Gyro }));
}

#[test]
fn without_a_gyro_the_fastest_image_decides_also_after_sets_with_one() {
    let (mut test, still, moved) = (test(), waves(0.0), waves(25.0));
    assert_eq!(test.turn(set(0, [&still; 2], [None; 2])), None, "nothing to compare with");
    assert_eq!(test.refuses(None), None);
    let turn = test.turn(set(33, [&still; 2], [None; 2])).expect("images");
    assert_eq!((turn.sense, turn.rad_per_s), (TurnSense::Image, 0.0));
    test.turn(set(66, [&still; 2], [Some(0.0); 2]));
    let turn = test.turn(set(99, [&still, &moved], [Some(f64::NAN), None]));
    assert_eq!(test.refuses(turn), Some(TurnSense::Image), "{turn:?}");
}

#[test]
fn the_same_turn_is_told_for_any_focal_length_and_rate_of_frames() {
    let rate = |(shift_px, gap_ms, focal_px): (f64, i64, f64)| {
        let (mut test, before, after) = (test(), waves(0.0), waves(shift_px));
        let frame = |stamp_ms: i64, thumbnail| SeenFrame {
            focal_px,
            ..set(stamp_ms, [thumbnail; 2], [None; 2]).next().expect("two")
        };
        test.turn(std::iter::once(frame(0, &before)));
        test.turn(std::iter::once(frame(gap_ms, &after))).expect("images").rad_per_s
    };
    let expected = rate((4.0, 33, 600.0));
    for other in [(8.0, 66, 600.0), (2.0, 33, 300.0), (4.0, 66, 300.0)] {
        let found = rate(other);
        assert!((found / expected - 1.0).abs() < 0.1, "{found} instead of {expected} rad/s");
    }
}

/// What gyro and images say of a rendered rig before a board, rad/s, frame by frame.
fn gyro_and_image(view_step: f64) -> Vec<(f64, f64)> {
    let board = Some(Checkerboard { squares: [9, 7], square_m: 0.108 });
    let options = SyntheticOptions::exact_pair(0.0, 0.2, 5);
    let noise = Noise::D435i { disparity_sigma_px: 0.1 };
    let factory =
        SyntheticFactory::new(SyntheticOptions { board, view_step, has_gyro: true, noise, ..options });
    let mut source = factory.open("synthetic-01").expect("there");
    let focal_px = source.info().camera.mean_focal_px();
    let (mut test, mut frame) = (test(), RgbdFrame::default());
    let mut both = Vec::new();
    for _ in 0..8 {
        source.next_frame(&mut frame, Duration::from_secs(5)).expect("a frame");
        let gray: Vec<u8> = frame.rgb.chunks_exact(3).map(|rgb| rgb[1]).collect();
        let view = GrayView::try_new(&gray, (640, 480), 640).expect("whole image");
        let thumbnail = Thumbnail::of(&view);
        let seen =
            SeenFrame { camera: 0, stamp: frame.stamp, focal_px, thumbnail: &thumbnail, turn_rate: None };
        let image = test.turn(std::iter::once(seen));
        both.extend(frame.turn_rate.zip(image).map(|(gyro, image)| (gyro.max_rad_per_s, image.rad_per_s)));
    }
    both
}

#[test]
fn the_images_of_a_rendered_rig_tell_its_turn_rate_to_a_factor_of_two() {
    // Slower than this the rig's shift counts for more than its turn.
    let turns =
        [0.06, 0.12, 0.25].into_iter().flat_map(gyro_and_image).filter(|(gyro, _)| gyro.to_degrees() > 10.0);
    let ratios: Vec<f64> = turns.map(|(gyro, image)| image / gyro).collect();
    assert!(ratios.len() >= 10, "{ratios:?}");
    assert!(ratios.iter().all(|ratio| (0.5..2.0).contains(ratio)), "{ratios:?}");
}

#[test]
fn a_turn_that_leaves_no_image_like_the_one_before_is_still_beyond_the_default_limit() {
    let limit = MotionOptions::default().max_turn_rad_per_s;
    let fast: Vec<_> = gyro_and_image(1.0).into_iter().filter(|(gyro, _)| *gyro > 2.0 * limit).collect();
    assert!(fast.len() >= 3 && fast.iter().all(|(_, image)| *image > limit), "{fast:?}");
}

/// What the images say of a rendered room that is moved by so many pixels sideways between two frames, px.
fn told_px(frame: &RgbdFrame, shift_px: usize) -> f64 {
    let gray: Vec<u8> = frame.rgb.chunks_exact(3).map(|rgb| rgb[1]).collect();
    let cut = |left: usize| {
        let view = GrayView::try_new(&gray[left..], (448, 480), 640).expect("inside the image");
        Glimpse { stamp: StampNs(left as i64 + 1), thumbnail: Thumbnail::of(&view) }
    };
    let (before, after) = (cut(0), Glimpse { stamp: StampNs(1_000_001), ..cut(shift_px) });
    image_speed_px_per_s(&before, &after).expect("a furnished room") * 1e-3
}

#[test]
fn small_shifts_of_a_furnished_room_are_told_to_a_factor_of_two_and_large_ones_never_as_small() {
    let factory = SyntheticFactory::new(SyntheticOptions::pair(20.0, 0.2, 3));
    let mut source = factory.open("synthetic-01").expect("there");
    let mut frame = RgbdFrame::default();
    for _ in 0..4 {
        source.next_frame(&mut frame, Duration::from_secs(5)).expect("a frame");
        for shift_px in [5, 10, 20] {
            let told = told_px(&frame, shift_px);
            assert!((0.5..2.0).contains(&(told / shift_px as f64)), "{told} px instead of {shift_px}");
        }
        // Two cells of these thumbnails.
        assert!([60, 120, 180].iter().all(|shift_px| told_px(&frame, *shift_px) > 34.0));
    }
}
