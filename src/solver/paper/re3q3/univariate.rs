//! All real roots of a homogeneous polynomial of degree eight in two unknowns.
//!
//! The projective line is covered by u / v and v / u in -1..1. In each a polynomial's Bernstein coefficients change sign at least as often
//! as it has roots and, where at most once, exactly as often: intervals are halved until that is so. What remains undecided
//! at the smallest width is a multiple root or two that cannot be told apart.

const N_COEFFICIENTS: usize = 9;
/// Narrower intervals cannot be decided by the sign of values that are known to 1e-15.
const MIN_WIDTH: f64 = 1e-6;
/// Values at the ends of intervals that count as zero; the largest coefficient is 1.
const ZERO: f64 = 1e-14;
/// A last step of Newton's method of this length leaves an error of its square.
const LAST_STEP: f64 = 1e-7;
/// Bisection alone needs fewer.
const MAX_STEPS: usize = 60;
/// Roots closer than this are the same one, seen from both sides of an interval's end.
const SAME_RATIO: f64 = 1e-12;
/// Eight roots, and what rounding makes of them where some coincide.
const MAX_RATIOS: usize = 16;
/// Each halving leaves one half waiting: log2(2 / `MIN_WIDTH`) + 2.
const MAX_WAITING: usize = 24;

/// Coefficients of `u^i v^(8 - i)`.
pub type Octic = [f64; N_COEFFICIENTS];

/// A ratio u : v; one of them is 1, the other at most 1 in magnitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ratio {
    pub u: f64,
    pub v: f64,
}

impl Ratio {
    /// Value of a homogeneous polynomial.
    pub fn value<const N: usize>(self, polynomial: &[f64; N]) -> f64 {
        let Self { u, v } = self;
        if v == 1.0 {
            polynomial.iter().rev().fold(0.0, |sum, coefficient| sum * u + coefficient)
        } else {
            polynomial.iter().fold(0.0, |sum, coefficient| sum * v + coefficient)
        }
    }
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

/// Every real root of a polynomial whose largest coefficient is 1.
pub fn real_roots(octic: &Octic) -> Ratios {
    let mut ratios =
        Ratios { n_ratios: 0, ratios: [Ratio { u: 0.0, v: 1.0 }; MAX_RATIOS], are_clear: true };
    add_roots(octic, &mut ratios, |u| Ratio { u, v: 1.0 });
    let mut reversed = *octic;
    reversed.reverse();
    add_roots(&reversed, &mut ratios, |v| Ratio { u: 1.0, v });
    ratios
}

/// Part of -1..1 with the polynomial's Bernstein coefficients on it.
#[derive(Clone, Copy)]
struct Interval {
    low: f64,
    high: f64,
    bernstein: Octic,
}

/// Adds the roots in -1..1 of a polynomial in one unknown, lowest power first.
fn add_roots(polynomial: &Octic, ratios: &mut Ratios, ratio: impl Fn(f64) -> Ratio) {
    let whole = Interval { low: -1.0, high: 1.0, bernstein: bernstein(polynomial) };
    let mut waiting = [whole; MAX_WAITING];
    let mut n_waiting = 1;
    for end in [0, N_COEFFICIENTS - 1] {
        if whole.bernstein[end].abs() < ZERO {
            ratios.push(ratio(if end == 0 { -1.0 } else { 1.0 }));
        }
    }
    while n_waiting > 0 {
        n_waiting -= 1;
        let interval = waiting[n_waiting];
        match interval.sign_changes() {
            0 => {}
            1 => ratios.push(ratio(interval.only_root(polynomial))),
            _ if interval.high - interval.low < MIN_WIDTH => {
                ratios.are_clear = false;
                ratios.push(ratio(interval.extremum(polynomial)));
            }
            _ => {
                let [left, right] = interval.halves();
                // A root that only touches zero just here changes no sign in either half.
                if right.bernstein[0].abs() < ZERO {
                    ratios.push(ratio(right.low));
                }
                waiting[n_waiting] = right;
                waiting[n_waiting + 1] = left;
                n_waiting += 2;
            }
        }
    }
}

impl Interval {
    fn sign_changes(&self) -> usize {
        self.bernstein.windows(2).filter(|pair| (pair[0] >= 0.0) != (pair[1] >= 0.0)).count()
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
        let is_high_at_low = self.bernstein[0] >= 0.0;
        let (mut low, mut high) = (self.low, self.high);
        let mut x = self.crossing();
        for _ in 0..MAX_STEPS {
            let [value, slope, _] = value_and_derivatives(polynomial, x);
            if (value >= 0.0) == is_high_at_low {
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
    fn extremum(&self, polynomial: &Octic) -> f64 {
        let middle = 0.5 * (self.low + self.high);
        let mut x = middle;
        for _ in 0..3 {
            let [_, slope, curvature] = value_and_derivatives(polynomial, x);
            let next = x - slope / curvature;
            if !((next - middle).abs() < 4.0 * MIN_WIDTH) {
                return middle;
            }
            x = next;
        }
        x
    }
}

/// Value, first and second derivative.
#[inline]
fn value_and_derivatives(polynomial: &Octic, x: f64) -> [f64; 3] {
    let (mut value, mut slope, mut half_curvature) = (0.0, 0.0, 0.0);
    for coefficient in polynomial.iter().rev() {
        half_curvature = half_curvature * x + slope;
        slope = slope * x + value;
        value = value * x + coefficient;
    }
    [value, slope, 2.0 * half_curvature]
}

/// Bernstein coefficients on -1..1.
fn bernstein(polynomial: &Octic) -> Octic {
    let mut coefficients = [0.0; N_COEFFICIENTS];
    for (power, coefficient) in polynomial.iter().enumerate() {
        for (sum, of_power) in coefficients.iter_mut().zip(&BERNSTEIN_OF_POWERS[power]) {
            *sum += coefficient * of_power;
        }
    }
    coefficients
}

const BERNSTEIN_OF_POWERS: [Octic; N_COEFFICIENTS] = bernstein_of_powers();

/// With t = (x + 1) / 2: `x^k = (t - (1 - t))^k (t + (1 - t))^(8 - k)`, expanded in `C(8, i) t^i (1 - t)^(8 - i)`.
const fn bernstein_of_powers() -> [Octic; N_COEFFICIENTS] {
    let degree = N_COEFFICIENTS - 1;
    let mut table = [[0.0; N_COEFFICIENTS]; N_COEFFICIENTS];
    let mut k = 0;
    while k <= degree {
        let mut i = 0;
        while i <= degree {
            let mut j = 0;
            while j <= i && j <= k {
                let sign = if (k - j) % 2 == 0 { 1.0 } else { -1.0 };
                table[k][i] +=
                    sign * (binomial(k, j) * binomial(degree - k, i - j)) as f64 / binomial(degree, i) as f64;
                j += 1;
            }
            i += 1;
        }
        k += 1;
    }
    table
}

const fn binomial(n: usize, k: usize) -> usize {
    if k > n {
        return 0;
    }
    let mut value = 1;
    let mut i = 0;
    while i < k {
        value = value * (n - i) / (i + 1);
        i += 1;
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Coefficients of the product of (x - root), lowest power first.
    fn with_roots(roots: [f64; 8]) -> Octic {
        let mut octic = [0.0; 9];
        octic[0] = 1.0;
        for (degree, root) in roots.into_iter().enumerate() {
            for i in (0..=degree + 1).rev() {
                octic[i] = if i > 0 { octic[i - 1] } else { 0.0 } - root * octic[i];
            }
        }
        let largest = octic.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
        octic.map(|value| value / largest)
    }

    #[track_caller]
    fn check(octic: &Octic, expected: &[f64], tolerance: f64) {
        let found = real_roots(octic);
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
        check(&with_roots(roots), &roots, 1e-9);
        assert!(real_roots(&with_roots(roots)).are_clear);
    }

    #[test]
    fn a_polynomial_without_real_roots_has_none() {
        check(&[1.0, 0.0, 0.3, 0.0, 0.2, 0.0, 0.1, 0.0, 0.5], &[], 1e-9);
    }

    #[test]
    fn a_double_root_is_found_and_said_to_be_unclear() {
        for double in [0.5, 0.3, 0.0, -1.0, 3.7] {
            let roots = [double, double, -0.6, 0.8, 2.0, -3.0, 5.0, -8.0];
            check(&with_roots(roots), &roots[1..], 1e-6);
        }
        let roots = [0.3, 0.3, -0.6, 0.8, 2.0, -3.0, 5.0, -8.0];
        assert!(!real_roots(&with_roots(roots)).are_clear);
    }

    #[test]
    fn a_root_at_infinity_is_the_ratio_one_to_nothing() {
        let mut octic = with_roots([0.0, 0.2, -0.4, 0.7, 3.0, 4.0, -5.0, 0.9]);
        octic.reverse();
        assert!(real_roots(&octic).as_slice().iter().any(|ratio| ratio.u == 1.0 && ratio.v.abs() < 1e-12));
    }
}
