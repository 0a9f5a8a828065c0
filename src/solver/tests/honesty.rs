//! The covariance says how wrong the pose is.

use nalgebra::{Vector3, Vector6};

use super::room::{Random, camera, frame_sets, rig, room};
use crate::geometry::CameraView;
use crate::geometry::motion::Motion;
use crate::solver::association::Scene;
use crate::solver::candidates::PairEvidence;
use crate::solver::consensus::{Hypothesis, RankLimits, Ranked, Ranking, rank_poses};
use crate::solver::evidence::Evidence;
use crate::solver::missing::MissingLines;
use crate::solver::verdict::{Bench, judge};
use crate::solver::{EstimateOptions, ReasonCode, RigEstimator, State, VerdictLimits};

/// Lines whose noise is larger than they say by a factor.
fn overconfident(sets: &mut [Vec<Option<CameraView>>], factor: f64) {
    for line in sets.iter_mut().flatten().flatten().flat_map(|view| &mut view.lines) {
        line.sigma_across /= factor;
        let depth = line.depth.as_mut().expect("all lines of the room are lifted");
        depth.covariance_per_m2 /= factor * factor;
    }
}

/// Squared error of the published pose in units of its covariance; 6 on average when that is honest.
fn error2_in_sigmas(name: &str, noise_factor: f64) -> f64 {
    let mut random = Random::named(name);
    let room = room(&mut random, 45);
    let truth = Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0));
    let mut sets = frame_sets(&mut random, &room, &[Motion::identity(), truth], 8);
    overconfident(&mut sets, noise_factor);
    let options =
        EstimateOptions { max_baseline_m: 0.6, verdict: whatever_fixes_a_pose(), ..Default::default() };
    let mut estimator = RigEstimator::new(rig(2), options);
    sets.iter().for_each(|set| {
        estimator.add(set, &[]);
    });
    let calibration = estimator.solve();
    let found = calibration.cameras[1].as_ref().unwrap_or_else(|| panic!("{name}: {:?}", calibration.reason));
    let translation = truth.translation.vector - found.reference_from_camera.translation.vector;
    let rotation = (truth.rotation * found.reference_from_camera.rotation.inverse()).scaled_axis();
    let error = Vector6::from_iterator(translation.iter().chain(rotation.iter()).copied());
    error.dot(&found.covariance.cholesky().expect("positive definite").solve(&error))
}

/// No trial is left out for being uncertain: that would choose the lucky ones.
fn whatever_fixes_a_pose() -> VerdictLimits {
    VerdictLimits {
        min_matches: 3,
        min_views: 1,
        min_matches_elsewhere: 0,
        max_sigma_translation_m: 0.1,
        max_sigma_rotation_rad: 0.1,
        min_lead: 1.0,
        min_lead_nearby: 1.0,
        min_lead_impossible: 0.0,
        ..VerdictLimits::default()
    }
}

fn mean_error2(n_trials: usize, noise_factor: f64) -> f64 {
    (0..n_trials).map(|trial| error2_in_sigmas(&format!("honest {trial}"), noise_factor)).sum::<f64>()
        / n_trials as f64
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    let mean = mean_error2(200, 1.0);
    // Chi-square with 1200 degrees of freedom, divided by 200: 95 % within 5.53 and 6.49.
    assert!((5.53..6.49).contains(&mean), "mean of {mean:.2}, expected 6");
}

#[test]
fn noise_worse_than_its_model_does_not_make_the_pose_look_surer_than_it_is() {
    let mean = mean_error2(40, 1.5);
    // Chi-square with 240 degrees of freedom, divided by 40: 97.5 % below 7.1.
    assert!(mean < 7.1, "mean of {mean:.2}, expected at most 6");
}

#[test]
fn a_pose_with_many_missing_lines_is_not_trusted() {
    let mut random = Random::named("missing");
    let room = room(&mut random, 60);
    let evidence = evidence_of(&frame_sets(&mut random, &room, &[Motion::identity(), side_by_side()], 10));
    let pair = PairEvidence { evidence: &evidence, target: 0, source: 1 };
    let mut ranking = ranked(pair);
    let limits = EstimateOptions::default().verdict;
    let verdict = |ranking: &Ranking| {
        let scene = Scene { pair, candidates: &ranking.candidates };
        judge(&Bench { scene, ranking, limits })
    };
    assert_eq!(verdict(&ranking).0, State::Converged);
    ranking.best.missing = MissingLines { expected: 40, missing: 13 };
    let reason = verdict(&ranking).1.expect("a reason");
    assert_eq!(reason.code, ReasonCode::MissingLines);
    assert!(reason.sentence.contains("13 of 40"), "{}", reason.sentence);
}

#[test]
fn a_coincidence_that_cannot_be_shows_what_coincidence_reaches() {
    let mut random = Random::named("impossible");
    let room = room(&mut random, 60);
    let evidence = evidence_of(&frame_sets(&mut random, &room, &[Motion::identity(), side_by_side()], 10));
    let pair = PairEvidence { evidence: &evidence, target: 0, source: 1 };
    let mut ranking = ranked(pair);
    ranking.impossible = Some(Hypothesis { score: 0.9 * ranking.best.score, ..ranking.best.clone() });
    let scene = Scene { pair, candidates: &ranking.candidates };
    let (state, reason) =
        judge(&Bench { scene, ranking: &ranking, limits: EstimateOptions::default().verdict });
    assert_eq!(state, State::Ambiguous);
    assert_eq!(reason.expect("a reason").code, ReasonCode::RunnerUpTooClose);
}

fn side_by_side() -> Motion {
    Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0))
}

fn evidence_of(sets: &[Vec<Option<CameraView>>]) -> Evidence {
    let mut evidence = Evidence::new(EstimateOptions::default().evidence);
    sets.iter().for_each(|set| {
        evidence.add(set);
    });
    evidence
}

fn ranked(pair: PairEvidence<'_>) -> Ranking {
    let options = EstimateOptions::default();
    let limits = RankLimits {
        known: None,
        cameras: &[camera(); 2],
        max_baseline_m: options.max_baseline_m,
        max_free_space_violated: options.verdict.max_free_space_violated,
        keep_going: &|| true,
    };
    let Ranked::Poses(ranking) = rank_poses(pair, &limits) else { panic!("no pose") };
    *ranking
}

#[test]
fn a_ranking_can_be_given_up() {
    let mut random = Random::named("given up");
    let room = room(&mut random, 40);
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), Motion::identity()], 4);
    let mut estimator = RigEstimator::new(rig(2), EstimateOptions::default());
    sets.iter().for_each(|set| {
        estimator.add(set, &[]);
    });
    assert!(estimator.solve_while(&|| false).is_none());
    assert!(estimator.solve_while(&|| true).is_some());
}

#[test]
fn the_best_pose_leads_far_before_any_other() {
    let mut random = Random::named("leads");
    let room = room(&mut random, 60);
    let evidence = evidence_of(&frame_sets(&mut random, &room, &[Motion::identity(), side_by_side()], 10));
    let ranking = ranked(PairEvidence { evidence: &evidence, target: 0, source: 1 });
    let runner_up = ranking.runner_up.map_or(0.0, |other| other.score);
    assert!(ranking.best.score > 3.0 * runner_up, "{} against {runner_up}", ranking.best.score);
}
