//! The same scene seen under other light, noise, compression, blur, size and colour: the same segments, where they are.
use image::ImageEncoder;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};

use super::*;
use crate::geometry::PixelPoint;
use crate::image::gray_from_rgb;

const VGA: (usize, usize) = (640, 480);

/// Light of a wall of tiles, 0 to 1, turned by 0.13 rad; tiles of this size, px.
fn tiles(tile_px: f64) -> impl Fn(f64, f64) -> f64 {
    let gray = |column: f64, row: f64| ((column * 127.1 + row * 311.7).sin() * 43758.5453).fract().abs();
    move |x, y| {
        let (sin, cos) = 0.13_f64.sin_cos();
        let (u, v) = ((x * cos + y * sin) / tile_px, (y * cos - x * sin) / tile_px);
        let share = |offset: f64| 1.0 / (1.0 + (-(offset * tile_px) / 0.35).exp());
        let (a, b) = (share(u - u.round()), share(v - v.round()));
        let (column, row) = (u.round(), v.round());
        (1.0 - a) * (1.0 - b) * gray(column - 1.0, row - 1.0)
            + a * (1.0 - b) * gray(column, row - 1.0)
            + (1.0 - a) * b * gray(column - 1.0, row)
            + a * b * gray(column, row)
    }
}

fn exposed(size: (usize, usize), gain: f64, sigma: f64) -> Vec<u8> {
    let (light, mut random) = (tiles(57.0), Random(31));
    render(size, |x, y| 30.0 + gain * light(x, y) + sigma * random.normal())
}

fn jpeg(pixels: &[u8], size: (usize, usize), quality: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, quality)
        .write_image(pixels, size.0 as u32, size.1 as u32, ExtendedColorType::L8)
        .expect("encodes");
    let decoded = image::load_from_memory_with_format(&bytes, ImageFormat::Jpeg).expect("decodes");
    decoded.into_luma8().into_raw()
}

/// Share of the length of `before` that `after` has within half a pixel and in the same sense.
fn repeated(before: &[Segment], after: &[Segment]) -> f64 {
    let covered = |segment: &Segment, at: PixelPoint| {
        let (dx, dy) = (segment.end.x - segment.start.x, segment.end.y - segment.start.y);
        let length_px = segment.length_px();
        let along = ((at.x - segment.start.x) * dx + (at.y - segment.start.y) * dy) / length_px;
        let across = ((at.y - segment.start.y) * dx - (at.x - segment.start.x) * dy) / length_px;
        across.abs() < 0.5 && (-2.0..length_px + 2.0).contains(&along)
    };
    let (mut found, mut all) = (0.0, 0.0);
    for segment in before {
        for step in 0..segment.length_px() as usize {
            let share = step as f64 / segment.length_px();
            let at = |a: f64, b: f64| a + share * (b - a);
            let point =
                PixelPoint { x: at(segment.start.x, segment.end.x), y: at(segment.start.y, segment.end.y) };
            let same_sense = |other: &Segment| {
                (other.end.x - other.start.x) * (segment.end.x - segment.start.x)
                    + (other.end.y - other.start.y) * (segment.end.y - segment.start.y)
                    > 0.0
            };
            all += 1.0;
            found += f64::from(u8::from(after.iter().any(|s| same_sense(s) && covered(s, point))));
        }
    }
    found / all
}

#[test]
fn noise_exposure_and_jpeg_leave_the_segments_where_they_are() {
    let clean = detect(&exposed(VGA, 170.0, 0.0), VGA);
    assert!(clean.len() > 60, "{} segments", clean.len());
    let noisy = exposed(VGA, 170.0, 3.0);
    let others = [
        ("noise", noisy.clone(), 0.95),
        ("half the light", exposed(VGA, 85.0, 0.0), 0.93),
        ("half the light and noise", exposed(VGA, 85.0, 1.5), 0.9),
        ("jpeg 90", jpeg(&exposed(VGA, 170.0, 0.0), VGA, 90), 0.95),
        ("noise and jpeg 75", jpeg(&noisy, VGA, 75), 0.9),
    ];
    for (what, pixels, least) in others {
        let segments = detect(&pixels, VGA);
        let shares = [repeated(&clean, &segments), repeated(&segments, &clean)];
        assert!(shares.iter().all(|share| *share > least), "{what}: {shares:?} of the length");
    }
}

#[test]
fn small_and_large_images_show_their_edges() {
    for size in [(424, 240), (848, 480), (1280, 720)] {
        let segments = detect(&exposed(size, 170.0, 2.0), size);
        let total_px: f64 = segments.iter().map(Segment::length_px).sum();
        let edges_px = 2.0 * (size.0 * size.1) as f64 / 57.0;
        assert!(
            total_px > 0.7 * edges_px && total_px < 1.02 * edges_px,
            "{size:?}: {total_px} of {edges_px} px"
        );
    }
}

#[test]
fn blur_and_jpeg_move_an_edge_by_less_than_a_twentieth_of_a_pixel() {
    let size = (200, 160);
    for degrees in [3.0, 21.0, 45.0, 68.0, 90.0] {
        let edge = Edge::at_degrees(degrees);
        // The logistic's scale: 0.35 is what a sharp lens shows, 1 is out of focus.
        for softness in [0.25, 0.5, 1.0] {
            let pixels = render(size, |x, y| 60.0 + 90.0 * Edge::step(edge.right_px(x, y) * 0.35 / softness));
            for pixels in [jpeg(&pixels, size, 90), pixels] {
                let segments = detect(&pixels, size);
                assert_eq!(segments.len(), 1, "at {degrees} degrees, softness {softness}: {segments:?}");
                let error_px = 0.5 * (edge.error_px(segments[0].start) + edge.error_px(segments[0].end));
                assert!(
                    error_px.abs() < 0.05,
                    "at {degrees} degrees, softness {softness}: {error_px} px off"
                );
            }
        }
    }
}

#[test]
fn thin_lines_and_sharpened_edges_have_no_doubles() {
    let size = (200, 160);
    for degrees in [7.0, 33.0, 80.0] {
        let edge = Edge::at_degrees(degrees);
        for width_px in [1.5, 2.0, 3.0, 4.0] {
            let pixels = render(size, |x, y| {
                let right_px = edge.right_px(x, y);
                70.0 + 90.0 * (Edge::step(right_px) - Edge::step(right_px - width_px))
            });
            let segments = detect(&pixels, size);
            assert_eq!(segments.len(), 2, "a line {width_px} px wide at {degrees} degrees: {segments:?}");
        }
        // Unsharp mask: both sides overshoot by a tenth of the step, and fall back over two pixels.
        let pixels = render(size, |x, y| {
            let right_px = edge.right_px(x, y);
            let overshoot =
                right_px.signum() * (-right_px.abs() / 2.0).exp() * (1.0 - (-right_px.powi(2)).exp());
            60.0 + 100.0 * (Edge::step(right_px) + 0.1 * overshoot)
        });
        let segments = detect(&pixels, size);
        let same_sense = segments.iter().filter(|s| edge.error_px(s.start).abs() < 4.0).count();
        assert_eq!(same_sense, segments.len());
        assert!(edge.error_px(segments[0].start).abs() < 0.05 && segments.len() <= 3, "{segments:?}");
    }
}

/// Two colours that are equally bright, the first on the right hand.
fn two_colours(edge: Edge, [right, left]: [[f64; 3]; 2], size: (usize, usize)) -> Vec<u8> {
    let planes = [0, 1, 2]
        .map(|k| render(size, |x, y| left[k] + (right[k] - left[k]) * Edge::step(edge.right_px(x, y))));
    (0..size.0 * size.1).flat_map(|i| [planes[0][i], planes[1][i], planes[2][i]]).collect()
}

fn detect_colour(rgb: &[u8], size: (usize, usize)) -> Vec<Segment> {
    let mut gray = Vec::new();
    gray_from_rgb(rgb, &mut gray);
    let gray = GrayView::try_new(&gray, size, size.0).expect("fits");
    let rgb = RgbView::try_new(rgb, size, 3 * size.0).expect("fits");
    let mut segments = Vec::new();
    Detector::new(DetectOptions::default()).detect_color(&gray, &rgb, &mut segments);
    segments
}

#[test]
fn an_edge_between_colours_that_are_equally_bright_is_found_where_it_is() {
    let size = (201, 161);
    // Red and green, then blue and yellow; the redder or bluer one on the right hand.
    let pairs = [[[160.0, 80.0, 90.0], [90.0, 116.0, 90.0]], [[110.0, 110.0, 200.0], [118.0, 122.0, 100.0]]];
    for colours in pairs {
        for degrees in [4.0, 30.0, 77.0, 120.0, 200.0, 290.0] {
            let edge = Edge::at_degrees(degrees);
            let rgb = two_colours(edge, colours, size);
            let mut gray = Vec::new();
            gray_from_rgb(&rgb, &mut gray);
            assert!(detect(&gray, size).is_empty(), "gray shows it");
            let segments = detect_colour(&rgb, size);
            assert_eq!(segments.len(), 1, "{colours:?} at {degrees} degrees: {segments:?}");
            let Segment { start, end, .. } = segments[0];
            let (sin, cos) = edge.angle_rad.sin_cos();
            assert!((end.x - start.x) * cos + (end.y - start.y) * sin > 120.0, "{segments:?}");
            for end in [start, end] {
                assert!(edge.error_px(end).abs() < 0.15, "{degrees} degrees: {} px off", edge.error_px(end));
            }
        }
    }
}

#[test]
fn where_gray_shows_an_edge_colour_changes_nothing() {
    let size = (200, 160);
    let edge = Edge::at_degrees(40.0);
    let rgb = two_colours(edge, [[200.0, 170.0, 120.0], [90.0, 60.0, 50.0]], size);
    let mut gray = Vec::new();
    gray_from_rgb(&rgb, &mut gray);
    assert_eq!(detect_colour(&rgb, size), detect(&gray, size));
    assert_eq!(detect(&gray, size).len(), 1);
}
