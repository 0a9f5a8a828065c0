//! Watching a frozen result: moves are found with the right camera and amount, and nothing else raises alarm.

use std::time::Instant;

use nalgebra::{Matrix6, Vector3};

use super::room::{Random, Room, camera, frame_sets, room};
use crate::geometry::CameraView;
use crate::geometry::motion::Motion;
use crate::solver::watch::{Moved, Watch, WatchLimits, Who};
use crate::solver::{CameraPose, EstimateOptions, PairEstimate, RigCalibration, State};

/// A converged result as good as the verdict asks, at its limit: 3 mm and 0.126 degrees would be the largest allowed.
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
        residual_px: 0.3,
        residual_m: 0.003,
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

#[test]
fn explore() {
    for (deg, mm) in [
        (0.0, 0.0),
        (0.2, 3.0),
        (0.3, 5.0),
        (0.5, 0.0),
        (0.0, 10.0),
        (0.7, 10.0),
        (3.0, 0.0),
        (0.0, 50.0),
        (3.0, 50.0),
        (20.0, 200.0),
    ] {
        for trial in 0..3 {
            for who in 0..3 {
                let mut random = Random::named(&format!("explore {deg} {mm} {who} {trial}"));
                let room = room(&mut random, 60);
                let poses = three();
                let mut watch = Watch::new(
                    vec![camera(); 3],
                    &frozen(&poses, &mut random),
                    EstimateOptions::default(),
                    WatchLimits::default(),
                );
                let before = frame_sets(&mut random, &room, &poses, 10);
                let t = Instant::now();
                for set in &before {
                    watch.add(set);
                }
                let ms = t.elapsed().as_secs_f64() * 1e3 / 10.0;
                let report0 = watch.add(&before[0]).clone();
                let mut moved = poses.clone();
                let axis = Vector3::new(random.signed(), random.signed(), random.signed()).normalize();
                moved[who] = moved[who] * Motion::new(axis * (mm * 1e-3), axis * f64::to_radians(deg));
                let after = frame_sets(&mut random, &room, &moved, 30);
                let mut raised = None;
                let t = Instant::now();
                for (n, set) in after.iter().enumerate() {
                    let report = watch.add(set);
                    if raised.is_none() && !report.moved.is_empty() {
                        raised = Some(n + 1);
                    }
                }
                let ms2 = t.elapsed().as_secs_f64() * 1e3 / 30.0;
                let report = watch.add(&after[0]).clone();
                let text: Vec<String> = report
                    .moved
                    .iter()
                    .map(|m| {
                        format!(
                            "{:?} {:.2}±{:.2} deg {:.1}±{:.1} mm",
                            m.who,
                            m.rotation_rad.to_degrees(),
                            m.sigma_rotation_rad.to_degrees(),
                            m.translation_m * 1e3,
                            m.sigma_translation_m * 1e3
                        )
                    })
                    .collect();
                println!(
                    "{deg} deg {mm} mm cam {who}: before {:?}/{} {ms:.0} ms; raised {raised:?} {text:?} since {} {ms2:.0} ms",
                    report0.moved.len(),
                    report0.sets_since_confirmed,
                    report.sets_since_confirmed
                );
            }
        }
    }
}
