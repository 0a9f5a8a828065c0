use nalgebra::Unit;

use super::*;
use crate::solver::paper::translation_candidate::tests::{line, plane};
use crate::solver::tests::room::Random;

const FIXED: Tolerance = Tolerance::Fixed { epsilon_m: 0.02 };
const SCALED: Tolerance = Tolerance::Sigmas { n: 3.0, floor_m: 0.005 };

/// Algorithm 1 as it is written.
fn by_triple_loop(candidates: &[TranslationCandidate], tolerance: Tolerance) -> Option<Vote> {
    let mut best: Option<Vote> = None;
    for Point { at_m: point_m, .. } in points(candidates) {
        let inliers: Vec<usize> =
            (0..candidates.len()).filter(|&j| tolerance.holds(&candidates[j], &point_m)).collect();
        if inliers.len() > best.as_ref().map_or(0, |best| best.inliers.len()) {
            best = Some(Vote { inliers, point_m });
        }
    }
    best
}

fn vector(random: &mut Random) -> Vector3<f64> {
    Vector3::new(random.gaussian(), random.gaussian(), random.gaussian())
}

/// Of these many candidates some pass a common point to within their noise.
fn scene(random: &mut Random, n_candidates: usize, share_true: f64) -> Vec<TranslationCandidate> {
    let truth = vector(random) * 0.3;
    (0..n_candidates)
        .map(|i| {
            let is_true = 0.5 * (random.signed() + 1.0) < share_true;
            let off = if is_true { vector(random) * 0.004 } else { vector(random) };
            let towards = Unit::new_normalize(vector(random));
            if i % 5 == 4 { plane(truth + off, towards) } else { line(truth + off, towards) }
        })
        .collect()
}

#[track_caller]
fn check(candidates: &[TranslationCandidate]) {
    for tolerance in [FIXED, SCALED] {
        assert_eq!(convergence_vote(candidates, tolerance), by_triple_loop(candidates, tolerance));
    }
}

#[test]
fn the_vote_is_that_of_the_triple_loop() {
    let mut random = Random::named("triple loop");
    for trial in 0..120 {
        let share_true = [0.0, 0.3, 0.7, 1.0][trial % 4];
        check(&scene(&mut random, 3 + trial % 37, share_true));
    }
}

#[test]
fn many_lines_give_the_set_of_the_triple_loop() {
    let mut random = Random::named("many lines");
    for share_true in [0.0, 0.2, 0.9] {
        check(&scene(&mut random, 90, share_true));
    }
}

#[test]
fn of_equal_points_the_first_counts() {
    // Lines of a lattice: each of its many nodes has exactly three votes.
    let mut random = Random::named("ties");
    for _ in 0..60 {
        let mut candidates = Vec::new();
        for _ in 0..15 {
            let node = Vector3::from_fn(|_, _| (3.0 * random.signed()).round());
            let axis = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()][candidates.len() % 3];
            candidates.push(line(node, axis));
        }
        check(&candidates);
    }
}

#[test]
fn nearly_parallel_lines_and_their_far_points_change_nothing() {
    let mut random = Random::named("nearly parallel");
    for _ in 0..30 {
        let common = vector(&mut random);
        let candidates: Vec<_> = (0..30)
            .map(|_| {
                let direction = common + vector(&mut random) * 1e-4;
                line(vector(&mut random), Unit::new_normalize(direction))
            })
            .collect();
        check(&candidates);
    }
}

#[test]
fn lines_through_a_point_are_found_among_others() {
    let truth = Vector3::new(0.3, -0.1, 0.2);
    let mut random = Random::named("found");
    let mut candidates: Vec<_> =
        (0..20).map(|_| line(truth, Unit::new_normalize(vector(&mut random)))).collect();
    candidates
        .extend((0..20).map(|_| line(truth + vector(&mut random), Unit::new_normalize(vector(&mut random)))));
    let vote = convergence_vote(&candidates, FIXED).expect("twenty lines meet");
    assert!(vote.inliers.len() >= 20 && (0..20).all(|i| vote.inliers.contains(&i)));
    assert!((vote.point_m - truth).norm() < 0.02);
}

#[test]
fn a_plane_votes_and_helps_a_single_line_to_a_point() {
    let truth = Vector3::new(0.3, -0.1, 0.2);
    let candidates =
        [line(truth, Vector3::x_axis()), plane(truth, Unit::new_normalize(Vector3::new(1.0, 1.0, 0.0)))];
    let vote = convergence_vote(&candidates, FIXED).expect("line and plane meet");
    assert_eq!(vote.inliers, [0, 1]);
    assert!((vote.point_m - truth).norm() < 1e-12);
}

#[test]
fn what_has_no_points_has_no_vote() {
    let parallel = [0.0, 1.0, 2.0].map(|y| line(Vector3::new(0.0, y, 0.0), Vector3::x_axis()));
    let planes =
        [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()].map(|n| plane(Vector3::zeros(), n));
    let along = [line(Vector3::zeros(), Vector3::x_axis()), plane(Vector3::zeros(), Vector3::y_axis())];
    for candidates in [&[] as &[_], &parallel, &parallel[..1], &planes, &along] {
        assert_eq!(convergence_vote(candidates, FIXED), None);
    }
}

#[test]
fn a_middle_that_is_too_far_from_both_lines_has_no_votes() {
    let skew = [line(Vector3::zeros(), Vector3::x_axis()), line(Vector3::z(), Vector3::y_axis())];
    assert_eq!(convergence_vote(&skew, FIXED), None);
}

#[test]
fn lines_that_are_all_the_same_twice_are_counted_out() {
    let mut random = Random::named("twice");
    let scene = scene(&mut random, 12, 0.5);
    let many: Vec<_> = scene.iter().cycle().take(96).copied().collect();
    check(&many);
}
