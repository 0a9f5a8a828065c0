//! The right pose whatever it is, whoever is the target, and in whatever order the matches come.

use nalgebra::{UnitQuaternion, Vector3};

use super::scene::{check_close, pairs_along, pose, solved, spoil, with_pnl};
use crate::geometry::motion::Motion;
use crate::geometry::{LineObservation, RayPoint};
use crate::solver::tests::room::{Random, camera, room, world_from_rig};
use crate::solver::{LinePair, State};

fn matches(name: &str, truth: &Motion) -> (Random, Vec<LinePair>) {
    let mut random = Random::named(name);
    let room = room(&mut random, 60);
    let path: Vec<Motion> = (0..12).map(|_| world_from_rig(&mut random)).collect();
    let mut pairs = pairs_along(&mut random, &room, truth, &path);
    pairs.truncate(80);
    (random, pairs)
}

#[track_caller]
fn check_found(name: &str, truth: &Motion) {
    let (mut random, mut pairs) = matches(name, truth);
    let spoilt = spoil(&mut random, &mut pairs, 0.4);
    with_pnl(&mut pairs);
    let solution = solved(&pairs);
    assert_eq!(solution.state, State::Converged, "{name}: {:?}", solution.reason);
    check_close(&solution.target_from_source.expect("converged"), truth, (0.2, 0.005));
    let n_right = spoilt.iter().filter(|spoilt| !**spoilt).count();
    assert!(solution.inliers.len() * 10 > n_right * 9, "{name}: {} of {n_right}", solution.inliers.len());
    assert!(!solution.inliers.iter().any(|&at| spoilt[at]), "{name}: a wrong match agrees");
    assert!(solution.inliers.is_sorted());
}

#[test]
fn a_pose_is_found_among_wrong_matches() {
    check_found("side by side", &pose([0.3, 0.0, 0.0], [0.0, 0.0, 0.0]));
    check_found("turned", &pose([0.3, -0.02, 0.1], [4.0, 75.0, -3.0]));
    check_found("any attitude", &pose([-0.3, 0.5, 0.2], [-50.0, 40.0, 60.0]));
}

#[test]
fn rotations_near_half_a_turn_are_found_as_well() {
    check_found("upside down", &pose([0.2, 0.1, 0.0], [0.0, 0.0, 180.0]));
    check_found("nearly upside down", &pose([0.2, 0.1, 0.0], [3.0, -20.0, 179.5]));
    check_found("upside down and turned", &pose([0.1, -0.2, 0.1], [10.0, 40.0, -178.0]));
}

#[test]
fn swapped_roles_give_the_inverse() {
    let truth = pose([0.3, 0.1, -0.1], [6.0, 50.0, -17.0]);
    let (_, pairs) = matches("swapped", &truth);
    let swap = |pair: &LinePair| {
        LinePair::try_new(&pair.source.observation, pair.target_observation(), pair.set)
            .expect("both are lifted")
    };
    let swapped: Vec<LinePair> = pairs.iter().map(swap).collect();
    let there = solved(&pairs).target_from_source.expect("converged");
    let back = solved(&swapped).target_from_source.expect("converged");
    // The noise of the lines alone is ten times this.
    check_close(&(there * back), &Motion::identity(), (0.005, 1e-4));
}

/// The same line seen by a camera rolled about its viewing axis.
fn rolled(line: &LineObservation, roll: &UnitQuaternion<f64>) -> LineObservation {
    let ends = line.ends.map(|ray| {
        let turned = roll * Vector3::new(ray.x, ray.y, 1.0);
        RayPoint { x: turned.x, y: turned.y }
    });
    let mut line = LineObservation { ends, ..*line };
    [line.segment.start, line.segment.end] = ends.map(|ray| camera().pixel_from_ray(ray));
    line
}

#[test]
fn a_change_of_either_camera_s_coordinates_carries_through() {
    let truth = pose([0.3, 0.1, -0.1], [6.0, 50.0, -17.0]);
    let (mut random, mut pairs) = matches("coordinates", &truth);
    spoil(&mut random, &mut pairs, 0.3);
    with_pnl(&mut pairs);
    let about_z = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
    let (of_target, of_source) = (about_z(2.0), about_z(-0.7));
    let change = |pair: &LinePair| {
        let (target, source) = (pair.target_observation(), &pair.source.observation);
        LinePair::try_new(&rolled(target, &of_target), &rolled(source, &of_source), pair.set)
            .expect("as before")
    };
    let changed: Vec<LinePair> = pairs.iter().map(change).collect();
    let expected = of_target * solved(&pairs).target_from_source.expect("converged") * of_source.inverse();
    let found = solved(&changed);
    check_close(&found.target_from_source.expect("converged"), &expected, (1e-4, 1e-6));
    assert_eq!(found.inliers, solved(&pairs).inliers);
}

#[test]
fn the_order_of_the_matches_does_not_matter() {
    let truth = pose([-0.2, 0.3, 0.0], [20.0, -30.0, 10.0]);
    let (mut random, mut pairs) = matches("order", &truth);
    spoil(&mut random, &mut pairs, 0.3);
    let first = solved(&pairs);
    assert_eq!(first, solved(&pairs), "the same bits twice");
    let turned: Vec<LinePair> = pairs.iter().rev().cloned().collect();
    let second = solved(&turned);
    assert_eq!(second.target_from_source, first.target_from_source);
    let mut inliers: Vec<usize> = second.inliers.iter().map(|at| pairs.len() - 1 - at).collect();
    inliers.sort_unstable();
    assert_eq!(inliers, first.inliers);
}
