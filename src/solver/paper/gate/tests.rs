use super::*;
use crate::geometry::motion::Motion;
use crate::solver::paper::tests::scenes::{any_motion, penetrating, read, with_wrong};
use crate::solver::tests::room::Random;

#[test]
fn the_nearest_rotation_of_a_rotation_is_itself_and_of_a_reflection_another() {
    let rotation = Rotation3::new(Vector3::new(0.3, -1.2, 0.5));
    let (nearest, distance) = special_orthogonalisation(rotation.matrix()).expect("finite");
    assert!((nearest.matrix() - rotation.matrix()).amax() < 1e-12 && distance < 1e-12);
    let (nearest, distance) = special_orthogonalisation(&-rotation.matrix()).expect("finite");
    assert!((nearest.matrix().determinant() - 1.0).abs() < 1e-12);
    assert!((distance - 2.0).abs() < 1e-12);
    assert!(special_orthogonalisation(&Matrix3::repeat(f64::NAN)).is_none());
}

#[test]
fn the_distance_is_that_of_the_singular_values() {
    // Eq. 12: U diag(1.3, 1.1, 0.8) Vᵀ is |(0.3, 0.1, -0.2)| from SO(3).
    let (u, v) = (Rotation3::new(Vector3::new(0.4, 0.1, -0.9)), Rotation3::new(Vector3::new(-1.4, 0.6, 0.2)));
    let matrix = u.matrix() * Matrix3::from_diagonal(&Vector3::new(1.3, 1.1, 0.8)) * v.matrix().transpose();
    let (nearest, distance) = special_orthogonalisation(&matrix).expect("finite");
    assert!((nearest.matrix() - (u * v.inverse()).matrix()).amax() < 1e-12);
    assert!((distance - 0.14_f64.sqrt()).abs() < 1e-12);
}

#[test]
fn exact_directions_of_both_kinds_give_the_rotation() {
    let rotation = Rotation3::new(Vector3::new(0.4, -0.3, 0.9));
    let mut random = Random::named("directions");
    let mut direction = || Vector3::new(random.signed(), random.signed(), random.signed()).normalize();
    let mut system = DirectionSystem::empty();
    for _ in 0..2 {
        let source = direction();
        system.add_full(&source, &(rotation * source), 1.0);
    }
    assert!(system.solve().is_none(), "two directions leave three of nine numbers open");
    for _ in 0..12 {
        let source = direction();
        let plane_normal = (rotation * source).cross(&direction()).normalize();
        system.add_pnl(&source, &plane_normal, 1.0);
    }
    let found = system.solve().expect("nine independent rows");
    assert!((found.matrix - rotation.matrix()).amax() < 1e-9);
}

fn mixed(truth: &Motion, random: &mut Random) -> Vec<crate::solver::LinePair> {
    let mut pairs = with_wrong(&penetrating(random, truth, (40, 1.0)), 10);
    // Right pairs first: the gate believes its start.
    pairs.rotate_left(10);
    pairs
}

#[test]
fn within_noise_right_pairs_go_in_and_most_wrong_ones_stay_out() {
    let mut random = Random::named("gate");
    let (mut right, mut wrong) = (0, 0);
    for _ in 0..20 {
        let truth = any_motion(&mut random);
        let pairs = mixed(&truth, &mut random);
        let let_in = gate(&read(&pairs), GateRule::WithinNoise { n_sigmas: 3.0 });
        right += let_in.iter().filter(|idx| **idx < 30).count();
        wrong += let_in.iter().filter(|idx| **idx >= 30).count();
    }
    assert!(right >= 590 && wrong <= 80, "{right} of 600, {wrong} of 200");
}

#[test]
fn the_papers_rule_loses_many_right_pairs() {
    let mut random = Random::named("strict gate");
    let truth = any_motion(&mut random);
    let pairs = mixed(&truth, &mut random);
    let strict = gate(&read(&pairs), GateRule::Decreasing);
    assert!(strict.iter().filter(|idx| **idx < 30).count() < 25, "{strict:?}");
    assert_eq!(gate(&read(&pairs), GateRule::Off).len(), pairs.len());
}

#[test]
fn coplanar_directions_decide_nothing() {
    let mut random = Random::named("coplanar");
    let truth = any_motion(&mut random);
    let pairs = penetrating(&mut random, &truth, (3, 1.0));
    let same = [pairs[0].clone(), pairs[1].clone(), pairs[0].clone(), pairs[1].clone(), pairs[0].clone()];
    assert_eq!(gate(&read(&same), GateRule::Decreasing), [0, 1, 2, 3, 4]);
}

#[test]
fn the_start_takes_lines_of_either_orientation() {
    let mut random = Random::named("orientation");
    for _ in 0..20 {
        let truth = any_motion(&mut random);
        let pairs = penetrating(&mut random, &truth, (12, 0.0));
        let mut turned = read(&pairs);
        for pair in turned.iter_mut().step_by(2) {
            if let TargetGeometry::Full(line) = &mut pair.geometry.target {
                line.direction = -line.direction;
            }
        }
        let found = start_rotation(&turned).expect("two directions");
        let gap = (found.matrix() - truth.rotation.to_rotation_matrix().matrix()).amax();
        assert!(gap < 1e-9, "{gap}: {found} {truth}");
    }
}

#[test]
fn the_same_pairs_are_let_in_whichever_way_their_lines_run() {
    let mut random = Random::named("both signs");
    for _ in 0..10 {
        let truth = any_motion(&mut random);
        let pairs = mixed(&truth, &mut random);
        let mut turned = read(&pairs);
        for pair in &mut turned {
            if random.signed() < 0.0 {
                pair.geometry.source_direction = -pair.geometry.source_direction;
            }
            match &mut pair.geometry.target {
                TargetGeometry::Full(line) if random.signed() < 0.0 => line.direction = -line.direction,
                TargetGeometry::Pnl(segment) if random.signed() < 0.0 => {
                    segment.plane_normal = -segment.plane_normal;
                }
                _ => {}
            }
        }
        for rule in [GateRule::WithinNoise { n_sigmas: 3.0 }, GateRule::Decreasing] {
            assert_eq!(gate(&turned, rule), gate(&read(&pairs), rule));
        }
    }
}
