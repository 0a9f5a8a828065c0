//! The matcher on tiny models (scripts/tiny_models.py) against scores computed by hand there, and what is said of wrong models.
//!
//! Whatever runs a model needs the library of ONNX Runtime: `ORT_DYLIB_PATH` says where it is. Without it these tests say that
//! they did nothing, unless `PELICAL_TEST_ONNX=required`.

mod parts;
mod refused;
mod shared_models;

use std::path::{Path, PathBuf};

use super::*;
use crate::geometry::PixelPoint;

/// Options with these model files, where there is a runtime to run them; `None` says that the test was skipped.
fn options(models: &[PathBuf]) -> Option<LearnedOptions> {
    let runtime = std::env::var_os("ORT_DYLIB_PATH").map(PathBuf::from);
    let is_required = std::env::var_os("PELICAL_TEST_ONNX").is_some_and(|value| value == "required");
    assert!(runtime.is_some() || !is_required, "ORT_DYLIB_PATH must name the library of ONNX Runtime");
    if runtime.is_none() {
        println!("SKIPPED: ORT_DYLIB_PATH does not name the library of ONNX Runtime");
    }
    Some(LearnedOptions { runtime: Some(runtime?), models: models.to_vec(), ..LearnedOptions::default() })
}

fn tiny(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/learned").join(name)
}

fn tiny_options(names: &[&str]) -> Option<LearnedOptions> {
    options(&names.iter().map(|name| tiny(name)).collect::<Vec<_>>())
}

const SIZE: (usize, usize) = (64, 40);

/// The images of the script: the second is the first, seen from 6 px further right.
fn image(which: usize) -> Vec<u8> {
    let level = |x: usize, y: usize| {
        let x = x + 6 * which;
        ((3 * x * x + 5 * y * y + 7 * x * y) / 16 + 40 * ((x / 9 + y / 7) % 2)) % 256
    };
    (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| level(x, y) as u8)).collect()
}

fn view(pixels: &[u8]) -> GrayView<'_> {
    GrayView::try_new(pixels, SIZE, SIZE.0).expect("as long as its size")
}

fn segment([x, y, to_x, to_y]: [f64; 4]) -> Segment {
    let (start, end) = (PixelPoint { x, y }, PixelPoint { x: to_x, y: to_y });
    Segment { start, end, sigma_across_px: 0.1 }
}

/// What the script computed.
struct Golden {
    segments: [Vec<Segment>; 2],
    scores: serde_json::Value,
}

fn golden() -> Golden {
    let text = std::fs::read_to_string(tiny("golden.json")).expect("a committed file");
    let mut document: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let segments: [Vec<[f64; 4]>; 2] =
        serde_json::from_value(document["segments"].take()).expect("two lists of segments");
    let segments = segments.map(|segments| segments.into_iter().map(segment).collect());
    Golden { segments, scores: document["scores"].take() }
}

/// Scores of the two images of the script by these models.
fn scores(options: &LearnedOptions, segments: &[Vec<Segment>; 2]) -> Result<Scores, LearnedError> {
    let mut matcher = LearnedMatcher::load(options)?;
    let mut features = Vec::new();
    for which in 0..2 {
        features.push(matcher.image_features(&view(&image(which)))?);
    }
    matcher.scores((&features[0], &segments[0]), (&features[1], &segments[1]))
}

#[track_caller]
fn check_golden(models: &[&str], name: &str) {
    let Some(options) = tiny_options(models) else { return };
    let golden = golden();
    let found = scores(&options, &golden.segments).expect("the models fit");
    let wanted: Vec<Vec<f32>> = serde_json::from_value(golden.scores[name].clone()).expect("a matrix");
    assert_eq!((found.target.len(), found.source.len()), (wanted.len(), wanted[0].len()));
    for (found, wanted) in found.values.iter().zip(wanted.iter().flatten()) {
        assert!((found - wanted).abs() < 1e-4, "{models:?}: {found} is not {wanted}");
    }
}

#[test]
fn descriptors_alone_are_aligned_along_the_lines_as_by_hand() {
    check_golden(&["dense.onnx"], "dense");
}

#[test]
fn a_model_of_fixed_size_in_three_channels_sees_the_same() {
    check_golden(&["dense_rgb_fixed.onnx"], "dense");
}

#[test]
fn line_samples_are_assigned_and_pooled_as_by_hand() {
    check_golden(&["dense.onnx", "glue.onnx"], "glue");
    check_golden(&["glue.onnx", "dense.onnx"], "glue");
}

#[test]
fn a_model_of_whole_pairs_gets_both_images_and_their_lines() {
    check_golden(&["lines.onnx"], "lines");
}

#[test]
fn a_wireframe_model_gets_merged_junctions_and_their_descriptors() {
    check_golden(&["dense.onnx", "wireframe.onnx"], "wireframe");
}

#[test]
fn lines_that_run_the_other_way_score_the_same() {
    for models in [&["dense.onnx"][..], &["dense.onnx", "glue.onnx"], &["dense.onnx", "wireframe.onnx"]] {
        let Some(options) = tiny_options(models) else { return };
        let mut segments = golden().segments;
        let there = scores(&options, &segments).expect("the models fit");
        for segment in &mut segments[1] {
            (segment.start, segment.end) = (segment.end, segment.start);
        }
        let back = scores(&options, &segments).expect("the models fit");
        for (there, back) in there.values.iter().zip(&back.values) {
            assert!((there - back).abs() < 1e-4, "{models:?}: {there} became {back}");
        }
    }
}

#[test]
fn the_same_image_gives_the_same_bits_and_serves_any_number_of_pairs() {
    let Some(options) = tiny_options(&["dense.onnx", "glue.onnx"]) else { return };
    let mut matcher = LearnedMatcher::load(&options).expect("the models fit");
    let [target, source] = golden().segments;
    let [first, second] = [0, 1].map(image);
    let features =
        [&first, &second].map(|pixels| matcher.image_features(&view(pixels)).expect("the model runs"));
    let mut score =
        || matcher.score_lines((&features[0], &target), (&features[1], &source)).expect("the models run");
    assert_eq!(score(), score());
}

#[test]
fn segments_outside_the_image_or_without_numbers_are_no_error() {
    for models in [&["dense.onnx"][..], &["dense.onnx", "glue.onnx"], &["dense.onnx", "wireframe.onnx"]] {
        let Some(options) = tiny_options(models) else { return };
        let mut segments = golden().segments;
        segments[0].push(segment([-50.0, 1e6, 400.0, -1e9]));
        segments[1].push(segment([f64::NAN, 3.0, 20.0, f64::INFINITY]));
        scores(&options, &segments).expect("scored or not, but no error");
    }
}

#[test]
fn images_without_lines_have_no_matches() {
    for models in [
        &["dense.onnx"][..],
        &["dense.onnx", "glue.onnx"],
        &["lines.onnx"],
        &["dense.onnx", "wireframe.onnx"],
    ] {
        let Some(options) = tiny_options(models) else { return };
        let [target, source] = golden().segments;
        for segments in [[vec![], source], [target, vec![]], [vec![], vec![]]] {
            let found = scores(&options, &segments).expect("nothing to compare is no error");
            assert!(found.values.is_empty(), "{models:?}");
        }
    }
}

#[test]
fn features_of_another_matcher_are_refused() {
    let Some(map) = tiny_options(&["dense.onnx", "glue.onnx"]) else { return };
    let Some(whole) = tiny_options(&["lines.onnx"]) else { return };
    let [mut map, mut whole] = [map, whole].map(|options| LearnedMatcher::load(&options).expect("it fits"));
    let [target, source] = golden().segments;
    let pixels = image(0);
    let seen = map.image_features(&view(&pixels)).expect("the model runs");
    let picture = whole.image_features(&view(&pixels)).expect("nothing is run");
    for result in [
        whole.score_lines((&seen, &target), (&seen, &source)),
        map.score_lines((&picture, &target), (&picture, &source)),
    ] {
        let message = result.expect_err("these features are of the other matcher").to_string();
        assert!(message.contains("another matcher"), "{message}");
    }
}
