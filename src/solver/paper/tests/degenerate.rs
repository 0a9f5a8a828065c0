//! Scenes that leave the pose open, or seem to: the paper's estimator gives no answer or the right one.

use nalgebra::{Point3, Vector3};

use super::scenes::{any_motion, check_near, in_view, pair, penetrating, variants, with_wrong};
use crate::geometry::motion::Motion;
use crate::solver::LinePair;
use crate::solver::paper::{PaperOutcome, solve_pairs};
use crate::solver::tests::room::Random;

/// Noisy pairs of lines through points with directions, seen by cameras that look the same way.
fn scene(
    random: &mut Random,
    truth: &Motion,
    line: impl Fn(&mut Random) -> [Point3<f64>; 2],
) -> Vec<LinePair> {
    let parts = |[on_line, further]: [Point3<f64>; 2]| {
        let along = (further - on_line).normalize() * 0.5;
        ([on_line - along, on_line + along], [on_line - along * 0.6, on_line + along * 1.4])
    };
    let mut pairs = Vec::new();
    for idx in 0..40 {
        let parts = parts(line(random));
        pairs.extend(pair(random, (idx, parts), truth, 1.0));
    }
    assert!(pairs.len() > 30);
    pairs
}

fn forward_looking() -> Motion {
    Motion::new(Vector3::new(0.2, -0.05, 0.1), Vector3::new(0.1, 0.3, -0.15))
}

/// No answer, or the right one; `true` when there was one.
#[track_caller]
fn check_never_wrong(pairs: &[LinePair], truth: &Motion) -> bool {
    variants().iter().fold(false, |any, options| {
        let solution = solve_pairs(pairs, options);
        if solution.target_from_source.is_some() {
            check_near(&solution, truth, (0.009, 0.02));
        }
        any || solution.target_from_source.is_some()
    })
}

#[test]
fn parallel_lines_and_a_single_line_give_no_answer() {
    let mut random = Random::named("parallel lines");
    for direction in [Vector3::x(), Vector3::y(), Vector3::new(0.3, 1.0, 0.2)] {
        let parallel = scene(&mut random, &forward_looking(), |random| {
            let on_line = in_view(random);
            [on_line, on_line + direction]
        });
        assert!(!check_never_wrong(&parallel, &forward_looking()), "parallel to {direction}");
        let on_line = Point3::new(0.1, 0.1, 2.0);
        let single = scene(&mut random, &forward_looking(), |_| [on_line, on_line + direction]);
        assert!(!check_never_wrong(&single, &forward_looking()), "one line along {direction}");
    }
}

#[test]
fn two_directions_through_one_point_are_ambiguous() {
    // Half a turn about the normal of both maps every line onto itself.
    let mut random = Random::named("two lines");
    let middle = Point3::new(0.1, -0.1, 2.0);
    let turn = std::cell::Cell::new(false);
    let two = |_: &mut Random| {
        turn.set(!turn.get());
        [middle, middle + if turn.get() { Vector3::new(1.0, 0.2, 0.3) } else { Vector3::new(0.2, 1.0, -0.2) }]
    };
    // Twice as many as elsewhere: the pose is known well, but for the half turn.
    let two =
        [scene(&mut random, &forward_looking(), two), scene(&mut random, &forward_looking(), two)].concat();
    for options in variants() {
        let solution = solve_pairs(&two, &options);
        assert_eq!(solution.target_from_source, None);
        let PaperOutcome::Ambiguous { rotation_gap_rad, .. } = solution.outcome else {
            panic!("{}", solution.outcome)
        };
        assert!(rotation_gap_rad > 3.0, "half a turn: {rotation_gap_rad}");
    }
}

#[test]
fn lines_in_one_plane_through_one_point_or_seen_by_a_pure_shift_are_never_solved_wrong() {
    let mut random = Random::named("special scenes");
    for _ in 0..5 {
        let wall = scene(&mut random, &forward_looking(), |random| {
            let on_wall =
                |random: &mut Random| Point3::new(0.8 * random.signed(), 0.6 * random.signed(), 2.0);
            [on_wall(random), on_wall(random)]
        });
        check_never_wrong(&wall, &forward_looking());
        let centre = Point3::new(0.1, -0.2, 2.2);
        let star = scene(&mut random, &forward_looking(), |random| {
            [centre, centre + Vector3::new(random.signed(), random.signed(), random.signed())]
        });
        check_never_wrong(&star, &forward_looking());
        let shift = Motion::translation(0.3, 0.0, 0.0);
        let shifted = scene(&mut random, &shift, |random| [in_view(random), in_view(random)]);
        assert!(check_never_wrong(&shifted, &shift), "a pure shift is no special case");
    }
}

/// Pairs of the lines of a room, seen from places between which the rig only turns about the upright and shifts across it.
fn from_a_floor(random: &mut Random, line: impl Fn(&mut Random) -> [Point3<f64>; 2]) -> Vec<LinePair> {
    let room: Vec<[Point3<f64>; 2]> = (0..8).map(|_| line(random)).collect();
    let next = std::cell::Cell::new(0);
    scene(random, &forward_looking(), |random| {
        let edge = room[next.replace(next.get() + 1) % room.len()];
        let middle_m = Point3::new(0.0, 0.0, 2.0).coords;
        let shift_m = Vector3::new(0.2 * random.signed(), 0.0, 0.2 * random.signed());
        let turn = Motion::new(Vector3::zeros(), Vector3::y() * (0.3 * random.signed()));
        edge.map(|end_m| turn * (end_m - middle_m) + middle_m + shift_m)
    })
}

#[test]
fn a_rig_that_only_moves_on_a_floor_is_never_solved_wrong_and_not_at_all_by_upright_lines() {
    let mut random = Random::named("floor");
    for _ in 0..5 {
        let upright = from_a_floor(&mut random, |random| {
            let on_line = in_view(random);
            [on_line, on_line + Vector3::y()]
        });
        assert!(!check_never_wrong(&upright, &forward_looking()));
        let any = from_a_floor(&mut random, |random| [in_view(random), in_view(random)]);
        check_never_wrong(&any, &forward_looking());
    }
}

#[test]
fn cameras_that_see_different_lines_give_no_answer() {
    let mut random = Random::named("unrelated");
    for _ in 0..10 {
        let truth = any_motion(&mut random);
        let pairs = penetrating(&mut random, &truth, (40, 1.0));
        let unrelated = with_wrong(&pairs, 40);
        for options in variants() {
            let solution = solve_pairs(&unrelated, &options);
            assert_eq!(solution.target_from_source, None, "{solution:?}");
        }
    }
}
