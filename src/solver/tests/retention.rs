//! A memory that is full keeps what is rare and precise, however much of the common follows.

use nalgebra::{UnitQuaternion, Vector3};

use super::room::{Random, Room, edges, frame_sets, frame_sets_along, rig, room, world_from_rig};
use crate::geometry::CameraView;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::candidates::PairEvidence;
use crate::solver::evidence::{Evidence, EvidenceLine};
use crate::solver::retention::keep_best_lines;
use crate::solver::{EstimateOptions, EvidenceLimits, RigEstimator, State};

type FrameSet = Vec<Option<CameraView>>;

fn pair() -> [Motion; 2] {
    [Motion::identity(), Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.9, 0.0))]
}

/// Upright edges only.
fn uprights(random: &mut Random, n_edges: usize) -> Room {
    edges(random, n_edges, |random, _| Vector3::new(0.05 * random.signed(), 1.0, 0.05 * random.signed()))
}

/// Frame sets of a rig that stays upright among upright edges: they leave its height open.
fn common_sets(random: &mut Random, n_sets: usize) -> Vec<FrameSet> {
    let scene = uprights(random, 20);
    let path: Vec<Motion> = (0..n_sets)
        .map(|_| {
            let turn = Vector3::new(0.0, std::f64::consts::PI * random.signed(), 0.0);
            Motion::from_parts(world_from_rig(random).translation, UnitQuaternion::from_scaled_axis(turn))
        })
        .collect();
    frame_sets_along(random, &scene, &pair(), &path)
}

fn small_memory(max_sets: usize) -> EstimateOptions {
    let evidence = EvidenceLimits { max_lines_per_view: 100, max_sets };
    EstimateOptions { evidence, ..EstimateOptions::default() }
}

#[test]
fn views_that_came_once_outlive_a_thousand_common_ones() {
    let mut random = Random::named("rare and common");
    let scene = room(&mut random, 60);
    let rare = frame_sets(&mut random, &scene, &pair(), 14);
    let common = common_sets(&mut random, 1000);
    let mut estimator = RigEstimator::new(rig(2), small_memory(20));
    let n_kept = rare.iter().chain(&common).filter(|set| estimator.add(set, &[])).count();
    assert!(n_kept < 300, "common views that add nothing are refused, {n_kept} were taken");
    let calibration = estimator.solve();
    assert_eq!(calibration.state, State::Converged, "{:?}", calibration.reason);
    assert!(calibration.frame_sets_used <= 20, "{} sets", calibration.frame_sets_used);
    let found = calibration.cameras[1].as_ref().expect("a pose").reference_from_camera;
    let gap = (rotation_gap_rad(&found, &pair()[1]).to_degrees(), translation_gap_m(&found, &pair()[1]));
    assert!(gap.0 < 0.2 && gap.1 < 0.006, "{gap:?}");
    let mut newest_only = RigEstimator::new(rig(2), small_memory(20));
    common[common.len() - 20..].iter().for_each(|set| {
        newest_only.add(set, &[]);
    });
    assert_ne!(newest_only.solve().state, State::Converged, "the common views alone fix no pose");
}

#[test]
fn a_full_memory_holds_more_matches_than_the_newest_sets() {
    let mut random = Random::named("better than the newest");
    let scene = room(&mut random, 40);
    let sets = frame_sets(&mut random, &scene, &pair(), 150);
    let sigma = |sets: &[FrameSet]| {
        let mut estimator = RigEstimator::new(rig(2), small_memory(15));
        sets.iter().for_each(|set| {
            estimator.add(set, &[]);
        });
        let calibration = estimator.solve();
        (calibration.pairs[0].matches, calibration.cameras[1].as_ref().expect("a pose").covariance.trace())
    };
    let ((matches, variance), (newest_matches, newest_variance)) = (sigma(&sets), sigma(&sets[135..]));
    assert!(matches > newest_matches, "{matches} against {newest_matches}");
    assert!(variance < newest_variance, "{variance} against {newest_variance}");
}

#[test]
fn no_number_of_frame_sets_makes_the_candidates_grow() {
    let mut random = Random::named("candidates");
    let scene = room(&mut random, 600);
    let limits = EvidenceLimits { max_lines_per_view: 100, max_sets: 1000 };
    let mut evidence = Evidence::new(limits);
    let mut most = 0;
    for set in frame_sets(&mut random, &scene, &pair(), 45) {
        evidence.add(&set);
        let pair = PairEvidence { evidence: &evidence, target: 0, source: 1 };
        let n_lines =
            |set: usize| pair.lines(set).map_or(0, |(targets, sources)| targets.len() * sources.len());
        most = most.max((0..evidence.sets.len()).map(n_lines).sum());
    }
    assert!((150_000..=200_000).contains(&most), "{most}");
    assert!(evidence.sets.len() < 45, "some were dropped");
}

#[test]
fn of_a_crowded_view_the_only_line_of_a_direction_stays() {
    let mut random = Random::named("crowded");
    let mut scene = uprights(&mut random, 120);
    scene.extend(edges(&mut random, 3, |_, _| Vector3::x()));
    let view = super::room::view(&mut random, &scene, &Motion::translation(0.0, 0.0, -1.5));
    let mut lines: Vec<EvidenceLine> = view.lines.iter().filter_map(EvidenceLine::try_new).collect();
    let is_level = |line: &EvidenceLine| line.direction.x.abs() > 0.8;
    let (n_before, n_level) = (lines.len(), lines.iter().filter(|line| is_level(line)).count());
    assert!(n_before > 24 && n_level > 0, "{n_before} lines, {n_level} of them level");
    let before = lines.clone();
    keep_best_lines(&mut lines, 12);
    assert_eq!(lines.len(), 12);
    assert_eq!(lines.iter().filter(|line| is_level(line)).count(), n_level);
    let mut in_order = before.iter();
    assert!(lines.iter().all(|line| in_order.any(|other| other == line)), "their order stays");
}
