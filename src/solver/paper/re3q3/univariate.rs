//! All real roots of a homogeneous polynomial of degree eight in two unknowns, known by nine values.
//!
//! The projective line is covered by u / v and v / u in -1..1. In each a polynomial's Bernstein coefficients change sign at least as often
//! as it has roots and, where at most once, exactly as often: intervals are halved until that is so. What remains undecided
//! at the smallest width is a multiple root or two that cannot be told apart.

mod tables;

pub use tables::NODES;
use tables::{BERNSTEIN_OF_POWERS, N_COEFFICIENTS, Octic, POWERS_OF_VALUES};

/// Narrower intervals cannot be decided by the sign of values that are known to 1e-15.
const MIN_WIDTH: f64 = 1e-6;
/// Coefficients that count as zero: a hundred times their rounding, where the largest value is of order 1.
const ZERO: f64 = 1e-13;
/// A last step of Newton's method of this length leaves an error of its square, more or less: enough to start from.
const LAST_STEP: f64 = 1e-5;
/// Bisection alone needs fewer.
const MAX_STEPS: usize = 60;
/// Roots closer than this are the same one, seen from both sides of an interval's end or from two parts of its rounding.
const SAME_RATIO: f64 = 1e-9;
/// Rounding makes a double root many changes of sign, as far from it as this where the polynomial is flat.
const MAX_SPREAD: f64 = 1e-4;
/// Eight roots, and what rounding makes of them where some coincide.
const MAX_RATIOS: usize = 16;
/// A ratio u : v; one of them is 1, the other at most 1 in magnitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    pub u: f64,
    pub v: f64,
}

/// The distinct real roots.
#[derive(Debug)]
pub struct Ratios {
    n_ratios: usize,
    ratios: [Ratio; MAX_RATIOS],
    /// Whether every root is simple beyond doubt.
    pub are_clear: bool,
}

impl Ratios {
    pub fn as_slice(&self) -> &[Ratio] {
        &self.ratios[..self.n_ratios]
    }

    fn push(&mut self, ratio: Ratio) {
        let is_known =
            self.as_slice().iter().any(|known| (known.u * ratio.v - known.v * ratio.u).abs() < SAME_RATIO);
        if is_known {
            return;
        }
        if self.n_ratios < MAX_RATIOS {
            self.ratios[self.n_ratios] = ratio;
            self.n_ratios += 1;
        } else {
            self.are_clear = false;
        }
    }
}

/// Every real root of the polynomial with these values, the largest of order 1, at the [`NODES`].
pub fn real_roots(values: &[f64; N_COEFFICIENTS]) -> Ratios {
    let mut ratios = Ratios { n_ratios: 0, ratios: [Ratio { u: 0.0, v: 1.0 }; MAX_RATIOS], are_clear: true };
    let mut polynomial = powers(values);
    Part { polynomial: &polynomial, is_reversed: false, ratios: &mut ratios }.add_roots();
    polynomial.reverse();
    Part { polynomial: &polynomial, is_reversed: true, ratios: &mut ratios }.add_roots();
    ratios
}

/// One half of the projective line: a polynomial in one unknown of -1..1, lowest power first.
struct Part<'a> {
    polynomial: &'a Octic,
    /// Whether the unknown is v / u.
    is_reversed: bool,
    ratios: &'a mut Ratios,
}

impl Part<'_> {
    fn add_roots(&mut self) {
        let whole = Interval { low: -1.0, high: 1.0, bernstein: bernstein(self.polynomial) };
        self.add_roots_in(&whole);
    }

    fn push(&mut self, x: f64) {
        self.ratios.push(if self.is_reversed { Ratio { u: 1.0, v: x } } else { Ratio { u: x, v: 1.0 } });
    }

    fn add_roots_in(&mut self, interval: &Interval) {
        let is_narrow = interval.high - interval.low < MIN_WIDTH;
        match interval.sign_changes() {
            0 if !interval.is_touching() => {}
            1 if is_narrow || !interval.is_touching() => self.push(interval.only_root(self.polynomial)),
            n_changes if is_narrow => {
                let extremum = interval.extremum(self.polynomial);
                // Without one, what touches zero is the end of a neighbour that has a simple root.
                if n_changes > 0 || extremum.is_some() {
                    self.ratios.are_clear = false;
                    self.push(extremum.unwrap_or(interval.low));
                }
            }
            _ => interval.halves().iter().for_each(|half| self.add_roots_in(half)),
        }
    }
}

/// Part of -1..1 with the polynomial's Bernstein coefficients on it.
struct Interval {
    low: f64,
    high: f64,
    bernstein: Octic,
}

impl Interval {
    fn sign_changes(&self) -> usize {
        self.bernstein.windows(2).filter(|pair| (pair[0] >= 0.0) != (pair[1] >= 0.0)).count()
    }

    /// Whether rounding may have lifted a double root off zero.
    fn is_touching(&self) -> bool {
        self.bernstein.iter().any(|coefficient| coefficient.abs() < ZERO)
    }

    /// De Casteljau's scheme at the middle.
    fn halves(&self) -> [Self; 2] {
        let middle = 0.5 * (self.low + self.high);
        let mut work = self.bernstein;
        let mut left = [0.0; N_COEFFICIENTS];
        for order in 1..N_COEFFICIENTS {
            left[order - 1] = work[0];
            for i in 0..N_COEFFICIENTS - order {
                work[i] = 0.5 * (work[i] + work[i + 1]);
            }
        }
        left[N_COEFFICIENTS - 1] = work[0];
        // What is left in `work` are the last entries of each order: the right half.
        [
            Self { low: self.low, high: middle, bernstein: left },
            Self { low: middle, high: self.high, bernstein: work },
        ]
    }

    /// The root where the coefficients change sign once: Newton's method, kept within the ends by bisection.
    fn only_root(&self, polynomial: &Octic) -> f64 {
        let is_positive_at_low = self.bernstein[0] >= 0.0;
        let (mut low, mut high) = (self.low, self.high);
        let mut x = self.crossing();
        for _ in 0..MAX_STEPS {
            let (value, slope) = value_and_slope(polynomial, x);
            if (value >= 0.0) == is_positive_at_low {
                low = x;
            } else {
                high = x;
            }
            let newton = x - value / slope;
            let next = if newton >= low && newton <= high { newton } else { 0.5 * (low + high) };
            let step = (next - x).abs();
            x = next;
            if step < LAST_STEP {
                break;
            }
        }
        x
    }

    /// Where the polygon of the coefficients crosses zero.
    fn crossing(&self) -> f64 {
        let b = &self.bernstein;
        let at = (1..N_COEFFICIENTS).find(|&i| (b[i] >= 0.0) != (b[0] >= 0.0)).unwrap_or(N_COEFFICIENTS - 1);
        let within = b[at - 1] / (b[at - 1] - b[at]);
        let share = ((at - 1) as f64 + within) / (N_COEFFICIENTS - 1) as f64;
        self.low + (self.high - self.low) * share
    }

    /// Where the polynomial touches zero, nearly: its extremum in or near the interval.
    fn extremum(&self, polynomial: &Octic) -> Option<f64> {
        let middle = 0.5 * (self.low + self.high);
        let mut x = middle;
        for _ in 0..3 {
            let (slope, curvature) = slope_and_curvature(polynomial, x);
            x -= slope / curvature;
            if !((x - middle).abs() < MAX_SPREAD) {
                return None;
            }
        }
        Some(x)
    }
}

/// Value and first derivative.
#[inline]
fn value_and_slope(polynomial: &Octic, x: f64) -> (f64, f64) {
    let (mut value, mut slope) = (0.0, 0.0);
    for coefficient in polynomial.iter().rev() {
        slope = slope * x + value;
        value = value * x + coefficient;
    }
    (value, slope)
}

/// First and second derivative.
fn slope_and_curvature(polynomial: &Octic, x: f64) -> (f64, f64) {
    let mut derivative = [0.0; N_COEFFICIENTS];
    for power in 1..N_COEFFICIENTS {
        derivative[power - 1] = power as f64 * polynomial[power];
    }
    value_and_slope(&derivative, x)
}

/// Coefficients of `u^i v^(8 - i)`.
fn powers(values: &[f64; N_COEFFICIENTS]) -> Octic {
    let mut powers = [0.0; N_COEFFICIENTS];
    for (value, of_value) in values.iter().zip(&POWERS_OF_VALUES) {
        for (power, factor) in powers.iter_mut().zip(of_value) {
            *power += value * factor;
        }
    }
    powers
}

/// Bernstein coefficients on -1..1: those of even powers are symmetric, those of odd ones antisymmetric.
fn bernstein(polynomial: &Octic) -> Octic {
    let (mut even, mut odd) = ([0.0; N_COEFFICIENTS / 2 + 1], [0.0; N_COEFFICIENTS / 2 + 1]);
    for (power, (coefficient, of_power)) in polynomial.iter().zip(&BERNSTEIN_OF_POWERS).enumerate() {
        let sums = if power.is_multiple_of(2) { &mut even } else { &mut odd };
        for (sum, factor) in sums.iter_mut().zip(of_power) {
            *sum += coefficient * factor;
        }
    }
    let mut coefficients = [0.0; N_COEFFICIENTS];
    for i in 0..even.len() {
        coefficients[i] = even[i] + odd[i];
        coefficients[N_COEFFICIENTS - 1 - i] = even[i] - odd[i];
    }
    coefficients
}

#[cfg(test)]
mod tests {
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
            assert!(
                found.iter().any(|x| (x - root).abs() < tolerance * (1.0 + root.abs())),
                "{root}: {found:?}"
            );
        }
        for x in &found {
            assert!(
                expected.iter().any(|root| (x - root).abs() < tolerance * (1.0 + root.abs())),
                "{found:?}"
            );
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
            real_roots(&values(&octic))
                .as_slice()
                .iter()
                .any(|ratio| ratio.u == 1.0 && ratio.v.abs() < 1e-12)
        );
    }
}
