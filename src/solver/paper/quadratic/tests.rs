use nalgebra::{Point3, UnitQuaternion};

use super::*;
use crate::solver::paper::cgr::rotation_from_cgr;
use crate::solver::paper::tests::scenes::{any_motion, cgr_of, penetrating, read};
use crate::solver::tests::room::Random;

/// The paper's monomials.
fn monomials(s: &Vector3<f64>) -> SVector<f64, 10> {
    let [x, y, z] = [s.x, s.y, s.z];
    SVector::from([x * x, y * y, z * z, x * y, x * z, y * z, x, y, z, 1.0])
}

fn target_line() -> TargetLine {
    TargetLine { point_m: Vector3::new(0.3, -0.4, 1.7), direction: Vector3::new(2.0, -1.0, 2.0) / 3.0 }
}

#[test]
fn the_entries_are_linear_in_the_monomials() {
    let mut random = Random::named("entries");
    for _ in 0..100 {
        let s = Vector3::new(random.signed(), random.signed(), random.signed()) * 3.0;
        let scaled = rotation_from_cgr(&s).matrix() * (1.0 + s.norm_squared());
        let entries = entries_from_monomials() * monomials(&s);
        assert!((Matrix3::from_column_slice(&entries.as_slice()[..9]) - scaled).amax() < 1e-12);
        assert!((entries[9] - 1.0 - s.norm_squared()).abs() < 1e-12);
    }
}

#[test]
fn the_true_pose_solves_the_system_with_tau_its_translation_times_one_plus_s_squared() {
    let mut random = Random::named("merged system");
    for _ in 0..50 {
        let truth = any_motion(&mut random);
        let s = cgr_of(&truth.rotation.to_rotation_matrix()).expect("no half turn");
        let scale = 1.0 + s.norm_squared();
        let mut unknowns = SVector::<f64, 13>::zeros();
        unknowns.fixed_rows_mut::<10>(0).copy_from(&(entries_from_monomials() * monomials(&s) / scale));
        unknowns.fixed_rows_mut::<3>(10).copy_from(&truth.translation.vector);
        for pair in &read(&penetrating(&mut random, &truth, (8, 0.0))) {
            let rows = |point_m: &Vector3<f64>| match &pair.geometry.target {
                TargetGeometry::Full(line) => full_rows(line, point_m).to_vec(),
                TargetGeometry::Pnl(segment) => vec![pnl_row(&segment.plane_normal, point_m)],
            };
            for row in pair.geometry.source_ends_m.iter().flat_map(rows) {
                assert!(row.coefficients().dot(&unknowns).abs() < 1e-9, "{row:?}");
            }
        }
    }
}

#[test]
fn the_rows_of_a_point_are_its_distance_from_the_line_and_from_the_viewing_plane() {
    let line = target_line();
    let point_m = Vector3::new(0.5, 0.2, 2.0);
    let at_identity: Vec<f64> =
        full_rows(&line, &point_m).iter().map(|row| row.normal.dot(&row.point_m) + row.offset_m).collect();
    let distance_m = (point_m - line.point_m).cross(&line.direction).norm();
    assert!((Vector3::from_column_slice(&at_identity[..3]).norm() - distance_m).abs() < 1e-12);
    let normal = line.point_m.cross(&line.direction).normalize();
    assert!((at_identity[3] - normal.dot(&point_m)).abs() < 1e-12);
}

#[test]
fn the_translation_is_recovered_by_the_elimination() {
    let mut random = Random::named("elimination");
    for _ in 0..50 {
        let truth = any_motion(&mut random);
        let pairs = penetrating(&mut random, &truth, (8, 0.0));
        let system = QuadraticSystem::of(read(&pairs).iter().map(|pair| &pair.geometry));
        let system = system.eliminate_translation().expect("many directions");
        let rotation = truth.rotation.to_rotation_matrix();
        assert!((system.translation_m(rotation.matrix()) - truth.translation.vector).amax() < 1e-9);
        assert!(system.cost_m2(rotation.matrix()).abs() < 1e-12);
        let turned = UnitQuaternion::from_euler_angles(0.1, 0.0, 0.0) * truth.rotation;
        assert!(system.cost_m2(turned.to_rotation_matrix().matrix()) > 1e-4);
    }
}

#[test]
fn parallel_lines_leave_the_translation_open() {
    let line = target_line();
    let shifted = |k: f64| PairGeometry {
        source_ends_m: [line.point_m, line.point_m + line.direction],
        source_direction: line.direction,
        target: TargetGeometry::Full(TargetLine {
            point_m: line.point_m + Point3::new(k, k * k, 0.3 * k).coords,
            direction: line.direction,
        }),
    };
    let pairs: Vec<PairGeometry> = (0..6).map(|k| shifted(0.1 * f64::from(k))).collect();
    let system = QuadraticSystem::of(pairs.iter());
    assert_eq!(system.eliminate_translation(), None);
}
