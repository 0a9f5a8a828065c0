//! The scalar twins of the vectorised loops: one pixel at a time, written plainly. What they give is the same to the last bit, and all
//! else in the detector is common to both, so the segments are the same.
use super::{Random, render};
use crate::geometry::PixelPoint;
use crate::image::GrayView;
use crate::lines::detect::gradient::{BORDER_PX, COUNTS_PER_LEVEL, Gradient};
use crate::lines::detect::samples::{LANES, Scan};
use crate::lines::detect::track::Track;

const SIZE: (usize, usize) = (83, 61);

/// Tiles with noise: edges of all strengths, saturated pixels, plain places.
fn pixels(random: &mut Random) -> Vec<u8> {
    let (period, noise) = (9.0 + 20.0 * random.uniform(), 6.0 * random.uniform());
    let turn = random.uniform();
    render(SIZE, |x, y| {
        let (u, v) = (x + turn * y, y - turn * x);
        let level = ((u / period).floor() * 83.0 + (v / period).floor() * 131.0).rem_euclid(290.0);
        level - 20.0 + noise * random.normal()
    })
}

fn scalar_gradient(image: &GrayView<'_>) -> (Vec<[i16; 2]>, Vec<i16>) {
    let (width, height) = SIZE;
    let binomial = [1, 4, 6, 4, 1];
    let pixel = |x: usize, y: usize| i32::from(image.row(y)[x]);
    let smooth = |x: usize, y: usize| {
        let taps = (0..25).map(|i| binomial[i % 5] * binomial[i / 5] * pixel(x + i % 5 - 2, y + i / 5 - 2));
        taps.sum::<i32>() >> 4
    };
    let (mut vector, mut magnitude) = (vec![[0; 2]; width * height], vec![0; width * height]);
    for y in BORDER_PX..height - BORDER_PX {
        for x in BORDER_PX..width - BORDER_PX {
            let at = |dx: usize, dy: usize| smooth(x + dx - 1, y + dy - 1);
            let gx = at(2, 0) + 2 * at(2, 1) + at(2, 2) - at(0, 0) - 2 * at(0, 1) - at(0, 2);
            let gy = at(0, 2) + 2 * at(1, 2) + at(2, 2) - at(0, 0) - 2 * at(1, 0) - at(2, 0);
            vector[y * width + x] = [gx as i16, gy as i16];
            magnitude[y * width + x] = (gx.abs() + gy.abs()) as i16;
        }
    }
    (vector, magnitude)
}

/// `u, v, weight, sharpness` of one column as bits; `None` where it does not show the edge.
fn scalar_sample(gradient: &Gradient, track: &Track, u: i64) -> Option<[u32; 4]> {
    let size = if track.along_x { SIZE } else { (SIZE.1, SIZE.0) };
    let predicted = track.offset as f32 + track.slope as f32 * u as f32;
    let rounded = predicted + 0.5;
    let margin = BORDER_PX as i64 + 2;
    let inside = u >= BORDER_PX as i64 && u < size.0 as i64 - BORDER_PX as i64;
    if !inside || rounded < margin as f32 || rounded > (size.1 as i64 - 1 - margin) as f32 {
        return None;
    }
    let [dx, dy] = track.direction();
    let (normal_x, normal_y) = (-dy as f32, dx as f32);
    let vector = |v: i64| {
        let (x, y) = if track.along_x { (u, v) } else { (v, u) };
        gradient.vector[y as usize * SIZE.0 + x as usize].map(f32::from)
    };
    let along_normal = |v: i64| vector(v)[0] * normal_x + vector(v)[1] * normal_y;
    let middle = rounded as i64;
    let [before, here, after] = [-1, 0, 1].map(|step| along_normal(middle + step));
    let top = if after > here && after >= before { middle + 1 } else { middle - i64::from(before > here) };
    let [before, peak, after] = [-1, 0, 1].map(|step| along_normal(top + step));
    let [gx, gy] = vector(top);
    if peak < 0.8 * COUNTS_PER_LEVEL as f32 || before > peak || after > peak {
        return None;
    }
    if peak * peak < 0.927 * 0.927 * (gx * gx + gy * gy) {
        return None;
    }
    let curvature = before - (peak + peak) + after;
    let parabola = if curvature < 0.0 { 0.5 * (before - after) / curvature } else { 0.0 };
    let offset = parabola + 0.5 * parabola * (0.25 - parabola * parabola).max(0.0);
    let v = middle as f32 + ((top - middle) as f32 + offset);
    let noise = 0.4 * COUNTS_PER_LEVEL as f32;
    let weight = peak * peak / (0.01 * (peak * peak) + noise * noise);
    let is_near = (v - predicted).abs() <= track.stretch() as f32;
    is_near.then(|| [u as f32, v, weight, -curvature / peak].map(f32::to_bits))
}

#[test]
fn the_gradient_is_that_of_one_pixel_at_a_time() {
    let mut random = Random(21);
    for _ in 0..3 {
        let pixels = pixels(&mut random);
        let image = GrayView::try_new(&pixels, SIZE, SIZE.0).expect("fits");
        let mut gradient = Gradient::default();
        gradient.compute(&image);
        assert_eq!((gradient.vector, gradient.magnitude), scalar_gradient(&image));
    }
}

#[test]
fn eight_columns_together_show_what_one_at_a_time_shows() {
    let mut random = Random(22);
    let (mut n_found, mut n_missing) = (0, 0);
    for _ in 0..6 {
        let pixels = pixels(&mut random);
        let mut gradient = Gradient::default();
        gradient.compute(&GrayView::try_new(&pixels, SIZE, SIZE.0).expect("fits"));
        for _ in 0..200 {
            let mut point =
                || PixelPoint { x: random.uniform() * SIZE.0 as f64, y: random.uniform() * SIZE.1 as f64 };
            let track = Track::through(point(), point());
            let scan = Scan::new(&gradient, &track);
            for first in (-5..100).step_by(LANES) {
                let sampled = scan.sample(first);
                for lane in 0..LANES {
                    let expected = scalar_sample(&gradient, &track, first + lane as i64);
                    assert_eq!(sampled.bits(lane), expected, "{track:?} at {}", first + lane as i64);
                    n_found += usize::from(expected.is_some());
                    n_missing += usize::from(expected.is_none());
                }
            }
        }
    }
    assert!(n_found > 1_000 && n_missing > 1_000, "{n_found} found, {n_missing} missing");
}
