//! Robust Levenberg-Marquardt over the pose of one pair, with the measurement weights of both lines.

use nalgebra::{Matrix6, SMatrix, SVector, Vector6};

use super::association::{MAX_DISTANCE2, Scene};
use super::residual::{MatchResidual, OffsetResidual, match_residual};
use crate::geometry::motion::{Motion, updated};

/// Steps that take a start within the voting's reach to the minimum (5 to 15 are needed).
pub const TO_THE_MINIMUM: usize = 30;
/// Steps that bring a start near the minimum, where the matches will change anyway.
pub const TOWARDS_THE_MINIMUM: usize = 4;
/// A step this small ends the iteration: m and rad.
const SMALL_STEP: f64 = 1e-8;
/// Width of the Cauchy loss in standard deviations of one match (four numbers: true matches lie near 2).
const LOSS_WIDTH: f64 = 3.5;

/// Why the iteration ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stop {
    /// The step became negligible: a minimum.
    SmallStep,
    /// No damping made the cost smaller: at a minimum to machine precision.
    NoDescent,
    /// Steps used up.
    StepLimit,
    /// The matches fix no pose.
    Singular,
}

/// The refined pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The pose.
    pub target_from_source: Motion,
    /// Weighted information of a step (x y z rx ry rz), 1/m², 1/rad² and mixed.
    pub information: Matrix6<f64>,
    /// Why it ended.
    pub stop: Stop,
}

/// Minimises the robust cost over the given matches (indices of candidates) in at most `max_steps`.
pub fn refine(
    scene: &Scene<'_>,
    matches: &[usize],
    start: &Motion,
    (noise_scale, max_steps): (f64, usize),
) -> Refined {
    descend(start, max_steps, |pose| NormalEquations::at(scene, matches, pose, noise_scale))
}

/// Levenberg-Marquardt from `start` over the robust cost that `system_at` sums at a pose, in at most `max_steps`.
pub fn descend(start: &Motion, max_steps: usize, system_at: impl Fn(&Motion) -> NormalEquations) -> Refined {
    let mut pose = *start;
    let mut system = system_at(&pose);
    let mut damping = 1e-4;
    let mut stop = Stop::StepLimit;
    for _ in 0..max_steps {
        let Some(step) = system.step(damping) else {
            stop = Stop::Singular;
            break;
        };
        let next_pose = updated(&pose, &step);
        let next = system_at(&next_pose);
        if next.cost <= system.cost {
            pose = next_pose;
            system = next;
            damping = (damping * 0.2).max(1e-12);
            if step.amax() < SMALL_STEP {
                stop = Stop::SmallStep;
                break;
            }
        } else if damping > 1e6 {
            stop = Stop::NoDescent;
            break;
        } else {
            damping *= 8.0;
        }
    }
    Refined { target_from_source: pose, information: system.information, stop }
}

/// `H step = -g` of the robust cost at one pose.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NormalEquations {
    /// Robust cost.
    pub cost: f64,
    /// `H`: information of a step (x y z rx ry rz).
    pub information: Matrix6<f64>,
    /// `g`.
    pub gradient: Vector6<f64>,
}

impl NormalEquations {
    /// Sums the matches (indices of candidates) at a pose.
    pub fn at(scene: &Scene<'_>, matches: &[usize], pose: &Motion, noise_scale: f64) -> Self {
        let mut sum = Self::zero();
        for &idx in matches {
            let found = scene
                .pair
                .pair(&scene.candidates[idx])
                .and_then(|(target, source)| match_residual(target, source, pose));
            sum.add(found.and_then(|found| Whitened::new(&found, noise_scale)), LOSS_WIDTH);
        }
        sum
    }

    /// Nothing summed yet.
    pub fn zero() -> Self {
        Self { cost: 0.0, information: Matrix6::zeros(), gradient: Vector6::zeros() }
    }

    /// Adds one match under a Cauchy loss of this width in standard deviations; `None` is a line that predicts nothing.
    pub fn add(&mut self, whitened: Option<Whitened>, loss_width: f64) {
        let width2 = loss_width * loss_width;
        let Some(whitened) = whitened else {
            // It must not look better than a bad match.
            self.cost += 0.5 * width2 * (1.0 + 10.0 * MAX_DISTANCE2 / width2).ln();
            return;
        };
        // Cauchy: rho = w²/2 ln(1 + d²/w²), weight 1 / (1 + d²/w²).
        let ratio = whitened.distance2 / width2;
        let weight = 1.0 / (1.0 + ratio);
        self.cost += 0.5 * width2 * ratio.ln_1p();
        self.information += whitened.information * weight;
        self.gradient += whitened.gradient * weight;
    }

    /// The same with every weight multiplied by a factor.
    pub fn scaled(self, factor: f64) -> Self {
        let Self { cost, information, gradient } = self;
        Self { cost: cost * factor, information: information * factor, gradient: gradient * factor }
    }

    /// Those of both sums of matches together.
    pub fn plus(self, other: Self) -> Self {
        Self {
            cost: self.cost + other.cost,
            information: self.information + other.information,
            gradient: self.gradient + other.gradient,
        }
    }

    /// The step to the minimum of the quadratic model, shortened by the damping; `None` when the matches fix no pose.
    pub fn step(&self, damping: f64) -> Option<Vector6<f64>> {
        let mut damped = self.information;
        for axis in 0..6 {
            damped[(axis, axis)] += damping * self.information[(axis, axis)] + 1e-9;
        }
        Some(-damped.cholesky()?.solve(&self.gradient))
    }
}

/// One match's part of the normal equations.
#[derive(Debug, Clone, Copy)]
pub struct Whitened {
    /// Squared Mahalanobis distance.
    pub distance2: f64,
    /// `Jᵀ Σ⁻¹ J`.
    pub information: Matrix6<f64>,
    /// `Jᵀ Σ⁻¹ r`.
    pub gradient: Vector6<f64>,
}

impl Whitened {
    /// A match lifted on both sides; `None` when the covariance is not positive definite (a line without noise model).
    pub fn new(found: &MatchResidual, noise_scale: f64) -> Option<Self> {
        whitened(&found.residual, &found.d_residual_d_pose, found.covariance * (noise_scale * noise_scale))
    }

    /// A match lifted in the source only; `None` as above.
    pub fn of_offsets(found: &OffsetResidual, noise_scale: f64) -> Option<Self> {
        whitened(&found.residual, &found.d_residual_d_pose, found.covariance * (noise_scale * noise_scale))
    }
}

fn whitened<const D: usize>(
    residual: &SVector<f64, D>,
    d_residual_d_pose: &SMatrix<f64, D, 6>,
    mut covariance: SMatrix<f64, D, D>,
) -> Option<Whitened> {
    // Forward elimination of [Σ | J | r]: with Σ = L Lᵀ what is left are the whitened rows L⁻¹ J and L⁻¹ r.
    let (mut rows, mut numbers) = (*d_residual_d_pose, *residual);
    for k in 0..D {
        if covariance[(k, k)] <= 0.0 || covariance[(k, k)].is_nan() {
            return None;
        }
        let scale = 1.0 / covariance[(k, k)].sqrt();
        numbers[k] *= scale;
        for axis in 0..6 {
            rows[(k, axis)] *= scale;
        }
        for i in k + 1..D {
            let factor = covariance[(i, k)] * scale;
            numbers[i] -= factor * numbers[k];
            for axis in 0..6 {
                rows[(i, axis)] -= factor * rows[(k, axis)];
            }
            for j in k + 1..=i {
                covariance[(i, j)] -= factor * covariance[(j, k)] * scale;
            }
        }
    }
    Some(Whitened {
        distance2: numbers.norm_squared(),
        information: rows.tr_mul(&rows),
        gradient: rows.tr_mul(&numbers),
    })
}
