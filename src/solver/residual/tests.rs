use nalgebra::{Matrix2, Vector3, Vector6};

use super::*;
use crate::geometry::motion::updated;
use crate::geometry::{DepthFit, EdgeSide, PixelPoint, RayPoint, Segment};

/// A lifted line between two points of its camera's frame.
pub fn line_between(a_m: [f64; 3], b_m: [f64; 3]) -> EvidenceLine {
    let pixel = |p: [f64; 3]| PixelPoint { x: 600.0 * p[0] / p[2] + 320.0, y: 600.0 * p[1] / p[2] + 240.0 };
    let ray = |p: [f64; 3]| RayPoint { x: p[0] / p[2], y: p[1] / p[2] };
    let observation = LineObservation {
        segment: Segment { start: pixel(a_m), end: pixel(b_m), sigma_across_px: 0.3 },
        ends: [ray(a_m), ray(b_m)],
        sigma_across: 0.0005,
        depth: Some(DepthFit {
            inverse_depth_per_m: [1.0 / a_m[2], 1.0 / b_m[2]],
            covariance_per_m2: Matrix2::new(9e-6, -3e-6, -3e-6, 4e-6),
            inlier_ratio: 1.0,
            n_inliers: 50,
            side: EdgeSide::Both,
        }),
    };
    EvidenceLine::try_new(&observation).expect("a line in front of the camera")
}

fn pose() -> Motion {
    Motion::new(Vector3::new(0.3, -0.05, 0.1), Vector3::new(0.1, 0.9, -0.2))
}

/// Two views of one physical line, each seeing another part of it.
fn views_of_one_line() -> (EvidenceLine, EvidenceLine) {
    let (a, b) = (nalgebra::Point3::new(-0.4, 0.2, 1.4), nalgebra::Point3::new(0.5, 0.4, 1.9));
    let (c, d) = (pose() * (a + (b - a) * 0.3), pose() * (a + (b - a) * 1.4));
    (line_between(c.into(), d.into()), line_between(a.into(), b.into()))
}

#[test]
fn the_true_pose_leaves_no_residual_even_when_the_views_share_no_point() {
    let (target, source) = views_of_one_line();
    let found = match_residual(&target, &source, &pose()).expect("a line in general position");
    assert!(found.residual.amax() < 1e-12, "{}", found.residual);
}

#[test]
fn the_derivative_by_the_pose_agrees_with_central_differences() {
    let (target, source) = views_of_one_line();
    let near = updated(&pose(), &Vector6::new(0.02, -0.01, 0.03, 0.01, -0.02, 0.015));
    let found = match_residual(&target, &source, &near).expect("a line in general position");
    for axis in 0..6 {
        let mut step = Vector6::zeros();
        step[axis] = 1e-6;
        let at = |step: Vector6<f64>| {
            match_residual(&target, &source, &updated(&near, &step)).expect("as above").residual
        };
        let difference = (at(step) - at(-step)) / 2e-6;
        let column = found.d_residual_d_pose.column(axis).into_owned();
        assert!(
            (difference - column).amax() < 1e-6 * (1.0 + column.amax()),
            "axis {axis}: {difference} {column}"
        );
    }
}

#[test]
fn the_covariance_is_that_of_many_noisy_measurements() {
    let (target, source) = views_of_one_line();
    let found = match_residual(&target, &source, &pose()).expect("a line in general position");
    let mut expected = target.covariance;
    for axis in 0..4 {
        let mut moved = source.clone();
        let shift = source.covariance.cholesky().expect("positive definite").l().column(axis) * 1e-3;
        let [da, db] = source.d_ends_d_measurement().map(|derivative| derivative * shift);
        moved.ends_m[0] += da;
        moved.ends_m[1] += db;
        let change = match_residual(&target, &moved, &pose()).expect("as above").residual / 1e-3;
        expected += change * change.transpose();
    }
    let relative = (found.covariance - expected).amax() / expected.amax();
    assert!(relative < 0.01, "{} {expected}", found.covariance);
}

#[test]
fn a_line_through_the_targets_centre_predicts_nothing() {
    let source = line_between([0.0, 0.0, 1.0], [0.0, 0.0, 2.0]);
    let (target, _) = views_of_one_line();
    assert!(match_residual(&target, &source, &Motion::identity()).is_none());
}

#[test]
fn without_depth_the_offsets_alone_are_compared() {
    let (target, source) = views_of_one_line();
    let near = updated(&pose(), &Vector6::new(0.02, -0.01, 0.03, 0.01, -0.02, 0.015));
    let with_depth = match_residual(&target, &source, &near).expect("a line in general position");
    let unlifted = LineObservation { depth: None, ..target.observation };
    let found = offset_residual(&unlifted, &source, &near).expect("as above");
    assert_eq!(found.residual, with_depth.residual.fixed_rows::<2>(0));
    assert_eq!(found.d_residual_d_pose, with_depth.d_residual_d_pose.fixed_rows::<2>(0));
    assert!((found.covariance - with_depth.covariance.fixed_view::<2, 2>(0, 0)).amax() < 1e-15);
}

#[test]
fn the_reversed_roles_derivative_is_by_the_same_step() {
    let (target, source) = views_of_one_line();
    let unlifted = LineObservation { depth: None, ..source.observation };
    let near = updated(&pose(), &Vector6::new(0.02, -0.01, 0.03, 0.01, -0.02, 0.015));
    let at = |step: Vector6<f64>| {
        reversed_offset_residual(&target, &unlifted, &updated(&near, &step))
            .expect("a line in general position")
    };
    let found = at(Vector6::zeros());
    for axis in 0..6 {
        let mut step = Vector6::zeros();
        step[axis] = 1e-6;
        let difference = (at(step).residual - at(-step).residual) / 2e-6;
        let column = found.d_residual_d_pose.column(axis).into_owned();
        assert!(
            (difference - column).amax() < 1e-6 * (1.0 + column.amax()),
            "axis {axis}: {difference} {column}"
        );
    }
    let at_truth = reversed_offset_residual(&target, &unlifted, &pose()).expect("as above");
    assert!(at_truth.residual.amax() < 1e-12, "{}", at_truth.residual);
}

#[test]
fn an_image_that_runs_backwards_is_told() {
    let (target, source) = views_of_one_line();
    let [start, end] = target.observation.ends;
    let turned = LineObservation { ends: [end, start], ..target.observation };
    assert!(offset_residual(&target.observation, &source, &pose()).expect("a line").is_same_way);
    assert!(!offset_residual(&turned, &source, &pose()).expect("a line").is_same_way);
}
