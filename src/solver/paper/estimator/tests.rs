use nalgebra::{Point3, Vector3};

use super::*;
use crate::solver::paper::convergence_vote::Tolerance;
use crate::solver::paper::tests::scenes::{
    Parts, any_motion, check_near, in_view, pair, parts, penetrating, variants, with_wrong,
};
use crate::solver::tests::room::Random;
use crate::solver::{LinePair, TargetSide};

#[test]
fn exact_pairs_give_the_truth_for_any_rotation() {
    let mut random = Random::named("exact pairs");
    for trial in 0..30 {
        let mut truth = any_motion(&mut random);
        if trial % 5 == 0 {
            truth = Motion::new(truth.translation.vector, Vector3::new(0.0, std::f64::consts::PI, 0.0));
        }
        let pairs = penetrating(&mut random, &truth, (20, 0.0));
        for options in variants() {
            let solution = solve_pairs(&pairs, &options);
            check_near(&solution, &truth, (1e-6, 1e-6));
            assert_eq!((solution.outcome, solution.inliers.len()), (PaperOutcome::Converged, 20));
        }
    }
}

#[test]
fn a_third_of_wrong_pairs_is_left_out() {
    let mut random = Random::named("wrong pairs");
    let (mut converged, mut wrong) = (0, 0);
    for _ in 0..10 {
        let truth = any_motion(&mut random);
        let pairs = with_wrong(&penetrating(&mut random, &truth, (48, 1.0)), 16);
        for options in variants() {
            let solution = solve_pairs(&pairs, &options);
            if solution.target_from_source.is_some() {
                check_near(&solution, &truth, (0.009, 0.02));
                converged += 1;
                wrong += solution.inliers.iter().filter(|idx| **idx < 16).count();
            }
        }
    }
    assert!(converged >= 16 && wrong <= 10, "{converged} of 20, {wrong} wrong pairs among the inliers");
}

#[test]
fn swapped_roles_give_the_inverse() {
    let mut random = Random::named("swapped roles");
    for _ in 0..10 {
        let truth = any_motion(&mut random);
        let pairs = penetrating(&mut random, &truth, (32, 1.0));
        let full: Vec<LinePair> = pairs.into_iter().filter(|pair| pair.full_target().is_some()).collect();
        let swapped = full.iter().filter_map(|pair| match &pair.target {
            TargetSide::Full(target) => Some(LinePair {
                target: TargetSide::Full(pair.source.clone()),
                source: target.clone(),
                set: pair.set,
            }),
            TargetSide::Pnl(_) => None,
        });
        let swapped: Vec<LinePair> = swapped.collect();
        let options = PaperOptions::whitened();
        let there = solve_pairs(&full, &options);
        let back = solve_pairs(&swapped, &options).target_from_source.expect("enough pairs");
        check_near(&there, &back.inverse(), (2e-3, 5e-3));
    }
}

#[test]
fn another_place_of_either_camera_carries_through() {
    let mut random = Random::named("change of coordinates");
    for _ in 0..10 {
        let truth = any_motion(&mut random);
        let moved_from_source = Motion::new(Vector3::new(0.05, -0.1, 0.02), Vector3::new(0.1, -0.2, 0.3));
        let all: Vec<Parts> =
            (0..20).map(|_| parts(in_view(&mut random), truth.inverse() * in_view(&mut random))).collect();
        let mut solved = |target_from_here: &Motion, here_from_source: &Motion| {
            let pairs = all.iter().enumerate().filter_map(|(idx, (source, target))| {
                let here = |ends: &[Point3<f64>; 2]| ends.map(|end_m| here_from_source * end_m);
                pair(&mut random, (idx, (here(source), here(target))), target_from_here, 0.0)
            });
            solve_pairs(&pairs.collect::<Vec<_>>(), &PaperOptions::default())
        };
        let plain = solved(&truth, &Motion::identity()).target_from_source.expect("exact pairs");
        let moved = solved(&(truth * moved_from_source.inverse()), &moved_from_source);
        check_near(&moved, &(plain * moved_from_source.inverse()), (1e-5, 1e-5));
        // The target's frame turned about its viewing axis, so that it still sees every line.
        let turned_from_target = Motion::new(Vector3::zeros(), Vector3::z() * 2.0);
        let turned = solved(&(turned_from_target * truth), &Motion::identity());
        check_near(&turned, &(turned_from_target * plain), (1e-5, 1e-5));
    }
}

#[test]
fn the_order_of_the_pairs_does_not_matter() {
    let mut random = Random::named("order");
    let truth = any_motion(&mut random);
    let pairs = with_wrong(&penetrating(&mut random, &truth, (40, 1.0)), 8);
    let forth = solve_pairs(&pairs, &PaperOptions::default()).target_from_source.expect("enough pairs");
    let reversed: Vec<LinePair> = pairs.into_iter().rev().collect();
    check_near(&solve_pairs(&reversed, &PaperOptions::default()), &forth, (1e-3, 3e-3));
}

#[test]
fn every_outcome_says_its_numbers() {
    let mut random = Random::named("outcomes");
    let truth = any_motion(&mut random);
    let pairs = penetrating(&mut random, &truth, (30, 1.0));
    let options = PaperOptions::default();
    let few = solve_pairs(&pairs[..3], &options);
    assert_eq!(few.outcome, PaperOutcome::TooFewPairs { pairs: 3, needed: options.min_pairs });
    assert!(few.outcome.to_string().starts_with("3 usable line pairs"));
    let strict = PaperOptions { min_voters: 31, ..options };
    assert!(matches!(solve_pairs(&pairs, &strict).outcome, PaperOutcome::TooFewVoters { needed: 31, .. }));
    let cheap = PaperOptions { max_mean_cost: 1e-9, ..options };
    let outcome = solve_pairs(&pairs, &cheap).outcome;
    assert!(
        matches!(outcome, PaperOutcome::CostTooHigh { limit: 1e-9, .. } | PaperOutcome::TooFewVoters { .. }),
        "{outcome:?}"
    );
    let sure = PaperOptions { max_sigma_rotation_rad: 1e-9, ..options };
    assert!(matches!(solve_pairs(&pairs, &sure).outcome, PaperOutcome::NotObservable { .. }));
}

#[test]
fn the_papers_fixed_epsilon_works_too() {
    let mut random = Random::named("fixed epsilon");
    let truth = any_motion(&mut random);
    let pairs = penetrating(&mut random, &truth, (40, 1.0));
    let options =
        PaperOptions { tolerance: Tolerance::Fixed { epsilon_m: 0.015 }, ..PaperOptions::default() };
    check_near(&solve_pairs(&pairs, &options), &truth, (0.009, 0.02));
}
