//! Matched pairs of what two cameras see of a room.

use nalgebra::{UnitQuaternion, Vector3};

use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::LinePair;
use crate::solver::matched::{MatchedLimits, MatchedSolution, solve_matches};
use crate::solver::tests::room::{Random, Room, measured, visible};

/// Every edge both cameras see from each place of the target camera; each frame set is one place.
pub fn pairs_along(
    random: &mut Random,
    room: &Room,
    target_from_source: &Motion,
    path: &[Motion],
) -> Vec<LinePair> {
    let mut pairs = Vec::new();
    for (set, world_from_target) in (0..).zip(path) {
        let target_from_world = world_from_target.inverse();
        let source_from_world = target_from_source.inverse() * target_from_world;
        for edge in room {
            let seen = |camera_from_world: &Motion| visible(&edge.map(|end| camera_from_world * end));
            let Some((target, source)) = seen(&target_from_world).zip(seen(&source_from_world)) else {
                continue;
            };
            let mut line = |[start, end]: [_; 2]| measured(random, start, end);
            pairs.extend(LinePair::try_new(&line(target), &line(source), set));
        }
    }
    pairs
}

/// Every fourth match without depth in the target.
pub fn with_pnl(pairs: &mut [LinePair]) {
    for pair in pairs.iter_mut().step_by(4) {
        let mut target = *pair.target_observation();
        target.depth = None;
        pair.target = crate::solver::TargetSide::Pnl(target);
    }
}

/// Gives a share of the matches the target of another match; which ones comes back.
pub fn spoil(random: &mut Random, pairs: &mut [LinePair], share: f64) -> Vec<bool> {
    let targets: Vec<_> = pairs.iter().map(|pair| pair.target.clone()).collect();
    let mut spoilt = vec![false; pairs.len()];
    for (at, pair) in pairs.iter_mut().enumerate() {
        if 0.5 * (random.signed() + 1.0) < share {
            // Far enough in the list to be another edge.
            pair.target = targets[(at + 7) % targets.len()].clone();
            spoilt[at] = true;
        }
    }
    spoilt
}

/// A pose by its place, m, and its turn about x, y and z, deg.
pub fn pose(at_m: [f64; 3], turn_deg: [f64; 3]) -> Motion {
    let [x, y, z] = turn_deg.map(f64::to_radians);
    Motion::from_parts(Vector3::from(at_m).into(), UnitQuaternion::from_euler_angles(x, y, z))
}

pub fn solved(pairs: &[LinePair]) -> MatchedSolution {
    solve_matches(pairs, &MatchedLimits::default())
}

#[track_caller]
pub fn check_close(found: &Motion, truth: &Motion, (limit_deg, limit_m): (f64, f64)) {
    let gap = (rotation_gap_rad(found, truth).to_degrees(), translation_gap_m(found, truth));
    assert!(gap.0 < limit_deg && gap.1 < limit_m, "off by {} deg, {} m", gap.0, gap.1);
}
