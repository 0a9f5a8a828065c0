//! How sure depth along an edge is: noise of readings that resemble their neighbours, its size taken from the readings.
use nalgebra::{Matrix2, Matrix4};

use super::band;
use super::fit::Agreement;
use super::plane::Plane;

/// Share of the noise's variance with a long correlation.
const SLOW_SHARE: f64 = 0.15;
/// Pixels per independent reading of the quick part of the noise (stereo matching windows overlap).
pub const QUICK_AREA_PX2: f64 = 28.0;
/// The same within one bin of the band, which is hardly larger than the correlation.
const QUICK_AREA_IN_BIN_PX2: f64 = 18.0;
/// Share of the variance that is slow and shows in the bins: the surface itself follows the rest.
const SLOW_SHARE_IN_BIN: f64 = 0.08;
/// Length per independent reading of the slow part, px.
const SLOW_LENGTH_PX: f64 = 40.0;
/// Weights of the sensor's noise model against what readings say of it, in independent readings.
const MODEL_WEIGHT: f64 = 8.0;
/// Least readings of a bin whose mean is compared with the surface.
const MIN_BIN_READINGS: f64 = 4.0;

/// Standard deviation of a reading, 1/m: what the residuals say, shrunk to the sensor's model.
pub fn reading_sigma_per_m(sides: &[&Agreement], length_px: f64, model_per_m: f64) -> f64 {
    let sum_per_m2: f64 = sides.iter().map(|side| side.sum_per_m2).sum();
    let n: f64 = sides.iter().map(|side| side.n).sum();
    let per_independent = readings_per_independent(length_px);
    let model_sum_per_m2 = MODEL_WEIGHT * model_per_m * model_per_m;
    ((model_sum_per_m2 + sum_per_m2 / per_independent) / (MODEL_WEIGHT + n / per_independent)).sqrt()
}

/// Readings of a segment that say as much as one independent one.
pub fn readings_per_independent(length_px: f64) -> f64 {
    QUICK_AREA_PX2 / band::pixels_per_reading(length_px)
}

/// Covariance of a surface from readings whose noise is correlated: a quick part over some pixels and a slow part over
/// lengths beyond the band's width, which moves the two ends.
pub fn covariance(unit_covariance: &Matrix4<f64>, sigma_per_m: f64, length_px: f64) -> Matrix2<f64> {
    let variance = sigma_per_m * sigma_per_m;
    let quick = (1.0 - SLOW_SHARE) * variance * readings_per_independent(length_px);
    // A mean and a tilt from n independent pieces: the tilt moves each end by 3/n, and cannot be told with one piece.
    let n = 1.0 + length_px / SLOW_LENGTH_PX;
    let (mean, tilt) = (1.0 / n, 3.0 / n * (1.0 - 1.0 / n));
    let slow = SLOW_SHARE * variance;
    let ends = Matrix2::new(mean + tilt, mean - tilt, mean - tilt, mean + tilt);
    unit_covariance.fixed_view::<2, 2>(0, 0) * quick + ends * slow
}

/// How the means of bins along an edge scatter about the surface, in units of the noise model: a chi-square and its degrees of
/// freedom. It shows what single readings do not: longer correlations than assumed, and surfaces that are not quite plane.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scatter {
    chi_square: f64,
    freedom: f64,
}

impl Scatter {
    /// Of one side about its plane.
    pub fn of(side: &Agreement, plane: &Plane, (sigma_per_m, length_px): (f64, f64)) -> Self {
        let area_px2 = band::pixels_per_reading(length_px);
        let (mut chi_square, mut bins) = (0.0, 0.0);
        for (n, residual_per_m) in side.bin_residuals(plane).filter(|(n, _)| *n >= MIN_BIN_READINGS) {
            let quick = (QUICK_AREA_IN_BIN_PX2 / (n * area_px2)).min(1.0);
            let variance = sigma_per_m * sigma_per_m * (SLOW_SHARE_IN_BIN + (1.0 - SLOW_SHARE) * quick);
            chi_square += residual_per_m * residual_per_m / variance;
            bins += 1.0;
        }
        // Two bins' worth goes into the surface's own ends.
        Self { chi_square, freedom: f64::max(bins - 2.0, 0.0) }
    }

    /// Of two sides together.
    pub fn and(self, other: Self) -> Self {
        Self { chi_square: self.chi_square + other.chi_square, freedom: self.freedom + other.freedom }
    }

    /// Factor on the variance: what is known beforehand, `prior`, and this scatter.
    pub fn variance_factor(self, prior: f64) -> f64 {
        (MODEL_WEIGHT * prior + self.chi_square) / (MODEL_WEIGHT + self.freedom)
    }
}

/// Factor on the variance that the lines of an image have in common: they share the sensor.
pub fn common_variance_factor(scatters: impl Iterator<Item = Scatter> + Clone) -> f64 {
    let mut factor = f64::INFINITY;
    // Lines that scatter much more than the others are not on a plane and say nothing of the sensor.
    for _ in 0..3 {
        let fair = scatters.clone().filter(|scatter| scatter.chi_square <= 3.0 * factor * scatter.freedom);
        factor = fair.fold(Scatter::default(), Scatter::and).variance_factor(1.0);
    }
    factor
}
