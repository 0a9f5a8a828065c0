//! Which new pairs are let in: the distance from SO(3) of the least squares `C vec(R) = b` over directions (paper, eq. 9 to 12).
//!
//! Only directions are looked at, so the gate is cheap and weak: a wrong pair of parallel lines passes. The paper lets in only what
//! decreases the distance; noise alone refuses more than half of the right pairs then. The rule here refuses what noise does
//! not explain. Where the directions so far leave the matrix open (rank 6 when they are coplanar) nothing can be said, and the pair is let in.

use nalgebra::{Cholesky, Const, Matrix3, Rotation3, SMatrix, SVector, Vector3};

use super::pair_geometry::{PairGeometry, TargetGeometry};
use super::refine::ReadPair;

/// What is let in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GateRule {
    /// Everything.
    Off,
    /// Everything first; only where that leads to no pose, what is not within noise stays out. A wrong pair at the start of the
    /// line makes the gate refuse right ones: of 360 sets it lost 20 to 30 when it always stood first, and won some when it stood last.
    WhenStuck {
        /// As in [`GateRule::WithinNoise`].
        n_sigmas: f64,
    },
    /// The paper's rule: only a pair that makes the distance smaller.
    Decreasing,
    /// A pair that makes the distance smaller, or leaves it within this many standard deviations of what the noise of the directions
    /// makes of it.
    WithinNoise {
        /// Standard deviations.
        n_sigmas: f64,
    },
}

/// A direction known better than this is not believed, rad: 0.1 deg, what lenses and depth calibration leave.
const MIN_SIGMA_RAD: f64 = 0.002;
/// Share of the largest pivot below which the directions leave the matrix open: within about 2 deg of a plane.
const MIN_PIVOT_SHARE: f64 = 1e-3;
/// Sine of the least angle between the two pairs that start the gate: 15 deg.
const MIN_START_SINE: f64 = 0.26;
/// The cosines of their mutual angle in both cameras may differ by this (3 to 10 deg).
const MAX_START_COSINE_GAP: f64 = 0.05;
/// Cosine of the angle within which a start explains a pair's direction: 10 deg.
const START_COSINE: f64 = 0.985;

/// Normal equations of `C vec(R) = b` (paper, eq. 11): three rows per full pair, one per PnL pair, all of unit vectors.
#[derive(Debug, Clone, PartialEq)]
pub struct DirectionSystem {
    products: SMatrix<f64, 9, 9>,
    right_side: SVector<f64, 9>,
}

/// The least squares of a [`DirectionSystem`], which need not be a rotation.
#[derive(Debug, Clone)]
pub struct DirectionMatrix {
    /// `M`.
    pub matrix: Matrix3<f64>,
    factors: Cholesky<f64, Const<9>>,
}

impl DirectionSystem {
    /// No rows.
    pub fn empty() -> Self {
        Self { products: SMatrix::zeros(), right_side: SVector::zeros() }
    }

    /// `d_t = R d_s` (eq. 9), with the orientation as given: a line has none of its own, so the caller decides.
    pub fn add_full(&mut self, source: &Vector3<f64>, target: &Vector3<f64>, weight: f64) {
        for (j, source_j) in source.iter().enumerate() {
            for (k, source_k) in source.iter().enumerate() {
                let product = weight * source_j * source_k;
                for i in 0..3 {
                    self.products[(3 * j + i, 3 * k + i)] += product;
                }
            }
            let mut right_side = self.right_side.fixed_rows_mut::<3>(3 * j);
            right_side += target * (weight * source_j);
        }
    }

    /// `n·R d_s = 0` with the normal `n` of the target segment's plane (eq. 10).
    pub fn add_pnl(&mut self, source: &Vector3<f64>, plane_normal: &Vector3<f64>, weight: f64) {
        let row = SVector::<f64, 9>::from_fn(|idx, _| plane_normal[idx % 3] * source[idx / 3]);
        self.products.ger(weight, &row, &row, 1.0);
    }

    /// The least squares; `None` where the directions leave it open (9 numbers need three independent directions).
    pub fn solve(&self) -> Option<DirectionMatrix> {
        let factors = self.products.cholesky()?;
        let pivots = factors.l_dirty().diagonal().map(|pivot| pivot * pivot);
        if pivots.min() < MIN_PIVOT_SHARE * pivots.max() {
            return None;
        }
        let solved = factors.solve(&self.right_side);
        Some(DirectionMatrix { matrix: Matrix3::from_column_slice(solved.as_slice()), factors })
    }
}

impl DirectionMatrix {
    /// Root of the summed variances of the nine numbers, for rows weighted by their variance.
    fn sigma(&self) -> f64 {
        self.factors.inverse().trace().sqrt()
    }
}

/// The rotation nearest to a matrix, and how far it is: `U diag(1, 1, det U Vᵀ) Vᵀ` and the Frobenius norm of the difference
/// (paper, eq. 12). `None` for numbers that are not finite.
pub fn special_orthogonalisation(matrix: &Matrix3<f64>) -> Option<(Rotation3<f64>, f64)> {
    let svd = matrix.iter().all(|value| value.is_finite()).then(|| matrix.svd(true, true))?;
    let (mut u, v_t) = (svd.u?, svd.v_t?);
    // Singular values come largest first: the last one takes the sign.
    if (u.determinant() * v_t.determinant()) < 0.0 {
        u.column_mut(2).neg_mut();
    }
    let nearest = u * v_t;
    Some((Rotation3::from_matrix_unchecked(nearest), (matrix - nearest).norm()))
}

/// Indices of the pairs that are let in, in order of arrival.
pub fn gate(pairs: &[ReadPair<'_>], rule: GateRule) -> Vec<usize> {
    let n_sigmas = match rule {
        GateRule::Off => return (0..pairs.len()).collect(),
        GateRule::Decreasing => 0.0,
        GateRule::WithinNoise { n_sigmas } | GateRule::WhenStuck { n_sigmas } => n_sigmas,
    };
    let Some(start) = start_rotation(pairs) else { return (0..pairs.len()).collect() };
    let mut system = DirectionSystem::empty();
    let mut distance = None;
    let mut let_in = Vec::with_capacity(pairs.len());
    for (idx, pair) in pairs.iter().enumerate() {
        let mut next = system.clone();
        add(&mut next, pair, &start);
        let after = next.solve();
        let limit = after
            .as_ref()
            .zip(distance)
            .map(|(after, before): (_, f64)| before.max(n_sigmas * after.sigma()));
        let after = after.and_then(|after| Some(special_orthogonalisation(&after.matrix)?.1));
        if limit.zip(after).is_none_or(|(limit, after)| after < limit) {
            system = next;
            distance = after;
            let_in.push(idx);
        }
    }
    let_in
}

/// Adds a pair with the orientation that a rotation gives it.
fn add(system: &mut DirectionSystem, pair: &ReadPair<'_>, rotation: &Rotation3<f64>) {
    let source = &pair.geometry.source_direction;
    let sigma_source_rad = pair.pair.source.sigma_direction_rad.max(MIN_SIGMA_RAD);
    match &pair.geometry.target {
        TargetGeometry::Full(line) => {
            let sigma_target_rad = pair.pair.full_target().map_or(0.0, |target| target.sigma_direction_rad);
            let orientation = (rotation * source).dot(&line.direction).signum();
            system.add_full(
                source,
                &(line.direction * orientation),
                1.0 / (sigma_source_rad.powi(2) + sigma_target_rad.powi(2)),
            );
        }
        TargetGeometry::Pnl(segment) => {
            system.add_pnl(source, &segment.plane_normal, sigma_source_rad.powi(-2))
        }
    }
}

/// A line has no orientation, so two directions leave four rotations (paper, eq. 9 corrected): of those of the first two full pairs
/// with equal mutual angle the one that explains most directions. `None` where no two pairs will do: nothing can be said then.
fn start_rotation(pairs: &[ReadPair<'_>]) -> Option<Rotation3<f64>> {
    let full = || pairs.iter().filter(|pair| matches!(pair.geometry.target, TargetGeometry::Full(_)));
    let starts =
        full().enumerate().flat_map(|(i, first)| full().skip(i + 1).map(move |second| (first, second)));
    let start = starts
        .map(|(first, second)| four_rotations(&first.geometry, &second.geometry))
        .find(|found| !found.is_empty())?;
    let explained =
        |rotation: &Rotation3<f64>| pairs.iter().filter(|pair| explains(rotation, &pair.geometry)).count();
    start.into_iter().max_by_key(explained)
}

fn explains(rotation: &Rotation3<f64>, pair: &PairGeometry) -> bool {
    let turned = rotation * pair.source_direction;
    match &pair.target {
        TargetGeometry::Full(line) => turned.dot(&line.direction).abs() > START_COSINE,
        TargetGeometry::Pnl(segment) => turned.cross(&segment.plane_normal).norm() > START_COSINE,
    }
}

/// The rotations that turn two source directions into two target directions of either orientation; empty where the mutual angles differ or
/// are too small.
fn four_rotations(first: &PairGeometry, second: &PairGeometry) -> Vec<Rotation3<f64>> {
    let (TargetGeometry::Full(first_target), TargetGeometry::Full(second_target)) =
        (&first.target, &second.target)
    else {
        return Vec::new();
    };
    let Some(source) = frame(&first.source_direction, &second.source_direction) else { return Vec::new() };
    let cosine = first.source_direction.dot(&second.source_direction);
    let fits = |target_cosine: f64| (target_cosine - cosine).abs() < MAX_START_COSINE_GAP;
    [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)]
        .into_iter()
        .map(|(sign, other_sign)| (first_target.direction * sign, second_target.direction * other_sign))
        .filter(|(one, other)| fits(one.dot(other)))
        .filter_map(|(one, other)| {
            Some(Rotation3::from_matrix_unchecked(frame(&one, &other)? * source.transpose()))
        })
        .collect()
}

/// The right-handed frame of two directions; `None` where they are nearly parallel.
fn frame(first: &Vector3<f64>, second: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let normal = first.cross(second).try_normalize(MIN_START_SINE)?;
    Some(Matrix3::from_columns(&[*first, normal.cross(first), normal]))
}

#[cfg(test)]
mod tests;
