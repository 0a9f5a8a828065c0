use nalgebra::Vector6;

use super::*;
use crate::geometry::motion::{rotation_gap_rad, translation_gap_m};
use crate::solver::paper::tests::scenes::{any_motion, penetrating, read, with_wrong};
use crate::solver::tests::room::Random;

#[track_caller]
fn check_derivative<const D: usize>(pose: &Motion, term: impl Fn(&Motion) -> ErrorTerm<D>) {
    let found = term(pose);
    for axis in 0..6 {
        let step = Vector6::ith(axis, 1e-6);
        let difference = (term(&updated(pose, &step)).error - term(&updated(pose, &-step)).error) / 2e-6;
        let column = found.d_error_d_pose.column(axis).into_owned();
        assert!(
            (difference - column).amax() < 1e-6 * (1.0 + column.amax()),
            "axis {axis}: {difference} {column}"
        );
    }
}

#[test]
fn both_derivatives_agree_with_central_differences() {
    let mut random = Random::named("derivatives");
    for _ in 0..20 {
        let truth = any_motion(&mut random);
        let near = updated(&truth, &Vector6::new(0.02, -0.01, 0.03, 0.01, -0.02, 0.015));
        for pair in read(&penetrating(&mut random, &truth, (8, 1.0))) {
            let ends_m = pair.geometry.source_ends_m;
            match pair.geometry.target {
                TargetGeometry::Full(line) => {
                    check_derivative(&near, |pose| point_to_line_error(&line, &ends_m, pose));
                }
                TargetGeometry::Pnl(segment) => check_derivative(&near, |pose| {
                    reprojection_error(&segment, &ends_m, pose).expect("a line in general position")
                }),
            }
        }
    }
}

#[test]
fn the_gradient_of_the_robust_cost_agrees_with_central_differences() {
    let mut random = Random::named("robust gradient");
    let truth = any_motion(&mut random);
    let pairs = penetrating(&mut random, &truth, (12, 1.0));
    let read = read(&pairs);
    let near = updated(&truth, &Vector6::new(0.002, -0.001, 0.003, 0.001, -0.002, 0.0015));
    let objective = Objective { pairs: &read, weighting: Weighting::AsPublished, loss_width: 2.0 };
    let gradient = objective.at(&near).gradient;
    for axis in 0..6 {
        let step = Vector6::ith(axis, 1e-6);
        let difference =
            (objective.at(&updated(&near, &step)).cost - objective.at(&updated(&near, &-step)).cost) / 2e-6;
        assert!((difference - gradient[axis]).abs() < 1e-4 * gradient.amax(), "axis {axis}");
    }
}

#[test]
fn the_errors_are_millimetres_across_the_target_line_and_pixels_across_its_image() {
    let line = TargetLine { point_m: Vector3::new(0.0, 0.0, 2.0), direction: Vector3::x() };
    let ends_m = [Vector3::new(-1.0, 0.004, 2.003), Vector3::new(1.0, 0.0, 2.0)];
    let full = point_to_line_error(&line, &ends_m, &Motion::identity());
    assert!((full.error - Vector6::new(0.0, 4.0, 3.0, 0.0, 0.0, 0.0)).amax() < 1e-9);
    let segment = TargetSegment {
        end_rays: [Vector3::new(0.1, 0.005, 1.0), Vector3::new(0.3, 0.0, 1.0)],
        plane_normal: Vector3::y(),
        focal_px: 600.0,
    };
    let level = [Vector3::new(-1.0, 0.0, 2.0), Vector3::new(1.0, 0.0, 2.0)];
    let pnl = reprojection_error(&segment, &level, &Motion::identity()).expect("a line with an image");
    assert!((pnl.error.abs() - Vector2::new(3.0, 0.0)).amax() < 1e-9);
}

#[test]
fn both_weightings_come_back_to_the_truth_from_some_degrees_off() {
    let mut random = Random::named("refinement");
    for weighting in [Weighting::AsPublished, Weighting::Whitened] {
        for _ in 0..10 {
            let truth = any_motion(&mut random);
            let pairs = penetrating(&mut random, &truth, (12, 0.0));
            let read = read(&pairs);
            let objective = Objective { pairs: &read, weighting, loss_width: 1e3 };
            let start = updated(&truth, &Vector6::new(0.03, -0.02, 0.03, 0.04, -0.03, 0.05));
            let found = refine(&objective, &start, 50);
            assert!(rotation_gap_rad(&found.target_from_source, &truth) < 1e-6, "{weighting:?} {found:?}");
            assert!(translation_gap_m(&found.target_from_source, &truth) < 1e-6, "{weighting:?} {found:?}");
        }
    }
}

#[test]
fn pairs_without_target_depth_pull_at_the_pose_too() {
    let mut random = Random::named("both kinds");
    let truth = any_motion(&mut random);
    let pairs = penetrating(&mut random, &truth, (16, 1.0));
    let all = read(&pairs);
    let full: Vec<_> = all.iter().copied().filter(|pair| pair.pair.full_target().is_some()).collect();
    let refined = |pairs: &[ReadPair<'_>]| {
        refine(&Objective { pairs, weighting: Weighting::AsPublished, loss_width: 5.0 }, &truth, 30)
    };
    let gap_m = translation_gap_m(&refined(&all).target_from_source, &refined(&full).target_from_source);
    assert!(full.len() == 12 && gap_m > 1e-5, "{gap_m}");
}

#[test]
fn wrong_pairs_lose_their_weight() {
    let mut random = Random::named("robust loss");
    let truth = any_motion(&mut random);
    let pairs = with_wrong(&penetrating(&mut random, &truth, (24, 0.0)), 6);
    let read = read(&pairs);
    let objective = Objective { pairs: &read, weighting: Weighting::AsPublished, loss_width: 2.0 };
    let start = updated(&truth, &Vector6::new(0.002, -0.002, 0.003, 0.002, -0.003, 0.002));
    let found = refine(&objective, &start, 50);
    assert!(translation_gap_m(&found.target_from_source, &truth) < 1e-3, "{found:?}");
}

#[test]
fn a_line_through_the_targets_centre_has_no_reprojection_error() {
    let segment = TargetSegment {
        end_rays: [Vector3::new(0.1, 0.0, 1.0), Vector3::new(0.3, 0.0, 1.0)],
        plane_normal: Vector3::y(),
        focal_px: 600.0,
    };
    let through_centre = [Vector3::new(0.1, 0.1, 1.0), Vector3::new(0.2, 0.2, 2.0)];
    assert_eq!(reprojection_error(&segment, &through_centre, &Motion::identity()), None);
}
