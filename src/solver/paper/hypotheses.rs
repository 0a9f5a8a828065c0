//! The poses one set of pairs allows: quadratic system, RE3Q3, and each root refined towards its minimum.
//!
//! The least squares of the system knows no outliers. Refinement does: its loss starts wide, so that a root some degrees off still
//! feels the right pairs, and narrows until the wrong ones are without weight. Roots that fall behind on the way are left.

use nalgebra::{Translation3, UnitQuaternion};

use super::quadratic::{QuadraticSystem, RotationSystem};
use super::refine::{Objective, ReadPair, Refined, Weighting, refine};
use super::rotation_roots::{RotationRoot, Starts, rotation_roots};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};

/// Widths of the loss on the way, mm and px: from what a root misses by to what noise makes of a far line.
const WIDTHS: [f64; 3] = [60.0, 20.0, 6.0];
/// Poses that go on with each width: as many of the best as three quadrics can have roots, then those that are still distinct minima.
const KEPT: [usize; 3] = [8, 4, 4];
/// Steps with each width.
const STEPS: usize = 4;
/// Poses closer than this, rad (0.5 deg) ...
const SAME_MINIMUM_RAD: f64 = 0.01;
/// ... and this, m, are refined as one.
const SAME_MINIMUM_M: f64 = 0.01;

/// The refined roots, least robust cost first. Empty where the pairs leave the translation open.
pub fn hypotheses(pairs: &[ReadPair<'_>], starts: Starts) -> Vec<Motion> {
    let system = QuadraticSystem::of(pairs.iter().map(|pair| &pair.geometry));
    let Some(system) = system.eliminate_translation() else { return Vec::new() };
    let roots = rotation_roots(&system, starts);
    let mut poses: Vec<Motion> = roots.iter().map(|root| pose(&system, root)).collect();
    let objective = |loss_width| Objective { pairs, weighting: Weighting::AsPublished, loss_width };
    let mut ranked: Vec<(f64, Motion)> =
        poses.iter().map(|pose| (objective(WIDTHS[0]).at(pose).cost, *pose)).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    poses = ranked.into_iter().map(|(_, pose)| pose).collect();
    for (loss_width, kept) in WIDTHS.into_iter().zip(KEPT) {
        let poses_kept = poses.iter().take(kept);
        let mut refined: Vec<Refined> =
            poses_kept.map(|pose| refine(&objective(loss_width), pose, STEPS)).collect();
        refined.sort_by(|a, b| a.mean_cost.total_cmp(&b.mean_cost));
        poses.clear();
        for Refined { target_from_source, .. } in refined {
            if poses.iter().all(|better| !is_same(better, &target_from_source)) {
                poses.push(target_from_source);
            }
        }
    }
    poses
}

/// Whether two poses are on their way into one minimum.
fn is_same(a: &Motion, b: &Motion) -> bool {
    rotation_gap_rad(a, b) < SAME_MINIMUM_RAD && translation_gap_m(a, b) < SAME_MINIMUM_M
}

fn pose(system: &RotationSystem, root: &RotationRoot) -> Motion {
    let translation_m = system.translation_m(root.rotation.matrix());
    Motion::from_parts(
        Translation3::from(translation_m),
        UnitQuaternion::from_rotation_matrix(&root.rotation),
    )
}
