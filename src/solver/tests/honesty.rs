//! The covariance says how wrong the pose is.

use nalgebra::{Vector3, Vector6};

use super::room::{Random, camera, frame_sets, rig, room};
use crate::geometry::motion::Motion;
use crate::solver::candidates::PairEvidence;
use crate::solver::consensus::{RankLimits, Ranked, rank_poses};
use crate::solver::evidence::Evidence;
use crate::solver::{EstimateOptions, RigEstimator};

/// Squared error of the pose in units of its covariance; 6 on average when that is honest.
fn error2_in_sigmas(name: &str) -> f64 {
    let mut random = Random::named(name);
    let room = room(&mut random, 40);
    let truth = Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0));
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), truth], 16);
    let mut estimator = RigEstimator::new(rig(2), EstimateOptions::default());
    sets.iter().for_each(|set| {
        estimator.add(set);
    });
    let calibration = estimator.solve();
    let found = calibration.cameras[1].as_ref().unwrap_or_else(|| panic!("{name}: {:?}", calibration.reason));
    let translation = truth.translation.vector - found.reference_from_camera.translation.vector;
    let rotation = (truth.rotation * found.reference_from_camera.rotation.inverse()).scaled_axis();
    let error = Vector6::from_iterator(translation.iter().chain(rotation.iter()).copied());
    error.dot(&found.covariance.cholesky().expect("positive definite").solve(&error))
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    const TRIALS: usize = 30;
    let mean =
        (0..TRIALS).map(|trial| error2_in_sigmas(&format!("honest {trial}"))).sum::<f64>() / TRIALS as f64;
    // Chi-square with 180 degrees of freedom, divided by 30: 99 % within 4.5 and 7.7; the noise scale of at least 1
    // makes the covariance a little too large, never too small.
    assert!((3.0..7.7).contains(&mean), "mean of {mean:.2}, expected about 6");
}

#[test]
fn a_ranking_can_be_given_up() {
    let mut random = Random::named("given up");
    let room = room(&mut random, 40);
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), Motion::identity()], 4);
    let mut estimator = RigEstimator::new(rig(2), EstimateOptions::default());
    sets.iter().for_each(|set| {
        estimator.add(set);
    });
    assert!(estimator.solve_while(&|| false).is_none());
    assert!(estimator.solve_while(&|| true).is_some());
}

#[test]
fn the_best_pose_leads_far_before_any_other() {
    let mut random = Random::named("leads");
    let room = room(&mut random, 60);
    let truth = Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0));
    let options = EstimateOptions::default();
    let mut evidence = Evidence::new(options.evidence);
    for set in frame_sets(&mut random, &room, &[Motion::identity(), truth], 10) {
        evidence.add(&set);
    }
    let pair = PairEvidence { evidence: &evidence, target: 0, source: 1 };
    let cameras = [camera(); 2];
    let limits = RankLimits {
        cameras: &cameras,
        max_baseline_m: options.max_baseline_m,
        max_free_space_violated: options.verdict.max_free_space_violated,
        keep_going: &|| true,
    };
    let Ranked::Poses(ranking) = rank_poses(pair, &limits) else { panic!("no pose") };
    let runner_up = ranking.runner_up.map_or(0.0, |other| other.score);
    assert!(ranking.best.score > 3.0 * runner_up, "{} against {runner_up}", ranking.best.score);
}
