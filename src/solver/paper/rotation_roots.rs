//! The rotations that solve the quadratic system: three quadrics, RE3Q3, and the least squares beside each root.
//!
//! As in the paper only three combinations of the rows are solved exactly. With noise these may have no real root, and near half turns
//! the Cayley vector runs away. Both are met by solving in four charts (source lines turned by nothing, or by half a turn about an
//! axis): the charts weigh the rows differently, so one has roots where another has none. Where all four have none, the least
//! squares is descended into from the cube's 24 rotations.

use nalgebra::{Matrix3, Rotation3, SMatrix};

use super::cgr::{pre_rotations, rotation_from_cgr};
use super::quadratic::{Entries, RotationSystem, entries_from_monomials, entries_of};
use super::re3q3::re3q3;

/// A monomial column weaker than this share of the strongest, once the chosen ones are taken out, says nothing.
const MIN_COLUMN_SHARE: f64 = 1e-12;
/// Rotations this close are one start of the refinement, rad: 3 deg.
const SAME_ROOT_RAD: f64 = 0.05;
/// Roots and minima that are kept: no more were seen to matter.
const MAX_ROOTS: usize = 24;
/// Steps from a root to the minimum beside it (3 to 6 are needed).
const DESCENT_STEPS: usize = 8;
/// A step this small ends the descent, rad.
const SMALL_STEP_RAD: f64 = 1e-9;

/// A rotation `target_from_source` that solves the system.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotationRoot {
    /// The rotation.
    pub rotation: Rotation3<f64>,
    /// Sum of squared rows it leaves, m².
    pub cost_m2: f64,
}

/// Where the search for rotations starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Starts {
    /// At the real roots of the four charts; where there are none, as below.
    Roots,
    /// ... and at the cube's rotations, so that (nearly) no minimum of the least squares is missed.
    RootsAndCube,
}

/// The distinct real roots of all four charts and the minima beside them, least cost first; at most 24, and never none.
pub fn rotation_roots(system: &RotationSystem, starts: Starts) -> Vec<RotationRoot> {
    let mut raw: Vec<RotationRoot> = pre_rotations()
        .iter()
        .flat_map(|turned_from_source| chart_roots(system, turned_from_source))
        .collect();
    if raw.is_empty() || starts == Starts::RootsAndCube {
        raw.extend(cube_rotations().map(|rotation| at(system, rotation)));
    }
    sort(&mut raw);
    let mut roots: Vec<RotationRoot> = Vec::with_capacity(MAX_ROOTS);
    for root in raw.iter().map(|start| descend(system, *start)).chain(raw.iter().copied()) {
        if roots.len() < MAX_ROOTS && is_new(&root, &roots) {
            roots.push(root);
        }
    }
    sort(&mut roots);
    roots
}

fn at(system: &RotationSystem, rotation: Rotation3<f64>) -> RotationRoot {
    RotationRoot { rotation, cost_m2: system.cost_m2(rotation.matrix()) }
}

fn sort(roots: &mut [RotationRoot]) {
    roots.sort_by(|a, b| a.cost_m2.total_cmp(&b.cost_m2));
}

fn is_new(root: &RotationRoot, known: &[RotationRoot]) -> bool {
    known.iter().all(|other| root.rotation.angle_to(&other.rotation) > SAME_ROOT_RAD)
}

/// The roots of one chart: `target_from_source = target_from_turned * turned_from_source`.
fn chart_roots(system: &RotationSystem, turned_from_source: &Rotation3<f64>) -> Vec<RotationRoot> {
    let products = chart_products(system.products(), turned_from_source);
    let Some(quadrics) = three_quadrics(&products) else { return Vec::new() };
    let roots = re3q3(&quadrics);
    let rotations = roots.as_slice().iter().map(|cgr| rotation_from_cgr(cgr) * turned_from_source);
    rotations.map(|rotation| at(system, rotation)).collect()
}

/// `A'ᵀA'` over the monomials of a chart: the entries of `R = R' P` are those of `R'` with `P`, a half turn about an axis, applied to
/// the columns, which only flips signs.
fn chart_products(
    products: &SMatrix<f64, 10, 10>,
    turned_from_source: &Rotation3<f64>,
) -> SMatrix<f64, 10, 10> {
    let mut from_monomials = entries_from_monomials();
    for (column, sign) in turned_from_source.matrix().diagonal().iter().enumerate() {
        from_monomials.fixed_rows_mut::<3>(3 * column).scale_mut(*sign);
    }
    from_monomials.transpose() * products * from_monomials
}

/// Three quadrics `[I | (K₃ᵀK₃)⁻¹ K₃ᵀK₇] r = 0` (columns put back in the order of `r`) from `KᵀK` over the monomials: `K₃` are the three
/// columns, other than the constant, that are longest once those chosen before are projected out. `None` where there are no three.
pub fn three_quadrics(products: &SMatrix<f64, 10, 10>) -> Option<SMatrix<f64, 3, 10>> {
    let mut left = *products;
    let strongest = products.diagonal().max();
    let mut chosen = [0; 3];
    for choice in &mut chosen {
        let (column, length2) = (0..9)
            .map(|column| (column, left[(column, column)]))
            .fold((0, 0.0), |best, next| if next.1 > best.1 { next } else { best });
        if length2 <= MIN_COLUMN_SHARE * strongest {
            return None;
        }
        *choice = column;
        let along: Entries = left.column(column) / length2.sqrt();
        left -= along * along.transpose();
    }
    let rows = products.select_rows(&chosen);
    let rows = SMatrix::<f64, 3, 10>::from_fn(|row, column| rows[(row, column)]);
    let own = Matrix3::from_fn(|row, column| products[(chosen[row], chosen[column])]);
    Some(own.cholesky()?.solve(&rows))
}

/// Levenberg-Marquardt on `f(R) = eᵀ A'ᵀA' e`, `R <- exp(dr) R`: ten numbers instead of all rows.
fn descend(system: &RotationSystem, start: RotationRoot) -> RotationRoot {
    let mut best = start;
    let mut damping = 1e-6;
    for _ in 0..DESCENT_STEPS {
        let d_entries = d_entries_d_rotation(best.rotation.matrix());
        let weighted = system.products() * d_entries;
        let gradient = weighted.transpose() * entries_of(best.rotation.matrix());
        let mut information = d_entries.transpose() * weighted;
        let trace = information.trace();
        for axis in 0..3 {
            information[(axis, axis)] += damping * trace;
        }
        let Some(cholesky) = information.cholesky() else { break };
        let step_rad = -cholesky.solve(&gradient);
        let next = at(system, Rotation3::new(step_rad) * best.rotation);
        if next.cost_m2 > best.cost_m2 {
            damping *= 30.0;
            continue;
        }
        best = next;
        damping *= 0.1;
        if step_rad.amax() < SMALL_STEP_RAD {
            break;
        }
    }
    best
}

/// Derivative of the entries by `dr` of `R <- exp(dr) R`: every column `c` of `R` moves by `dr × c`.
fn d_entries_d_rotation(rotation: &Matrix3<f64>) -> SMatrix<f64, 10, 3> {
    let mut derivative = SMatrix::<f64, 10, 3>::zeros();
    for column in 0..3 {
        let own = -rotation.column(column).into_owned().cross_matrix();
        derivative.fixed_view_mut::<3, 3>(3 * column, 0).copy_from(&own);
    }
    derivative
}

/// The 24 rotations that map the coordinate axes onto each other.
fn cube_rotations() -> impl Iterator<Item = Rotation3<f64>> {
    let axes = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]];
    (0..48).filter_map(move |i: usize| {
        let mut matrix = Matrix3::zeros();
        for (column, row) in axes[i / 8].into_iter().enumerate() {
            matrix[(row, column)] = if i >> column & 1 == 0 { 1.0 } else { -1.0 };
        }
        (matrix.determinant() > 0.0).then(|| Rotation3::from_matrix_unchecked(matrix))
    })
}

#[cfg(test)]
mod tests;
