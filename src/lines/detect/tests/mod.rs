//! Rendered edges with known positions.
mod stability;
mod twin;

use super::*;
use crate::geometry::PixelPoint;

const SIZE: (usize, usize) = (200, 160);

/// splitmix64.
pub struct Random(pub u64);

impl Random {
    pub fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Unit variance, nearly normal.
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// A straight edge: through a point, at an angle; bright on the right hand.
#[derive(Clone, Copy)]
pub struct Edge {
    through: [f64; 2],
    pub angle_rad: f64,
}

impl Edge {
    pub fn at_degrees(angle_deg: f64) -> Self {
        Self { through: [100.3, 79.7], angle_rad: angle_deg.to_radians() }
    }

    /// Distance of a pixel position to the right of the edge, px.
    pub fn right_px(&self, x: f64, y: f64) -> f64 {
        let (sin, cos) = self.angle_rad.sin_cos();
        (y - self.through[1]) * cos - (x - self.through[0]) * sin
    }

    /// Share of light in a pixel at a distance: a blurred step.
    pub fn step(distance_px: f64) -> f64 {
        1.0 / (1.0 + (-distance_px / 0.35).exp())
    }

    pub fn error_px(&self, at: PixelPoint) -> f64 {
        self.right_px(at.x, at.y)
    }
}

pub fn render((width, height): (usize, usize), level: impl FnMut(f64, f64) -> f64) -> Vec<u8> {
    let mut level = level;
    (0..width * height)
        .map(|i| level((i % width) as f64, (i / width) as f64).round().clamp(0.0, 255.0) as u8)
        .collect()
}

pub fn detect(pixels: &[u8], (width, height): (usize, usize)) -> Vec<Segment> {
    let image = GrayView::try_new(pixels, (width, height), width).expect("fits");
    let mut segments = Vec::new();
    Detector::new(DetectOptions::default()).detect(&image, &mut segments);
    segments
}

fn edge_image(edge: Edge, [dark, bright]: [f64; 2]) -> Vec<u8> {
    render(SIZE, |x, y| dark + (bright - dark) * Edge::step(edge.right_px(x, y)))
}

#[test]
fn edges_at_every_angle_are_found_once_to_a_thirtieth_of_a_pixel() {
    for degrees in (0..360).step_by(7) {
        let edge = Edge::at_degrees(f64::from(degrees));
        let segments = detect(&edge_image(edge, [60.0, 160.0]), SIZE);
        assert_eq!(segments.len(), 1, "at {degrees} degrees: {segments:?}");
        let segment = segments[0];
        assert!(segment.length_px() > 140.0, "at {degrees} degrees: {segment:?}");
        for end in [segment.start, segment.end] {
            assert!(edge.error_px(end).abs() < 0.03, "at {degrees} degrees: off by {}", edge.error_px(end));
        }
    }
}

#[test]
fn the_brighter_side_is_on_the_right_hand() {
    for degrees in [0.0_f64, 40.0, 90.0, 135.0, 180.0, 222.0, 270.0, 300.0] {
        let edge = Edge::at_degrees(degrees);
        let segment = detect(&edge_image(edge, [90.0, 110.0]), SIZE)[0];
        let (dx, dy) = (segment.end.x - segment.start.x, segment.end.y - segment.start.y);
        let (sin, cos) = edge.angle_rad.sin_cos();
        assert!(dx * cos + dy * sin > 0.99 * segment.length_px(), "at {degrees} degrees: {segment:?}");
    }
}

#[test]
fn a_gap_is_bridged_and_a_long_one_is_not() {
    for (gap_px, n_expected) in [(20.0, 1), (90.0, 2)] {
        let edge = Edge::at_degrees(12.0);
        // The gap hides the edge behind a gray patch that fades in, without edges of its own.
        let pixels = render(SIZE, |x, y| {
            let hidden = Edge::step((0.5 * gap_px - (x - 100.0).abs()) / 4.0);
            let level = 60.0 + 60.0 * Edge::step(edge.right_px(x, y));
            level + (90.0 - level) * hidden
        });
        let along: Vec<Segment> = detect(&pixels, SIZE)
            .into_iter()
            .filter(|s| edge.error_px(s.start).abs() < 0.5 && edge.error_px(s.end).abs() < 0.5)
            .collect();
        assert_eq!(along.len(), n_expected, "gap of {gap_px} px: {along:?}");
    }
}

#[test]
fn a_thin_bar_has_two_edges_of_opposite_sense() {
    let edge = Edge::at_degrees(25.0);
    let pixels = render(SIZE, |x, y| {
        let right_px = edge.right_px(x, y);
        60.0 + 90.0 * (Edge::step(right_px) - Edge::step(right_px - 6.0))
    });
    let segments = detect(&pixels, SIZE);
    assert_eq!(segments.len(), 2, "{segments:?}");
    let [a, b] = [segments[0], segments[1]].map(|s| (s.end.x - s.start.x) * edge.angle_rad.cos());
    assert!(a * b < 0.0);
}

#[test]
fn moving_the_image_by_a_fraction_of_a_pixel_moves_the_segment_as_much() {
    let place = |shift_px: f64| {
        let mut edge = Edge::at_degrees(0.0);
        edge.through[1] += shift_px;
        detect(&edge_image(edge, [50.0, 120.0]), SIZE)[0].start.y
    };
    let origin = place(0.0);
    for tenths in 1..=10 {
        let shift_px = 0.1 * f64::from(tenths);
        let error_px = place(shift_px) - origin - shift_px;
        assert!(error_px.abs() < 0.02, "shift {shift_px}: {error_px}");
    }
}

#[test]
fn a_weak_edge_under_noise_is_found_whole() {
    let (edge, mut random) = (Edge::at_degrees(33.0), Random(5));
    let pixels = render(SIZE, |x, y| 100.0 + 10.0 * Edge::step(edge.right_px(x, y)) + 1.5 * random.normal());
    let segment = detect(&pixels, SIZE)[0];
    assert!(segment.length_px() > 130.0, "{segment:?}");
    assert!(edge.error_px(segment.start).abs() < 0.4 && edge.error_px(segment.end).abs() < 0.4);
}

#[test]
fn the_stated_deviation_covers_the_errors() {
    let mut random = Random(11);
    let (mut sum, mut n) = (0.0, 0.0);
    for trial in 0..40 {
        let edge = Edge::at_degrees(9.0 * f64::from(trial));
        let pixels =
            render(SIZE, |x, y| 80.0 + 30.0 * Edge::step(edge.right_px(x, y)) + 5.0 * random.normal());
        let segment = detect(&pixels, SIZE)[0];
        for end in [segment.start, segment.end] {
            sum += (edge.error_px(end) / segment.sigma_across_px).powi(2);
            n += 1.0;
        }
        assert!(segment.sigma_across_px < 0.5, "{segment:?}");
    }
    let rms = f64::sqrt(sum / n);
    // Below one because of the floor for what rendering does not show: lens, compression.
    assert!((0.3..1.2).contains(&rms), "errors are {rms} of the stated deviation");
}

#[test]
fn noise_and_blank_images_give_next_to_nothing() {
    let mut random = Random(3);
    for (sigma, n_allowed) in [(2.0, 1), (8.0, 1), (30.0, 3)] {
        let noise = render((320, 240), |_, _| 120.0 + sigma * random.normal());
        let found = detect(&noise, (320, 240));
        assert!(found.len() <= n_allowed, "sigma {sigma}: {} segments", found.len());
    }
    assert!(detect(&[77; 320 * 240], (320, 240)).is_empty());
}

#[test]
fn tiny_and_odd_images_do_no_harm() {
    for size in [(1, 1), (2, 3), (640, 1), (15, 40), (16, 16), (17, 33), (641, 19)] {
        let stripes = render(size, |x, y| if (x + y) as i64 / 5 % 2 == 0 { 30.0 } else { 220.0 });
        for segment in detect(&stripes, size) {
            let inside =
                |p: PixelPoint| p.x >= 0.0 && p.y >= 0.0 && p.x < size.0 as f64 && p.y < size.1 as f64;
            assert!(inside(segment.start) && inside(segment.end), "{size:?}: {segment:?}");
        }
    }
}

#[test]
fn what_was_seen_before_changes_no_bit() {
    let mut random = Random(9);
    let first = edge_image(Edge::at_degrees(70.0), [60.0, 90.0]);
    let second =
        render(SIZE, |x, y| 40.0 * ((x / 9.0).floor() + (y / 11.0).floor()) % 256.0 + random.normal());
    let alone = detect(&second, SIZE);
    let mut detector = Detector::new(DetectOptions::default());
    let mut segments = Vec::new();
    for pixels in [&second, &first, &second] {
        let image = GrayView::try_new(pixels, SIZE, SIZE.0).expect("fits");
        detector.detect(&image, &mut segments);
    }
    assert!(!alone.is_empty());
    assert_eq!(alone, segments);
}

#[test]
fn a_stride_is_no_part_of_the_image() {
    let pixels = edge_image(Edge::at_degrees(15.0), [60.0, 90.0]);
    let padded: Vec<u8> = pixels.chunks(SIZE.0).flat_map(|row| row.iter().copied().chain([255; 7])).collect();
    let image = GrayView::try_new(&padded, SIZE, SIZE.0 + 7).expect("fits");
    let mut segments = Vec::new();
    Detector::new(DetectOptions::default()).detect(&image, &mut segments);
    assert_eq!(segments, detect(&pixels, SIZE));
}

#[test]
fn the_longest_come_first_and_no_more_than_asked_for() {
    let pixels = render(SIZE, |x, y| if (x as i64 / 20 + y as i64 / 40) % 2 == 0 { 50.0 } else { 200.0 });
    let image = GrayView::try_new(&pixels, SIZE, SIZE.0).expect("fits");
    let options = DetectOptions { max_segments: 5, min_length_px: 15.0, ..DetectOptions::default() };
    let mut segments = Vec::new();
    Detector::new(options).detect(&image, &mut segments);
    assert_eq!(segments.len(), 5);
    assert!(segments.is_sorted_by(|a, b| a.length_px() >= b.length_px()));
}
