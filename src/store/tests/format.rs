use proptest::prelude::*;

use super::*;

#[test]
fn what_was_written_is_read_to_the_bit() {
    for id in 1..40 {
        let text = encode(&stored(id)).expect("sound");
        assert_eq!(decode(text.as_bytes()), Ok(stored(id)));
    }
}

#[test]
fn a_file_is_yaml_that_people_can_read() {
    let text = encode(&stored(4)).expect("sound");
    let value: serde_yaml::Value = serde_yaml::from_str(&text).expect("YAML, the first line a comment");
    assert_eq!(value["cameras"][0]["name"].as_str(), Some("left"));
    assert_eq!(value["cameras"][0]["serial"].as_str(), Some("0123"), "text, not a number");
    assert_eq!(value["cameras"][1]["firmware"].as_str(), Some("5.16.0.1"));
    assert_eq!(value["pairs"][0]["line_residuals"].as_sequence().map(Vec::len), Some(4));
    assert_eq!(value["restored"]["from"].as_u64(), Some(1));
}

#[test]
fn a_file_that_ends_too_early_is_refused_wherever_it_ends() {
    let text = encode(&stored(1)).expect("sound");
    for length in 0..text.len() {
        decode(&text.as_bytes()[..length]).expect_err("torn");
    }
    let longer = format!("{text}\n");
    assert!(matches!(decode(longer.as_bytes()), Err(FormatError::Length { .. })));
    // Some file systems leave zeros where data never came.
    let mut zeros = text.clone().into_bytes();
    let half = zeros.len() / 2;
    zeros[half..].fill(0);
    assert_eq!(decode(&zeros), Err(FormatError::Checksum));
}

/// A text with the right head for any body.
fn with_head(body: &str) -> String {
    format!("# pelical.stored/1 bytes={} sha256={}\n{body}", body.len(), sha256_hex(body.as_bytes()))
}

#[track_caller]
fn check_refused(from: &str, to: &str, expected: &str) {
    let text = encode(&stored(1)).expect("sound");
    let (_, body) = text.split_once('\n').expect("lines");
    assert!(body.contains(from), "{from} is not in {body}");
    let error = decode(with_head(&body.replacen(from, to, 1)).as_bytes()).expect_err(expected);
    assert!(matches!(&error, FormatError::Content(what) if what.contains(expected)), "{error}");
}

#[test]
fn a_right_checksum_over_nonsense_is_refused_by_the_name_of_the_key() {
    check_refused("reference: left", "reference: nobody", "\"nobody\" is not among the cameras");
    check_refused("name: left", "name: '- top #'", "stands there twice");
    check_refused("state: ambiguous", "state: stored", "unknown name \"stored\"");
    check_refused("code: runner_up_too_close", "code: tired", "unknown code \"tired\"");
    check_refused("source: '- top #'", "source: left", "two cameras");
    check_refused("residual_px: 0.6", "residual_px: -0.6", "none negative");
    check_refused("residual_m: 0.004", "residual_m: .nan", "finite");
    check_refused("matches: 73", "matches: many", "matches");
    check_refused("version: 0.1.0", "versions: 0.1.0", "versions");
    check_refused("3.333333333333333e-7", "-3.333333333333333e-7", "no variance negative");
    check_refused("-2e-7", "-3e-7", "symmetric");
    check_refused("translation_m:\n    - 0.0", "translation_m:\n    - .inf", "unit quaternion");
    check_refused("    - 1.0\n", "    - 1.1\n", "unit quaternion");
}

#[test]
fn a_calibration_that_no_reader_would_take_is_not_written() {
    let mut entry = stored(1);
    entry.calibration.pairs[0].residual_px = f64::NAN;
    encode(&entry).expect_err("not a number");
    let mut entry = stored(1);
    entry.calibration.cameras[1] = None;
    encode(&entry).expect_err("a camera without a pose");
}

proptest! {
    #![proptest_config(crate::tests::hostile::properties())]

    #[test]
    fn any_changed_byte_is_noticed(at in any::<prop::sample::Index>(), change in 1..=255u8) {
        let mut bytes = encode(&stored(1)).expect("sound").into_bytes();
        let at = at.index(bytes.len());
        bytes[at] ^= change;
        prop_assert!(decode(&bytes).is_err(), "byte {at}");
    }

    #[test]
    fn any_bytes_are_refused_without_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        prop_assert!(decode(&bytes).is_err());
    }
}

#[test]
fn a_stored_calibration_of_any_bytes_under_a_right_checksum_is_refused_or_sound() {
    let bodies = [1, 2].map(|id| {
        let text = encode(&stored(id)).expect("sound");
        text.split_once('\n').expect("lines").1.as_bytes().to_vec()
    });
    crate::tests::hostile::check_any_bytes("stored calibration", &bodies, |bytes| {
        let decoded = decode(with_head(&String::from_utf8_lossy(bytes)).as_bytes());
        if let Ok(entry) = &decoded {
            for pose in entry.calibration.cameras.iter().flatten() {
                assert!((pose.reference_from_camera.rotation.norm() - 1.0).abs() < 1e-8);
                assert!(pose.covariance.iter().all(|value| value.is_finite()));
            }
            assert!(entry.calibration.cameras.iter().all(Option::is_some));
            assert!(entry.calibration.reference < entry.cameras.len());
        }
        decoded.is_ok()
    });
}
