//! Which camera was moved: the one whose move alone explains how all pairs stand now.

use super::pair::{PairWatch, Sight};
use super::shift::Shift;
use super::{Moved, Who};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};

/// Squared distance that one pair can hold against a camera, in variances: another camera may have been moved too.
const MAX_MISFIT: f64 = 50.0;
/// One camera of a pair is the culprit when this much less is held against it than against the other.
const MIN_LEAD: f64 = 20.0;

/// Every move that the pairs have seen, in camera order; where nothing tells which camera of a pair it was, the pair.
pub(super) fn culprits(frozen: &[Option<Motion>], pairs: &[PairWatch], sights: &[Sight]) -> Vec<Moved> {
    let mut found: Vec<Moved> = Vec::new();
    for (pair, sight) in pairs.iter().zip(sights) {
        let Sight::Moved(shift) = sight else { continue };
        let [target, source] = pair.cameras;
        let against = |camera| misfit(frozen, (pairs, sights), (pair, shift), camera);
        let lead = against(target) - against(source);
        found.push(if lead > MIN_LEAD {
            moved(Who::Camera(source), shift)
        } else if lead < -MIN_LEAD {
            moved(Who::Camera(target), &pair.seen_from_source(shift))
        } else {
            moved(Who::OneOf(target, source), shift)
        });
    }
    // Several pairs may have seen one move: the surest tells how far.
    let order = |a: &Moved, b: &Moved| {
        a.who.cmp(&b.who).then(a.sigma_translation_m.total_cmp(&b.sigma_translation_m))
    };
    found.sort_by(order);
    found.dedup_by_key(|moved| moved.who);
    found
}

fn moved(who: Who, shift: &Shift) -> Moved {
    let ((translation_m, sigma_translation_m), (rotation_rad, sigma_rotation_rad)) = shift.amounts();
    Moved { who, rotation_rad, sigma_rotation_rad, translation_m, sigma_translation_m }
}

/// What the other pairs hold against the guess that of this pair it was `camera` that moved.
fn misfit(
    frozen: &[Option<Motion>],
    (pairs, sights): (&[PairWatch], &[Sight]),
    (moved_pair, shift): (&PairWatch, &Shift),
    camera: usize,
) -> f64 {
    let [target, source] = moved_pair.cameras;
    let place = |camera: usize| frozen.get(camera).copied().flatten();
    let guessed = if camera == source {
        place(target).map(|pose| pose * shift.target_from_source)
    } else {
        place(source).map(|pose| pose * shift.target_from_source.inverse())
    };
    let now = |other: usize| if other == camera { guessed } else { place(other) };
    let held = pairs.iter().zip(sights).map(|(pair, sight)| {
        let (Sight::Moved(seen) | Sight::Confirmed(seen)) = sight else { return 0.0 };
        let [a, b] = pair.cameras;
        let (Some(from_a), Some(from_b)) = (now(a), now(b)) else { return 0.0 };
        let expected = from_a.inverse() * from_b;
        let gap = (
            translation_gap_m(&expected, &seen.target_from_source),
            rotation_gap_rad(&expected, &seen.target_from_source),
        );
        let (variance_m2, variance_rad2) = (
            seen.mean_variances().0 + shift.mean_variances().0,
            seen.mean_variances().1 + shift.mean_variances().1,
        );
        (gap.0 * gap.0 / variance_m2 + gap.1 * gap.1 / variance_rad2).min(MAX_MISFIT)
    });
    held.sum()
}
