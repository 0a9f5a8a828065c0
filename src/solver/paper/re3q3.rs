//! Three quadrics in three unknowns: every real common root (the paper's solver of eq. 5, own implementation).
//!
//! The unknowns are taken as homogeneous, (s, 1) ~ (s1, s2, s3, w), so that all of projective space is one: a rotation of half a
//! turn, at infinity in the paper's parameters, is the root w = 0. Two of the four are eliminated; what remains is one polynomial
//! of degree eight in the ratio of the other two. Which two is decided by the conditioning of the elimination, and where no two
//! will do, or roots coincide in their ratio, the unknowns are first turned by one of a few fixed rotations. Nothing is drawn by
//! chance. Roots are finished by Newton's method on the three quadrics themselves and dropped when they do not satisfy them.

mod elimination;
mod forms;
mod univariate;

use nalgebra::{Matrix4, Quaternion, SMatrix, SVector, Vector4};

use elimination::Elimination;
use forms::Forms;

/// By Bezout no three quadrics have more isolated common roots.
const MAX_ROOTS: usize = 8;
/// An elimination whose 3 x 3 determinant (of orthonormal rows: at most 1) is smaller loses more than two of sixteen digits.
const GOOD_PIVOT: f64 = 0.02;
/// ... and below this there is nothing left of it.
const MIN_PIVOT: f64 = 1e-6;
/// Roots closer than this on the unit sphere are one: a double root is known to the square root of the rounding.
const SAME_ROOT: f64 = 1e-5;
/// Newton's method moves a root that is known from the polynomial by rounding only; a longer way means that it was another.
const FAR: f64 = 1e-2;
/// Rounding of the equations, with a margin of three digits: times the inverse Jacobian it is what a root may be off.
const ROUNDING: f64 = 1e-13;
/// Turns of the four homogeneous unknowns to fall back on, each `q -> a q b` with two quaternions; no meaning but being generic.
const TURNS: [[[f64; 4]; 2]; 3] = [
    [[1.0, 2.0, -3.0, 5.0], [4.0, -1.0, 3.0, 2.0]],
    [[3.0, -5.0, 1.0, 4.0], [2.0, 3.0, 5.0, -1.0]],
    [[-2.0, 1.0, 7.0, 3.0], [5.0, 2.0, -1.0, 6.0]],
];

/// Up to eight distinct real roots, without a heap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Roots<const D: usize = 3> {
    n_roots: usize,
    roots: [SVector<f64, D>; MAX_ROOTS],
}

impl<const D: usize> Roots<D> {
    fn none() -> Self {
        Self { n_roots: 0, roots: [SVector::zeros(); MAX_ROOTS] }
    }

    fn push(&mut self, root: SVector<f64, D>) {
        if self.n_roots < MAX_ROOTS {
            self.roots[self.n_roots] = root;
            self.n_roots += 1;
        }
    }

    /// The roots, in no particular (but always the same) order.
    pub fn as_slice(&self) -> &[SVector<f64, D>] {
        &self.roots[..self.n_roots]
    }
}

/// Every real root s of the three quadrics `quadrics * r = 0`.
///
/// **Order of the ten columns: that of the paper's eq. 5,
/// `r = [s1², s2², s3², s1 s2, s1 s3, s2 s3, s1, s2, s3, 1]`** - squares first. Other solvers take `x², xy, xz, y², yz, z², ...`;
/// the authors' program mixed the two up and solved another system.
///
/// Rows may have any scale; the unknowns should be of order one, as the parameters of rotations are. A double root is given once. The
/// answer is empty for a system without isolated roots (dependent or not finite quadrics, a common curve, also one at infinity).
/// Roots at infinity, half turns, are left out: they are found after a change of variables
/// ([`pre_rotations`](super::cgr::pre_rotations)).
pub fn re3q3(quadrics: &SMatrix<f64, 3, 10>) -> Roots {
    let mut roots = Roots::none();
    let Some(forms) = Forms::orthonormal(quadrics) else { return roots };
    for root in projective_roots(&forms).as_slice() {
        // How far from infinity the root is must be beyond doubt.
        let is_finite = root.w.abs() > 0.1 || root.w.abs() > ROUNDING * (1.0 + forms.inverse_norm(root));
        if is_finite {
            roots.push(root.xyz() / root.w);
        }
    }
    roots
}

/// The roots as unit vectors `(s1, s2, s3, 1) / |(s, 1)|`, those at infinity (last component 0) included. Of the paper's system each is
/// the unit quaternion `(x, y, z, w)` of a rotation.
fn projective_roots(forms: &Forms) -> Roots<4> {
    let mut roots = Roots::none();
    for min_pivot in [GOOD_PIVOT, MIN_PIVOT] {
        let mut is_tried = false;
        for turn in 0..=TURNS.len() {
            let Some(chart) = Chart::new(forms, turn, min_pivot) else { continue };
            is_tried = true;
            if chart.find(forms, &mut roots) == Found::All {
                return roots;
            }
        }
        if is_tried {
            break;
        }
    }
    roots
}

/// Whether a chart may have missed roots.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Found {
    All,
    Perhaps,
}

/// The forms in turned unknowns, with the elimination chosen there.
struct Chart {
    root_from_chart: Option<Matrix4<f64>>,
    elimination: Elimination,
}

impl Chart {
    /// Chart 0 is that of the unknowns as they are; `None` where the elimination loses too much.
    fn new(forms: &Forms, turn: usize, min_pivot: f64) -> Option<Self> {
        let root_from_chart = turn.checked_sub(1).map(|turn| turned(&TURNS[turn]));
        let elimination = match &root_from_chart {
            None => Elimination::best(forms, min_pivot),
            Some(root_from_chart) => Elimination::best(&forms.turned(root_from_chart), min_pivot),
        }?;
        Some(Self { root_from_chart, elimination })
    }

    /// Adds the roots that are new to `roots`.
    fn find(&self, forms: &Forms, roots: &mut Roots<4>) -> Found {
        let Some(determinants) = self.elimination.determinants() else { return Found::Perhaps };
        let ratios = univariate::real_roots(&determinants);
        let mut found = if ratios.are_clear { Found::All } else { Found::Perhaps };
        let mut here = Roots::<4>::none();
        for &ratio in ratios.as_slice() {
            let start = self.elimination.root(ratio);
            let start = self.root_from_chart.map_or(start, |root_from_chart| root_from_chart * start);
            let Some(root) = forms.polished(&start) else {
                found = Found::Perhaps;
                continue;
            };
            if gap(&start, &root) > FAR || here.as_slice().iter().any(|known| gap(known, &root) < SAME_ROOT) {
                // Two ratios that lead to one root may have been two roots.
                found = Found::Perhaps;
            }
            here.push(root);
        }
        for root in here.as_slice() {
            if roots.as_slice().iter().all(|known| gap(known, root) >= SAME_ROOT) {
                roots.push(*root);
            }
        }
        found
    }
}

/// Distance of two unit vectors that have no sign.
fn gap(a: &Vector4<f64>, b: &Vector4<f64>) -> f64 {
    (a - b).norm_squared().min((a + b).norm_squared()).sqrt()
}

/// The rotation `q -> a q b` of four-dimensional space.
fn turned([a, b]: &[[f64; 4]; 2]) -> Matrix4<f64> {
    let [a, b] = [a, b].map(|q| Quaternion::from(*q).normalize());
    let column = |unit: Vector4<f64>| (a * Quaternion::from(unit) * b).coords;
    Matrix4::from_columns(&[
        column(Vector4::x()),
        column(Vector4::y()),
        column(Vector4::z()),
        column(Vector4::w()),
    ])
}

#[cfg(test)]
mod tests;
