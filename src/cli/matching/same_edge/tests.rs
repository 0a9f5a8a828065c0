use nalgebra::{Matrix2, Point3, Vector3};

use super::*;
use crate::geometry::camera::Pinhole;
use crate::geometry::{Distortion, EdgeSide, Segment};

/// A horizontal edge in front of the target, m.
const LEFT: [f64; 3] = [-0.5, 0.1, 1.8];
const RIGHT: [f64; 3] = [0.6, 0.0, 2.1];

fn camera() -> Camera {
    let pinhole = Pinhole { fx_px: 600.0, fy_px: 600.0, cx_px: 320.0, cy_px: 240.0 };
    Camera::try_new((640, 480), pinhole, Distortion::None).expect("valid intrinsics")
}

fn target_from_source() -> Motion {
    Motion::new(Vector3::new(0.3, 0.02, -0.05), Vector3::new(0.05, 0.3, -0.1))
}

/// Between two shares of the way from one point of the target's frame to another, as a camera sees it.
fn seen(
    camera_from_target: &Motion,
    [a, b]: [[f64; 3]; 2],
    [from, to]: [f64; 2],
    is_lifted: bool,
) -> LineObservation {
    let [a, b] = [Point3::from(a), Point3::from(b)];
    let points = [from, to].map(|share| camera_from_target * (a + (b - a) * share));
    let [start, end] = points.map(|point| camera().project(&point).expect("in front of the camera"));
    let depth = DepthFit {
        inverse_depth_per_m: points.map(|point| 1.0 / point.z),
        covariance_per_m2: Matrix2::from_diagonal_element(0.002f64.powi(2)),
        inlier_ratio: 1.0,
        n_inliers: 100,
        side: EdgeSide::Both,
    };
    LineObservation {
        segment: Segment { start, end, sigma_across_px: 0.2 },
        ends: [start, end].map(|pixel| camera().ray_from_pixel(pixel)),
        sigma_across: 0.3 / 600.0,
        depth: is_lifted.then_some(depth),
    }
}

fn target(ends: [[f64; 3]; 2], part: [f64; 2]) -> LineObservation {
    seen(&Motion::identity(), ends, part, true)
}

fn source(ends: [[f64; 3]; 2], part: [f64; 2]) -> LineObservation {
    seen(&target_from_source().inverse(), ends, part, true)
}

fn unlifted(line: LineObservation) -> LineObservation {
    LineObservation { depth: None, ..line }
}

fn compared(target: LineObservation, source: LineObservation) -> SameEdge {
    compared_by(target, source, &target_from_source())
}

fn compared_by(target: LineObservation, source: LineObservation, target_from_source: &Motion) -> SameEdge {
    let camera = camera();
    let sight = |lines| Sight { camera: &camera, lines };
    let (targets, sources) = ([target], [source]);
    let there = SameEdges::new(&sight(&targets), &sight(&sources), target_from_source).of(0, 0);
    let back = SameEdges::new(&sight(&sources), &sight(&targets), &target_from_source.inverse()).of(0, 0);
    assert_eq!(there.is_true(), back.is_true(), "swapped roles: {there:?} and {back:?}");
    assert_eq!(there.is_shared(), back.is_shared(), "swapped roles: {there:?} and {back:?}");
    there
}

fn moved(point: [f64; 3], by: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|axis| point[axis] + by[axis])
}

#[test]
fn an_edge_that_both_see_is_shared_whichever_way_it_runs() {
    let (seen_by_target, seen_by_source) =
        (target([LEFT, RIGHT], [0.1, 0.8]), source([LEFT, RIGHT], [0.3, 1.0]));
    let SameEdge::Shared { overlap_px } = compared(seen_by_target, seen_by_source) else {
        panic!("not shared")
    };
    let part = target([LEFT, RIGHT], [0.3, 0.8]).segment.length_px();
    assert!((overlap_px - part).abs() < 6.0, "{overlap_px} instead of {part} px");
    assert!(compared(seen_by_target, source([RIGHT, LEFT], [0.0, 0.7])).is_shared());
}

#[test]
fn depth_in_one_camera_is_enough_and_depth_in_none_tells_nothing() {
    let (seen_by_target, seen_by_source) =
        (target([LEFT, RIGHT], [0.1, 0.8]), source([LEFT, RIGHT], [0.3, 1.0]));
    assert!(compared(unlifted(seen_by_target), seen_by_source).is_shared());
    assert!(compared(seen_by_target, unlifted(seen_by_source)).is_shared());
    assert_eq!(compared(unlifted(seen_by_target), unlifted(seen_by_source)), SameEdge::Unknown);
}

#[test]
fn an_edge_beside_is_another_one_with_and_without_depth() {
    for by in [[0.0, 0.05, 0.0], [0.0, -0.05, 0.02]] {
        let beside = [moved(LEFT, by), moved(RIGHT, by)];
        assert_eq!(compared(target([LEFT, RIGHT], [0.1, 0.8]), source(beside, [0.1, 0.8])), SameEdge::No);
        assert_eq!(
            compared(unlifted(target([LEFT, RIGHT], [0.1, 0.8])), source(beside, [0.1, 0.8])),
            SameEdge::No
        );
    }
}

#[test]
fn an_edge_behind_at_the_same_pixels_is_another_one() {
    let behind = [LEFT, RIGHT].map(|point| point.map(|value| 1.2 * value));
    let hidden = compared_by(
        target([LEFT, RIGHT], [0.1, 0.8]),
        seen(&Motion::identity(), behind, [0.1, 0.8], true),
        &Motion::identity(),
    );
    assert_eq!(hidden, SameEdge::No);
}

#[test]
fn parts_without_anything_in_common_continue_each_other() {
    let parts = compared(target([LEFT, RIGHT], [0.0, 0.4]), source([LEFT, RIGHT], [0.6, 1.0]));
    assert_eq!(parts, SameEdge::Continued);
    let bent = moved(RIGHT, [0.0, 0.15, 0.0]);
    let other = compared(target([LEFT, RIGHT], [0.0, 0.4]), source([LEFT, bent], [0.6, 1.0]));
    assert_eq!(other, SameEdge::No);
}

#[test]
fn with_a_wrong_pose_nothing_is_shared() {
    let wrong = Motion::new(Vector3::new(0.3, 0.02, -0.05), Vector3::new(0.1, 0.3, -0.1));
    let (target, source) = (target([LEFT, RIGHT], [0.1, 0.8]), source([LEFT, RIGHT], [0.3, 1.0]));
    assert_eq!(compared_by(target, source, &wrong), SameEdge::No);
}

#[test]
fn both_fragments_of_an_edge_are_shared_with_the_whole() {
    let camera = camera();
    let targets = [target([LEFT, RIGHT], [0.05, 0.45]), target([LEFT, RIGHT], [0.5, 0.95])];
    let sources = [source([LEFT, RIGHT], [0.0, 1.0])];
    let sight = |lines| Sight { camera: &camera, lines };
    let same = SameEdges::new(&sight(&targets), &sight(&sources), &target_from_source());
    assert!(same.of(0, 0).is_shared() && same.of(1, 0).is_shared());
    assert_eq!(same.pairs().count(), 2);
    assert_eq!((same.of(2, 0), same.of(0, 1)), (SameEdge::No, SameEdge::No), "no such lines");
}

#[test]
fn views_without_lines_have_nothing_in_common() {
    let camera = camera();
    let lines = [target([LEFT, RIGHT], [0.1, 0.8])];
    for (targets, sources) in [(&lines[..], &[][..]), (&[], &lines), (&[], &[])] {
        let sight = |lines| Sight { camera: &camera, lines };
        let same = SameEdges::new(&sight(targets), &sight(sources), &target_from_source());
        assert_eq!(same.pairs().count(), 0);
    }
}
