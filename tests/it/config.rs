//! The shipped config files, and what the daemon says about wrong ones.

use std::collections::BTreeSet;
use std::path::Path;

use serde_yaml::Value;

use crate::env::TestEnv;

fn shipped(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config").join(name)
}

/// Every leaf as `dotted.key = value`.
fn leaves(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Mapping(entries) => {
            for (key, value) in entries {
                leaves(value, &format!("{path}.{}", key.as_str().expect("keys are text")), found);
            }
        }
        leaf => {
            found.insert(format!("{path} = {leaf:?}"));
        }
    }
}

fn leaves_of(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    leaves(&serde_yaml::from_str(text).expect("YAML"), "", &mut found);
    found
}

#[test]
fn the_shipped_config_equals_the_defaults_key_for_key() {
    let env = TestEnv::new();
    let defaults = env.write("defaults.yaml", "{}\n");
    let effective =
        env.pelicald(&["--config", defaults.to_str().expect("text"), "--check-config"]).expect_code(0);
    let text = std::fs::read_to_string(shipped("pelicald.yaml")).expect("shipped");
    let (shipped, defaults) = (leaves_of(&text), leaves_of(&effective.stdout));
    let differing: Vec<_> = shipped.symmetric_difference(&defaults).collect();
    assert!(differing.is_empty(), "shipped and default differ in {differing:#?}");
}

#[test]
fn the_shipped_config_explains_every_key() {
    let text = std::fs::read_to_string(shipped("pelicald.yaml")).expect("shipped");
    let mut explained = false;
    for line in text.lines() {
        let is_comment = line.trim_start().starts_with("# ");
        assert!(explained || is_comment || line.trim().is_empty(), "no comment above or beside: {line}");
        explained = is_comment;
    }
}

#[test]
fn every_shipped_config_is_valid() {
    let env = TestEnv::new();
    for file in std::fs::read_dir(shipped("")).expect("shipped") {
        let file = file.expect("listed").path();
        let checked =
            env.pelicald(&["--config", file.to_str().expect("text"), "--check-config"]).expect_code(0);
        assert!(checked.stdout.contains("max_skew_ms:"), "{checked:?}");
    }
}

#[test]
fn a_wrong_config_ends_with_78_and_names_file_line_and_key() {
    let env = TestEnv::new();
    for (text, parts) in [
        ("log:\n  levle: info\n", ["c.yaml:2: log: unknown key `levle`", "`level`"]),
        (
            "cameras:\n  list:\n  - name: a\n    serial: 0123\n",
            ["c.yaml:4: cameras.list[0].serial", "quotes"],
        ),
        ("lines:\n  min_length_px: -5\n", ["c.yaml:2: lines.min_length_px", "10 to 1000"]),
        ("cameras: {backend: replay}\n", ["c.yaml:1: cameras.replay.recording", "folder"]),
        ("log: [\n", ["c.yaml:", "log"]),
        ("log:\n  level: info\n  format: json\n  level: warn\n", ["c.yaml:4: log: this key", "`level`"]),
        ("instance: a\nlog: {}\ninstance: b\n", ["c.yaml:3: this key stands here twice", "`instance`"]),
        ("\"sync\":\n  max_skew_ms: 8\n  'wait_ms' : 0\n", ["c.yaml:3: sync.wait_ms", "1 to 10000"]),
        (
            "cameras:\n  list: [{name: a, serial: \"1\"}, {name: b, serial: 0123}]\n",
            ["list[1].serial", "quotes"],
        ),
        (
            "cameras:\n  list:\n  - name: a\n    \"serial\": 0123\n",
            ["c.yaml:4: cameras.list[0].serial", "quotes"],
        ),
        (
            "cameras: {backend: replay, replay: {recording: \"\"}}\n",
            ["cameras.replay.recording: is empty", "folder"],
        ),
        ("lines: {threads: -1}\n", ["lines.threads", "expected a whole number"]),
        ("log: loud\n", ["c.yaml:1: log: ", ", expected a section of keys with values"]),
    ] {
        env.write("c.yaml", text);
        for arguments in [&["--config", "c.yaml"][..], &["--config", "c.yaml", "--check-config"]] {
            let ended = env.pelicald(arguments).expect_code(78).expect_talk(&parts);
            assert_eq!(ended.stdout, "");
        }
    }
    env.pelicald(&["--config", "none.yaml"]).expect_code(78).expect_talk(&["none.yaml", "cannot read"]);
}

#[test]
fn a_byte_order_mark_is_no_part_of_the_first_key() {
    let env = TestEnv::new();
    env.write("c.yaml", "\u{feff}instance: marked\nlog:\n  level: warn\n");
    let checked = env.pelicald(&["--config", "c.yaml", "--check-config"]).expect_code(0);
    assert!(checked.stdout.contains("instance: marked"), "{}", checked.stdout);
}

#[test]
fn the_client_refuses_a_wrong_config_in_the_same_way() {
    let env = TestEnv::new();
    env.write("c.yaml", "log:\n  levle: info\n");
    for command in [&["calibrate", "."][..], &["evaluate", "."], &["record", "out"], &["devices"]] {
        let arguments = [command, &["--config", "c.yaml"]].concat();
        env.pelical(&arguments).expect_code(78).expect_talk(&["c.yaml:2: log: unknown key"]);
    }
}

#[test]
fn a_wrong_command_line_ends_with_2() {
    let env = TestEnv::new();
    for arguments in [&[][..], &["--check-config"], &["--config"], &["--config", "x", "--frobnicate"]] {
        env.pelicald(arguments).expect_code(2).expect_talk(&["--help"]);
    }
    for arguments in
        [&[][..], &["frobnicate"], &["calibrate"], &["evaluate"], &["status", "--instance", "a/b"]]
    {
        env.pelical(arguments).expect_code(2);
    }
}
