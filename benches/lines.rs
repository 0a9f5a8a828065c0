//! Time per 640 x 480 image of the line stage on one core, beside the segment detector of the crate lsdetect; first checks that the
//! lines are right. `scripts/compare_detectors.py time` adds OpenCV's detector on images from outside.
#![allow(missing_docs, reason = "criterion_group! writes an undocumented function")]
#![allow(clippy::expect_used, reason = "a bench stops at the first wrong answer")]
use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use pelical::capture::synthetic::{SyntheticFactory, SyntheticOptions};
use pelical::capture::{DeviceFactory, RgbdFrame};
use pelical::geometry::camera::Pinhole;
use pelical::geometry::{Camera, Distortion, LineObservation, PixelPoint, Segment};
use pelical::image::{DepthView, GrayView, RgbView, gray_from_rgb};
use pelical::lines::{DetectOptions, Detector, LiftOptions, Lifter};

const SIZE: (usize, usize) = (640, 480);
/// Tiles of the rendered wall, px.
const TILE_PX: f64 = 57.0;
const TILT_RAD: f64 = 0.13;

/// Coordinates in tiles, turned a little so that no edge runs along the pixels.
fn tile(x: f64, y: f64) -> (f64, f64) {
    let (sin, cos) = TILT_RAD.sin_cos();
    ((x * cos + y * sin) / TILE_PX, (y * cos - x * sin) / TILE_PX)
}

/// A wall of tiles of pseudo-random grays with blurred edges and a little noise.
fn render() -> Vec<u8> {
    let gray = |column: f64, row: f64| {
        40.0 + ((column * 127.1 + row * 311.7).sin() * 43758.5453).fract().abs() * 170.0
    };
    let mut noise = 1_u32;
    (0..SIZE.0 * SIZE.1)
        .map(|i| {
            let (u, v) = tile((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let (column, row) = (u.round(), v.round());
            // Share of this tile's light in the pixel along each axis: blur of about half a pixel.
            let blur = |offset: f64| 1.0 / (1.0 + (-(offset * TILE_PX) / 0.35).exp());
            let (a, b) = (blur(u - column), blur(v - row));
            let level = (1.0 - a) * (1.0 - b) * gray(column - 1.0, row - 1.0)
                + a * (1.0 - b) * gray(column, row - 1.0)
                + (1.0 - a) * b * gray(column - 1.0, row)
                + a * b * gray(column, row);
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (level + f64::from(noise >> 24) / 64.0 - 2.0).round().clamp(0.0, 255.0) as u8
        })
        .collect()
}

/// Depth of a plane, mm, and its inverse depth, 1/m.
fn plane_per_m(x: f64, y: f64) -> f64 {
    0.4 + 0.0004 * x + 0.0003 * y
}

/// Every segment lies on an edge between tiles, and most of the edges' length is found.
fn check_segments(segments: &[Segment]) {
    for segment in segments {
        let (u0, v0) = tile(segment.start.x, segment.start.y);
        let (u1, v1) = tile(segment.end.x, segment.end.y);
        let off = |a: f64, b: f64| (a - a.round()).abs().max((b - b.round()).abs()) * TILE_PX;
        let error_px = off(u0, u1).min(off(v0, v1));
        assert!(error_px < 0.5, "{segment:?} is {error_px} px off the tiles' edges");
    }
    let total_px: f64 = segments.iter().map(Segment::length_px).sum();
    let edges_px = 2.0 * (SIZE.0 * SIZE.1) as f64 / TILE_PX;
    assert!(total_px > 0.7 * edges_px, "{total_px} px of {edges_px} px of edges found");
}

fn check_lines(lines: &[LineObservation]) {
    for line in lines {
        let depth = line.depth.expect("full depth everywhere");
        for (inverse_depth_per_m, end) in
            depth.inverse_depth_per_m.into_iter().zip([line.segment.start, line.segment.end])
        {
            let PixelPoint { x, y } = end;
            assert!((inverse_depth_per_m - plane_per_m(x, y)).abs() < 1e-3, "{line:?}");
        }
    }
}

/// All threads of this process on the core it is on: lsdetect uses a thread pool.
fn stay_on_one_core() {
    let mut core = rustix::thread::CpuSet::new();
    core.set(rustix::thread::sched_getcpu());
    rustix::thread::sched_setaffinity(None, &core).expect("a core of its own");
}

/// A furnished room with the noise of a camera.
fn room() -> RgbdFrame {
    let factory = SyntheticFactory::new(SyntheticOptions::pair(40.0, 0.3, 7));
    let serial = factory.list().expect("cameras")[0].serial.clone();
    let mut frame = RgbdFrame::default();
    let mut source = factory.open(&serial).expect("opens");
    source.next_frame(&mut frame, Duration::from_secs(60)).expect("a frame");
    frame
}

/// The detector and lsdetect on one gray image.
fn compare(criterion: &mut Criterion, name: &str, pixels: &[u8]) {
    let image = GrayView::try_new(pixels, SIZE, SIZE.0).expect("fits");
    let (mut detector, mut segments) = (Detector::new(DetectOptions::default()), Vec::new());
    detector.detect(&image, &mut segments);
    let longest_px = segments.first().expect("segments").length_px();
    assert!(segments.len() > 20 && longest_px > 100.0, "{name}: {} segments", segments.len());
    let n = segments.len();
    criterion.bench_function(&format!("detect, {name}, {n} segments"), |bencher| {
        bencher.iter(|| detector.detect(black_box(&image), &mut segments));
    });
    let find = || lsdetect::detect(black_box(pixels), SIZE.0, SIZE.1, lsdetect::SCALE).expect("fits");
    let n =
        find().iter().filter(|segment| segment.length() >= DetectOptions::default().min_length_px).count();
    criterion
        .bench_function(&format!("lsdetect, {name}, {n} segments as long"), |bencher| bencher.iter(find));
}

fn lines(criterion: &mut Criterion) {
    stay_on_one_core();
    let frame = room();
    let mut gray = Vec::new();
    gray_from_rgb(&frame.rgb, &mut gray);
    compare(criterion, "room", &gray);
    compare(criterion, "tiles", &render());
    let (mut detector, mut segments) = (Detector::new(DetectOptions::default()), Vec::new());
    let gray = GrayView::try_new(&gray, SIZE, SIZE.0).expect("fits");
    let rgb = RgbView::try_new(&frame.rgb, SIZE, 3 * SIZE.0).expect("fits");
    criterion.bench_function("detect, room in colour", |bencher| {
        bencher.iter(|| detector.detect_color(black_box(&gray), &rgb, &mut segments));
    });
    lift(criterion);
}

fn lift(criterion: &mut Criterion) {
    let pixels = render();
    let counts: Vec<u16> = (0..SIZE.0 * SIZE.1)
        .map(|i| (1000.0 / plane_per_m((i % SIZE.0) as f64, (i / SIZE.0) as f64)).round() as u16)
        .collect();
    let pinhole = Pinhole { fx_px: 605.0, fy_px: 605.0, cx_px: 320.0, cy_px: 240.0 };
    let camera = Camera::try_new((640, 480), pinhole, Distortion::None).expect("valid intrinsics");
    let image = GrayView::try_new(&pixels, SIZE, SIZE.0).expect("fits");
    let depth = DepthView::try_new(&counts, SIZE, SIZE.0, 0.001).expect("fits");
    let mut segments = Vec::new();
    let (mut lifter, mut lifted) = (Lifter::new(LiftOptions::default()), Vec::new());

    Detector::new(DetectOptions::default()).detect(&image, &mut segments);
    check_segments(&segments);
    lifter.lift(&segments, &depth, &camera, &mut lifted);
    check_lines(&lifted);

    let n = segments.len();
    criterion.bench_function(&format!("lift {n} segments"), |bencher| {
        bencher.iter(|| lifter.lift(black_box(&segments), &depth, &camera, &mut lifted));
    });
}

criterion_group!(benches, lines);
criterion_main!(benches);
