//! Watching a frozen result: moves are found with the right camera and amount, and nothing else raises alarm.

use nalgebra::{Matrix6, Vector3};

use super::room::{Random, Room, camera, edges, frame_sets, frame_sets_along, room, world_from_rig};
use crate::geometry::CameraView;
use crate::geometry::motion::Motion;
use crate::solver::{
    CameraPose, EstimateOptions, PairEstimate, RigCalibration, State, Watch, WatchLimits, WatchReport, Who,
};

/// A converged result, off by the uncertainty that it states: 1 mm and 0.03 degrees per axis.
fn frozen(poses: &[Motion], random: &mut Random) -> RigCalibration {
    let (sigma_m, sigma_rad) = (0.001, 0.0005);
    let covariance = |camera: usize| {
        let mut covariance = Matrix6::zeros();
        for axis in 0..6 {
            let sigma: f64 = if axis < 3 { sigma_m } else { sigma_rad };
            covariance[(axis, axis)] = if camera == 0 { 0.0 } else { sigma * sigma };
        }
        covariance
    };
    let mut noisy = |camera: usize, pose: &Motion| {
        if camera == 0 {
            return *pose;
        }
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| sigma * random.gaussian());
        let (t, r) = (vector(sigma_m), vector(sigma_rad));
        Motion::new(t, Vector3::zeros()) * pose * Motion::new(Vector3::zeros(), r)
    };
    let cameras: Vec<_> = poses
        .iter()
        .enumerate()
        .map(|(camera, pose)| {
            Some(CameraPose { reference_from_camera: noisy(camera, pose), covariance: covariance(camera) })
        })
        .collect();
    let pair = |target: usize, source: usize| PairEstimate {
        target,
        source,
        state: State::Converged,
        reason: None,
        target_from_source: None,
        matches: 80,
        full: 80,
        pnl: 0,
        lead: None,
        residual_px: 0.3,
        residual_m: 0.003,
        line_residuals: Vec::new(),
    };
    let pairs = (0..poses.len()).flat_map(|a| (a + 1..poses.len()).map(move |b| (a, b)));
    RigCalibration {
        state: State::Converged,
        reason: None,
        reference: 0,
        pairs: pairs.map(|(a, b)| pair(a, b)).collect(),
        cameras,
        frame_sets_used: 16,
    }
}

fn three() -> Vec<Motion> {
    let left = Motion::new(Vector3::new(-0.2, 0.0, 0.0), Vector3::new(0.0, -0.9, 0.1));
    let right = Motion::new(Vector3::new(0.2, 0.0, 0.1), Vector3::new(0.1, 0.8, 0.0));
    vec![Motion::identity(), left, right]
}

fn pair() -> Vec<Motion> {
    vec![Motion::identity(), Motion::new(Vector3::new(0.3, 0.0, 0.05), Vector3::new(0.05, 0.7, 0.0))]
}

/// A rig under watch in a room.
struct Trial {
    random: Random,
    room: Room,
    poses: Vec<Motion>,
    watch: Watch,
}

impl Trial {
    fn new(name: &str, poses: Vec<Motion>) -> Self {
        let mut random = Random::named(name);
        let room = room(&mut random, 60);
        let frozen = frozen(&poses, &mut random);
        let cameras = vec![camera(); poses.len()];
        let watch = Watch::new(cameras, &frozen, EstimateOptions::default(), WatchLimits::default());
        Self { random, room, poses, watch }
    }

    /// Moves a camera along and about an axis of its own.
    fn knock(&mut self, camera: usize, deg: f64, mm: f64) {
        let axis = Vector3::from_fn(|_, _| self.random.signed()).normalize();
        self.poses[camera] *= Motion::new(axis * (mm * 1e-3), axis * f64::to_radians(deg));
    }

    fn sets(&mut self, n: usize) -> Vec<Vec<Option<CameraView>>> {
        frame_sets(&mut self.random, &self.room, &self.poses, n)
    }

    /// Frame sets of a rig that stands still: other noise each time.
    fn parked_sets(&mut self, world_from_rig: &Motion, n: usize) -> Vec<Vec<Option<CameraView>>> {
        frame_sets_along(&mut self.random, &self.room, &self.poses, &vec![*world_from_rig; n])
    }

    /// Watches sets; after how many of them cameras were said to be moved, if at all.
    fn alarm_after(&mut self, sets: &[Vec<Option<CameraView>>]) -> Option<usize> {
        let alarms: Vec<bool> = sets.iter().map(|set| !self.watch.add(set).moved.is_empty()).collect();
        alarms.iter().position(|alarm| *alarm).map(|index| index + 1)
    }

    fn report(&mut self) -> WatchReport {
        // A set without views changes nothing but the count.
        self.watch.add(&[]).clone()
    }
}

/// Knocks a camera of a rig and expects it to be named with the amounts, in so many frame sets.
#[track_caller]
fn check_moved(name: &str, (poses, camera): (Vec<Motion>, usize), (deg, mm): (f64, f64), who: Who) {
    let mut trial = Trial::new(name, poses);
    let before = trial.sets(8);
    assert_eq!(trial.alarm_after(&before), None, "{name}: alarm before anything was moved");
    trial.knock(camera, deg, mm);
    let after = trial.sets(25);
    let raised = trial.alarm_after(&after);
    let report = trial.report();
    assert!(raised.is_some_and(|raised| raised >= 3), "{name}: {raised:?}");
    let [moved] = report.moved.as_slice() else { panic!("{name}: {report:?}") };
    assert_eq!(moved.who, who, "{name}: {report:?}");
    let off_deg = (moved.rotation_rad - deg.to_radians()).abs().to_degrees();
    let off_mm = 1e3 * (moved.translation_m - mm * 1e-3).abs();
    assert!(off_deg < 0.15 && off_mm < 5.0, "{name}: off by {off_deg} deg, {off_mm} mm: {report:?}");
    assert!(off_deg < 0.03 + 4.0 * moved.sigma_rotation_rad.to_degrees(), "{name}: {report:?}");
    assert!(off_mm < 1.0 + 4e3 * moved.sigma_translation_m, "{name}: {report:?}");
}

#[test]
fn a_camera_turned_by_half_a_degree_is_named() {
    check_moved("half a degree", (three(), 1), (0.5, 0.0), Who::Camera(1));
}

#[test]
fn a_camera_shifted_by_twelve_millimetres_is_named() {
    check_moved("twelve millimetres", (three(), 2), (0.0, 12.0), Who::Camera(2));
}

#[test]
fn a_camera_turned_by_three_degrees_is_named() {
    check_moved("three degrees", (three(), 2), (3.0, 0.0), Who::Camera(2));
}

#[test]
fn a_camera_shifted_by_five_centimetres_is_named() {
    check_moved("five centimetres", (three(), 1), (0.0, 50.0), Who::Camera(1));
}

#[test]
fn the_reference_itself_may_be_the_one() {
    check_moved("the reference", (three(), 0), (1.0, 10.0), Who::Camera(0));
}

#[test]
fn a_camera_that_looks_elsewhere_is_named() {
    check_moved("elsewhere", (three(), 1), (40.0, 150.0), Who::Camera(1));
}

#[test]
fn of_two_cameras_nothing_tells_which_was_moved() {
    check_moved("two", (pair(), 1), (2.0, 20.0), Who::OneOf(0, 1));
}

#[test]
fn where_views_are_few_no_coincidence_of_parallel_edges_is_told_as_the_move() {
    for number in 0..8 {
        let beside = Motion::new(Vector3::new(0.25, 0.0, 0.0), Vector3::new(0.0, 0.26, 0.0));
        let mut trial = Trial::new(&format!("few views {number}"), vec![Motion::identity(), beside]);
        trial.room = edges(&mut trial.random, 150, |_, k| Vector3::ith(k % 3, 1.0));
        trial.knock(1, 3.0, 20.0);
        let places: Vec<Motion> = (0..3).map(|_| world_from_rig(&mut trial.random)).collect();
        let path: Vec<Motion> = places.iter().cycle().take(9).copied().collect();
        let sets = frame_sets_along(&mut trial.random, &trial.room, &trial.poses, &path);
        assert!(trial.alarm_after(&sets).is_some(), "trial {number} tells nothing");
        let [moved] = trial.report().moved[..] else { panic!("trial {number}") };
        let off_deg = (moved.rotation_rad.to_degrees() - 3.0).abs();
        let off_mm = (1e3 * moved.translation_m - 20.0).abs();
        assert!(off_deg < 0.3 && off_mm < 8.0, "trial {number}: {moved:?}");
    }
}

#[test]
fn a_rig_that_nobody_touches_raises_no_alarm() {
    for trial in 0..10 {
        let mut trial = Trial::new(&format!("untouched {trial}"), pair());
        let sets = trial.sets(20);
        assert_eq!(trial.alarm_after(&sets), None);
        assert!(trial.report().sets_since_confirmed < 10, "{:?}", trial.report());
    }
}

#[test]
fn cameras_without_a_common_view_cannot_tell() {
    let mut trial = Trial::new("no common view", pair());
    let mut sets = trial.sets(12);
    trial.room = room(&mut trial.random, 60);
    let elsewhere = trial.sets(12);
    for (set, other) in sets.iter_mut().zip(elsewhere) {
        set[1].clone_from(&other[1]);
    }
    assert_eq!(trial.alarm_after(&sets), None);
    assert!(trial.report().sets_since_confirmed >= 12, "{:?}", trial.report());
}

#[test]
fn a_covered_or_missing_camera_is_no_moved_one() {
    let mut trial = Trial::new("covered", three());
    let mut sets = trial.sets(24);
    for (number, set) in sets.iter_mut().enumerate().skip(6) {
        set[1] = (number < 15).then(CameraView::default);
    }
    assert_eq!(trial.alarm_after(&sets), None);
    assert!(trial.report().sets_since_confirmed < 5, "the others are still confirmed");
}

#[test]
fn an_alarm_ends_when_the_camera_is_back() {
    let mut trial = Trial::new("back", pair());
    let (at_home, before) = (trial.poses.clone(), trial.sets(6));
    assert_eq!(trial.alarm_after(&before), None);
    trial.knock(1, 1.0, 15.0);
    let away = trial.sets(20);
    assert!(trial.alarm_after(&away).is_some());
    trial.poses = at_home;
    let back = trial.sets(20);
    // Not at once: one frame set proves nothing in either direction.
    assert_eq!(trial.alarm_after(&back[..1]), Some(1));
    trial.alarm_after(&back[1..]);
    assert_eq!(trial.report().moved, []);
}

#[test]
fn a_knock_is_seen_while_the_rig_stands_still() {
    let mut trial = Trial::new("parked", pair());
    // A single view has to show enough on its own: seven common edges.
    trial.room = room(&mut trial.random, 120);
    let place = Motion::translation(0.1, 0.2, -0.3);
    let before = trial.parked_sets(&place, 10);
    assert_eq!(trial.alarm_after(&before), None);
    trial.knock(1, 2.0, 20.0);
    let after = trial.parked_sets(&place, 40);
    let raised = trial.alarm_after(&after);
    assert!(raised.is_some(), "{:?}", trial.report());
}

#[test]
fn another_scene_before_a_rig_that_stands_still_is_no_knock() {
    for number in 0..20 {
        let mut trial = Trial::new(&format!("other scene {number}"), pair());
        let place = Motion::translation(0.1, 0.2, -0.3);
        // First both cameras see another room, then each its own.
        for _ in 0..2 {
            trial.room = room(&mut trial.random, 120);
            let sets = trial.parked_sets(&place, 4);
            assert_eq!(trial.alarm_after(&sets), None, "{number}");
        }
        let mut sets = trial.parked_sets(&place, 4);
        trial.room = room(&mut trial.random, 120);
        let elsewhere = trial.parked_sets(&place, 4);
        for (set, other) in sets.iter_mut().zip(elsewhere) {
            set[1].clone_from(&other[1]);
        }
        assert_eq!(trial.alarm_after(&sets), None, "{number}");
    }
}

#[test]
fn a_result_without_converged_pairs_is_never_confirmed() {
    let mut trial = Trial::new("nothing to watch", pair());
    let mut frozen = frozen(&trial.poses, &mut trial.random);
    frozen.pairs.clear();
    trial.watch = Watch::new(vec![camera(); 2], &frozen, EstimateOptions::default(), WatchLimits::default());
    let sets = trial.sets(2);
    assert_eq!(trial.alarm_after(&sets), None);
    assert_eq!(trial.report().sets_since_confirmed, 3);
}

/// Whether the frozen result was said to be verified after any of these sets.
fn is_ever_verified(trial: &mut Trial, sets: &[Vec<Option<CameraView>>]) -> bool {
    sets.iter().any(|set| trial.watch.add(set).is_verified)
}

#[test]
fn live_lines_vouch_for_a_rig_that_stands_as_it_stood() {
    for number in 0..8 {
        let rig = if number % 2 == 0 { pair() } else { three() };
        let mut trial = Trial::new(&format!("as it stood {number}"), rig);
        let sets = trial.sets(20);
        assert!(!is_ever_verified(&mut trial, &sets[..2]), "{number}: two looks prove nothing");
        assert!(is_ever_verified(&mut trial, &sets[2..]), "{number}: {:?}", trial.report());
    }
}

#[test]
fn nothing_vouches_for_a_rig_that_was_moved_before_the_watch_began() {
    for (deg, mm) in [(1.0, 0.0), (0.0, 15.0), (0.0, 25.0), (3.0, 20.0), (40.0, 150.0)] {
        for poses in [pair(), three()] {
            let mut trial = Trial::new(&format!("moved before {deg} {mm}"), poses);
            trial.knock(1, deg, mm);
            let sets = trial.sets(12);
            assert!(!is_ever_verified(&mut trial, &sets), "{deg} deg {mm} mm: {:?}", trial.report());
        }
    }
}

#[test]
fn a_camera_that_nothing_vouches_for_keeps_the_result_from_being_verified() {
    let mut trial = Trial::new("unseen", three());
    let mut sets = trial.sets(15);
    sets.iter_mut().for_each(|set| set[2] = None);
    assert!(!is_ever_verified(&mut trial, &sets));
    assert!(trial.report().sets_since_confirmed < 5, "the other two are confirmed");
}
