//! Evidence that cannot fix the rig gives a reason, never a pose called converged.

use nalgebra::{UnitQuaternion, Vector3};

use super::poses::solved;
use super::room::{Random, edges, frame_sets, frame_sets_along, rig, room, world_from_rig};
use crate::geometry::CameraView;
use crate::geometry::motion::Motion;
use crate::solver::evidence::Evidence;
use crate::solver::{EstimateOptions, EvidenceLimits, ReasonCode, RigEstimator, State};

fn pair() -> [Motion; 2] {
    [Motion::identity(), Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.7, 0.0))]
}

#[track_caller]
fn check_not_converged(sets: &[Vec<Option<CameraView>>], codes: &[ReasonCode]) {
    let calibration = solved(sets[0].len(), sets);
    assert_ne!(calibration.state, State::Converged);
    let reason = calibration.reason.expect("a reason");
    assert!(codes.contains(&reason.code), "{reason:?}");
    assert!(reason.sentence.len() > 20, "the sentence explains: {reason:?}");
}

#[test]
fn parallel_edges_fix_no_pose_while_the_rig_does_not_turn() {
    let mut random = Random::named("parallel");
    let room = edges(&mut random, 50, |_, _| Vector3::new(0.3, 1.0, 0.2));
    let path: Vec<Motion> = (0..12)
        .map(|_| Motion::from_parts(world_from_rig(&mut random).translation, UnitQuaternion::identity()))
        .collect();
    let sets = frame_sets_along(&mut random, &room, &pair(), &path);
    check_not_converged(
        &sets,
        &[ReasonCode::AxisUnobservable, ReasonCode::RunnerUpTooClose, ReasonCode::NotEnoughEvidence],
    );
}

#[test]
fn a_rig_that_stands_still_brings_no_new_evidence() {
    let mut random = Random::named("still");
    let room = room(&mut random, 60);
    let set = frame_sets(&mut random, &room, &pair(), 1);
    let again: Vec<_> = set.iter().cycle().take(20).cloned().collect();
    check_not_converged(&again, &[ReasonCode::NotEnoughEvidence]);
    assert_eq!(solved(2, &again).frame_sets_used, 1);
}

#[test]
fn cameras_in_different_rooms_never_converge() {
    for trial in 0..6 {
        let mut random = Random::named(&format!("different rooms {trial}"));
        let (one, other) = (room(&mut random, 60), room(&mut random, 60));
        let mut sets = frame_sets(&mut random, &one, &pair(), 12);
        for (set, unrelated) in sets.iter_mut().zip(frame_sets(&mut random, &other, &pair(), 12)) {
            set[1].clone_from(&unrelated[1]);
        }
        check_not_converged(&sets, &ReasonCode::ALL);
    }
}

#[test]
fn one_camera_has_nothing_to_calibrate() {
    let mut random = Random::named("one camera");
    let room = room(&mut random, 20);
    check_not_converged(&frame_sets(&mut random, &room, &pair()[..1], 3), &[ReasonCode::OneCamera]);
}

#[test]
fn a_rig_without_cameras_is_told_too() {
    let mut estimator = RigEstimator::new(Vec::new(), EstimateOptions::default());
    assert!(!estimator.add(&[], &[]));
    let calibration = estimator.solve();
    assert_eq!(calibration.reason.expect("not converged").code, ReasonCode::OneCamera);
}

#[test]
fn no_line_at_all_says_so() {
    check_not_converged(&vec![vec![Some(CameraView::default()); 2]; 4], &[ReasonCode::NoLines]);
}

#[test]
fn a_camera_that_never_comes_leaves_the_others_their_result() {
    let mut random = Random::named("absent camera");
    let room = room(&mut random, 60);
    let mut sets = frame_sets(&mut random, &room, &pair(), 12);
    sets.iter_mut().for_each(|set| set.push(None));
    let calibration = solved(3, &sets);
    assert_ne!(calibration.state, State::Converged);
    assert!(calibration.cameras[1].is_some() && calibration.cameras[2].is_none());
}

#[test]
fn a_changing_scene_before_a_rig_that_stands_still_is_one_view() {
    let mut random = Random::named("changing scene");
    let path = [world_from_rig(&mut random)];
    let backdrop = room(&mut random, 60);
    let mut estimator = RigEstimator::new(rig(2), EstimateOptions::default());
    for _ in 0..30 {
        let mut scene = room(&mut random, 12);
        scene.extend(&backdrop);
        estimator.add(&frame_sets_along(&mut random, &scene, &pair(), &path)[0], &[]);
    }
    let calibration = estimator.solve();
    assert!(calibration.frame_sets_used <= 8, "{} sets of one pose are kept", calibration.frame_sets_used);
    assert_eq!(calibration.reason.map(|reason| reason.code), Some(ReasonCode::NotEnoughEvidence));
}

#[test]
fn full_memory_keeps_the_pose_at_which_the_rig_stands() {
    let mut random = Random::named("full memory");
    let path: Vec<Motion> = (0..3).map(|_| world_from_rig(&mut random)).collect();
    let backdrop = room(&mut random, 60);
    let limits = EvidenceLimits { max_lines_per_view: 100, max_sets: 2 };
    let mut evidence = Evidence::new(limits);
    for world_from_rig in &path {
        let stand = std::slice::from_ref(world_from_rig);
        assert!(evidence.add(&frame_sets_along(&mut random, &backdrop, &pair(), stand)[0]), "a new pose");
        for _ in 0..4 {
            let mut scene = room(&mut random, 35);
            scene.extend(&backdrop);
            let set = &frame_sets_along(&mut random, &scene, &pair(), stand)[0];
            evidence.add(set);
            assert!(evidence.sets.len() <= limits.max_sets);
        }
        let again = &frame_sets_along(&mut random, &backdrop, &pair(), stand)[0];
        assert!(!evidence.add(again), "the backdrop from the same place is nothing new");
    }
}
