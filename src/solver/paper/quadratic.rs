//! The merged quadratic system `A r + B τ = 0` of full and PnL pairs (paper, eq. 1, 2, 4 and 5), as its normal matrices.
//!
//! Every row says that a moved source point lies in a plane of the target camera. Rows of both kinds are distances in metres
//! (directions, moments and plane normals have unit length), so neither kind outweighs the other. The rows themselves are never
//! stored: of `[A B]` only the 13 x 13 matrix of products is needed, and τ is eliminated from that.
//!
//! Rows are kept over the ten *entries* `e = (vec R̄, 1 + s·s)`; the paper's ten monomials follow by one fixed matrix, `A r = E e`
//! with `e = T r`. Entries make the change of variables near half turns a change of signs, and let the cost of any rotation be
//! evaluated without its Cayley vector.

use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

use super::pair_geometry::{PairGeometry, TargetGeometry, TargetLine};

/// The ten entries: `R̄` column by column, then `1 + s·s`; for a rotation (divided by that) `vec R`, then 1.
pub type Entries = SVector<f64, 10>;

/// Below this share of its largest eigenvalue `BᵀB` leaves a direction of the translation open (all lines parallel).
const MIN_TRANSLATION_SHARE: f64 = 1e-7;

/// `e = T r` (paper, eq. 3 corrected: the last term of R̄ is `2 s sᵀ`), with the monomials in the paper's order
/// `s1², s2², s3², s1s2, s1s3, s2s3, s1, s2, s3, 1`.
#[rustfmt::skip]
const ENTRIES_FROM_MONOMIALS: [[f64; 10]; 10] = [
    [ 1.0, -1.0, -1.0, 0.0, 0.0, 0.0,  0.0,  0.0,  0.0, 1.0],
    [ 0.0,  0.0,  0.0, 2.0, 0.0, 0.0,  0.0,  0.0,  2.0, 0.0],
    [ 0.0,  0.0,  0.0, 0.0, 2.0, 0.0,  0.0, -2.0,  0.0, 0.0],
    [ 0.0,  0.0,  0.0, 2.0, 0.0, 0.0,  0.0,  0.0, -2.0, 0.0],
    [-1.0,  1.0, -1.0, 0.0, 0.0, 0.0,  0.0,  0.0,  0.0, 1.0],
    [ 0.0,  0.0,  0.0, 0.0, 0.0, 2.0,  2.0,  0.0,  0.0, 0.0],
    [ 0.0,  0.0,  0.0, 0.0, 2.0, 0.0,  0.0,  2.0,  0.0, 0.0],
    [ 0.0,  0.0,  0.0, 0.0, 0.0, 2.0, -2.0,  0.0,  0.0, 0.0],
    [-1.0, -1.0,  1.0, 0.0, 0.0, 0.0,  0.0,  0.0,  0.0, 1.0],
    [ 1.0,  1.0,  1.0, 0.0, 0.0, 0.0,  0.0,  0.0,  0.0, 1.0],
];

/// The matrix `T` with `e = T r`.
pub fn entries_from_monomials() -> SMatrix<f64, 10, 10> {
    SMatrix::from_fn(|row, column| ENTRIES_FROM_MONOMIALS[row][column])
}

/// `(vec R, 1)`.
pub fn entries_of(rotation: &Matrix3<f64>) -> Entries {
    let mut entries = Entries::repeat(1.0);
    entries.as_mut_slice()[..9].copy_from_slice(rotation.as_slice());
    entries
}

/// One row `normal·(R̄ X + τ) + offset (1 + s·s) = 0`: the moved point lies in a plane of the target's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// The plane's normal; of unit length for a row that is a distance in metres.
    pub normal: Vector3<f64>,
    /// The plane's offset, m.
    pub offset_m: f64,
    /// The source point `X`, m.
    pub point_m: Vector3<f64>,
}

impl Row {
    /// The row over `(e, τ)`: `A` in the entries, then `B`.
    pub fn coefficients(&self) -> SVector<f64, 13> {
        let mut row = SVector::<f64, 13>::zeros();
        for (column, coordinate_m) in self.point_m.iter().enumerate() {
            row.fixed_rows_mut::<3>(3 * column).copy_from(&(self.normal * *coordinate_m));
        }
        row[9] = self.offset_m;
        row.fixed_rows_mut::<3>(10).copy_from(&self.normal);
        row
    }
}

/// The four rows of a source point on a target line (paper, eq. 1 corrected: with `m = p × d` the sign of `[d]ₓ` is plus):
/// `[d]ₓ (R X + t) + m = 0` and `m·(R X + t) = 0`. They have rank 2. The moment of the last is taken to unit length: as printed it
/// would weigh a line by its squared distance, and the result would depend on the unit of length.
pub fn full_rows(target: &TargetLine, point_m: &Vector3<f64>) -> [Row; 4] {
    let TargetLine { direction: d, point_m: p } = target;
    let moment_m = p.cross(d);
    let moment_normal = moment_m.try_normalize(1e-9).unwrap_or_default();
    let row = |normal, offset_m| Row { normal, offset_m, point_m: *point_m };
    [
        row(Vector3::new(0.0, -d.z, d.y), moment_m.x),
        row(Vector3::new(d.z, 0.0, -d.x), moment_m.y),
        row(Vector3::new(-d.y, d.x, 0.0), moment_m.z),
        row(moment_normal, 0.0),
    ]
}

/// The row of a source point in the plane of a target segment (paper, eq. 2).
pub fn pnl_row(plane_normal: &Vector3<f64>, point_m: &Vector3<f64>) -> Row {
    Row { normal: *plane_normal, offset_m: 0.0, point_m: *point_m }
}

/// `[A B]ᵀ [A B]` of all pairs, over `(e, τ)`: eight rows per full pair, two per PnL pair.
#[derive(Debug, Clone, PartialEq)]
pub struct QuadraticSystem {
    products: SMatrix<f64, 13, 13>,
}

impl QuadraticSystem {
    /// Sums the rows of all pairs.
    pub fn of<'a>(pairs: impl Iterator<Item = &'a PairGeometry>) -> Self {
        let mut products = SMatrix::<f64, 13, 13>::zeros();
        let mut add = |row: Row| {
            let row = row.coefficients();
            products.ger(1.0, &row, &row, 1.0);
        };
        for pair in pairs {
            for point_m in &pair.source_ends_m {
                match &pair.target {
                    TargetGeometry::Full(line) => {
                        full_rows(line, point_m).into_iter().for_each(&mut add);
                    }
                    TargetGeometry::Pnl(segment) => add(pnl_row(&segment.plane_normal, point_m)),
                }
            }
        }
        Self { products }
    }

    /// Eliminates the translation: `τ = -(BᵀB)⁻¹ BᵀA r`. `None` where the rows leave a direction of it open.
    pub fn eliminate_translation(&self) -> Option<RotationSystem> {
        let a_products = self.products.fixed_view::<10, 10>(0, 0);
        let b_a_products = self.products.fixed_view::<3, 10>(10, 0);
        let b_products: Matrix3<f64> = self.products.fixed_view::<3, 3>(10, 10).into_owned();
        let eigenvalues = b_products.symmetric_eigenvalues();
        if eigenvalues.min() <= MIN_TRANSLATION_SHARE * eigenvalues.max() {
            return None;
        }
        let translation_from_entries = -b_products.cholesky()?.solve(&b_a_products.into_owned());
        let products = a_products + b_a_products.transpose() * translation_from_entries;
        Some(RotationSystem { products, translation_from_entries })
    }
}

/// What is left for the rotation: `A' e = 0` with `A' = A - B (BᵀB)⁻¹ BᵀA`, as `A'ᵀA'`.
#[derive(Debug, Clone, PartialEq)]
pub struct RotationSystem {
    products: SMatrix<f64, 10, 10>,
    translation_from_entries: SMatrix<f64, 3, 10>,
}

impl RotationSystem {
    /// `A'ᵀA'` over the entries.
    pub fn products(&self) -> &SMatrix<f64, 10, 10> {
        &self.products
    }

    /// The sum of squared rows that a rotation leaves, with its best translation, m².
    pub fn cost_m2(&self, rotation: &Matrix3<f64>) -> f64 {
        let entries = entries_of(rotation);
        entries.dot(&(self.products * entries))
    }

    /// The best translation of a rotation, m (`t = τ / (1 + s·s)`).
    pub fn translation_m(&self, rotation: &Matrix3<f64>) -> Vector3<f64> {
        self.translation_from_entries * entries_of(rotation)
    }
}

#[cfg(test)]
mod tests;
