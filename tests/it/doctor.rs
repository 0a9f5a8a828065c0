//! `pelical doctor` from outside: over a made-up system below a folder, and on the machine of the tests.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::env::TestEnv;

fn write(root: &Path, absolute: &str, text: &str) {
    let file = root.join(absolute.trim_start_matches('/'));
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    fs::write(file, text).unwrap();
}

/// A D435i on the bus at so many Mbit/s, with its USB node and nothing else in order.
fn plug_in(root: &Path, speed: &str) {
    let device = "/sys/bus/usb/devices/1-2";
    for (name, text) in
        [("idVendor", "8086"), ("idProduct", "0b3a"), ("speed", speed), ("busnum", "1"), ("devnum", "9")]
    {
        write(root, &format!("{device}/{name}"), text);
    }
    write(root, "/dev/bus/usb/001/009", "");
    write(root, "/etc/passwd", "pelical:x:77002:77002::/:/bin/false\n");
    write(root, "/etc/group", "pelical:x:77002:\n");
}

fn findings<'a>(document: &'a Value, check: &str) -> Vec<&'a Value> {
    document["findings"].as_array().unwrap().iter().filter(|finding| finding["check"] == check).collect()
}

#[test]
fn a_camera_at_usb_2_with_wrong_permissions_and_no_rule_is_told_with_causes_and_cures() {
    let env = TestEnv::new();
    let root = env.path("root");
    plug_in(&root, "480");
    let ended = env.pelical(&["doctor", "--root", "root", "--json"]).expect_code(1);
    let document = ended.json();
    assert_eq!((&document["schema"], &document["grade"]), (&"pelical.doctor/1".into(), &"problem".into()));
    for (check, part) in
        [("usb_speed", "480"), ("permissions", "/dev/bus/usb/001/009"), ("udev_rule", "60-pelical.rules")]
    {
        let found = findings(&document, check);
        assert_eq!(found.len(), 1, "{check}: {document}");
        assert_eq!(found[0]["grade"], "problem", "{}", found[0]);
        assert!(found[0]["finding"].as_str().unwrap().contains(part), "{}", found[0]);
        assert!(
            found[0]["cause"].as_str().unwrap().len() > 10 && found[0]["cure"].as_str().unwrap().len() > 10
        );
    }
    assert!(findings(&document, "daemon").is_empty(), "what runs has nothing to do with that folder");
    let text = env.pelical(&["doctor", "--root", "root"]).expect_code(1).stdout;
    assert!(text.contains("PROBLEM: usb_speed") && text.contains("cure:"), "{text}");
}

#[test]
fn a_root_that_is_not_there_is_told_and_memory_is_no_matter_of_an_image() {
    let env = TestEnv::new();
    for root in ["nowhere", "file"] {
        env.write("file", "");
        let ended = env.pelical(&["doctor", "--root", root]).expect_code(65);
        ended.expect_talk(&[root, "there is no such folder"]);
    }
    std::fs::create_dir(env.path("image")).unwrap();
    let document = env.pelical(&["doctor", "--root", "image", "--json"]).json();
    assert!(findings(&document, "shared_memory").is_empty(), "{document}");
}

#[test]
fn at_usb_3_the_speed_is_fine() {
    let env = TestEnv::new();
    plug_in(&env.path("root"), "5000");
    let document = env.pelical(&["doctor", "--root", "root", "--json"]).json();
    assert_eq!(findings(&document, "usb_speed")[0]["grade"], "ok", "{document}");
}

#[test]
fn the_doctor_looks_at_this_machine_and_its_daemon() {
    let env = TestEnv::new();
    let config = env.config("cameras: {synthetic: {rate_hz: 1}}\n");
    let doctor = || {
        let ended = env.pelical(&["doctor", "--config", "pelicald.yaml", "--json"]);
        let document = ended.json();
        let grade = if document["grade"] == "problem" { 1 } else { 0 };
        ended.expect_code(grade);
        document
    };
    let before = doctor();
    let daemon = findings(&before, "daemon");
    assert!(daemon[0]["grade"] != "ok" && daemon[0]["cure"].is_string(), "{before}");
    for check in [
        "devices",
        "udev_rule",
        "group",
        "shared_memory",
        "clock",
        "unit",
        "versions",
        "config",
        "state_directory",
    ] {
        assert!(!findings(&before, check).is_empty(), "{check}: {before}");
    }
    let running = env.start_daemon(&config);
    env.wait_for_status("an answer", |_| true);
    let after = doctor();
    let told = findings(&after, "daemon")[0]["finding"].as_str().unwrap();
    assert!(told.contains("cameras stream"), "{after}");
    assert_eq!(findings(&after, "shared_memory")[0]["grade"], "ok", "{after}");
    running.signal("TERM");
    running.wait().expect_code(0);
}

#[test]
fn a_wrong_config_is_a_problem_with_its_line() {
    let env = TestEnv::new();
    env.config("sync:\n  max_turn_deg_per_s: 0\n");
    let document = env.pelical(&["doctor", "--config", "pelicald.yaml", "--json"]).expect_code(1).json();
    let config = findings(&document, "config")[0];
    assert_eq!(config["grade"], "problem");
    let cause = config["cause"].as_str().unwrap();
    assert!(
        cause.contains("pelicald.yaml:3: sync.max_turn_deg_per_s: 0") && cause.contains("0.1 to 10000"),
        "{cause}"
    );
}
