//! Config files of any bytes: refused with the place, or usable.

use std::path::Path;

use crate::service::config::{Config, checked};
use crate::tests::hostile::check_any_bytes;

const FAULTS: &str = "\
instance: robot
cameras:
  backend: synthetic
  synthetic:
    rig: pair
    moves:
      - {serial: synthetic-01, at_frame: 3, by_mm: [1.0, 0.0, 0.0]}
  list:
    - {name: left, serial: \"012345\"}
    - {name: right, serial: \"012346\"}
  reference: right
  faults:
    seed: 3
    list:
      - {serial: \"012345\", fault: stall, at_frame: 90, for_s: 5}
      - {serial: \"012345\", fault: stamp_jump, chance: 0.5, by_ms: -3.5}
";

/// What every config that was accepted promises.
fn is_usable(config: &Config) -> bool {
    let sync = &config.pipeline.sync;
    config.transport.check().is_ok() && !config.hash.is_empty() && sync.stalled_after.as_millis() >= 10
}

#[test]
fn a_config_of_any_bytes_is_refused_with_its_place_or_usable() {
    let whole = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/config/pelicald.yaml"));
    let demo = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/config/demo.yaml"));
    let valid = [whole, demo, FAULTS].map(|text| text.as_bytes().to_vec());
    check_any_bytes("config", &valid, |bytes| {
        let text = String::from_utf8_lossy(bytes);
        match checked(Path::new("c.yaml"), &text) {
            Ok((_, config)) => is_usable(&config) || panic!("accepted, but not usable: {config:?}"),
            Err(error) => {
                let message = error.to_string();
                let line = message.strip_prefix("c.yaml:").and_then(|rest| rest.split(':').next());
                let line: Option<usize> = line.and_then(|line| line.parse().ok());
                let n_lines = text.lines().count().max(1);
                assert!(
                    line.is_some_and(|line| (1..=n_lines + 1).contains(&line)),
                    "no place in {message:?}"
                );
                false
            }
        }
    });
}

#[test]
fn aliases_that_would_fill_the_memory_and_brackets_without_end_are_refused() {
    let mut text = "a: &a [x, x, x, x, x, x, x, x, x, x]\n".to_owned();
    for (from, to) in ('a'..'j').zip('b'..='j') {
        let tenfold = vec![format!("*{from}"); 10].join(", ");
        text += &format!("{to}: &{to} [{tenfold}]\n");
    }
    let error = checked(Path::new("c.yaml"), &text).expect_err("ten billion entries").to_string();
    assert!(error.starts_with("c.yaml:"), "{error}");
    let deep = format!("log: {}{}\n", "[".repeat(100_000), "]".repeat(100_000));
    let error = checked(Path::new("c.yaml"), &deep).expect_err("too deep").to_string();
    assert!(error.starts_with("c.yaml:1:") && error.contains("nested"), "{error}");
}
