//! `evaluate --paper` on a grid as small as can be: its document, its files, its text.

use std::path::Path;

use serde_json::Value;

use crate::env::TestEnv;

/// Two configurations in one room, one of them parallel at 30 cm so that the stereo experiment is in it.
const GRID: [&str; 10] =
    ["evaluate", "--paper", "--angles", "20,0", "--distances", "30", "--seeds", "1", "--sets", "8"];

#[track_caller]
fn check_spread(spread: &Value, limit: f64) {
    let [median, worst] = ["median", "worst"].map(|key| spread[key].as_f64().unwrap());
    assert!((0.0..=limit).contains(&worst) && median <= worst, "{spread}");
}

fn check_document(document: &Value) {
    assert_eq!(document["schema"], "pelical.paper/1");
    assert_eq!([&document["trials"], &document["converged"], &document["wrong"]], [2, 2, 0]);
    let configurations = document["configurations"].as_array().unwrap();
    let settings =
        |entry: &Value| (entry["angle_deg"].as_u64().unwrap(), entry["distance_cm"].as_u64().unwrap());
    assert_eq!(configurations.iter().map(settings).collect::<Vec<_>>(), [(0, 30), (20, 30)]);
    for entry in configurations {
        check_spread(&entry["rotation_error_deg"], 0.25);
        check_spread(&entry["translation_error_mm"], 5.0);
        check_spread(&entry["sets_until_converged"], 8.0);
        assert_eq!(entry["trials"][0]["state"], "converged");
    }
    let change = &document["rotation_changes"][0];
    assert_eq!((&change["step_deg"][1], &change["paper_deg"]), (&20.into(), &0.3974.into()));
    check_spread(&change["error_deg"], 0.25);
    let stereo = &document["stereo"][0];
    assert_eq!((&stereo["baseline_cm"], stereo["paper"].as_array().unwrap().len()), (&30.into(), 3));
    for (key, limit) in [("l_mm", 1.0), ("d_mm", 6.0), ("theta_deg", 1.0)] {
        check_spread(&stereo["estimated"][key], limit);
    }
}

/// Every element is closed, in order; text holds no bare sign of markup.
fn check_xml(svg: &str) {
    let mut open: Vec<&str> = Vec::new();
    let mut rest = svg;
    while let Some((text, from_tag)) = rest.split_once('<') {
        assert!(!text.contains('>'), "bare > in {text:?}");
        let (tag, after) = from_tag.split_once('>').expect("a tag without end");
        match tag.strip_prefix('/') {
            Some(closed) => assert_eq!(open.pop(), Some(closed)),
            None if tag.ends_with('/') => assert_eq!(tag.matches('"').count() % 2, 0),
            None => open.push(tag.split(' ').next().unwrap()),
        }
        rest = after;
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "left open: {open:?}");
}

fn check_files(folder: &Path) {
    let svg = std::fs::read_to_string(folder.join("paper-heat-map.svg")).unwrap();
    assert!(svg.starts_with("<svg ") && svg.contains("change of rotation"));
    check_xml(&svg);
    let png = image::open(folder.join("paper-heat-map.png")).unwrap();
    assert!(svg.contains(&format!("width=\"{}\" height=\"{}\"", png.width(), png.height())));
    let page = std::fs::read_to_string(folder.join("paper-experiments.md")).unwrap();
    for part in [
        "pelical evaluate --paper --seeds 1 --sets 8 --angles 0,20 --distances 30",
        "(0.397)",
        "paper: Kalibr",
    ] {
        assert!(page.contains(part), "{part:?} is not in {page}");
    }
}

#[test]
fn a_small_grid_converges_and_writes_its_page() {
    let env = TestEnv::new();
    let ended = env.pelical(&[&GRID[..], &["--json", "--output", "page"]].concat()).expect_code(0);
    let document = ended.json();
    check_document(&document);
    let written = std::fs::read_to_string(env.path("page/paper-experiments.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&written).unwrap(), document);
    check_files(&env.path("page"));
}
