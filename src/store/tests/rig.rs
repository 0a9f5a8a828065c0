use super::*;

/// The cameras of `stored(1)` in another order and under other names.
fn reordered() -> Vec<StoredCamera> {
    vec![camera("front", "0123"), camera("- top #", ""), camera("right", "1e5")]
}

#[test]
fn a_calibration_follows_the_serial_numbers_into_another_order() {
    let (entry, rig) = (stored(1), reordered());
    let same = entry.for_rig(&rig).expect("the same cameras");
    let names: Vec<&str> = same.cameras.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["front", "- top #", "right"], "names are those of the rig");
    assert_eq!(same.cameras[2].firmware.as_deref(), Some("5.16.0.1"));
    let (before, after) = (&entry.calibration, &same.calibration);
    assert_eq!(after.cameras[1], before.cameras[2]);
    assert_eq!(after.cameras[2], before.cameras[1]);
    assert_eq!((after.pairs[0].target, after.pairs[0].source), (0, 2));
    assert_eq!((after.pairs[2].target, after.pairs[2].source), (2, 1));
    let back = same.for_rig(&entry.cameras).expect("there and back");
    assert_eq!(back, entry);
}

#[test]
fn a_calibration_of_other_cameras_is_refused_with_both_rigs() {
    let mut rig = reordered();
    rig[2].serial = "999".to_owned();
    let why = stored(1).for_rig(&rig).expect_err("a camera was exchanged").to_string();
    assert!(why.contains("rechts: ü (1e5)") && why.contains("right (999)"), "{why}");
    stored(1).for_rig(&reordered()[..2]).expect_err("a camera less");
    let mut more = reordered();
    more.push(camera("fourth", "4"));
    stored(1).for_rig(&more).expect_err("a camera more");
    let mut twice = reordered();
    twice[2] = twice[0].clone();
    stored(1).for_rig(&twice).expect_err("one camera twice");
    stored(1).for_rig(&[]).expect_err("no camera");
}

#[test]
fn cameras_without_a_serial_number_are_told_apart_by_name() {
    let mut rig = reordered();
    rig[1].name = "bottom".to_owned();
    stored(1).for_rig(&rig).expect_err("another camera without a number");
}

#[test]
fn a_calibration_in_another_cameras_frame_is_refused() {
    let mut rig = reordered();
    rig.swap(0, 2);
    let why = stored(1).for_rig(&rig).expect_err("another reference").to_string();
    assert!(why.contains("frame of left (0123)") && why.contains("is right (1e5)"), "{why}");
}
