//! Two of four homogeneous unknowns eliminated from three quadrics: one polynomial of degree eight in the ratio of the others.
//!
//! With a and b to be eliminated and u, v hidden in the coefficients, the three equations are solved for a², b² and ab:
//! each is then linear in (a, b, 1). The identities a² b = ab a, ab b = b² a and a² b² = (ab)² give three more equations linear in
//! (a, b, 1), whose determinant vanishes at the roots (Kukelova, Heller, Fitzgibbon: Efficient intersection of three quadrics).
//! The polynomial is never expanded: nine values of the determinant say all of it.

use nalgebra::{Vector3, Vector4};

use super::forms::{Forms, MONOMIAL};
use super::univariate::{NODES, Ratio};

/// A determinant this much smaller than the products it is the sum of is rounding: the quadrics share a curve.
const MIN_DETERMINANT: f64 = 1e-14;
/// Which two unknowns are eliminated, and which two remain.
const SPLITS: [([usize; 2], [usize; 2]); 6] = [
    ([0, 1], [2, 3]),
    ([0, 2], [1, 3]),
    ([1, 2], [0, 3]),
    ([0, 3], [1, 2]),
    ([1, 3], [0, 2]),
    ([2, 3], [0, 1]),
];

/// Choice of a and b, and the equations solved for a², b² and ab (the three entries of each vector): the sum of
/// `a (a_u u + a_v v)`, `b (b_u u + b_v v)` and `uu u² + uv u v + vv v²`.
pub struct Elimination {
    eliminated: [usize; 2],
    hidden: [usize; 2],
    a_u: Vector3<f64>,
    a_v: Vector3<f64>,
    b_u: Vector3<f64>,
    b_v: Vector3<f64>,
    uu: Vector3<f64>,
    uv: Vector3<f64>,
    vv: Vector3<f64>,
}

/// The equations linear in (a, b, 1) at one ratio u : v.
struct Rows {
    /// Cross product of the first two: (a, b, 1) up to scale at a root.
    solution: Vector3<f64>,
    third: Vector3<f64>,
}

impl Elimination {
    /// The choice of a and b with the largest determinant of the columns of a², b² and ab; `None` when even that is at most
    /// `min_pivot`.
    pub fn best(forms: &Forms, min_pivot: f64) -> Option<Self> {
        let column = |i: usize, j: usize| forms.columns[MONOMIAL[i][j]];
        let mut best = (min_pivot, None);
        for (split, ([a, b], _)) in SPLITS.iter().enumerate() {
            let pivot = column(*a, *a).cross(&column(*b, *b)).dot(&column(*a, *b)).abs();
            if pivot > best.0 {
                best = (pivot, Some(split));
            }
        }
        let (eliminated, hidden) = SPLITS[best.1?];
        let ([a, b], [u, v]) = (eliminated, hidden);
        let (aa, bb, ab) = (column(a, a), column(b, b), column(a, b));
        let (for_aa, for_bb, for_ab) = (bb.cross(&ab), ab.cross(&aa), aa.cross(&bb));
        let scale = -1.0 / aa.dot(&for_aa);
        let solved = |i: usize, j: usize| {
            let right = column(i, j) * scale;
            Vector3::new(for_aa.dot(&right), for_bb.dot(&right), for_ab.dot(&right))
        };
        Some(Self {
            eliminated,
            hidden,
            a_u: solved(a, u),
            a_v: solved(a, v),
            b_u: solved(b, u),
            b_v: solved(b, v),
            uu: solved(u, u),
            uv: solved(u, v),
            vv: solved(v, v),
        })
    }

    /// Values of the determinant at the [`NODES`]; `None` when it vanishes everywhere: a curve of solutions.
    pub fn determinants(&self) -> Option<[f64; 9]> {
        let mut values = [0.0; 9];
        let mut largest = 0.0_f64;
        for (value, (u, v)) in values.iter_mut().zip(NODES) {
            let rows = self.rows(u, v);
            *value = rows.solution.dot(&rows.third);
        }
        for value in values {
            largest = largest.max(value.abs());
        }
        let linear =
            [self.a_u, self.a_v, self.b_u, self.b_v].iter().fold(0.0, |size, part| part.amax().max(size));
        let square = self.uu.amax().max(self.uv.amax()).max(self.vv.amax());
        // What a and b are for u and v of order one; every product in the determinant has eight such factors.
        let scale = (linear * linear).max(square).powi(4);
        (largest > MIN_DETERMINANT * scale && largest.is_finite())
            .then(|| values.map(|value| value / largest))
    }

    /// The root that belongs to a ratio u : v, of unit length.
    pub fn root(&self, ratio: Ratio) -> Vector4<f64> {
        let Ratio { u, v } = ratio;
        let solution = self.rows(u, v).solution;
        let mut root = Vector4::zeros();
        root[self.eliminated[0]] = solution.x;
        root[self.eliminated[1]] = solution.y;
        root[self.hidden[0]] = solution.z * u;
        root[self.hidden[1]] = solution.z * v;
        root.normalize()
    }

    /// With a² = p.x a + q.x b + r.x, b² = p.y a + ... and ab = p.z a + ...
    #[inline]
    fn rows(&self, u: f64, v: f64) -> Rows {
        let p = self.a_u * u + self.a_v * v;
        let q = self.b_u * u + self.b_v * v;
        let r = self.uu * (u * u) + self.uv * (u * v) + self.vv * (v * v);
        // a² b = ab a and ab b = b² a, of the form x a + y b + z; the second's y is the first's x with the other sign.
        let (of_first, of_second) = (p.x - q.z, p.z - q.y);
        let first_x = q.x * p.y - p.z * q.z - r.z;
        let first_y = of_first * q.z + q.x * q.y - p.z * q.x + r.x;
        let first_z = of_first * r.z + q.x * r.y - p.z * r.x;
        let second_x = of_second * p.z + q.z * p.y - p.y * p.x - r.y;
        let second_z = of_second * r.z + q.z * r.y - p.y * r.x;
        // a² b² = (ab)² has a², b² and ab once more.
        let of_aa = p.x * p.y - p.z * p.z;
        let of_bb = q.x * q.y - q.z * q.z;
        let of_ab = p.x * q.y + q.x * p.y - 2.0 * p.z * q.z;
        Rows {
            solution: Vector3::new(
                first_y * second_z + first_z * first_x,
                first_z * second_x - first_x * second_z,
                -first_x * first_x - first_y * second_x,
            ),
            third: Vector3::new(
                of_aa * p.x + of_bb * p.y + of_ab * p.z + p.x * r.y + p.y * r.x - 2.0 * p.z * r.z,
                of_aa * q.x + of_bb * q.y + of_ab * q.z + q.x * r.y + q.y * r.x - 2.0 * q.z * r.z,
                of_aa * r.x + of_bb * r.y + of_ab * r.z + r.x * r.y - r.z * r.z,
            ),
        }
    }
}
