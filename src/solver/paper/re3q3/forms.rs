//! Three quadrics as quadratic forms of four homogeneous unknowns (s1, s2, s3, w): values, derivatives, Newton's method.

use nalgebra::{Matrix4, SMatrix, SVector, Vector3, Vector4};

/// Column of the paper's order r of eq. 5 that belongs to the product of two of the four unknowns.
pub const MONOMIAL: [[usize; 4]; 4] = [[0, 3, 4, 6], [3, 1, 5, 7], [4, 5, 2, 8], [6, 7, 8, 9]];
/// A row that its predecessors explain to within this share is no equation of its own: ten digits are more than data has.
const MIN_INDEPENDENT: f64 = 1e-10;
/// Newton steps at most: two suffice for a simple root, a double one halves its error with each.
const MAX_STEPS: usize = 20;
/// Values of the forms that count as zero where rows and unknowns are of unit length.
const ZERO: f64 = 1e-12;
/// ... and below this another step brings nothing.
const ROUNDING: f64 = 4e-16;

/// Three quadrics with orthonormal coefficients.
#[derive(Debug, Clone)]
pub struct Forms {
    /// The ten columns in the order of eq. 5.
    pub columns: [Vector3<f64>; 10],
}

impl Forms {
    /// The span of three quadrics; `None` when they are dependent or not finite.
    pub fn orthonormal(quadrics: &SMatrix<f64, 3, 10>) -> Option<Self> {
        let mut rows: [SVector<f64, 10>; 3] = [0, 1, 2].map(|i| quadrics.row(i).transpose());
        for i in 0..3 {
            let scale = rows[i].norm();
            if !scale.is_finite() || scale == 0.0 {
                return None;
            }
            let mut row = rows[i] / scale;
            for known in &rows[..i] {
                row -= known * row.dot(known);
            }
            let norm = row.norm();
            if norm.is_nan() || norm <= MIN_INDEPENDENT {
                return None;
            }
            rows[i] = row / norm;
        }
        let [first, second, third] = rows;
        let mut columns = [Vector3::zeros(); 10];
        for (i, column) in columns.iter_mut().enumerate() {
            *column = Vector3::new(first[i], second[i], third[i]);
        }
        Some(Self { columns })
    }

    /// The forms of q' where q = `root_from_chart` q'.
    pub fn turned(&self, root_from_chart: &Matrix4<f64>) -> Self {
        let mut turned = self.clone();
        for form in 0..3 {
            let half = |i: usize, j: usize| if i == j { 1.0 } else { 0.5 };
            let matrix = Matrix4::from_fn(|i, j| half(i, j) * self.columns[MONOMIAL[i][j]][form]);
            let matrix = root_from_chart.transpose() * matrix * root_from_chart;
            for i in 0..4 {
                for j in i..4 {
                    turned.columns[MONOMIAL[i][j]][form] = matrix[(i, j)] / half(i, j);
                }
            }
        }
        turned
    }

    /// Derivatives of the three forms by the four unknowns. Half of their sum weighted with q is the forms' value (Euler).
    fn derivatives(&self, q: &Vector4<f64>) -> [Vector3<f64>; 4] {
        let [xx, yy, zz, xy, xz, yz, xw, yw, zw, ww] = &self.columns;
        let [x, y, z, w] = [q.x, q.y, q.z, q.w];
        [
            xx * (2.0 * x) + xy * y + xz * z + xw * w,
            xy * x + yy * (2.0 * y) + yz * z + yw * w,
            xz * x + yz * y + zz * (2.0 * z) + zw * w,
            xw * x + yw * y + zw * z + ww * (2.0 * w),
        ]
    }

    /// The root near `start` as a unit vector, by Newton's method with the largest unknown held; `None` when there is none.
    pub fn polished(&self, start: &Vector4<f64>) -> Option<Vector4<f64>> {
        let held = start.iamax();
        let mut q = start / start[held];
        let mut best = (f64::INFINITY, q);
        for _ in 0..MAX_STEPS {
            let derivatives = self.derivatives(&q);
            let values = 0.5
                * (derivatives[0] * q[0]
                    + derivatives[1] * q[1]
                    + derivatives[2] * q[2]
                    + derivatives[3] * q[3]);
            let size = values.norm_squared();
            let is_progress = size < 0.25 * best.0;
            if size < best.0 {
                best = (size, q);
            }
            // Without progress it is the end, or a multiple root that no step brings nearer.
            if !is_progress || size < ROUNDING * ROUNDING {
                break;
            }
            let [i, j, k] = others(held);
            let columns = [derivatives[i], derivatives[j], derivatives[k]];
            let Some(step) = solved(&columns, &values) else { break };
            q[i] -= step.x;
            q[j] -= step.y;
            q[k] -= step.z;
        }
        (best.0 < ZERO * ZERO).then(|| best.1.normalize())
    }

    /// Norm of the inverse Jacobian at a root: how far a change of the equations moves it. Infinite at a multiple root.
    pub fn inverse_norm(&self, root: &Vector4<f64>) -> f64 {
        let derivatives = self.derivatives(root);
        let [i, j, k] = others(root.iamax()).map(|i| derivatives[i]);
        let (jk, ki, ij) = (j.cross(&k), k.cross(&i), i.cross(&j));
        (jk.norm_squared() + ki.norm_squared() + ij.norm_squared()).sqrt() / i.dot(&jk).abs()
    }
}

fn others(held: usize) -> [usize; 3] {
    match held {
        0 => [1, 2, 3],
        1 => [0, 2, 3],
        2 => [0, 1, 3],
        _ => [0, 1, 2],
    }
}

/// Cramer's rule; `None` when the columns are dependent.
fn solved([i, j, k]: &[Vector3<f64>; 3], right: &Vector3<f64>) -> Option<Vector3<f64>> {
    let jk = j.cross(k);
    let determinant = i.dot(&jk);
    let step = Vector3::new(right.dot(&jk), right.dot(&k.cross(i)), right.dot(&i.cross(j))) / determinant;
    // Beyond this it is no correction of a start that is nearly right.
    (step.amax() < 0.5).then_some(step)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::tests::room::Random;

    #[test]
    fn the_derivatives_agree_with_central_differences() {
        let mut random = Random::named("forms");
        for _ in 0..20 {
            let quadrics = SMatrix::<f64, 3, 10>::from_fn(|_, _| random.gaussian());
            let forms = Forms::orthonormal(&quadrics).expect("independent rows");
            let values = |q: &Vector4<f64>| {
                let products = (0..4).flat_map(|i| (i..4).map(move |j| (i, j)));
                products.map(|(i, j)| forms.columns[MONOMIAL[i][j]] * (q[i] * q[j])).sum::<Vector3<f64>>()
            };
            let q = random.rotation().coords;
            for (axis, derivative) in forms.derivatives(&q).iter().enumerate() {
                let step = Vector4::ith(axis, 1e-5);
                let difference = (values(&(q + step)) - values(&(q - step))) / 2e-5;
                assert!((difference - derivative).amax() < 1e-9, "axis {axis}: {difference} {derivative}");
            }
        }
    }
}
