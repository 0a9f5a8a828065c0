use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::geometry::motion::Motion;
use crate::solver::paper::quadratic::QuadraticSystem;
use crate::solver::paper::tests::scenes::{any_motion, cgr_of, penetrating, read, with_wrong};
use crate::solver::tests::room::Random;

fn system(random: &mut Random, truth: &Motion, (n, noise): (usize, f64), n_wrong: usize) -> RotationSystem {
    let pairs = with_wrong(&penetrating(random, truth, (n, noise)), n_wrong);
    let system = QuadraticSystem::of(read(&pairs).iter().map(|pair| &pair.geometry));
    system.eliminate_translation().expect("many directions")
}

fn nearest(roots: &[RotationRoot], truth: &UnitQuaternion<f64>) -> f64 {
    let truth = truth.to_rotation_matrix();
    // Not the angle: its arc cosine turns the last digits of the trace into 1e-7 rad.
    let gap = |root: &RotationRoot| (root.rotation.matrix() - truth.matrix()).amax();
    roots.iter().map(gap).fold(f64::INFINITY, f64::min)
}

#[test]
fn the_truth_is_the_best_root_of_exact_pairs_for_any_rotation() {
    let mut random = Random::named("truth among the roots");
    for n in [8, 12, 30] {
        for _ in 0..40 {
            let truth = any_motion(&mut random);
            let roots = rotation_roots(&system(&mut random, &truth, (n, 0.0), 0), Starts::Roots);
            assert!(nearest(&roots[..1], &truth.rotation) < 1e-6, "{n} pairs, {truth}: {roots:?}");
        }
    }
}

#[test]
fn half_turns_are_found() {
    let mut random = Random::named("half turns");
    let axes = [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(1.0, 2.0, -2.0) / 3.0];
    for axis in axes {
        let truth = Motion::new(Vector3::new(0.2, -0.1, 0.3), axis * std::f64::consts::PI);
        let roots = rotation_roots(&system(&mut random, &truth, (8, 0.0), 0), Starts::Roots);
        assert!(nearest(&roots[..1], &truth.rotation) < 1e-5, "{truth}: {roots:?}");
    }
}

#[test]
fn the_true_vector_is_a_zero_of_the_three_quadrics() {
    let mut random = Random::named("three quadrics");
    for _ in 0..50 {
        let truth = any_motion(&mut random);
        let system = system(&mut random, &truth, (8, 0.0), 0);
        let s = cgr_of(&truth.rotation.to_rotation_matrix()).expect("no half turn");
        let products = chart_products(system.products(), &Rotation3::identity());
        let quadrics = three_quadrics(&products).expect("many directions");
        let [x, y, z] = [s.x, s.y, s.z];
        let monomials = Entries::from([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, 1.0]);
        let scale = monomials.amax() * quadrics.amax();
        assert!((quadrics * monomials).amax() < 1e-6 * scale, "{s}: {}", quadrics * monomials);
    }
}

#[test]
fn noise_and_wrong_pairs_never_leave_it_without_a_start_and_noise_alone_near_the_truth() {
    let mut random = Random::named("no real root");
    for _ in 0..30 {
        let truth = any_motion(&mut random);
        let noisy = rotation_roots(&system(&mut random, &truth, (30, 1.0), 0), Starts::Roots);
        assert!(nearest(&noisy, &truth.rotation) < 0.03, "{truth}: {noisy:?}");
        let mixed = system(&mut random, &truth, (30, 1.0), 12);
        assert!(!rotation_roots(&mixed, Starts::Roots).is_empty());
        let everywhere = rotation_roots(&mixed, Starts::RootsAndCube);
        assert!(everywhere.len() <= MAX_ROOTS && everywhere.is_sorted_by(|a, b| a.cost_m2 <= b.cost_m2));
    }
}

#[test]
fn the_descent_ends_where_the_gradient_vanishes() {
    let mut random = Random::named("descent");
    let truth = any_motion(&mut random);
    let system = system(&mut random, &truth, (20, 1.0), 0);
    let start = Rotation3::new(Vector3::new(0.05, -0.1, 0.08)) * truth.rotation.to_rotation_matrix();
    let found = descend(&system, at(&system, start));
    for axis in 0..3 {
        let moved = |step_rad: f64| {
            let turn = Rotation3::new(Vector3::ith(axis, step_rad));
            system.cost_m2((turn * found.rotation).matrix())
        };
        assert!(moved(1e-3) > found.cost_m2 && moved(-1e-3) > found.cost_m2);
        assert!((moved(1e-4) - moved(-1e-4)).abs() < 1e-2 * (moved(1e-3) - found.cost_m2));
    }
}

#[test]
fn the_cube_has_24_rotations() {
    let all: Vec<Rotation3<f64>> = cube_rotations().collect();
    assert_eq!(all.len(), 24);
    for (i, one) in all.iter().enumerate() {
        assert!(all[..i].iter().all(|other| one.angle_to(other) > 1.0));
    }
}

#[test]
fn the_derivative_of_the_entries_agrees_with_central_differences() {
    let mut random = Random::named("entries by rotation");
    for _ in 0..20 {
        let rotation = random.rotation().to_rotation_matrix();
        let derivative = d_entries_d_rotation(rotation.matrix());
        for axis in 0..3 {
            let turned = |step_rad: f64| {
                entries_of((Rotation3::new(Vector3::ith(axis, step_rad)) * rotation).matrix())
            };
            let difference = (turned(1e-5) - turned(-1e-5)) / 2e-5;
            assert!((difference - derivative.column(axis)).amax() < 1e-9, "axis {axis}: {difference}");
        }
    }
}
