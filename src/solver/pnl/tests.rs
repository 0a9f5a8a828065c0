use nalgebra::Vector3;

use super::*;
use crate::solver::consensus::settle;
use crate::solver::evidence::Evidence;
use crate::solver::noise::covariance;
use crate::solver::tests::room::{Random, frame_sets, room};
use crate::solver::{EstimateOptions, State};

fn truth() -> Motion {
    Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0))
}

/// Frame sets in which the given camera lost the depth of every other line, or all of these lines.
fn evidence(camera: usize, is_kept: bool) -> Evidence {
    let mut random = Random::named("pnl");
    let room = room(&mut random, 80);
    let mut evidence = Evidence::new(EstimateOptions::default().evidence);
    for mut set in frame_sets(&mut random, &room, &[Motion::identity(), truth()], 8) {
        let lines = &mut set[camera].as_mut().expect("both cameras are there").lines;
        lines.iter_mut().step_by(2).for_each(|line| line.depth = None);
        lines.retain(|line| is_kept || line.depth.is_some());
        evidence.add(&set);
    }
    evidence
}

#[track_caller]
fn check_segments_help(camera: usize, unlifted: Unlifted) {
    let settled = |evidence: &Evidence| {
        let pair = PairEvidence { evidence, target: 0, source: 1 };
        let candidates = pair.candidates(0.05);
        settle(Scene { pair, candidates: &candidates }, &truth()).expect("a pose")
    };
    let (with, without) = (settled(&evidence(camera, true)), settled(&evidence(camera, false)));
    assert!(without.pnl.is_empty() && with.pnl.len() >= 10, "{} further matches", with.pnl.len());
    assert!(with.pnl.iter().all(|found| found.pair.unlifted == unlifted));
    let sigma2 = |found: &crate::solver::consensus::Hypothesis| {
        covariance(&found.refined, found.noise_scale).expect("fixed").determinant()
    };
    assert!(sigma2(&with) < 0.5 * sigma2(&without), "{} {}", sigma2(&with), sigma2(&without));
    let gap_m = (with.refined.target_from_source.translation.vector - truth().translation.vector).norm();
    assert!(gap_m < 0.006, "{gap_m}");
}

#[test]
fn segments_of_the_target_without_depth_make_the_pose_surer() {
    check_segments_help(0, Unlifted::Target);
}

#[test]
fn segments_of_the_source_without_depth_make_the_pose_surer() {
    check_segments_help(1, Unlifted::Source);
}

#[test]
fn a_line_of_the_lifted_matches_is_not_used_again() {
    let evidence = evidence(0, true);
    let pair = PairEvidence { evidence: &evidence, target: 0, source: 1 };
    let candidates = pair.candidates(0.05);
    let scene = Scene { pair, candidates: &candidates };
    let found = settle(scene, &truth()).expect("a pose");
    let sources = found.matches.iter().map(|found| {
        let candidate = &candidates[found.candidate];
        (candidate.set, candidate.source)
    });
    let used: BTreeSet<(u32, u16)> = sources.collect();
    assert!(found.pnl.iter().all(|found| !used.contains(&(found.pair.set, found.pair.lifted))));
    let segments: BTreeSet<(u32, u16)> =
        found.pnl.iter().map(|found| (found.pair.set, found.pair.segment)).collect();
    assert_eq!(segments.len(), found.pnl.len(), "a segment matches one line");
}

#[test]
fn lines_lifted_by_one_camera_only_fix_no_pose() {
    let mut random = Random::named("pnl only");
    let room = room(&mut random, 60);
    let mut estimator =
        crate::solver::RigEstimator::new(crate::solver::tests::room::rig(2), EstimateOptions::default());
    for mut set in frame_sets(&mut random, &room, &[Motion::identity(), truth()], 8) {
        set[1].as_mut().expect("there").lines.iter_mut().for_each(|line| line.depth = None);
        estimator.add(&set, &[]);
    }
    assert_ne!(estimator.solve().state, State::Converged);
}
