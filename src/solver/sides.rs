//! The two sides of an edge: what both cameras say of them must fit together under a pose.
//!
//! A segment runs so that its right hand is brighter, and at an occluding edge one side owns it. Two cameras that see the front of
//! the same surface see it on the same hand of the edge: with `d` the edge's direction, `p` a point of it, `N` the surface's normal
//! and `d × N` pointing away from the surface, the hand is the sign of `(d × N).(p × d) = -N.p`, and `N` faces both. No other
//! appearance is asked.

use super::evidence::EvidenceLine;
use crate::geometry::{EdgeSide, LineObservation};

/// The brighter side is the same for both cameras in 93 of 100 true matches at least (measured: 96; light, and backgrounds that
/// change with the viewpoint, turn the others), and in half of the chance matches: `ln(0.93 / 0.5)`, nats ...
const SAME_BRIGHTER_SIDE: f64 = 0.62;
/// ... and `ln(0.07 / 0.5)`.
const OTHER_BRIGHTER_SIDE: f64 = -1.97;

/// What the brighter sides say for a match, nats; `is_same_way` when the pose turns both directions, start to end, alike.
pub fn brightness_gain(is_same_way: bool) -> f64 {
    if is_same_way { SAME_BRIGHTER_SIDE } else { OTHER_BRIGHTER_SIDE }
}

/// Whether both cameras see the surface that ends at an occluding edge on opposite sides of it (never the case in 99 of 100 true
/// matches); edges where two surfaces meet contradict nothing.
pub fn owners_contradict(target: &EvidenceLine, source: &EvidenceLine, is_same_way: bool) -> bool {
    match (owner(&target.observation), owner(&source.observation)) {
        (Some(target), Some(source)) => (target == source) != is_same_way,
        _ => false,
    }
}

/// The side of an occluding edge that owns it; `None` without depth and where two surfaces meet.
fn owner(line: &LineObservation) -> Option<EdgeSide> {
    line.depth.map(|depth| depth.side).filter(|side| *side != EdgeSide::Both)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solver::residual::tests::line_between;

    fn owned_by(side: EdgeSide) -> EvidenceLine {
        let mut line = line_between([-0.3, 0.1, 1.5], [0.3, 0.2, 1.8]);
        line.observation.depth.as_mut().expect("lifted").side = side;
        line
    }

    #[test]
    fn a_surface_ends_on_the_same_hand_for_both_cameras() {
        let (left, right) = (owned_by(EdgeSide::Left), owned_by(EdgeSide::Right));
        assert!(!owners_contradict(&left, &left, true) && owners_contradict(&left, &right, true));
        assert!(owners_contradict(&right, &right, false) && !owners_contradict(&left, &right, false));
    }

    #[test]
    fn a_crease_contradicts_nothing() {
        let (left, both) = (owned_by(EdgeSide::Left), owned_by(EdgeSide::Both));
        assert!([true, false].iter().all(|way| !owners_contradict(&left, &both, *way)));
        assert!([true, false].iter().all(|way| !owners_contradict(&both, &both, *way)));
    }

    #[test]
    fn a_brighter_side_that_changes_costs_more_than_it_gains_otherwise() {
        assert!(brightness_gain(true) > 0.0 && brightness_gain(false) < -brightness_gain(true));
    }
}
