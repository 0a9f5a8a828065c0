//! From likeness to evidence: how many times likelier it is for one edge than for two, and how far the two images may be
//! believed to show anything in common.
//!
//! Fitted to 24 synthetic rooms (yaw 0 to 45 degrees, 0.2 to 0.4 m apart; 73 pairs of images, 132 k shortlisted pairs of
//! lines, 9.6 k of them one edge): a logistic fit with the odds of an arbitrary pair of the same images taken off. Checked on 97
//! pairs of images rendered otherwise and 47 of real cameras, where the observed odds follow the predicted ones within 1 nat.

use super::likeness::Likeness;

/// Added to gaps before their ratio, so that noise is no difference.
const NOISE_GAP: f32 = 0.01;
/// Nats by the logarithm of the gap over the least gap to a rival in the other image: below 0 the pair is mutually the best.
const CURVE: [(f64, f64); 7] =
    [(-1.0, 9.65), (-0.5, 7.97), (-0.2, 6.89), (0.0, 5.44), (0.2, 3.73), (0.6, 3.10), (1.2, 2.36)];
/// Nats per unit of the logarithm of the gap over the least gap within one image: who has a double at home is not known by
/// its looks.
const DOUBLE_SLOPE: f64 = -1.9;
const DOUBLE_RANGE: [f64; 2] = [-0.5, 1.2];
/// Nats per unit of the logarithm of the length: short lines see little.
const LENGTH_SLOPE: f64 = 1.5;
const LENGTH_RANGE_PX: [f64; 2] = [28.0, 120.0];
const USUAL_LENGTH_PX: f64 = 60.0;
/// Bounds of what is said of one pair of lines, nats.
const RANGE_NATS: [f64; 2] = [-2.0, 8.0];

/// Logarithm of the likelihood ratio of one pair of lines, nats, if the two images overlap; the shorter line is that long.
pub(super) fn nats(pair: &Likeness, shorter_px: f64) -> f64 {
    let log_ratio = |other: f32| f64::from(((pair.gap + NOISE_GAP) / (other + NOISE_GAP)).ln());
    let double = log_ratio(pair.own_gap).clamp(DOUBLE_RANGE[0], DOUBLE_RANGE[1]);
    let length = (shorter_px.clamp(LENGTH_RANGE_PX[0], LENGTH_RANGE_PX[1]) / USUAL_LENGTH_PX).ln();
    let sum = on_curve(log_ratio(pair.rival_gap)) + DOUBLE_SLOPE * double + LENGTH_SLOPE * length;
    sum.clamp(RANGE_NATS[0], RANGE_NATS[1])
}

/// Straight between the points of [`CURVE`], level beyond its ends.
fn on_curve(x: f64) -> f64 {
    let x = x.clamp(CURVE[0].0, CURVE[CURVE.len() - 1].0);
    let piece = CURVE.windows(2).find(|piece| x <= piece[1].0).unwrap_or(&CURVE[CURVE.len() - 2..]);
    let [(x0, y0), (x1, y1)] = [piece[0], piece[1]];
    y0 + (y1 - y0) * (x - x0) / (x1 - x0)
}

/// A pair of lines counts as strong from here, nats.
const STRONG_NATS: f64 = 6.0;
/// Strong pairs at which the images are believed by half: some, and a share of the lines of the poorer image. Without any overlap
/// there are 5 in the median and fewer than this in 19 of 20 pairs of images, nearly all of them wrong.
const HALF_STRONG: f64 = 7.0;
const HALF_STRONG_PER_LINE: f64 = 0.085;

/// How far to believe what was said of the lines of two images, 0 to 1. Without overlap a few lines always look alike,
/// and the same ones in frame set after frame set: as evidence they must not add up.
pub(super) fn trust(nats: &[f64], n_lines_of_poorer: usize) -> f64 {
    let n_strong = nats.iter().filter(|nats| **nats >= STRONG_NATS).count() as f64;
    let half = HALF_STRONG + HALF_STRONG_PER_LINE * n_lines_of_poorer as f64;
    let odds = ((n_strong + 1.0) / half).powi(4);
    odds / (1.0 + odds)
}
