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
        let (mut left, mut right) = ([0.0; N_COEFFICIENTS], [0.0; N_COEFFICIENTS]);
        for (order, first) in left.iter_mut().enumerate() {
            let last = N_COEFFICIENTS - 1 - order;
            *first = work[0];
            right[last] = work[last];
            // Beyond `last` it is of no use, but a fixed number of steps is faster.
            for i in 0..N_COEFFICIENTS - 1 {
                work[i] = 0.5 * (work[i] + work[i + 1]);
            }
        }
        [
            Self { low: self.low, high: middle, bernstein: left },
            Self { low: middle, high: self.high, bernstein: right },
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
            let spread = (x - middle).abs();
            if spread.is_nan() || spread > MAX_SPREAD {
                return None;
            }
        }
        Some(x)
    }
}

/// Value and first derivative: even and odd powers apart, since four short sums at once are done sooner than two long ones.
#[inline]
fn value_and_slope(polynomial: &Octic, x: f64) -> (f64, f64) {
    let square = x * x;
    let (mut even, mut odd) = (polynomial[8], polynomial[7]);
    let (mut even_slope, mut odd_slope) = (0.0, 0.0);
    for power in [6, 4, 2] {
        even_slope = even_slope * square + even;
        even = even * square + polynomial[power];
        odd_slope = odd_slope * square + odd;
        odd = odd * square + polynomial[power - 1];
    }
    even_slope = even_slope * square + even;
    even = even * square + polynomial[0];
    (even + x * odd, odd + 2.0 * x * (even_slope + x * odd_slope))
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
mod tests;
