//! How much worse than its model the noise is, and the covariance that follows: neither larger nor smaller than the errors are.

use nalgebra::Matrix6;

use super::association::Match;
use super::refine::Refined;

/// Sensors noisier than this many times the model are not explained by it.
pub const MAX_NOISE_SCALE: f64 = 2.5;
/// Median of a chi-square with four degrees of freedom.
const MEDIAN_DISTANCE2: f64 = 3.357;
/// Standard deviation of the noise scale estimated from the median of n such distances, times the square root of n.
const SIGMA_OF_MEDIAN: f64 = 0.475;
/// A loss that gives less weight to large residuals sums less information than the matches hold. With `w` the Cauchy weight at the
/// widths used here and normal noise: `E[w + 2 w' d²/D]² / (E[w² d²/D] E[w])` (variance of an M-estimator), 1.26 for lifted
/// matches and 1.20 for the others.
const INFORMATION_LEFT_OUT: f64 = 1.25;

/// The noise scale that the matches found with the scale `assumed` speak for, at least 1.
///
/// The model counts as right until the matches say otherwise: what exceeds 1 is shrunk by what chance would make of it
/// (James and Stein), so that good noise does not pass for bad one whenever the median happens to be high.
pub fn noise_scale(matches: &[Match], assumed: f64) -> f64 {
    let n = matches.len() as f64;
    let mut distances2: Vec<f64> = matches.iter().map(|found| found.distance2).collect();
    distances2.sort_by(f64::total_cmp);
    let Some(upper) = distances2.get(distances2.len() / 2) else { return 1.0 };
    let lower = distances2[(distances2.len() - 1) / 2];
    // Six numbers were fitted to these 4 n.
    let fitted = 4.0 * n / (4.0 * n - 6.0).max(1.0);
    let excess = assumed * (0.5 * (lower + upper) * fitted / MEDIAN_DISTANCE2).sqrt() - 1.0;
    let sigma = SIGMA_OF_MEDIAN / n.sqrt();
    if excess <= sigma {
        return 1.0;
    }
    (1.0 + excess - sigma * sigma / excess).min(MAX_NOISE_SCALE)
}

/// What to multiply robust normal equations at a noise scale with, so that their information is that of the pose.
///
/// They count the lines' noise scaled up by `noise_scale`. What a sensor is worse than its model (bent depth, wrong intrinsics) is
/// alike in all lines and does not average out as noise does, so the factor is applied to the pose once more.
pub fn information_factor(noise_scale: f64) -> f64 {
    INFORMATION_LEFT_OUT / (noise_scale * noise_scale)
}

/// Covariance of a pose (x y z rx ry rz); `None` when the matches do not fix it.
pub fn covariance(refined: &Refined, noise_scale: f64) -> Option<Matrix6<f64>> {
    let covariance = (refined.information * information_factor(noise_scale)).cholesky()?.inverse();
    covariance.iter().all(|value| value.is_finite()).then_some(covariance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::tests::room::Random;

    /// Matches with normal residuals, so many times larger than the model says.
    fn matches(name: &str, n: usize, factor: f64) -> Vec<Match> {
        let mut random = Random::named(name);
        let mut distance2 = || (0..4).map(|_| (factor * random.gaussian()).powi(2)).sum();
        (0..n).map(|candidate| Match { candidate, distance2: distance2(), gain: 1.0, nats: 0.0 }).collect()
    }

    #[test]
    fn noise_as_its_model_says_is_left_alone() {
        let scales = (0..50).map(|trial| noise_scale(&matches(&format!("good {trial}"), 40, 1.0), 1.0));
        let mean = scales.sum::<f64>() / 50.0;
        assert!((1.0..1.03).contains(&mean), "{mean}");
    }

    #[test]
    fn worse_noise_is_found_whatever_was_assumed() {
        let mut found = matches("bad", 400, 2.0);
        assert!((noise_scale(&found, 1.0) - 2.0).abs() < 0.15, "{}", noise_scale(&found, 1.0));
        found.iter_mut().for_each(|found| found.distance2 /= 1.6 * 1.6);
        assert!((noise_scale(&found, 1.6) - 2.0).abs() < 0.15, "{}", noise_scale(&found, 1.6));
    }

    #[test]
    fn no_match_says_nothing_and_no_noise_exceeds_the_limit() {
        assert_eq!(noise_scale(&[], 2.0), 1.0);
        assert_eq!(noise_scale(&matches("absurd", 30, 20.0), 1.0), MAX_NOISE_SCALE);
    }
}
