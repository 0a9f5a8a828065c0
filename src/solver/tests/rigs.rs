//! Rigs of three to six cameras: whatever pairs share edges, the cameras find their places, or say why not.

use nalgebra::{Vector3, Vector6};

use super::poses::solved;
use super::room::{Random, Room, frame_sets, room, view, world_from_rig};
use crate::geometry::CameraView;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::{ReasonCode, RigCalibration, State};

type FrameSet = Vec<Option<CameraView>>;

/// `reference_from_camera` of cameras on an arc, each turned away from the one before.
fn arc(n_cameras: usize) -> Vec<Motion> {
    let step = Motion::new(Vector3::new(0.2, 0.01, -0.05), Vector3::new(0.05, 0.35, -0.03));
    (0..n_cameras)
        .scan(Motion::identity(), |pose, _| {
            let here = *pose;
            *pose = here * step;
            Some(here)
        })
        .collect()
}

/// Two cameras that see edges of their own, and how far the second is elsewhere when it sees them.
#[derive(Clone, Copy)]
struct Link {
    cameras: [usize; 2],
    elsewhere: Motion,
}

fn links(of: &[[usize; 2]]) -> Vec<Link> {
    of.iter().map(|&cameras| Link { cameras, elsewhere: Motion::identity() }).collect()
}

fn moved(links: &mut [Link], cameras: [usize; 2], by_m: [f64; 3]) {
    for link in links.iter_mut().filter(|link| link.cameras == cameras) {
        link.elsewhere = Motion::new(Vector3::from(by_m), Vector3::zeros());
    }
}

/// Frame sets in which only linked cameras see the same edges.
fn linked_sets(name: &str, poses: &[Motion], links: &[Link]) -> Vec<FrameSet> {
    let mut random = Random::named(name);
    let rooms: Vec<Room> = links.iter().map(|_| room(&mut random, 70)).collect();
    let n_sets = 12;
    (0..n_sets)
        .map(|_| {
            let world_from_rig = world_from_rig(&mut random);
            let mut views = vec![CameraView::default(); poses.len()];
            for (link, room) in links.iter().zip(&rooms) {
                let [target, source] = link.cameras;
                let from_source = poses[source] * link.elsewhere;
                for (camera, pose) in [(target, poses[target]), (source, from_source)] {
                    views[camera].lines.extend(view(&mut random, room, &(world_from_rig * pose)).lines);
                }
            }
            views.into_iter().map(Some).collect()
        })
        .collect()
}

#[track_caller]
fn check_places(calibration: &RigCalibration, poses: &[Motion], cameras: &[usize]) {
    for &camera in cameras {
        let found = calibration.cameras[camera].as_ref().expect("a place").reference_from_camera;
        let gap_deg = rotation_gap_rad(&found, &poses[camera]).to_degrees();
        let gap_m = translation_gap_m(&found, &poses[camera]);
        assert!(gap_deg < 0.25 && gap_m < 0.008, "camera {camera}: {gap_deg} deg, {gap_m} m");
    }
}

#[track_caller]
fn check_converges(name: &str, n_cameras: usize, of: &[[usize; 2]]) -> RigCalibration {
    let poses = arc(n_cameras);
    let calibration = solved(n_cameras, &linked_sets(name, &poses, &links(of)));
    assert_eq!(calibration.state, State::Converged, "{:?}", calibration.reason);
    check_places(&calibration, &poses, &(0..n_cameras).collect::<Vec<_>>());
    calibration
}

#[test]
fn a_chain_is_joined_and_less_sure_towards_its_end() {
    let calibration = check_converges("chain", 4, &[[0, 1], [1, 2], [2, 3]]);
    let variance = |camera: usize| calibration.cameras[camera].as_ref().expect("a place").covariance.trace();
    assert!(variance(1) < variance(2) && variance(2) < variance(3));
}

#[test]
fn a_star_around_another_camera_than_the_reference_is_joined() {
    check_converges("star", 4, &[[0, 2], [1, 2], [2, 3]]);
}

#[test]
fn a_ring_of_six_is_joined() {
    check_converges("ring of six", 6, &[[0, 1], [1, 2], [2, 3], [3, 4], [4, 5], [0, 5]]);
}

const ALL_OF_FOUR: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

#[test]
fn a_pair_that_contradicts_the_others_is_named_and_the_cameras_keep_their_places() {
    let poses = arc(4);
    let mut links = links(&ALL_OF_FOUR);
    moved(&mut links, [1, 3], [0.03, 0.0, 0.02]);
    let calibration = solved(4, &linked_sets("contradicting pair", &poses, &links));
    let reason = calibration.reason.as_ref().expect("a reason");
    assert_eq!((calibration.state, reason.code), (State::Failed, ReasonCode::LoopInconsistent));
    assert!(reason.sentence.contains("suspect is the pair camera 1 and camera 3,"), "{}", reason.sentence);
    let failed: Vec<_> = calibration.pairs.iter().filter(|pair| pair.state == State::Failed).collect();
    assert_eq!(failed.iter().map(|pair| [pair.target, pair.source]).collect::<Vec<_>>(), [[1, 3]]);
    check_places(&calibration, &poses, &[1, 2, 3]);
}

#[test]
fn a_camera_that_is_not_fixed_is_named_and_loses_its_place_alone() {
    let poses = arc(4);
    let mut links = links(&ALL_OF_FOUR);
    moved(&mut links, [0, 3], [0.04, 0.0, 0.0]);
    moved(&mut links, [1, 3], [0.0, -0.05, 0.0]);
    moved(&mut links, [2, 3], [0.0, 0.0, 0.06]);
    let calibration = solved(4, &linked_sets("loose camera", &poses, &links));
    let reason = calibration.reason.as_ref().expect("a reason");
    assert_eq!((calibration.state, reason.code), (State::Failed, ReasonCode::LoopInconsistent));
    assert!(reason.sentence.contains("suspect is camera 3,"), "{}", reason.sentence);
    check_places(&calibration, &poses, &[1, 2]);
    assert!(calibration.cameras[3].is_none());
    let why = calibration.missing_link(3).and_then(|link| link.reason.as_ref()).expect("told");
    assert_eq!(why.code, ReasonCode::LoopInconsistent);
}

#[test]
fn a_triangle_that_does_not_close_gives_nobody_a_place() {
    let poses = arc(3);
    let mut links = links(&[[0, 1], [0, 2], [1, 2]]);
    moved(&mut links, [1, 2], [0.04, 0.0, 0.03]);
    let calibration = solved(3, &linked_sets("open triangle", &poses, &links));
    let reason = calibration.reason.as_ref().expect("a reason");
    assert_eq!((calibration.state, reason.code), (State::Failed, ReasonCode::LoopInconsistent));
    assert!(reason.sentence.contains("cannot tell; the weakest evidence"), "{}", reason.sentence);
    assert!(calibration.cameras[1].is_none() && calibration.cameras[2].is_none());
}

#[test]
fn a_blind_camera_is_told_and_the_others_have_their_places() {
    let poses = arc(3);
    let mut sets = linked_sets("blind camera", &poses, &links(&[[0, 2]]));
    sets.iter_mut().for_each(|set| set[1] = Some(CameraView::default()));
    let calibration = solved(3, &sets);
    assert_eq!(calibration.state, State::Collecting);
    check_places(&calibration, &poses, &[2]);
    let why = calibration.missing_link(1).and_then(|link| link.reason.as_ref()).expect("told");
    assert_eq!(why.code, ReasonCode::NoLines);
    assert!(why.sentence.starts_with("camera 1 saw no straight edge"), "{}", why.sentence);
    assert_eq!(calibration.missing_link(2), None);
}

#[test]
fn of_two_groups_apart_the_one_without_the_reference_is_missing() {
    let poses = arc(4);
    let calibration = solved(4, &linked_sets("two groups", &poses, &links(&[[0, 1], [2, 3]])));
    assert_ne!(calibration.state, State::Converged);
    check_places(&calibration, &poses, &[1]);
    let state = |target, source| {
        let mut pairs = calibration.pairs.iter();
        pairs.find(|pair| [pair.target, pair.source] == [target, source]).expect("every pair").state
    };
    assert_eq!(state(2, 3), State::Converged);
    for camera in [2, 3] {
        assert!(calibration.cameras[camera].is_none());
        let link = calibration.missing_link(camera).expect("told");
        assert!([0, 1].contains(&link.target) && [2, 3].contains(&link.source) && link.reason.is_some());
    }
}

#[test]
fn another_reference_gives_the_same_rig_in_its_frame() {
    let mut random = Random::named("another reference");
    let scene = room(&mut random, 60);
    let poses = arc(3);
    let sets = frame_sets(&mut random, &scene, &poses, 12);
    const ORDER: [usize; 3] = [2, 0, 1];
    let reordered: Vec<FrameSet> =
        sets.iter().map(|set| ORDER.iter().map(|&camera| set[camera].clone()).collect()).collect();
    let (one, other) = (solved(3, &sets), solved(3, &reordered));
    let place = |calibration: &RigCalibration, camera: usize| {
        calibration.cameras[camera].as_ref().expect("a place").reference_from_camera
    };
    for (index, &camera) in ORDER.iter().enumerate() {
        let expected = place(&one, ORDER[0]).inverse() * place(&one, camera);
        let found = place(&other, index);
        let gap = (rotation_gap_rad(&found, &expected).to_degrees(), translation_gap_m(&found, &expected));
        assert!(gap.0 < 0.03 && gap.1 < 0.001, "camera {camera}: {gap:?}");
    }
}

/// Squared errors of the cameras of a rig that sees one room, each in units of its covariance; 6 each when that is honest.
fn errors2_in_sigmas(name: &str, n_cameras: usize) -> Vec<f64> {
    let mut random = Random::named(name);
    let scene = room(&mut random, 40);
    let poses = arc(n_cameras);
    let calibration = solved(n_cameras, &frame_sets(&mut random, &scene, &poses, 14));
    let error2 = |camera: usize| {
        let found = calibration.cameras[camera].as_ref()?;
        let translation = poses[camera].translation.vector - found.reference_from_camera.translation.vector;
        let rotation =
            (poses[camera].rotation * found.reference_from_camera.rotation.inverse()).scaled_axis();
        let error = Vector6::from_iterator(translation.iter().chain(rotation.iter()).copied());
        Some(error.dot(&found.covariance.cholesky().expect("positive definite").solve(&error)))
    };
    (1..n_cameras).filter_map(error2).collect()
}

#[test]
fn a_camera_that_shares_its_edges_with_many_is_as_far_off_as_its_covariance_says() {
    const TRIALS: usize = 8;
    let errors2: Vec<f64> =
        (0..TRIALS).flat_map(|trial| errors2_in_sigmas(&format!("honest rig {trial}"), 4)).collect();
    let mean = errors2.iter().sum::<f64>() / errors2.len() as f64;
    assert!(errors2.len() > TRIALS, "{} cameras found", errors2.len());
    assert!((3.0..8.5).contains(&mean), "mean of {mean:.2}, expected about 6");
}
