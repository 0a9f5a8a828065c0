//! From the pose that a pair was frozen with to the one it has now, with its uncertainty: what counts as a move, and what as the
//! same place.

use nalgebra::{Matrix6, Vector6};

use super::WatchLimits;
use crate::geometry::motion::Motion;

/// Least squared Mahalanobis distance of a move (six degrees of freedom: by chance once in a million looks).
const MIN_DISTANCE2: f64 = 38.0;
/// A move exceeds the least one by so many standard deviations.
const SIGMAS: f64 = 3.0;
/// A pair that stands within so many times the least move that counts, uncertainty included, stands where it stood ...
const SAME_PLACE: f64 = 2.0;
/// ... with so many standard deviations of it: one in forty by chance.
const SAME_PLACE_SIGMAS: f64 = 2.0;

/// How a pair stands now, against how it stood.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shift {
    /// As it stands now.
    pub(super) target_from_source: Motion,
    /// From the frozen pose to this one: x y z rx ry rz, m and rad.
    step: Vector6<f64>,
    /// Covariance of the step: that of both poses.
    pub(super) covariance: Matrix6<f64>,
}

/// A length and its standard deviation.
pub(super) type Amount = (f64, f64);

impl Shift {
    pub(super) fn between(frozen: (&Motion, &Matrix6<f64>), now: (&Motion, &Matrix6<f64>)) -> Self {
        let translation = now.0.translation.vector - frozen.0.translation.vector;
        let rotation = (now.0.rotation * frozen.0.rotation.inverse()).scaled_axis();
        let step = Vector6::from_iterator(translation.iter().chain(rotation.iter()).copied());
        Self { target_from_source: *now.0, step, covariance: frozen.1 + now.1 }
    }

    /// Shift (m) and turn (rad).
    pub(super) fn amounts(&self) -> (Amount, Amount) {
        (self.amount(0), self.amount(3))
    }

    /// Variance of the shift (m²) and of the turn (rad²), mean of the three axes.
    pub(super) fn mean_variances(&self) -> (f64, f64) {
        mean_variances(&self.covariance)
    }

    /// Length of three components from `first`, and its standard deviation along their direction.
    fn amount(&self, first: usize) -> Amount {
        let part = self.step.fixed_rows::<3>(first).into_owned();
        let covariance = self.covariance.fixed_view::<3, 3>(first, first).into_owned();
        let length = part.norm();
        let variance = match part.try_normalize(0.0) {
            Some(along) => along.dot(&(covariance * along)),
            None => covariance.diagonal().max(),
        };
        (length, variance.max(0.0).sqrt())
    }

    /// Whether the pair is shown to stand where it stood: not only that no move is seen, but that there is none of any size that
    /// counts.
    pub(super) fn is_same_place(&self, limits: &WatchLimits) -> bool {
        let ((shift_m, sigma_m), (turn_rad, sigma_rad)) = self.amounts();
        shift_m + SAME_PLACE_SIGMAS * sigma_m <= SAME_PLACE * limits.min_translation_m
            && turn_rad + SAME_PLACE_SIGMAS * sigma_rad <= SAME_PLACE * limits.min_rotation_rad
    }

    /// Whether this is more than noise and more than nobody minds, or at least that share of both.
    pub(super) fn is_beyond(&self, limits: &WatchLimits, share: f64) -> bool {
        let Some(cholesky) = self.covariance.cholesky() else { return false };
        let ((shift_m, sigma_m), (turn_rad, sigma_rad)) = self.amounts();
        self.step.dot(&cholesky.solve(&self.step)) > share * MIN_DISTANCE2
            && (shift_m > share * (limits.min_translation_m + SIGMAS * sigma_m)
                || turn_rad > share * (limits.min_rotation_rad + SIGMAS * sigma_rad))
    }
}

/// Variance of the translation (m²) and of the rotation (rad²), mean of the three axes.
pub(super) fn mean_variances(covariance: &Matrix6<f64>) -> (f64, f64) {
    let mean = |first: usize| covariance.fixed_view::<3, 3>(first, first).trace().max(0.0) / 3.0;
    (mean(0), mean(3))
}
