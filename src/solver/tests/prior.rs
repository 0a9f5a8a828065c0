//! Scores of appearance: they find a pose sooner, they never make a wrong one, and where they are nonsense they cost nothing.

use nalgebra::Vector3;

use super::room::{Random, Room, frame_sets, measured, rig, room, visible, world_from_rig};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::geometry::{CameraView, PairScores, ScoredMatch};
use crate::solver::candidates::PairEvidence;
use crate::solver::evidence::Evidence;
use crate::solver::prior::prior;
use crate::solver::{EstimateOptions, EvidenceLimits, RigCalibration, RigEstimator, State};

/// Frame sets of two cameras, and for each line of each view the edge it shows.
struct Scene {
    sets: Vec<Vec<Option<CameraView>>>,
    edges: Vec<[Vec<usize>; 2]>,
}

fn scene(random: &mut Random, room: &Room, target_from_source: &Motion, n_sets: usize) -> Scene {
    let mut scene = Scene { sets: Vec::new(), edges: Vec::new() };
    for _ in 0..n_sets {
        let world_from_target = world_from_rig(random);
        let poses = [world_from_target, world_from_target * target_from_source];
        let mut edges = [Vec::new(), Vec::new()];
        let mut views = Vec::new();
        for (world_from_camera, edges) in poses.iter().zip(&mut edges) {
            let mut lines = Vec::new();
            for (idx, edge) in room.iter().enumerate() {
                let seen = visible(&edge.map(|end| world_from_camera.inverse() * end));
                if let Some([a, b]) = seen {
                    lines.push(measured(random, a, b));
                    edges.push(idx);
                }
            }
            views.push(Some(CameraView { lines, surface: Vec::new() }));
        }
        scene.sets.push(views);
        scene.edges.push(edges);
    }
    scene
}

/// Scores with `right` of the true matches around 6 nats, and as many false ones.
fn scores(random: &mut Random, edges: &[Vec<usize>; 2], right: f64) -> Vec<PairScores> {
    let mut matches = Vec::new();
    for (target, edge) in (0..).zip(&edges[0]) {
        let true_source = edges[1].iter().position(|other| other == edge);
        let is_right = 0.5 * (random.signed() + 1.0) < right;
        let any = (0.5 * (random.signed() + 1.0) * edges[1].len() as f64) as usize;
        let source = true_source.filter(|_| is_right).unwrap_or(any);
        if source < edges[1].len() {
            matches.push(ScoredMatch { target, source: source as u32, nats: 6.0 + 0.5 * random.gaussian() });
        }
    }
    vec![PairScores { target: 0, source: 1, matches }]
}

fn solved(scene: &Scene, mut score: impl FnMut(usize) -> Vec<PairScores>) -> RigCalibration {
    let mut estimator = RigEstimator::new(rig(2), EstimateOptions::default());
    for (idx, set) in scene.sets.iter().enumerate() {
        estimator.add(set, &score(idx));
    }
    estimator.solve()
}

fn gap(calibration: &RigCalibration, truth: &Motion) -> (f64, f64) {
    let found = calibration.pairs[0].target_from_source.expect("a pose");
    (rotation_gap_rad(&found, truth).to_degrees(), translation_gap_m(&found, truth))
}

fn side_by_side() -> Motion {
    Motion::new(Vector3::new(0.25, 0.0, 0.05), Vector3::new(0.05, 0.4, 0.0))
}

fn evidence(scene: &Scene, mut score: impl FnMut(usize) -> Vec<PairScores>) -> Evidence {
    let mut evidence = Evidence::new(EvidenceLimits { max_lines_per_view: 100, max_sets: 80 });
    for (idx, set) in scene.sets.iter().enumerate() {
        if evidence.add(set) {
            evidence.score_newest(&score(idx));
        }
    }
    evidence
}

#[test]
fn look_alikes_that_agree_propose_the_pose_and_are_believed() {
    let mut random = Random::named("agreeing look-alikes");
    let room = room(&mut random, 60);
    let scene = scene(&mut random, &room, &side_by_side(), 4);
    // Of the false ones some are of lines that only one camera sees.
    let evidence = evidence(&scene, |idx| scores(&mut random, &scene.edges[idx], 0.9));
    let prior = prior(&PairEvidence { evidence: &evidence, target: 0, source: 1 }, 1.5);
    assert!(prior.is_certain(), "{prior:?}");
    let gap = (
        rotation_gap_rad(&prior.poses[0], &side_by_side()),
        translation_gap_m(&prior.poses[0], &side_by_side()),
    );
    assert!(gap.0 < 0.02 && gap.1 < 0.03, "{gap:?}");
}

#[test]
fn look_alikes_that_agree_on_nothing_leave_every_bit_to_geometry() {
    let mut random = Random::named("look-alikes by chance");
    let room = room(&mut random, 60);
    let scene = scene(&mut random, &room, &side_by_side(), 8);
    let mut chance = Random::named("chance");
    let misled = solved(&scene, |idx| scores(&mut chance, &scene.edges[idx], 0.0));
    assert_eq!(misled, solved(&scene, |_| Vec::new()));
    assert_eq!(misled.state, State::Converged, "{:?}", misled.reason);
}

#[test]
fn with_scores_the_pose_is_found_as_exactly_as_without() {
    let mut random = Random::named("with scores");
    let room = room(&mut random, 60);
    let scene = scene(&mut random, &room, &side_by_side(), 8);
    let calibration = solved(&scene, |idx| scores(&mut random, &scene.edges[idx], 0.7));
    assert_eq!(calibration.state, State::Converged, "{:?}", calibration.reason);
    let gap = gap(&calibration, &side_by_side());
    assert!(gap.0 < 0.2 && gap.1 < 0.006, "{gap:?}");
}

#[test]
fn look_alikes_of_another_pose_in_every_set_make_no_wrong_result() {
    for trial in 0..3 {
        let mut random = Random::named(&format!("misled {trial}"));
        let room = room(&mut random, 60);
        let scene = scene(&mut random, &room, &side_by_side(), 6);
        // Whatever lies near under another pose looks perfectly alike.
        let wrong = Motion::new(Vector3::new(-0.3, 0.2, 0.1), random.rotation().scaled_axis());
        let calibration = solved(&scene, |idx| {
            let near = near_under(&scene.sets[idx], &wrong);
            vec![PairScores { target: 0, source: 1, matches: near }]
        });
        if calibration.state == State::Converged {
            let gap = gap(&calibration, &side_by_side());
            assert!(gap.0 < 0.5 && gap.1 < 0.015, "trial {trial}: {gap:?}");
        }
    }
}

/// Every pair of lines whose directions a pose aligns within 6 degrees and that it brings within 15 cm, as look-alikes.
fn near_under(views: &[Option<CameraView>], target_from_source: &Motion) -> Vec<ScoredMatch> {
    use crate::solver::evidence::EvidenceLine;
    let lines = |camera: usize| -> Vec<(u32, EvidenceLine)> {
        let lines = views[camera].iter().flat_map(|view| &view.lines);
        (0..).zip(lines).filter_map(|(idx, line)| Some((idx, EvidenceLine::try_new(line)?))).collect()
    };
    let mut near = Vec::new();
    for (target, a) in lines(0) {
        for (source, b) in lines(1) {
            let direction = target_from_source.rotation * b.direction.into_inner();
            let offset_m = a.middle_m() - target_from_source * b.middle_m();
            let across_m = (offset_m - direction * offset_m.dot(&direction)).norm();
            if direction.dot(&a.direction).abs() > 0.995 && across_m < 0.15 {
                near.push(ScoredMatch { target, source, nats: 4.0 });
            }
        }
    }
    near
}

#[test]
fn scores_follow_their_lines_when_a_view_is_cut_to_its_best() {
    let mut random = Random::named("cut views");
    let room = room(&mut random, 300);
    let scene = scene(&mut random, &room, &side_by_side(), 1);
    let mut evidence = Evidence::new(EvidenceLimits { max_lines_per_view: 10, max_sets: 80 });
    assert!(evidence.add(&scene.sets[0]), "a first set is new");
    let n = [0, 1].map(|camera| scene.sets[0][camera].as_ref().expect("a view").lines.len() as u32);
    let nats = |target: u32, source: u32| f64::from(target * n[1] + source) * 1e-4;
    let all = (0..n[0]).flat_map(|target| (0..n[1]).map(move |source| (target, source)));
    let mut matches: Vec<ScoredMatch> =
        all.map(|(target, source)| ScoredMatch { target, source, nats: nats(target, source) }).collect();
    matches.push(ScoredMatch { target: n[0] + 7, source: 0, nats: 1.0 });
    matches.push(ScoredMatch { target: 0, source: 0, nats: f64::NAN });
    evidence.score_newest(&[PairScores { target: 0, source: 1, matches }]);
    let candidates = PairEvidence { evidence: &evidence, target: 0, source: 1 }.candidates(10.0);
    assert!(n[0] > 10 && n[1] > 10, "{n:?} lines: none would be cut");
    assert_eq!(candidates.len(), 100, "ten by ten lines are kept");
    for candidate in &candidates {
        let lines = |camera: usize| &evidence.sets[0].views[camera].as_ref().expect("a view").lines;
        let target = lines(0)[usize::from(candidate.target)].in_view;
        let source = lines(1)[usize::from(candidate.source)].in_view;
        assert_eq!(candidate.nats, nats(target, source), "{target} {source}");
    }
}

#[test]
fn scores_of_cameras_that_are_not_there_are_left_out() {
    let mut random = Random::named("absent cameras");
    let room = room(&mut random, 40);
    let sets = frame_sets(&mut random, &room, &[Motion::identity(), side_by_side()], 1);
    let mut evidence = Evidence::new(EvidenceLimits { max_lines_per_view: 10, max_sets: 80 });
    assert!(evidence.add(&sets[0]), "a first set is new");
    let found = vec![ScoredMatch { target: 0, source: 0, nats: 1.0 }];
    evidence.score_newest(&[
        PairScores { target: 0, source: 7, matches: found.clone() },
        PairScores { target: 9, source: 1, matches: found },
    ]);
    assert!(evidence.sets[0].scores.is_empty());
}
