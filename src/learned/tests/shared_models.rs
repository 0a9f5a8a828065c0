//! XFeat with LighterGlue against the Python reference (scripts/line_samples.py), where the models are beside the checkout.

use super::*;

/// `PELICAL_TEST_MODELS` names the folder of the two models.
fn shared_options() -> Option<LearnedOptions> {
    let Some(folder) = std::env::var_os("PELICAL_TEST_MODELS").map(PathBuf::from) else {
        println!("SKIPPED: PELICAL_TEST_MODELS does not name the folder of the models");
        return None;
    };
    options(&["xfeat_dense_f16.onnx", "lighterglue_f16.onnx"].map(|name| folder.join(name)))
}

const SIZE: (usize, usize) = (200, 150);
/// Left, top, right, bottom and gray level.
const BOXES: [[usize; 5]; 5] = [
    [20, 25, 90, 70, 210],
    [60, 50, 150, 120, 30],
    [110, 15, 185, 60, 160],
    [30, 90, 75, 140, 120],
    [160, 80, 195, 145, 235],
];

fn boxes(which: usize) -> Vec<u8> {
    let level = |x: usize, y: usize| {
        let (x, y) = (x + 9 * which, y + 4 * which);
        let inside = |b: &&[usize; 5]| (b[0]..b[2]).contains(&x) && (b[1]..b[3]).contains(&y);
        let box_level = BOXES.iter().rfind(inside).map(|b| b[4] + (x * y) % 11);
        box_level.unwrap_or(60 + x / 4 + y / 3) as u8
    };
    (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| level(x, y))).collect()
}

#[test]
fn line_samples_score_as_the_python_reference_does() {
    let Some(options) = shared_options() else { return };
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/xfeat_lighterglue.json");
    let text = std::fs::read_to_string(file).expect("a committed file");
    let document: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let read = |value: &serde_json::Value| -> Vec<Vec<f64>> {
        serde_json::from_value(value.clone()).expect("rows of numbers")
    };
    let segments = [0, 1].map(|which| {
        let ends = read(&document["segments"][which]);
        ends.iter().map(|ends| segment([ends[0], ends[1], ends[2], ends[3]])).collect::<Vec<_>>()
    });
    let mut matcher = LearnedMatcher::load(&options).expect("the models fit");
    let features = [0, 1].map(|which| {
        let pixels = boxes(which);
        let image = GrayView::try_new(&pixels, SIZE, SIZE.0).expect("as long as its size");
        matcher.image_features(&image).expect("the model runs")
    });
    let (target, source) = ((&features[0], &segments[0][..]), (&features[1], &segments[1][..]));
    let found = matcher.scores(target, source).expect("the models run");
    let wanted: Vec<f64> = read(&document["scores"]).concat();
    assert_eq!(found.values.len(), wanted.len());
    for (&found, wanted) in found.values.iter().zip(wanted) {
        assert!((f64::from(found) - wanted).abs() < 1e-3, "{found} is not {wanted}");
    }
    // Every side of a box is found again, in the other order that the second image has them in.
    let matches = matcher.score_lines(target, source).expect("the models run");
    for line in 0..segments[0].len() as u32 {
        let of_line = matches.iter().filter(|found| found.target == line);
        let best = of_line.max_by(|a, b| a.nats.total_cmp(&b.nats)).expect("every side has a candidate");
        assert_eq!(best.source, segments[1].len() as u32 - 1 - line);
        assert!(best.nats > 3.0, "{best:?}");
    }
}
