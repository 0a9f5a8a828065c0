//! Levenberg-Marquardt over the paper's two errors: the line reprojection error `e_l` of PnL pairs (eq. 6) and the point-to-line
//! error `e_L` of full pairs (eq. 7), summed as in eq. 8 with a Cauchy loss per pair. The rotation is free: `R <- exp(dr) R`.
//!
//! As published the errors are pixels and millimetres with equal weight. Whitened, a pair counts by the covariance of what both
//! cameras measured, and a full pair is compared in what the target measures instead of in millimetres.

use nalgebra::{Matrix2x6, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::pair_geometry::{PairGeometry, TargetGeometry, TargetLine, TargetSegment};
use crate::geometry::motion::{Motion, hat, updated};
use crate::solver::refine::{Stop, Whitened};
use crate::solver::residual::{match_residual, offset_residual};
use crate::solver::{LinePair, TargetSide};

const MM_PER_M: f64 = 1e3;
/// A step this small ends the iteration, m and rad: the next one is its square.
const SMALL_STEP: f64 = 1e-6;
/// Squared error, in loss widths, of a pair whose line predicts nothing: it must not look better than a wrong pair.
const NOTHING_PREDICTED: f64 = 1e5;
/// Damping beyond which no step can make the cost smaller.
const MAX_DAMPING: f64 = 1e6;

/// In which units the errors of the pairs are summed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// Millimetres and pixels with equal weight (eq. 8).
    AsPublished,
    /// Standard deviations: every error divided by its covariance.
    Whitened,
}

/// A matched pair with its reading by the paper's equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadPair<'a> {
    /// What was measured.
    pub pair: &'a LinePair,
    /// The same as points, directions and rays.
    pub geometry: PairGeometry,
}

/// What is minimised: the pairs and how they count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Objective<'a> {
    /// The pairs that take part.
    pub pairs: &'a [ReadPair<'a>],
    /// Units of the errors.
    pub weighting: Weighting,
    /// Width of the Cauchy loss in these units.
    pub loss_width: f64,
}

/// The refined pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The pose.
    pub target_from_source: Motion,
    /// Robust cost, mean over the pairs: half of `w² ln(1 + e²/w²)`.
    pub mean_cost: f64,
    /// Why the iteration ended.
    pub stop: Stop,
}

/// Minimises the objective from `start` in at most `max_steps`.
pub fn refine(objective: &Objective<'_>, start: &Motion, max_steps: usize) -> Refined {
    let mut pose = *start;
    let mut system = objective.at(&pose);
    let mut damping = 1e-4;
    let mut stop = Stop::StepLimit;
    for _ in 0..max_steps {
        let Some(step) = system.step(damping) else {
            stop = Stop::Singular;
            break;
        };
        let next_pose = updated(&pose, &step);
        let next = objective.at(&next_pose);
        if next.cost <= system.cost {
            pose = next_pose;
            system = next;
            damping = (damping * 0.1).max(1e-12);
            if step.amax() < SMALL_STEP {
                stop = Stop::SmallStep;
                break;
            }
        } else if damping > MAX_DAMPING {
            stop = Stop::NoDescent;
            break;
        } else {
            damping *= 10.0;
        }
    }
    let mean_cost = system.cost / objective.pairs.len().max(1) as f64;
    Refined { target_from_source: pose, mean_cost, stop }
}

/// `H step = -g` of an objective at one pose; a step is ordered x y z rx ry rz.
#[derive(Debug, Clone, PartialEq)]
pub struct NormalEquations {
    /// Robust cost, summed.
    pub cost: f64,
    /// Sum of squared errors, each with the weight that the loss leaves it.
    pub weighted_error2: f64,
    /// `H`, 1/m², 1/rad² and mixed.
    pub information: Matrix6<f64>,
    /// `g`.
    pub gradient: Vector6<f64>,
}

impl NormalEquations {
    fn step(&self, damping: f64) -> Option<Vector6<f64>> {
        let mut damped = self.information;
        for axis in 0..6 {
            damped[(axis, axis)] += damping * self.information[(axis, axis)] + 1e-9;
        }
        Some(-damped.cholesky()?.solve(&self.gradient))
    }
}

impl Objective<'_> {
    /// Sums all pairs at a pose.
    pub fn at(&self, target_from_source: &Motion) -> NormalEquations {
        let mut sum = NormalEquations {
            cost: 0.0,
            weighted_error2: 0.0,
            information: Matrix6::zeros(),
            gradient: Vector6::zeros(),
        };
        let width2 = self.loss_width * self.loss_width;
        for pair in self.pairs {
            let Some(term) = squared_error(pair, target_from_source, self.weighting) else {
                sum.cost += 0.5 * width2 * NOTHING_PREDICTED.ln_1p();
                continue;
            };
            // Cauchy: rho = w² ln(1 + e²/w²), weight 1 / (1 + e²/w²).
            let ratio = term.distance2 / width2;
            let weight = 1.0 / (1.0 + ratio);
            sum.cost += 0.5 * width2 * ratio.ln_1p();
            sum.weighted_error2 += weight * term.distance2;
            sum.information += term.information * weight;
            sum.gradient += term.gradient * weight;
        }
        sum
    }
}

/// `eᵀe` of one pair with its normal equations; `None` where the moved source line has no image.
pub fn squared_error(
    pair: &ReadPair<'_>,
    target_from_source: &Motion,
    weighting: Weighting,
) -> Option<Whitened> {
    let LinePair { target, source, .. } = pair.pair;
    match (weighting, target, &pair.geometry.target) {
        (Weighting::Whitened, TargetSide::Full(target), _) => {
            Whitened::new(&match_residual(target, source, target_from_source)?, 1.0)
        }
        (Weighting::Whitened, TargetSide::Pnl(target), _) => {
            Whitened::of_offsets(&offset_residual(target, source, target_from_source)?, 1.0)
        }
        (Weighting::AsPublished, _, TargetGeometry::Full(line)) => {
            let error = point_to_line_error(line, &pair.geometry.source_ends_m, target_from_source);
            Some(error.squared())
        }
        (Weighting::AsPublished, _, TargetGeometry::Pnl(segment)) => {
            Some(reprojection_error(segment, &pair.geometry.source_ends_m, target_from_source)?.squared())
        }
    }
}

/// An error with its derivative by a step of the pose, ordered x y z rx ry rz.
#[derive(Debug, Clone, PartialEq)]
pub struct ErrorTerm<const D: usize> {
    /// The error.
    pub error: SVector<f64, D>,
    /// Its derivative.
    pub d_error_d_pose: SMatrix<f64, D, 6>,
}

impl<const D: usize> ErrorTerm<D> {
    fn squared(&self) -> Whitened {
        let transposed = self.d_error_d_pose.transpose();
        Whitened {
            distance2: self.error.norm_squared(),
            information: transposed * self.d_error_d_pose,
            gradient: transposed * self.error,
        }
    }
}

/// `e_L` (paper, eq. 7): `(I - d dᵀ)(R X + t - p)` of both source ends, mm. Any point `p` of the target line will do; `d` is a unit
/// vector.
pub fn point_to_line_error(
    line: &TargetLine,
    source_ends_m: &[Vector3<f64>; 2],
    target_from_source: &Motion,
) -> ErrorTerm<6> {
    let mut term = ErrorTerm { error: Vector6::zeros(), d_error_d_pose: Matrix6::zeros() };
    let d = &line.direction;
    for (i, end_m) in source_ends_m.iter().enumerate() {
        let turned_m = target_from_source.rotation * end_m;
        let offset_m = turned_m + target_from_source.translation.vector - line.point_m;
        let error = (offset_m - d * d.dot(&offset_m)) * MM_PER_M;
        term.error.fixed_rows_mut::<3>(3 * i).copy_from(&error);
        for axis in 0..3 {
            // Column k of (I - d dᵀ), and of its product with -[R X]ₓ: exp(dr) R X = R X + dr × R X.
            let unit = Vector3::ith(axis, MM_PER_M);
            let by_rotation = unit.cross(&turned_m);
            let mut column = term.d_error_d_pose.fixed_view_mut::<3, 1>(3 * i, axis);
            column.copy_from(&(unit - d * (d[axis] * MM_PER_M)));
            let mut column = term.d_error_d_pose.fixed_view_mut::<3, 1>(3 * i, 3 + axis);
            column.copy_from(&(by_rotation - d * d.dot(&by_rotation)));
        }
    }
    term
}

/// `e_l` (paper, eq. 6): distances of the target segment's two ends from the image of the moved source line, px. `None` where that line
/// passes through the camera's centre, or its image is at infinity.
pub fn reprojection_error(
    segment: &TargetSegment,
    source_ends_m: &[Vector3<f64>; 2],
    target_from_source: &Motion,
) -> Option<ErrorTerm<2>> {
    let turned_m = source_ends_m.map(|end_m| target_from_source.rotation * end_m);
    let [a, b] = turned_m.map(|turned_m| turned_m + target_from_source.translation.vector);
    // The moment of the moved line is the image line l̂ on the plane z = 1, up to its length.
    let image_line = a.cross(&b);
    let norm = image_line.xy().norm();
    if norm <= 1e-9 * (1.0 + image_line.norm()) {
        return None;
    }
    let normal = Vector3::new(image_line.x / norm, image_line.y / norm, 0.0);
    // d(a × b) = da × b + a × db with da = dt + dr × R X.
    let by_translation = hat(&(a - b));
    let by_rotation = hat(&b) * hat(&turned_m[0]) - hat(&a) * hat(&turned_m[1]);
    let mut term = ErrorTerm { error: Vector2::zeros(), d_error_d_pose: Matrix2x6::zeros() };
    for (i, ray) in segment.end_rays.iter().enumerate() {
        let distance = ray.dot(&image_line) / norm;
        let d_distance_d_line = (ray - normal * distance) * (segment.focal_px / norm);
        term.error[i] = distance * segment.focal_px;
        let mut translation = term.d_error_d_pose.fixed_view_mut::<1, 3>(i, 0);
        translation.copy_from(&(d_distance_d_line.transpose() * by_translation));
        let mut rotation = term.d_error_d_pose.fixed_view_mut::<1, 3>(i, 3);
        rotation.copy_from(&(d_distance_d_line.transpose() * by_rotation));
    }
    Some(term)
}

#[cfg(test)]
mod tests;
