use nalgebra::{RowSVector, UnitQuaternion, Vector3};

use super::*;
use crate::solver::tests::room::Random;

type Quadrics = SMatrix<f64, 3, 10>;

/// As [`re3q3`], those at infinity included.
fn re3q3_projective(quadrics: &Quadrics) -> Roots<4> {
    Forms::orthonormal(quadrics).map_or_else(Roots::none, |forms| projective_roots(&forms))
}

/// The paper's r of eq. 5 of a homogeneous point, written out once more.
fn monomials(q: &Vector4<f64>) -> SVector<f64, 10> {
    let [x, y, z, w] = [q.x, q.y, q.z, q.w];
    SVector::from([x * x, y * y, z * z, x * y, x * z, y * z, x * w, y * w, z * w, w * w])
}

fn random_quadrics(random: &mut Random) -> Quadrics {
    Quadrics::from_fn(|_, _| random.gaussian())
}

/// Random quadrics through a point.
fn quadrics_through(random: &mut Random, point: &Vector4<f64>) -> Quadrics {
    let mut quadrics = random_quadrics(random);
    let r = monomials(point);
    let off = quadrics * r / r.norm_squared();
    quadrics -= off * r.transpose();
    quadrics
}

/// Rows of coefficients in the order of eq. 5.
fn quadrics(rows: [[f64; 10]; 3]) -> Quadrics {
    Quadrics::from_rows(&rows.map(RowSVector::from))
}

#[track_caller]
fn check_no_false_root(quadrics: &Quadrics) -> Roots {
    let roots = re3q3(quadrics);
    for root in roots.as_slice() {
        let q = Vector4::new(root.x, root.y, root.z, 1.0).normalize();
        let left = quadrics * monomials(&q);
        assert!(left.amax() < 1e-9 * quadrics.amax(), "{root} leaves {left}");
    }
    for (i, a) in roots.as_slice().iter().enumerate() {
        assert!(roots.as_slice()[..i].iter().all(|b| (a - b).norm() > 1e-9), "{a} twice");
    }
    roots
}

#[track_caller]
fn check_roots(quadrics: &Quadrics, expected: &[[f64; 3]], tolerance: f64) {
    let found = check_no_false_root(quadrics);
    assert_eq!(found.as_slice().len(), expected.len(), "{:?}", found.as_slice());
    for root in expected {
        let is_found = found.as_slice().iter().any(|x| (x - Vector3::from(*root)).norm() < tolerance);
        assert!(is_found, "{root:?} not in {:?}", found.as_slice());
    }
}

/// Another way to the roots: Newton's method from many starts on the sphere of unit quaternions.
fn roots_by_search(random: &mut Random, quadrics: &Quadrics) -> Vec<Vector4<f64>> {
    let forms = Forms::orthonormal(quadrics).expect("independent quadrics");
    let mut found: Vec<Vector4<f64>> = Vec::new();
    for _ in 0..400 {
        let mut q = random.rotation().coords;
        for _ in 0..12 {
            let mut matrix = Matrix4::zeros();
            let r =
                |q: &Vector4<f64>| forms.columns.iter().zip(monomials(q).iter()).map(|(c, r)| c * *r).sum();
            let values: Vector3<f64> = r(&q);
            for i in 0..4 {
                let mut step = Vector4::zeros();
                step[i] = 1e-6;
                let difference: Vector3<f64> = r(&(q + step)) - r(&(q - step));
                matrix.fixed_view_mut::<3, 1>(0, i).copy_from(&(difference / 2e-6));
            }
            matrix.set_row(3, &q.transpose());
            let Some(inverse) = matrix.try_inverse() else { break };
            q = (q - inverse * Vector4::new(values.x, values.y, values.z, 0.0)).normalize();
        }
        let Some(root) = forms.polished(&q) else { continue };
        if found.iter().all(|known| gap(known, &root) > 1e-6) {
            found.push(root);
        }
    }
    found
}

#[test]
fn a_point_that_random_quadrics_share_is_among_the_roots() {
    let mut random = Random::named("known roots");
    for _ in 0..5000 {
        let point = Vector3::new(random.gaussian(), random.gaussian(), random.gaussian());
        let quadrics = quadrics_through(&mut random, &point.push(1.0));
        let roots = check_no_false_root(&quadrics);
        let error = roots.as_slice().iter().map(|root| (root - point).norm()).fold(f64::INFINITY, f64::min);
        assert!(error < 1e-6 * (1.0 + point.norm_squared()), "{point} missed by {error}");
    }
}

#[test]
fn a_search_from_many_starts_finds_no_other_root() {
    let mut random = Random::named("search");
    for _ in 0..60 {
        let quadrics = random_quadrics(&mut random);
        let roots = re3q3_projective(&quadrics);
        for other in roots_by_search(&mut random, &quadrics) {
            let is_found = roots.as_slice().iter().any(|root| gap(root, &other) < 1e-6);
            assert!(is_found, "{other} not in {:?}", roots.as_slice());
        }
        assert!(roots.as_slice().len().is_multiple_of(2), "complex roots come in pairs: {roots:?}");
    }
}

/// Three constraints `Σ m[i][j] R[i][j] = 0` on a rotation as quadrics of s, by evaluating eq. 3 times 1 + s.s.
fn rotation_constraints(random: &mut Random, truth: &UnitQuaternion<f64>) -> Quadrics {
    let matrix = truth.to_rotation_matrix().into_inner();
    let mut quadrics = Quadrics::zeros();
    for row in 0..3 {
        let mut weights = nalgebra::Matrix3::from_fn(|_, _| random.gaussian());
        weights -= matrix * (weights.dot(&matrix) / 3.0);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| Vector4::<f64>::ith(i, 1.0));
        let value = |q: Vector4<f64>| {
            let norm2 = q.norm_squared();
            UnitQuaternion::from_quaternion(Quaternion::from(q))
                .to_rotation_matrix()
                .into_inner()
                .dot(&weights)
                * norm2
        };
        let product = |p: Vector4<f64>, q: Vector4<f64>| value(p + q) - value(p) - value(q);
        let coefficients = [
            value(a),
            value(b),
            value(c),
            product(a, b),
            product(a, c),
            product(b, c),
            product(a, d),
            product(b, d),
            product(c, d),
            value(d),
        ];
        quadrics.set_row(row, &RowSVector::from(coefficients));
    }
    quadrics
}

#[track_caller]
fn check_rotation(random: &mut Random, truth: &UnitQuaternion<f64>) {
    let quadrics = rotation_constraints(random, truth);
    let roots = re3q3_projective(&quadrics);
    let error_rad = roots
        .as_slice()
        .iter()
        .map(|root| UnitQuaternion::from_quaternion(Quaternion::from(*root)).angle_to(truth))
        .fold(f64::INFINITY, f64::min);
    assert!(error_rad < 1e-6, "{truth} missed by {error_rad} rad");
}

#[test]
fn the_true_rotation_is_among_the_roots() {
    let mut random = Random::named("rotations");
    for _ in 0..2000 {
        let truth = random.rotation();
        check_rotation(&mut random, &truth);
    }
}

#[test]
fn the_identity_and_quarter_turns_are_found() {
    let mut random = Random::named("special rotations");
    for axis in [Vector3::zeros(), Vector3::x(), Vector3::y(), Vector3::z()] {
        for _ in 0..20 {
            check_rotation(&mut random, &UnitQuaternion::new(axis * std::f64::consts::FRAC_PI_2));
        }
    }
}

#[test]
fn half_turns_and_their_neighbours_are_found_as_projective_roots() {
    let mut random = Random::named("half turns");
    for axis in [Vector3::x(), Vector3::y(), Vector3::z(), Vector3::new(2.0, -1.0, 2.0) / 3.0] {
        for short_of_rad in [0.0, 1e-9, 1e-6, 1e-3, 0.1] {
            check_rotation(&mut random, &UnitQuaternion::new(axis * (std::f64::consts::PI - short_of_rad)));
        }
    }
}

#[test]
fn a_half_turn_is_no_affine_root() {
    let mut random = Random::named("affine");
    for _ in 0..50 {
        let truth = UnitQuaternion::new(Vector3::new(2.0, -1.0, 2.0) / 3.0 * std::f64::consts::PI);
        let quadrics = rotation_constraints(&mut random, &truth);
        let n_finite = check_no_false_root(&quadrics).as_slice().len();
        assert_eq!(n_finite + 1, re3q3_projective(&quadrics).as_slice().len());
    }
}

#[test]
fn quadrics_without_isolated_roots_have_no_answer() {
    let mut random = Random::named("dependent");
    let mut twice = random_quadrics(&mut random);
    twice.set_row(1, &(twice.row(0) * -2.5));
    let mut rank_two = random_quadrics(&mut random);
    rank_two.set_row(2, &(rank_two.row(0) - rank_two.row(1) * 0.3));
    let mut one_zero = random_quadrics(&mut random);
    one_zero.row_mut(1).fill(0.0);
    for degenerate in [Quadrics::zeros(), twice, rank_two, one_zero] {
        assert_eq!(re3q3_projective(&degenerate).as_slice(), &[] as &[Vector4<f64>]);
    }
}

#[test]
fn what_is_not_finite_has_no_answer() {
    let mut random = Random::named("not finite");
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for at in [(0, 0), (1, 4), (2, 9)] {
            let mut quadrics = random_quadrics(&mut random);
            quadrics[at] = bad;
            assert_eq!(re3q3(&quadrics).as_slice(), &[] as &[Vector3<f64>]);
        }
    }
}

#[test]
fn quadrics_with_a_common_curve_have_no_answer() {
    // The twisted cubic (t, t², t³): x² = y, xy = z, y² = xz.
    let cubic = quadrics([
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0],
        [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    ]);
    // (x - 0.3) times three linear equations.
    let planes = quadrics([
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -0.3, 0.0, 0.0],
        [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -0.3, 0.0],
    ]);
    // Linear equations alone: the plane at infinity solves them all.
    let linear = quadrics([
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.5],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -0.2],
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1],
    ]);
    for curve in [cubic, planes, linear] {
        check_roots(&curve, &[], 0.0);
    }
}

#[test]
fn three_cylinders_meet_in_eight_points_that_share_their_coordinates() {
    let cylinders = quadrics([
        [1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
        [0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
        [1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
    ]);
    let s = 0.5_f64.sqrt();
    let corners: Vec<[f64; 3]> =
        (0..8).map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { s } else { -s })).collect();
    check_roots(&cylinders, &corners, 1e-9);
}

#[test]
fn a_plane_and_two_quadrics_have_their_four_finite_roots() {
    // x = 0.5; y² = 1; z² = 4
    let plane = quadrics([
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.5],
        [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0],
        [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -4.0],
    ]);
    check_roots(&plane, &[[0.5, 1.0, 2.0], [0.5, 1.0, -2.0], [0.5, -1.0, 2.0], [0.5, -1.0, -2.0]], 1e-9);
}

#[test]
fn a_double_root_is_given_once() {
    let mut random = Random::named("double");
    let mut n_found = 0;
    for _ in 0..200 {
        // All three gradients at the root lie in one plane: a double root.
        let point = Vector3::new(random.gaussian(), random.gaussian(), random.gaussian()).push(1.0);
        let r = monomials(&point);
        let mut quadrics = random_quadrics(&mut random);
        let tangent = Vector4::new(random.gaussian(), random.gaussian(), random.gaussian(), 0.0);
        let along = monomials(&(point + tangent)) - monomials(&(point - tangent));
        let along = along - r * (along.dot(&r) / r.norm_squared());
        quadrics -= quadrics * r * r.transpose() / r.norm_squared();
        quadrics -= quadrics * along * along.transpose() / along.norm_squared();
        let roots = check_no_false_root(&quadrics);
        let near = roots.as_slice().iter().filter(|root| (root.push(1.0) - point).norm() < 1e-4).count();
        assert!(near < 2, "{point} {:?}", roots.as_slice());
        n_found += near;
    }
    // Rounding of the coefficients parts some into two complex roots.
    assert!(n_found > 190, "{n_found} of 200");
}

#[test]
fn the_scale_of_the_equations_is_of_no_account() {
    let mut random = Random::named("scale");
    for _ in 0..100 {
        let quadrics = random_quadrics(&mut random);
        let mut scaled = quadrics * 1e90;
        scaled.row_mut(0).scale_mut(1e-180);
        let (roots, of_scaled) = (re3q3(&quadrics), re3q3(&scaled));
        assert_eq!(roots.as_slice().len(), of_scaled.as_slice().len());
        for root in roots.as_slice() {
            let is_found =
                of_scaled.as_slice().iter().any(|other| (root - other).norm() < 1e-6 * (1.0 + root.norm()));
            assert!(is_found);
        }
    }
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let mut random = Random::named("bits");
    let quadrics = random_quadrics(&mut random);
    assert_eq!(re3q3(&quadrics), re3q3(&quadrics));
}
