//! Loops of pairs: what closes, what does not, and who is to be suspected.

use nalgebra::{Matrix6, Vector3, Vector6};

use super::room::Random;
use crate::geometry::motion::{Motion, updated};
use crate::solver::closure::{Miss, PairPose, Suspect, UncertainMotion, find_miss};

const SIGMA: f64 = 0.0005;

/// `reference_from_camera` of cameras somewhere.
fn cameras(random: &mut Random, n_cameras: usize) -> Vec<Motion> {
    (0..n_cameras)
        .map(|_| {
            let at_m = Vector3::new(random.signed(), random.signed(), random.signed()) * 0.4;
            Motion::from_parts(at_m.into(), random.rotation())
        })
        .collect()
}

/// Pairs of cameras as measured: with noise, and with extra errors of the named pairs, m.
fn measured(random: &mut Random, links: &[[usize; 2]], wrong_m: &[([usize; 2], f64)]) -> Vec<PairPose> {
    let n_cameras = links.iter().flatten().max().expect("links") + 1;
    let truth = cameras(random, n_cameras);
    let measure = |(idx, &[target, source]): (usize, &[usize; 2])| {
        let mut step = Vector6::from_fn(|_, _| SIGMA * random.gaussian());
        for (_, error_m) in wrong_m.iter().filter(|(link, _)| *link == [target, source]) {
            step.x += error_m;
        }
        let motion = updated(&(truth[target].inverse() * truth[source]), &step);
        let covariance = Matrix6::from_diagonal_element(SIGMA * SIGMA);
        PairPose {
            cameras: [target, source],
            pose: UncertainMotion { motion, covariance },
            matches: 100 - idx,
        }
    };
    links.iter().enumerate().map(measure).collect()
}

const ALL_OF_FOUR: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];

#[track_caller]
fn check_miss(name: &str, links: &[[usize; 2]], wrong_m: &[([usize; 2], f64)]) -> Miss {
    find_miss(&measured(&mut Random::named(name), links, wrong_m)).expect("a loop does not close")
}

#[test]
fn noise_within_its_covariance_closes() {
    for trial in 0..50 {
        let mut random = Random::named(&format!("closes {trial}"));
        assert_eq!(find_miss(&measured(&mut random, &ALL_OF_FOUR, &[])), None);
    }
}

#[test]
fn a_tree_has_no_loop() {
    let mut random = Random::named("tree");
    assert_eq!(find_miss(&measured(&mut random, &[[0, 1], [1, 2], [1, 3]], &[([1, 2], 0.5)])), None);
}

#[test]
fn one_wrong_pair_among_four_cameras_is_named_and_the_rest_trusted() {
    for (idx, link) in ALL_OF_FOUR.into_iter().enumerate() {
        let miss = check_miss("one wrong pair", &ALL_OF_FOUR, &[(link, 0.02)]);
        assert_eq!((miss.suspect, miss.n_open), (Suspect::Pair(idx), 2));
        assert_eq!(miss.untrusted, [idx]);
    }
}

#[test]
fn a_camera_that_is_wrong_towards_all_others_is_named_and_the_rest_trusted() {
    let wrong = [([0, 3], 0.03), ([1, 3], -0.04), ([2, 3], 0.09)];
    let miss = check_miss("one wrong camera", &ALL_OF_FOUR, &wrong);
    assert_eq!((miss.suspect, miss.n_open), (Suspect::Camera(3), 3));
    assert_eq!(miss.untrusted, [2, 4, 5]);
}

#[test]
fn a_single_loop_accuses_nobody_but_names_the_weakest() {
    let ring = [[0, 1], [1, 2], [2, 3], [0, 3]];
    let miss = check_miss("ring", &ring, &[([1, 2], 0.05)]);
    assert_eq!(miss.suspect, Suspect::Unknown(3), "the last has the fewest matches");
    assert_eq!(miss.untrusted, [0, 1, 2, 3]);
    assert_eq!(miss.worst.cameras.len(), 4);
}

#[test]
fn what_a_closed_loop_vouches_for_is_trusted() {
    // Triangles 0 1 2, which misses, and 0 2 3, which closes: the pair 0 2 is in both.
    let links = [[0, 1], [1, 2], [0, 2], [2, 3], [0, 3]];
    let miss = check_miss("vouched", &links, &[([0, 1], 0.05)]);
    assert_eq!((miss.suspect, miss.untrusted), (Suspect::Unknown(1), vec![0, 1]));
}

#[test]
fn two_wrong_pairs_accuse_nobody() {
    let miss = check_miss("two wrong pairs", &ALL_OF_FOUR, &[([0, 1], 0.05), ([2, 3], 0.07)]);
    assert!(matches!(miss.suspect, Suspect::Unknown(_)), "{:?}", miss.suspect);
    assert_eq!(miss.untrusted.len(), 6);
}

#[test]
fn steps_of_a_chain_and_of_the_way_back_follow_from_its_parts() {
    let mut random = Random::named("steps");
    let motions = cameras(&mut random, 2);
    let (first, next) = (motions[0], motions[1]);
    // A covariance of one axis only carries the derivative's column: its root is the size of the step.
    for axis in 0..6 {
        let mut step = Vector6::zeros();
        step[axis] = 1e-6;
        let covariance = step * step.transpose();
        let sure = |motion| UncertainMotion { motion, covariance: Matrix6::zeros() };
        let unsure = |motion| UncertainMotion { motion, covariance };
        for (found, moved) in [
            (unsure(first).inverse(), updated(&first, &step).inverse()),
            (unsure(first).then(&sure(next)), updated(&first, &step) * next),
            (sure(first).then(&unsure(next)), first * updated(&next, &step)),
        ] {
            let turned = (moved.rotation * found.motion.rotation.inverse()).scaled_axis();
            let shifted = moved.translation.vector - found.motion.translation.vector;
            let expected = Vector6::from_iterator(shifted.iter().chain(turned.iter()).copied());
            let gap = (found.covariance - expected * expected.transpose()).amax();
            assert!(gap < 1e-5 * found.covariance.amax(), "axis {axis}: {gap}");
        }
    }
}
