//! Two of four homogeneous unknowns eliminated from three quadrics: one polynomial of degree eight in the ratio of the others.
//!
//! With a and b to be eliminated and u, v hidden in the coefficients, the three equations are solved for a², b² and ab:
//! each is then linear in (a, b, 1). The identities a² b = ab a, ab b = b² a and a² b² = (ab)² give three more equations linear in
//! (a, b, 1), whose determinant vanishes at the roots (Kukelova, Heller, Fitzgibbon: Efficient intersection of three quadrics).

use nalgebra::{Matrix3, Vector3, Vector4};

use super::forms::{Forms, MONOMIAL};
use super::univariate::{Octic, Ratio};

/// A determinant this much smaller than what it is the sum of is rounding: the quadrics share a curve.
const MIN_DETERMINANT: f64 = 1e-12;
/// Which two unknowns are eliminated, and which two remain.
const SPLITS: [([usize; 2], [usize; 2]); 6] = [
    ([0, 1], [2, 3]),
    ([0, 2], [1, 3]),
    ([1, 2], [0, 3]),
    ([0, 3], [1, 2]),
    ([1, 3], [0, 2]),
    ([2, 3], [0, 1]),
];

/// A polynomial homogeneous in (u, v): entry i belongs to `u^i v^(n - i)`.
type Linear = [f64; 2];
type Quadratic = [f64; 3];
type Cubic = [f64; 4];
type Quartic = [f64; 5];
type Quintic = [f64; 6];

/// `a² = a_part a + b_part b + rest` and so on.
struct Reduced {
    a: Linear,
    b: Linear,
    rest: Quadratic,
}

/// An equation linear in (a, b, 1), of degree N, N, N + 1.
struct Row<const N: usize, const M: usize> {
    a: [f64; N],
    b: [f64; N],
    rest: [f64; M],
}

/// What is left when a and b are gone.
pub struct System {
    /// Vanishes at the roots' ratio u : v.
    pub determinant: Octic,
    /// a : b : 1 at a root.
    a: Quintic,
    b: Quintic,
    one: Quartic,
}

/// The best conditioned choice of a and b.
pub struct Elimination {
    /// Determinant of the columns of a², b² and ab.
    pub pivot: f64,
    eliminated: [usize; 2],
    hidden: [usize; 2],
    columns: [Vector3<f64>; 10],
}

impl Elimination {
    /// Chooses the pair with the largest pivot.
    pub fn best(forms: &Forms) -> Self {
        let pivot = |[a, b]: [usize; 2]| {
            let column = |i: usize, j: usize| forms.columns[MONOMIAL[i][j]];
            column(a, a).cross(&column(b, b)).dot(&column(a, b))
        };
        let mut best = Self { pivot: 0.0, eliminated: [0, 1], hidden: [2, 3], columns: forms.columns };
        for (eliminated, hidden) in SPLITS {
            let pivot = pivot(eliminated);
            if pivot.abs() > best.pivot.abs() {
                best = Self { pivot, eliminated, hidden, ..best };
            }
        }
        best
    }

    /// The equations solved for a², b² and ab.
    fn reduced(&self) -> [Reduced; 3] {
        let ([a, b], [u, v]) = (self.eliminated, self.hidden);
        let column = |i: usize, j: usize| self.columns[MONOMIAL[i][j]];
        let (aa, bb, ab) = (column(a, a), column(b, b), column(a, b));
        let inverse =
            Matrix3::from_rows(&[bb.cross(&ab), ab.cross(&aa), aa.cross(&bb)].map(|row| row.transpose()))
                / -self.pivot;
        let solved = |i: usize, j: usize| inverse * column(i, j);
        let (au, av, bu, bv) = (solved(a, u), solved(a, v), solved(b, u), solved(b, v));
        let (uu, uv, vv) = (solved(u, u), solved(u, v), solved(v, v));
        std::array::from_fn(|i| Reduced {
            a: [av[i], au[i]],
            b: [bv[i], bu[i]],
            rest: [vv[i], uv[i], uu[i]],
        })
    }

    /// The polynomial and the way back; `None` when the polynomial vanishes everywhere: a curve of solutions.
    pub fn system(&self) -> Option<System> {
        let [aa, bb, ab] = self.reduced();
        let first = first_row(&aa, &bb, &ab);
        let second = second_row(&aa, &bb, &ab, &first);
        let third = third_row(&aa, &bb, &ab);
        // The cross product of the first two rows is (a, b, 1) up to scale.
        let (mut a, mut b, mut one) = ([0.0; 6], [0.0; 6], [0.0; 5]);
        add_product(&mut a, 1.0, &first.b, &second.rest);
        add_product(&mut a, -1.0, &first.rest, &second.b);
        add_product(&mut b, 1.0, &first.rest, &second.a);
        add_product(&mut b, -1.0, &first.a, &second.rest);
        add_product(&mut one, 1.0, &first.a, &second.b);
        add_product(&mut one, -1.0, &first.b, &second.a);
        let mut determinant = [0.0; 9];
        add_product(&mut determinant, 1.0, &third.a, &a);
        add_product(&mut determinant, 1.0, &third.b, &b);
        add_product(&mut determinant, 1.0, &third.rest, &one);
        let summands = largest(&third.a) * largest(&a)
            + largest(&third.b) * largest(&b)
            + largest(&third.rest) * largest(&one);
        let size = largest(&determinant);
        // Also refuses what is not a number.
        (size > MIN_DETERMINANT * summands && size.is_finite()).then(|| System {
            determinant: determinant.map(|coefficient| coefficient / size),
            a,
            b,
            one,
        })
    }

    /// The root that belongs to a ratio u : v, of any length.
    pub fn root(&self, system: &System, ratio: Ratio) -> Vector4<f64> {
        let one = ratio.value(&system.one);
        let mut root = Vector4::zeros();
        root[self.eliminated[0]] = ratio.value(&system.a);
        root[self.eliminated[1]] = ratio.value(&system.b);
        root[self.hidden[0]] = one * ratio.u;
        root[self.hidden[1]] = one * ratio.v;
        root
    }
}

/// a² b = ab a
fn first_row(aa: &Reduced, bb: &Reduced, ab: &Reduced) -> Row<3, 4> {
    let (mut a, mut b, mut rest): (Quadratic, Quadratic, Cubic) =
        (ab.rest.map(|value| -value), aa.rest, [0.0; 4]);
    let difference = [aa.a[0] - ab.b[0], aa.a[1] - ab.b[1]];
    add_product(&mut a, 1.0, &aa.b, &bb.a);
    add_product(&mut a, -1.0, &ab.a, &ab.b);
    add_product(&mut b, 1.0, &difference, &ab.b);
    add_product(&mut b, 1.0, &aa.b, &bb.b);
    add_product(&mut b, -1.0, &ab.a, &aa.b);
    add_product(&mut rest, 1.0, &difference, &ab.rest);
    add_product(&mut rest, 1.0, &aa.b, &bb.rest);
    add_product(&mut rest, -1.0, &ab.a, &aa.rest);
    Row { a, b, rest }
}

/// ab b = b² a; its part of b is the first row's part of a with the other sign.
fn second_row(aa: &Reduced, bb: &Reduced, ab: &Reduced, first: &Row<3, 4>) -> Row<3, 4> {
    let (mut a, mut rest): (Quadratic, Cubic) = (bb.rest.map(|value| -value), [0.0; 4]);
    let difference = [ab.a[0] - bb.b[0], ab.a[1] - bb.b[1]];
    add_product(&mut a, 1.0, &difference, &ab.a);
    add_product(&mut a, 1.0, &ab.b, &bb.a);
    add_product(&mut a, -1.0, &bb.a, &aa.a);
    add_product(&mut rest, 1.0, &difference, &ab.rest);
    add_product(&mut rest, 1.0, &ab.b, &bb.rest);
    add_product(&mut rest, -1.0, &bb.a, &aa.rest);
    Row { a, b: first.a.map(|value| -value), rest }
}

/// a² b² = (ab)²: quadratic in a and b again, and reduced once more.
fn third_row(aa: &Reduced, bb: &Reduced, ab: &Reduced) -> Row<4, 5> {
    let (mut of_aa, mut of_bb, mut of_ab) = ([0.0; 3], [0.0; 3], [0.0; 3]);
    add_product(&mut of_aa, 1.0, &aa.a, &bb.a);
    add_product(&mut of_aa, -1.0, &ab.a, &ab.a);
    add_product(&mut of_bb, 1.0, &aa.b, &bb.b);
    add_product(&mut of_bb, -1.0, &ab.b, &ab.b);
    add_product(&mut of_ab, 1.0, &aa.a, &bb.b);
    add_product(&mut of_ab, 1.0, &aa.b, &bb.a);
    add_product(&mut of_ab, -2.0, &ab.a, &ab.b);
    let (mut a, mut b, mut rest): (Cubic, Cubic, Quartic) = ([0.0; 4], [0.0; 4], [0.0; 5]);
    add_product(&mut a, 1.0, &aa.a, &bb.rest);
    add_product(&mut a, 1.0, &bb.a, &aa.rest);
    add_product(&mut a, -2.0, &ab.a, &ab.rest);
    add_product(&mut b, 1.0, &aa.b, &bb.rest);
    add_product(&mut b, 1.0, &bb.b, &aa.rest);
    add_product(&mut b, -2.0, &ab.b, &ab.rest);
    add_product(&mut rest, 1.0, &aa.rest, &bb.rest);
    add_product(&mut rest, -1.0, &ab.rest, &ab.rest);
    for (factor, reduced) in [(&of_aa, aa), (&of_bb, bb), (&of_ab, ab)] {
        add_product(&mut a, 1.0, factor, &reduced.a);
        add_product(&mut b, 1.0, factor, &reduced.b);
        add_product(&mut rest, 1.0, factor, &reduced.rest);
    }
    Row { a, b, rest }
}

/// `sum += sign * a * b`; the sum has as many coefficients as the product.
#[inline]
fn add_product<const S: usize, const A: usize, const B: usize>(
    sum: &mut [f64; S],
    sign: f64,
    a: &[f64; A],
    b: &[f64; B],
) {
    const { assert!(S + 1 == A + B) };
    for i in 0..A {
        for j in 0..B {
            sum[i + j] += sign * a[i] * b[j];
        }
    }
}

fn largest(polynomial: &[f64]) -> f64 {
    polynomial.iter().fold(0.0, |largest, value| value.abs().max(largest))
}
