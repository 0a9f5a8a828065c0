//! Never a wrong pose called converged: too few matches, degenerate scenes and contradictions have their reason.

use nalgebra::{Vector3, Vector6};

use super::scene::{check_close, pairs_along, pose, solved, spoil, with_pnl};
use crate::geometry::motion::{Motion, normal_basis};
use crate::solver::tests::room::{Random, Room, edges, room, world_from_rig};
use crate::solver::{LinePair, ReasonCode, State, TargetSide};

fn truth() -> Motion {
    pose([0.3, 0.0, 0.05], [3.0, 40.0, -5.0])
}

/// Matches from places at which the rig does not turn: what is parallel stays so.
fn without_turning(random: &mut Random, room: &Room) -> Vec<LinePair> {
    let turn = random.rotation();
    let path: Vec<Motion> =
        (0..40).map(|_| Motion::from_parts(world_from_rig(random).translation, turn)).collect();
    pairs_along(random, room, &truth(), &path)
}

#[track_caller]
fn check_not_converged(pairs: &[LinePair], codes: &[ReasonCode]) {
    let solution = solved(pairs);
    assert_ne!(solution.state, State::Converged);
    assert!(solution.target_from_source.is_none() && solution.covariance.is_none());
    let reason = solution.reason.expect("a reason");
    assert!(codes.contains(&reason.code), "{} matches: {reason:?}", pairs.len());
    assert!(reason.sentence.len() > 20, "the sentence explains: {reason:?}");
}

/// No answer, or the right one.
#[track_caller]
fn check_not_wrong(pairs: &[LinePair]) {
    let solution = solved(pairs);
    match solution.target_from_source {
        Some(found) => check_close(&found, &truth(), (0.5, 0.02)),
        None => assert!(solution.reason.is_some()),
    }
}

#[test]
fn parallel_lines_fix_no_pose() {
    for trial in 0..5 {
        let mut random = Random::named(&format!("parallel {trial}"));
        let room = edges(&mut random, 80, |_, _| Vector3::new(0.3, 1.0, 0.2));
        let mut pairs = without_turning(&mut random, &room);
        assert!(pairs.len() >= 30, "{} matches are no test", pairs.len());
        check_not_converged(&pairs, &[ReasonCode::AxisUnobservable]);
        spoil(&mut random, &mut pairs, 0.3);
        check_not_converged(&pairs, &[ReasonCode::AxisUnobservable, ReasonCode::NotEnoughEvidence]);
    }
}

#[test]
fn an_axis_that_rests_on_one_match_is_not_fixed() {
    for (trial, along_m) in [0.0, 0.1, 0.4].into_iter().enumerate() {
        let mut random = Random::named(&format!("one across {trial}"));
        let along = Vector3::new(0.3, 1.0, 0.2);
        let across = Vector3::new(1.0, -0.4, 0.5);
        let room = edges(&mut random, 80, |_, _| along);
        let turn = random.rotation();
        let path: Vec<Motion> =
            (0..40).map(|_| Motion::from_parts(world_from_rig(&mut random).translation, turn)).collect();
        let mut pairs = pairs_along(&mut random, &room, &truth(), &path);
        let crossing = edges(&mut random, 20, |_, _| across);
        // The one line across the others is matched to a line further along them: a slide explains all matches.
        let slide =
            Motion::from_parts((turn.inverse() * along.normalize() * along_m).into(), Default::default());
        pairs.extend(pairs_along(&mut random, &crossing, &(slide * truth()), &path).into_iter().take(1));
        check_not_converged(&pairs, &[ReasonCode::AxisUnobservable]);
    }
}

#[test]
fn upright_lines_fix_no_pose_while_the_rig_moves_on_a_floor() {
    let mut random = Random::named("upright");
    let room = edges(&mut random, 80, |_, _| Vector3::y());
    let path: Vec<Motion> = (0..40)
        .map(|_| {
            let at = Vector3::new(random.signed(), 0.2, random.signed());
            Motion::new(at, Vector3::y() * (3.0 * random.signed()))
        })
        .collect();
    let pairs = pairs_along(&mut random, &room, &truth(), &path);
    assert!(pairs.len() >= 30);
    check_not_converged(&pairs, &[ReasonCode::AxisUnobservable]);
}

#[test]
fn one_line_seen_many_times_fixes_no_pose() {
    let mut random = Random::named("one line");
    let mut room = room(&mut random, 60);
    let path = [world_from_rig(&mut random)];
    room.retain(|edge| !pairs_along(&mut random, &vec![*edge], &truth(), &path).is_empty());
    room.truncate(1);
    let pairs = pairs_along(&mut random, &room, &truth(), &vec![path[0]; 100]);
    assert_eq!(pairs.len(), 100);
    check_not_converged(&pairs, &[ReasonCode::AxisUnobservable, ReasonCode::NotEnoughEvidence]);
}

#[test]
fn a_few_lines_seen_many_times_are_not_many_lines() {
    let mut random = Random::named("static");
    let room = room(&mut random, 40);
    let path: Vec<Motion> = (0..10).map(|_| world_from_rig(&mut random)).collect();
    let mut once = pairs_along(&mut random, &room, &truth(), &path);
    assert!(once.len() >= 4, "{}", once.len());
    once.truncate(4);
    let again: Vec<LinePair> = once.iter().cycle().take(200).cloned().collect();
    check_not_converged(&again, &[ReasonCode::NotEnoughEvidence]);
}

#[test]
fn mirror_images_of_a_plane_of_two_directions_are_not_told_apart() {
    for trial in 0..5 {
        let mut random = Random::named(&format!("grid {trial}"));
        // Lines through one point in two directions at right angles: four poses lay them on each other.
        let normal = random.rotation() * Vector3::z();
        let (first, second) = normal_basis(&normal);
        let middle = nalgebra::Point3::new(0.1, 0.1, 0.0);
        let room: Room =
            [first, second].iter().map(|along| [middle - along * 4.0, middle + along * 4.0]).collect();
        let path: Vec<Motion> = (0..200).map(|_| world_from_rig(&mut random)).collect();
        // The rig may move: the two lines are the same ones from everywhere, so turning is what tells.
        let still = [path[0]];
        check_not_wrong(&pairs_along(&mut random, &room, &truth(), &path));
        check_not_converged(
            &pairs_along(&mut random, &room, &truth(), &still.repeat(40)),
            &[ReasonCode::NotEnoughEvidence, ReasonCode::RunnerUpTooClose, ReasonCode::NoLines],
        );
    }
}

#[test]
fn lines_of_one_plane_or_through_one_point_give_the_right_pose_or_none() {
    for trial in 0..8 {
        let mut random = Random::named(&format!("plane {trial}"));
        let (first, second) = normal_basis(&(random.rotation() * Vector3::z()));
        let mut in_plane =
            edges(&mut random, 60, |random, _| first * random.signed() + second * random.signed());
        for edge in &mut in_plane {
            let off = first.cross(&second) * edge[0].coords.dot(&first.cross(&second));
            *edge = edge.map(|end| end - off);
        }
        let mut pairs = without_turning(&mut random, &in_plane);
        spoil(&mut random, &mut pairs, 0.2);
        check_not_wrong(&pairs);
        let mut through_point = room(&mut random, 60);
        for edge in &mut through_point {
            let middle = nalgebra::center(&edge[0], &edge[1]).coords;
            *edge = edge.map(|end| end - middle);
        }
        let mut pairs = without_turning(&mut random, &through_point);
        spoil(&mut random, &mut pairs, 0.2);
        check_not_wrong(&pairs);
    }
}

fn matches(name: &str, n: usize) -> (Random, Vec<LinePair>) {
    let mut random = Random::named(name);
    let room = room(&mut random, 60);
    let path: Vec<Motion> = (0..30).map(|_| world_from_rig(&mut random)).collect();
    let mut pairs = pairs_along(&mut random, &room, &truth(), &path);
    assert!(pairs.len() >= n, "{} matches", pairs.len());
    pairs.truncate(n);
    (random, pairs)
}

#[test]
fn too_few_matches_say_so() {
    check_not_converged(&[], &[ReasonCode::NoLines]);
    let (_, pairs) = matches("few", 30);
    for n in 1..6 {
        check_not_converged(&pairs[..n], &[ReasonCode::NotEnoughEvidence, ReasonCode::AxisUnobservable]);
    }
    let without_depth = |pair: &LinePair| {
        let target = TargetSide::Pnl(*pair.target_observation());
        LinePair { target, ..pair.clone() }
    };
    let pnl: Vec<LinePair> = pairs.iter().map(without_depth).collect();
    check_not_converged(&pnl, &[ReasonCode::NotEnoughEvidence]);
}

#[test]
fn matches_that_are_all_wrong_give_no_pose() {
    for trial in 0..10 {
        let (mut random, mut pairs) = matches(&format!("all wrong {trial}"), 60);
        spoil(&mut random, &mut pairs, 2.0);
        check_not_converged(&pairs, &[ReasonCode::NotEnoughEvidence]);
    }
}

#[test]
fn a_second_pose_with_as_many_matches_is_no_answer() {
    for moved_m in [0.03, 0.1, 0.5] {
        let mut random = Random::named("two poses");
        let room = room(&mut random, 60);
        let path: Vec<Motion> = (0..14).map(|_| world_from_rig(&mut random)).collect();
        let other = Motion::translation(0.0, moved_m, 0.0) * truth();
        let mut pairs = pairs_along(&mut random, &room, &truth(), &path[..7]);
        let mut others = pairs_along(&mut random, &room, &other, &path[7..]);
        let n = pairs.len().min(others.len());
        pairs.truncate(n);
        others.truncate(n);
        pairs.append(&mut others);
        check_not_converged(
            &pairs,
            &[ReasonCode::RunnerUpTooClose, ReasonCode::ResidualTooHigh, ReasonCode::HalvesDisagree],
        );
    }
}

#[test]
fn noise_beyond_what_was_said_is_no_answer() {
    let (_, pairs) = matches("noise", 60);
    let too_sure = |pair: &LinePair| {
        let sure = |line: &crate::geometry::LineObservation| {
            let mut line = *line;
            line.sigma_across /= 4.0;
            line.depth = line.depth.map(|mut depth| {
                depth.covariance_per_m2 /= 16.0;
                depth
            });
            line
        };
        LinePair::try_new(&sure(pair.target_observation()), &sure(&pair.source.observation), pair.set)
            .expect("as before")
    };
    let pairs: Vec<LinePair> = pairs.iter().map(too_sure).collect();
    check_not_converged(&pairs, &[ReasonCode::ResidualTooHigh, ReasonCode::NotEnoughEvidence]);
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    const TRIALS: usize = 60;
    let mut sum = 0.0;
    for trial in 0..TRIALS {
        let (mut random, mut pairs) = matches(&format!("honest {trial}"), 60);
        spoil(&mut random, &mut pairs, 0.2);
        with_pnl(&mut pairs);
        let solution = solved(&pairs);
        let found = solution.target_from_source.unwrap_or_else(|| panic!("{trial}: {:?}", solution.reason));
        let translation = truth().translation.vector - found.translation.vector;
        let rotation: Vector3<f64> = (truth().rotation * found.rotation.inverse()).scaled_axis();
        let error = Vector6::from_iterator(translation.iter().chain(rotation.iter()).copied());
        let cholesky = solution.covariance.and_then(nalgebra::Matrix6::cholesky).expect("positive definite");
        sum += error.dot(&cholesky.solve(&error));
    }
    // Chi-square with 360 degrees of freedom, divided by 60: 99 % within 4.9 and 7.2; the noise scale of at least 1 makes
    // the covariance a little too large, never too small.
    let mean = sum / TRIALS as f64;
    assert!((4.5..7.2).contains(&mean), "mean of {mean:.2}, expected about 6");
}
