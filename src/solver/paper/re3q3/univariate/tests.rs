use super::*;

/// Coefficients of the product of (x - root), lowest power first.
fn with_roots(roots: [f64; 8]) -> Octic {
    let mut octic: Octic = [0.0; 9];
    octic[0] = 1.0;
    for (degree, root) in roots.into_iter().enumerate() {
        for i in (0..=degree + 1).rev() {
            octic[i] = if i > 0 { octic[i - 1] } else { 0.0 } - root * octic[i];
        }
    }
    let largest = octic.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    octic.map(|value| value / largest)
}

fn values(octic: &Octic) -> [f64; N_COEFFICIENTS] {
    NODES.map(|(u, v)| {
        let power = |i: usize| u.powi(i as i32) * v.powi(8 - i as i32);
        octic.iter().enumerate().map(|(i, coefficient)| coefficient * power(i)).sum()
    })
}

#[test]
fn nine_values_give_the_coefficients() {
    let octic = with_roots([-7.0, -2.5, -0.9, -0.1, 0.0, 0.35, 1.0, 12.0]);
    for (found, expected) in powers(&values(&octic)).iter().zip(octic) {
        assert!((found - expected).abs() < 1e-13, "{found} {expected}");
    }
}

#[test]
fn bernstein_coefficients_give_the_values_at_both_ends_and_in_the_middle() {
    let octic = with_roots([-7.0, -2.5, -0.9, -0.1, 0.2, 0.35, 1.5, 12.0]);
    let whole = Interval { low: -1.0, high: 1.0, bernstein: bernstein(&octic) };
    let [left, right] = whole.halves();
    let at = |x| value_and_slope(&octic, x).0;
    for (found, expected) in [
        (whole.bernstein[0], at(-1.0)),
        (whole.bernstein[8], at(1.0)),
        (left.bernstein[8], at(0.0)),
        (right.halves()[0].bernstein[8], at(0.5)),
    ] {
        assert!((found - expected).abs() < 1e-14, "{found} {expected}");
    }
}

#[track_caller]
fn check(octic: &Octic, expected: &[f64], tolerance: f64) {
    let found = real_roots(&values(octic));
    let mut found: Vec<f64> = found.as_slice().iter().map(|ratio| ratio.u / ratio.v).collect();
    found.sort_by(f64::total_cmp);
    for root in expected {
        assert!(found.iter().any(|x| (x - root).abs() < tolerance * (1.0 + root.abs())), "{root}: {found:?}");
    }
    for x in &found {
        assert!(expected.iter().any(|root| (x - root).abs() < tolerance * (1.0 + root.abs())), "{found:?}");
    }
}

#[test]
fn eight_simple_roots_on_both_sides_of_one_are_found() {
    let roots = [-7.0, -2.5, -0.9, -0.1, 0.0, 0.35, 1.0, 12.0];
    check(&with_roots(roots), &roots, 1e-7);
    assert!(real_roots(&values(&with_roots(roots))).are_clear);
}

#[test]
fn a_polynomial_without_real_roots_has_none() {
    check(&[1.0, 0.0, 0.3, 0.0, 0.2, 0.0, 0.1, 0.0, 0.5], &[], 1e-9);
}

#[test]
fn a_double_root_is_found_and_said_to_be_unclear() {
    for double in [0.5, 0.3, 0.0, -1.0, 3.7] {
        let roots = [double, double, -0.6, 0.8, 2.0, -3.0, 5.0, -8.0];
        check(&with_roots(roots), &roots[1..], MAX_SPREAD);
    }
    let roots = [0.3, 0.3, -0.6, 0.8, 2.0, -3.0, 5.0, -8.0];
    assert!(!real_roots(&values(&with_roots(roots))).are_clear);
}

#[test]
fn a_root_at_infinity_is_the_ratio_one_to_nothing() {
    let mut octic = with_roots([0.0, 0.2, -0.4, 0.7, 3.0, 4.0, -5.0, 0.9]);
    octic.reverse();
    assert!(
        real_roots(&values(&octic)).as_slice().iter().any(|ratio| ratio.u == 1.0 && ratio.v.abs() < 1e-12)
    );
}

#[test]
fn both_derivatives_agree_with_central_differences() {
    let octic = with_roots([0.5, 0.2, -0.6, 0.8, 2.0, -3.0, 5.0, -8.0]);
    for x in [-1.0, -0.4, 0.0, 0.3, 0.9] {
        let (before, after) = (value_and_slope(&octic, x - 1e-5), value_and_slope(&octic, x + 1e-5));
        let (slope, curvature) = slope_and_curvature(&octic, x);
        assert!((value_and_slope(&octic, x).1 - slope).abs() < 1e-12);
        assert!(((after.0 - before.0) / 2e-5 - slope).abs() < 1e-8, "{x}: {slope}");
        assert!(((after.1 - before.1) / 2e-5 - curvature).abs() < 1e-8, "{x}: {curvature}");
    }
}
