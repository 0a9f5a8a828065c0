//! The right pose, for any arrangement of cameras.

use nalgebra::Vector3;

use super::room::{Random, frame_sets, rig, room};
use crate::geometry::CameraView;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::{EstimateOptions, Estimator, RigCalibration, RigEstimator, State};

pub fn solved(n_cameras: usize, sets: &[Vec<Option<CameraView>>]) -> RigCalibration {
    let mut estimator = RigEstimator::new(rig(n_cameras), EstimateOptions::default());
    for set in sets {
        estimator.add(set, &[]);
    }
    estimator.solve()
}

#[track_caller]
fn check_pair((name, n_edges): (&str, usize), at_m: [f64; 3], turn_deg: [f64; 3]) {
    let mut random = Random::named(name);
    let room = room(&mut random, n_edges);
    let turn = Vector3::from(turn_deg.map(f64::to_radians));
    let target_from_source = Motion::new(Vector3::from(at_m), turn);
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), target_from_source], 16);
    let calibration = solved(2, &sets);
    assert_eq!(calibration.state, State::Converged, "{name}: {:?}", calibration.reason);
    let found = calibration.cameras[1].as_ref().expect("a converged camera has a pose").reference_from_camera;
    let (turn_rad, gap_m) =
        (rotation_gap_rad(&found, &target_from_source), translation_gap_m(&found, &target_from_source));
    assert!(turn_rad.to_degrees() < 0.2 && gap_m < 0.006, "{name}: off by {turn_rad} rad, {gap_m} m");
}

#[test]
fn cameras_side_by_side_are_found() {
    check_pair(("side by side", 60), [0.2, 0.0, 0.0], [0.0, 0.0, 0.0]);
}

#[test]
fn cameras_turned_far_apart_are_found() {
    check_pair(("far apart", 60), [0.3, -0.02, 0.1], [4.0, 75.0, -3.0]);
}

#[test]
fn cameras_that_look_away_from_each_other_are_found() {
    // Few edges are long enough to run through both views.
    check_pair(("looking away", 300), [0.05, 0.1, -0.3], [5.0, 120.0, -10.0]);
}

#[test]
fn cameras_in_any_attitude_are_found() {
    check_pair(("any attitude", 60), [-0.3, 0.5, 0.2], [-50.0, 40.0, 70.0]);
}

#[test]
fn swapped_roles_give_the_inverse() {
    let mut random = Random::named("swapped roles");
    let room = room(&mut random, 60);
    let target_from_source = Motion::new(Vector3::new(0.3, 0.1, -0.1), Vector3::new(0.1, 0.9, -0.3));
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), target_from_source], 12);
    let swapped: Vec<_> = sets.iter().map(|set| set.iter().rev().cloned().collect()).collect();
    let pose = |sets| solved(2, sets).pairs[0].target_from_source.expect("a pose");
    let there_and_back = pose(&swapped) * pose(&sets);
    assert!(there_and_back.rotation.angle().to_degrees() < 0.03, "{}", there_and_back.rotation.angle());
    assert!(there_and_back.translation.vector.norm() < 0.001, "{}", there_and_back.translation.vector.norm());
}

#[test]
fn the_same_evidence_gives_the_same_bits() {
    let mut random = Random::named("same bits");
    let room = room(&mut random, 40);
    let target_from_source = Motion::new(Vector3::new(0.2, 0.0, 0.1), Vector3::new(0.0, 1.1, 0.0));
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), target_from_source], 8);
    assert_eq!(solved(2, &sets), solved(2, &sets));
}

#[test]
fn a_rig_of_three_is_joined_and_a_camera_without_shared_edges_is_left_out() {
    let mut random = Random::named("three");
    let own_room = room(&mut random, 60);
    let elsewhere = room(&mut random, 60);
    let left = Motion::new(Vector3::new(-0.2, 0.0, 0.0), Vector3::new(0.0, -0.9, 0.1));
    let right = Motion::new(Vector3::new(0.2, 0.0, 0.1), Vector3::new(0.1, 0.8, 0.0));
    let poses = [Motion::identity(), left, right, Motion::identity()];
    let mut sets = frame_sets(&mut random, &own_room, &poses, 12);
    let others = frame_sets(&mut random, &elsewhere, &poses[..1], 12);
    for (set, other) in sets.iter_mut().zip(others) {
        set[3].clone_from(&other[0]);
    }
    let calibration = solved(4, &sets);
    assert_ne!(calibration.state, State::Converged, "camera 3 shares no edge with the others");
    assert!(calibration.cameras[3].is_none());
    for (camera, truth) in [(1, left), (2, right)] {
        let found = calibration.cameras[camera].as_ref().expect("joined").reference_from_camera;
        let gap = (rotation_gap_rad(&found, &truth).to_degrees(), translation_gap_m(&found, &truth));
        assert!(gap.0 < 0.2 && gap.1 < 0.006, "camera {camera}: {gap:?}");
    }
    assert!(calibration.reason.is_some_and(|reason| reason.sentence.contains("camera 3")));
}

#[test]
fn a_pair_that_converges_apart_from_the_reference_is_no_converged_rig() {
    let mut random = Random::named("apart from the reference");
    let (here, elsewhere) = (room(&mut random, 60), room(&mut random, 60));
    let target_from_source = Motion::new(Vector3::new(0.3, 0.1, -0.1), Vector3::new(0.1, 0.9, -0.3));
    let mut sets = frame_sets(&mut random, &here, &[Motion::identity(), target_from_source], 14);
    let lost = frame_sets(&mut random, &elsewhere, &[Motion::identity()], 14);
    for (set, lost) in sets.iter_mut().zip(&lost) {
        set.insert(0, lost[0].clone());
    }
    let calibration = solved(3, &sets);
    assert!(calibration.pairs.iter().any(|pair| pair.state == State::Converged), "{:?}", calibration.pairs);
    assert!(calibration.state != State::Converged && calibration.reason.is_some(), "{calibration:?}");
}

#[test]
fn the_papers_estimator_finds_a_rig_behind_the_same_verdict() {
    let mut random = Random::named("by the paper");
    let room = room(&mut random, 60);
    let target_from_source = Motion::new(Vector3::new(0.3, 0.1, -0.1), Vector3::new(0.1, 0.9, -0.3));
    let options = EstimateOptions { estimator: Estimator::Pelical, ..EstimateOptions::default() };
    let mut estimator = RigEstimator::new(rig(2), options);
    for set in frame_sets(&mut random, &room, &[Motion::identity(), target_from_source], 12) {
        estimator.add(&set, &[]);
    }
    let calibration = estimator.solve();
    assert_eq!(calibration.state, State::Converged, "{:?}", calibration.reason);
    let found = calibration.pairs[0].target_from_source.expect("a converged pair has a pose");
    assert!(rotation_gap_rad(&found, &target_from_source).to_degrees() < 0.2);
    assert!(translation_gap_m(&found, &target_from_source) < 0.006);
}
