//! The files beside the programs: the unit is accepted by systemd, the udev rules do what they seem to do, and the script that
//! judges evaluations in CI finds what is wrong with one.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use pelical::capture::realsense_models::{MODELS, VENDOR_ID};
use pelical::ipc::Transport;

const RULES: &str = "udev/60-pelical.rules";
const SYSUSERS: &str = "systemd/pelical.sysusers";
const UNIT: &str = "systemd/pelicald.service";

fn shipped(path: &str) -> String {
    let place = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(path);
    fs::read_to_string(&place).unwrap_or_else(|error| panic!("{}: {error}", place.display()))
}

/// What a udev key is followed by when it is compared, and when it is set.
const COMPARE: [&str; 2] = ["==", "!="];
const ASSIGN: [&str; 3] = ["+=", ":=", "="];

/// Key, operator and value of one term of a rule such as `ATTR{idVendor}=="8086"`.
type Term<'a> = (&'a str, &'a str, &'a str);

fn term(text: &str) -> Result<Term<'_>, String> {
    let at = text.find(['=', '!', '+', ':']).ok_or(format!("'{text}' has no operator"))?;
    let (key, rest) = text.split_at(at);
    let operator = COMPARE.iter().chain(&ASSIGN).find(|operator| rest.starts_with(**operator));
    let operator = operator.ok_or(format!("'{text}' has no operator that udev knows"))?;
    let value = rest[operator.len()..].strip_prefix('"').and_then(|value| value.strip_suffix('"'));
    Ok((key, operator, value.ok_or(format!("the value of '{text}' is not in double quotes"))?))
}

/// A key that udev only compares must be compared, one that it only sets must be set; `ENV` may be both.
fn check_term((key, operator, _): Term<'_>) -> Result<(), String> {
    let is_compared = COMPARE.contains(&operator);
    match key.split('{').next().unwrap_or(key) {
        "ACTION" | "SUBSYSTEM" | "KERNEL" | "DRIVER" | "ATTR" | "ATTRS" if is_compared => Ok(()),
        "GROUP" | "MODE" | "TAG" | "RUN" | "GOTO" | "LABEL" if !is_compared => Ok(()),
        "ENV" => Ok(()),
        _ => Err(format!("'{key}{operator}' is not a use of this key that these rules need")),
    }
}

/// Every rule as its terms; errors name the line.
fn parse_rules(text: &str) -> Result<Vec<Vec<Term<'_>>>, String> {
    let mut rules = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        let terms = line.split(", ").map(|text| term(text).and_then(|term| check_term(term).map(|()| term)));
        let terms: Result<Vec<_>, String> = terms.collect();
        rules.push(terms.map_err(|error| format!("line {}: {error}", index + 1))?);
    }
    let values = |name: &str| -> BTreeSet<&str> {
        rules.iter().flatten().filter(|(key, _, _)| *key == name).map(|(_, _, value)| *value).collect()
    };
    match values("GOTO").difference(&values("LABEL")).next() {
        Some(lost) => Err(format!("GOTO=\"{lost}\" has no LABEL")),
        None => Ok(rules),
    }
}

/// The value of the one term of a rule with this key.
fn value_of<'a>(rule: &[Term<'a>], wanted: &str) -> Option<&'a str> {
    rule.iter().find(|(key, _, _)| *key == wanted).map(|(_, _, value)| *value)
}

#[test]
fn the_udev_rules_name_the_models_of_the_table_and_no_others() {
    let text = shipped(RULES);
    let rules = parse_rules(&text).unwrap_or_else(|error| panic!("{RULES}, {error}"));
    let named = rules.iter().filter_map(|rule| {
        Some((
            value_of(rule, "ATTR{idProduct}")?.to_owned(),
            value_of(rule, "ENV{PELICAL_CAMERA}")?.to_owned(),
        ))
    });
    let models = MODELS.iter().map(|model| (format!("{:04x}", model.product_id), model.name.to_owned()));
    assert_eq!(named.collect::<Vec<_>>(), models.collect::<Vec<_>>());
    let with_imu: Vec<String> = MODELS
        .iter()
        .filter(|model| model.has_imu)
        .map(|model| format!("{:04x}", model.product_id))
        .collect();
    let parts: Vec<&str> = rules.iter().filter_map(|rule| value_of(rule, "ATTRS{idProduct}")).collect();
    assert_eq!(parts, vec![with_imu.join("|"); 3], "iio, hidraw and custom sensors");
    let vendors = rules.iter().flatten().filter(|(key, _, _)| key.ends_with("{idVendor}"));
    assert!(vendors.into_iter().all(|(_, _, value)| *value == format!("{VENDOR_ID:04x}")));
}

#[test]
fn every_udev_rule_compares_what_it_should_and_gives_the_camera_to_the_group_alone() {
    let text = shipped(RULES);
    let rules = parse_rules(&text).unwrap_or_else(|error| panic!("{RULES}, {error}"));
    let given: Vec<_> = rules.iter().filter(|rule| value_of(rule, "MODE").is_some()).collect();
    assert_eq!(given.len(), 4, "cameras, and three kinds of IMU nodes");
    for rule in given {
        assert!(
            rule.contains(&("GROUP", "=", "pelical")) && rule.contains(&("MODE", "=", "0660")),
            "{rule:?}"
        );
    }
    let cameras = rules.iter().find(|rule| rule[0] == ("ENV{PELICAL_CAMERA}", "==", "?*"));
    assert!(cameras.expect("one rule for all cameras").contains(&("TAG", "+=", "systemd")));
}

#[test]
fn a_udev_rule_that_sets_what_it_should_compare_is_refused() {
    let good =
        "# a\nSUBSYSTEM!=\"usb\", GOTO=\"end\"\nATTR{idVendor}==\"8086\", MODE=\"0660\"\nLABEL=\"end\"\n";
    assert_eq!(parse_rules(good).map(|rules| rules.len()), Ok(3));
    let bad = [
        good.replace("ATTR{idVendor}==", "ATTR{idVendor}="),
        good.replace("MODE=", "MODE=="),
        good.replace("\"0660\"", "0660"),
        good.replace("LABEL=\"end\"", "LABEL=\"other\""),
        good.replace("MODE", "MOD"),
    ];
    for text in bad {
        assert!(parse_rules(&text).is_err(), "{text}");
    }
}

/// The value of a key that stands once in the unit.
fn value<'a>(unit: &'a str, key: &str) -> &'a str {
    let mut values = unit.lines().filter_map(|line| line.strip_prefix(key)?.strip_prefix('='));
    match (values.next(), values.next()) {
        (Some(value), None) => value,
        (found, _) => {
            panic!("{UNIT}: {key} stands {} once", if found.is_some() { "more than" } else { "not" })
        }
    }
}

#[test]
fn unit_users_rules_and_config_agree_and_a_wrong_config_is_not_tried_again() {
    let unit = shipped(UNIT);
    assert_eq!(value(&unit, "ExecStart"), "/usr/bin/pelicald --config /etc/pelical/pelicald.yaml");
    for key in ["User", "Group", "ConfigurationDirectory", "StateDirectory", "RuntimeDirectory"] {
        assert_eq!(value(&unit, key), "pelical", "{key}");
    }
    assert_eq!(value(&unit, "RuntimeDirectoryMode"), "0750");
    assert_eq!(value(&unit, "Type"), "notify");
    assert!(shipped(SYSUSERS).lines().any(|line| line.starts_with("u pelical ")), "{SYSUSERS}");
    let never_again: BTreeSet<&str> = value(&unit, "RestartPreventExitStatus").split(' ').collect();
    assert_eq!(never_again, BTreeSet::from(["2", "78"]));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("pelicald.yaml");
    fs::write(&file, shipped("config/robot.yaml")).expect("written");
    let (_, config) = pelical::service::config::load(&file).expect("the installed config is valid");
    assert_eq!(config.transport, Transport::files("/run/pelical"));
}

/// How exposed systemd thinks that a unit is, 0 to 10; `None` where systemd is not installed or cannot tell.
fn exposure(unit: &str, folder: &Path) -> Option<f64> {
    let file = folder.join("exposed.service");
    fs::write(&file, unit).expect("a folder that can be written");
    let output = Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--no-pager"])
        .arg(&file)
        .output();
    let said = String::from_utf8_lossy(&output.ok()?.stdout).into_owned();
    said.split("exposure level for").nth(1)?.split_whitespace().nth(1)?.parse().ok()
}

#[test]
fn the_unit_is_hardly_exposed_and_says_why_what_is_missing_is_missing() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let unit = shipped(UNIT);
    for missing in ["PrivateDevices=", "PrivateNetwork=", "RootDirectory=", "DynamicUser=", "~@resources"] {
        let is_explained = unit.lines().any(|line| line.starts_with('#') && line.contains(missing));
        assert!(is_explained, "{missing} is not there, and no comment says why");
    }
    let Some(found) = exposure(&unit, folder.path()) else {
        println!("systemd-analyze is not installed, or too old: the exposure is not known");
        return;
    };
    assert!(found <= 1.5, "{found}");
    let open = unit.replace("SystemCallFilter", "#SystemCallFilter");
    assert!(
        exposure(&open, folder.path()).is_some_and(|open| open > found + 1.0),
        "the figure does not depend on the unit"
    );
}

/// What systemd has against a unit; `None` where systemd is not installed.
fn objections(unit: &str, folder: &Path) -> Option<String> {
    let file = folder.join("pelicald.service");
    fs::write(&file, unit).expect("a folder that can be written");
    let output = match Command::new("systemd-analyze").args(["verify", "--man=no"]).arg(&file).output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return None,
        other => other.expect("systemd-analyze starts"),
    };
    // Older releases only print what they do not know, and exit with 0.
    let said =
        format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    Some(if output.status.success() { said } else { format!("{} {said}", output.status) })
}

#[test]
fn systemd_accepts_the_unit_and_would_say_what_is_wrong_with_it() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    // The program of this build in place of the installed one, which systemd would miss.
    let unit = shipped(UNIT).replace("/usr/bin/pelicald", env!("CARGO_BIN_EXE_pelicald"));
    let Some(said) = objections(&unit, folder.path()) else {
        println!("systemd-analyze is not installed: the unit is not verified");
        return;
    };
    assert_eq!(said, "");
    let misspelt = unit.replace("ProtectHome=", "ProtectHom=");
    assert_ne!(objections(&misspelt, folder.path()).as_deref(), Some(""));
}

/// Exit code of the script that judges a document; `None` where Python is not installed.
fn judged(document: &serde_json::Value, folder: &Path) -> Option<i32> {
    let file = folder.join("document.json");
    fs::write(&file, document.to_string()).expect("a folder that can be written");
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scripts/check_evaluation.py");
    match Command::new("python3").arg(script).arg(&file).output() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => None,
        other => other.expect("python3 starts").status.code(),
    }
}

/// A calibration of two cameras that is off by this much.
fn calibration(state: &str, rotation_error_deg: f64) -> serde_json::Value {
    let reason = (state != "converged").then(|| serde_json::json!({"code": "no_lines", "sentence": "none"}));
    serde_json::json!({
        "schema": "pelical.calibration/1", "state": state, "reason": reason,
        "frame_sets": {"seen": 5, "used": 5, "refused": 0}, "timing_ms": {"total": 2000.0},
        "truth": [{"camera": "b", "rotation_error_deg": rotation_error_deg, "translation_error_mm": 3.0}]
    })
}

/// An evaluation of the recordings that must converge and one more.
fn evaluation(other: &serde_json::Value, must_converge: &serde_json::Value) -> serde_json::Value {
    let names = ["office101_yaw00_b20", "lab105_stereo_near_b30", "living102_yaw60_b30_long"];
    let names = names.into_iter().chain(["kitchen103_yaw80_b45_long"]);
    let mut recordings: Vec<_> = names
        .map(|name| serde_json::json!({"path": format!("sim/{name}"), "calibration": must_converge}))
        .collect();
    recordings.push(serde_json::json!({"path": "sim/other", "calibration": other}));
    serde_json::json!({"schema": "pelical.evaluation/1", "recordings": recordings, "converged": 5, "wrong": 0})
}

#[test]
fn the_judge_of_evaluations_refuses_what_is_wrong_and_takes_what_is_honest() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (good, off, open) =
        (calibration("converged", 0.1), calibration("converged", 0.6), calibration("ambiguous", 9.0));
    let mut mute = open.clone();
    mute["reason"] = serde_json::Value::Null;
    let cases = [
        (good.clone(), 0, "a demo within its limits"),
        (off.clone(), 1, "a demo that is off"),
        (open.clone(), 1, "a demo without a result"),
        (evaluation(&good, &good), 0, "all converged"),
        (evaluation(&open, &good), 0, "one not converged, with a reason"),
        (evaluation(&mute, &good), 1, "one not converged, without a reason"),
        (evaluation(&off, &good), 1, "one converged and wrong"),
        (evaluation(&good, &open), 1, "those not converged that must"),
    ];
    for (document, wanted, what) in &cases {
        match judged(document, folder.path()) {
            None => return println!("python3 is not installed: the script is not tried"),
            code => assert_eq!(code, Some(*wanted), "{what}"),
        }
    }
}
