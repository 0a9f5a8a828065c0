//! How many matches agree with a pose that two of them gave: fast and tolerant, since such a pose is a few degrees off.

use super::sample::Placement;
use super::sight::Sight;

/// Offsets of the target segment's ends from the predicted line, on z = 1, at which a match stops counting: 25 px of 600.
const MAX_OFFSET: f64 = 0.042;
/// ... and differences of inverse depth, 1/m: 20 cm at 1.5 m.
const MAX_INVERSE_DEPTH_PER_M: f64 = 0.1;
/// What a PnL match counts: it measures two of the four numbers.
const PNL_WEIGHT: f64 = 0.5;

/// What a pose explains.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Score {
    /// Sum over the matches, a perfect full one counting 1.
    pub sum: f64,
    /// Full matches that count anything.
    pub n_full: usize,
}

/// Scores a pose; `None` as soon as it cannot reach `least` any more.
pub fn score(sights: &[Sight], placement: &Placement, least: f64) -> Option<Score> {
    let mut score = Score::default();
    let mut still_possible = sights.len() as f64;
    for sight in sights {
        let value = agreement(sight, placement);
        if sight.inverse_depth_per_m.is_some() {
            score.sum += value;
            score.n_full += usize::from(value > 0.0);
        } else {
            score.sum += PNL_WEIGHT * value;
        }
        still_possible -= 1.0;
        if score.sum + still_possible < least {
            return None;
        }
    }
    Some(score)
}

/// 1 for a perfect match, 0 for one that does not agree.
fn agreement(sight: &Sight, placement: &Placement) -> f64 {
    let Placement { rotation, translation_m } = placement;
    let [a, b] = sight.source_ends_m.map(|end_m| rotation * end_m + translation_m);
    let moment = a.cross(&b);
    let image_norm2 = moment.x * moment.x + moment.y * moment.y;
    let offsets = sight.target_rays.map(|ray| moment.dot(&ray));
    // (e / max)² averaged over the two ends; written so that a line through the centre counts nothing.
    let across2 = offsets[0] * offsets[0] + offsets[1] * offsets[1];
    let allowed2 = 2.0 * MAX_OFFSET * MAX_OFFSET * image_norm2;
    if across2 >= allowed2 {
        return 0.0;
    }
    // Inverse depth where the ray meets the plane of the line and the normal of its moment: q = u.(D × m) / |m|².
    let normal_to_both = (b - a).cross(&moment) / moment.norm_squared();
    let predicted_per_m = sight.target_rays.map(|ray| normal_to_both.dot(&ray));
    let along2 = match sight.inverse_depth_per_m {
        Some(measured_per_m) => {
            let [start, end] = [0, 1].map(|i| {
                let ratio = (measured_per_m[i] - predicted_per_m[i]) / MAX_INVERSE_DEPTH_PER_M;
                ratio * ratio
            });
            0.5 * (start + end)
        }
        // What the target saw is in front of it.
        None if predicted_per_m.iter().any(|&inverse_depth_per_m| inverse_depth_per_m <= 0.0) => return 0.0,
        None => 0.0,
    };
    (1.0 - across2 / allowed2 - along2).max(0.0)
}
