//! What a config file may say, and what is said about a wrong one.

mod hostile;

use std::path::Path;

use super::*;

fn refused(text: &str) -> String {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("c.yaml");
    std::fs::write(&file, text).expect("written");
    let message = load(&file).expect_err("the text is wrong").to_string();
    let place = format!("{}/", folder.path().display());
    message.strip_prefix(&place).expect("the file comes first").to_owned()
}

#[track_caller]
fn check_refused(text: &str, parts: &[&str]) {
    let message = refused(text);
    for part in parts {
        assert!(message.contains(part), "{part:?} is not in {message:?}");
    }
}

#[test]
fn an_unknown_key_is_refused_with_those_that_are_known() {
    check_refused(
        "log:\n  level: info\nlines:\n  min_length: 30\n",
        &["c.yaml:4: lines: unknown key `min_length`", "`min_length_px`", "`min_inlier_ratio`"],
    );
    check_refused("# x\nlins: {}\n", &["c.yaml:2: unknown key `lins`", "`lines`", "`sync`"]);
}

#[test]
fn a_wrong_type_is_refused_with_its_key() {
    check_refused("sync:\n  max_skew_ms: fast\n", &["c.yaml:2: sync.max_skew_ms", "expected a number"]);
    check_refused("cameras:\n  synthetic:\n    seed: -1\n", &["c.yaml:3: cameras.synthetic.seed"]);
    check_refused("log:\n  format: xml\n", &["c.yaml:2: log.format", "`human`", "`json`", "`journald`"]);
    check_refused("log: human\n", &["c.yaml:1: log", "expected a section"]);
}

#[test]
fn an_unquoted_serial_is_refused_with_the_reason() {
    for bare in ["123456789012", "012345", "1e5", "0x12", "99999999999999999999999", "-3"] {
        let text = format!("cameras:\n  list:\n    - name: a\n      serial: {bare}\n");
        check_refused(&text, &["c.yaml:4: cameras.list[0].serial", "quotes", "leading zeros"]);
    }
    check_refused(
        "cameras:\n  list: [{name: a, serial: 007}]\n",
        &["c.yaml:2: cameras.list[0].serial", "quotes"],
    );
    let quoted = "cameras:\n  list:\n    - {name: a, serial: \"012345\"}\n    - {name: b, serial: 'f001'}\n    - {name: c, serial: f12}\n";
    let sections = parse(Path::new("c.yaml"), quoted).expect("serials in quotes, or with letters");
    assert_eq!(sections.cameras.list[0].serial.0, "012345");
}

#[test]
fn values_out_of_range_say_line_key_and_range() {
    check_refused(
        "lines:\n  # why\n  min_length_px: 2\n",
        &["c.yaml:3: lines.min_length_px: 2", "10 to 1000"],
    );
    check_refused("estimate:\n  max_baseline_m: .nan\n", &["c.yaml:2: estimate.max_baseline_m: NaN"]);
    check_refused("estimate:\n  max_baseline_m: 5.1\n", &["c.yaml:2: estimate.max_baseline_m: 5.1", "to 5"]);
    check_refused("instance: a/b\n", &["c.yaml:1: instance: ", "a-z, 0-9"]);
    check_refused(
        "sync: {max_skew_ms: 500, stalled_after_ms: 500}\n",
        &["c.yaml:1: sync.max_skew_ms", "below sync.stalled_after_ms"],
    );
    check_refused("watch:\n  min_moved_deg: 0\n", &["c.yaml:2: watch.min_moved_deg: 0", "0.01 to 180"]);
    check_refused("watch: {min_moved_mm: .inf}\n", &["c.yaml:1: watch.min_moved_mm: inf", "0.1 to 10000"]);
    check_refused("watch:\n  on_moved: panic\n", &["c.yaml:2: watch.on_moved", "`report`", "`recalibrate`"]);
    check_refused("cameras:\n  backend: replay\n", &["c.yaml:1: cameras.replay.recording", "folder"]);
}

#[test]
fn the_learned_matcher_is_checked_but_its_files_are_not_looked_for() {
    check_refused("matcher: {threads: 65}\n", &["c.yaml:1: matcher.threads: 65", "0 to 64"]);
    check_refused("matcher:\n  runtime: ''\n", &["c.yaml:2: matcher.runtime", "null"]);
    check_refused("matcher:\n  models: [a.onnx, '']\n", &["c.yaml:2: matcher.models[1]", "model file"]);
    check_refused("matcher:\n  providers: []\n", &["c.yaml:2: matcher.providers", "cpu, cuda and tensorrt"]);
    check_refused("matcher:\n  providers: [cuda, cuda]\n", &["matcher.providers[1]", "twice"]);
    check_refused("matcher:\n  providers: [gpu]\n", &["matcher.providers", "`cpu`", "`cuda`", "`tensorrt`"]);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("c.yaml");
    std::fs::write(&file, "matcher: {runtime: lib/ort.so, models: [a.onnx, /b.onnx]}\n").expect("written");
    let (_, config) = load(&file).expect("valid, though none of these files is there");
    assert_eq!(config.pipeline.associate.learned.runtime, Some(folder.path().join("lib/ort.so")));
    assert_eq!(config.pipeline.associate.learned.models, [folder.path().join("a.onnx"), "/b.onnx".into()]);
}

#[test]
fn moves_of_synthetic_cameras_are_checked() {
    let text = |entry: &str| format!("cameras:\n  synthetic:\n    moves:\n      - {entry}\n");
    let unknown = text("{serial: nobody, at_frame: 1}");
    check_refused(&unknown, &["c.yaml:4: cameras.synthetic.moves[0].serial", "synthetic-01, synthetic-02"]);
    let far = text("{serial: synthetic-01, at_frame: 1, by_mm: [0, 2000, 0]}");
    check_refused(&far, &["c.yaml:4: cameras.synthetic.moves[0].by_mm: 2000", "-1000 to 1000"]);
    let ahead = format!("{}    render_ahead: 3\n", text("{serial: synthetic-01, at_frame: 1}"));
    check_refused(&ahead, &["cameras.synthetic.moves", "render_ahead"]);
    check_refused(&text("{serial: synthetic-01}"), &["missing key `at_frame`"]);
}

#[test]
fn cameras_must_differ_and_the_reference_must_be_one_of_them() {
    let two = |a: &str, b: &str| format!("cameras:\n  list:\n    - {a}\n    - {b}\n  reference: right\n");
    let left = "{name: left, serial: \"1\"}";
    check_refused(&two(left, "{name: left, serial: \"2\"}"), &["c.yaml:4: cameras.list[1].name", "earlier"]);
    check_refused(
        &two(left, "{name: right, serial: \"1\"}"),
        &["c.yaml:4: cameras.list[1].serial", "earlier"],
    );
    check_refused(&two(left, "{name: up, serial: \"2\"}"), &["c.yaml:5: cameras.reference", "left, up"]);
    let nine: String = (0..9).map(|n| format!("    - {{name: c{n}, serial: \"{n}\"}}\n")).collect();
    check_refused(&format!("cameras:\n  list:\n{nine}"), &["c.yaml:2: cameras.list", "at most 8"]);
    check_refused(&two(left, "{name: right}"), &["c.yaml:4: cameras.list[1]", "missing key `serial`"]);
    for bad in ["\"\"", "\"a\\0b\"", "\"two\\nlines\"", "\"123456789012345678901234567890123\""] {
        let camera = format!("{{name: {bad}, serial: \"2\"}}");
        check_refused(&two(left, &camera), &["c.yaml:4: cameras.list[1].name", "32 bytes without control"]);
    }
}

#[test]
fn broken_yaml_and_unreadable_files_are_refused() {
    check_refused("log: [\n", &["c.yaml:"]);
    check_refused("", &["c.yaml:1: the file has no content"]);
    check_refused("instance: a\ninstance: b\n", &["c.yaml:", "twice", "instance"]);
    let message = load(Path::new("no/such.yaml")).expect_err("it is not there").to_string();
    assert!(message.starts_with("no/such.yaml: cannot read"), "{message}");
}

#[test]
fn a_relative_recording_lies_beside_the_config_file() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("c.yaml");
    std::fs::write(&file, "cameras: {backend: replay, replay: {recording: rec}}\n").expect("written");
    let (_, config) = load(&file).expect("valid");
    let BackendConfig::Replay(recording, _) = config.cameras.backend else { panic!("replay was asked for") };
    assert_eq!(recording.0, [folder.path().join("rec")]);
}

#[test]
fn a_recording_is_one_path_or_a_list_of_bags_and_printed_as_such() {
    for (written, paths, printed) in [
        ("rec", vec!["rec"], "recording: rec\n"),
        ("[b.bag, a.bag]", vec!["b.bag", "a.bag"], "recording:\n    - b.bag\n    - a.bag\n"),
    ] {
        let text = format!("cameras: {{backend: replay, replay: {{recording: {written}}}}}\n");
        let file: ConfigFile = serde_yaml::from_str(&text).expect("valid");
        let wanted: Vec<std::path::PathBuf> = paths.into_iter().map(Into::into).collect();
        assert_eq!(file.cameras.replay.recording.0, wanted);
        let effective = serde_yaml::to_string(&file).expect("printable");
        assert!(effective.contains(printed), "{effective}");
        assert_eq!(serde_yaml::from_str::<ConfigFile>(&effective).expect("readable again"), file);
    }
    check_refused(
        "cameras: {backend: replay, replay: {recording: 5}}\n",
        &["c.yaml:1", "a list of .bag files"],
    );
    check_refused("cameras: {backend: replay, replay: {recording: []}}\n", &["is missing"]);
}

#[test]
fn the_defaults_are_valid_and_come_back_from_their_own_text() {
    let defaults = ConfigFile::default();
    let text = serde_yaml::to_string(&defaults).expect("sections can be written");
    assert_eq!(parse(Path::new("c.yaml"), &text).expect("and read"), defaults);
    Config::try_from(&defaults).expect("and are valid");
}
