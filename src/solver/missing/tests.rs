use nalgebra::{Point3, Vector3};

use super::*;
use crate::geometry::{CameraView, PixelPoint, SurfaceSample};
use crate::solver::EvidenceLimits;
use crate::solver::evidence::Evidence;
use crate::solver::tests::room::{Random, Room, camera, view};

/// Distance of the wall from the source camera, m.
const WALL_M: f64 = 2.0;

fn truth() -> Motion {
    Motion::new(Vector3::new(-0.3, 0.05, 0.0), Vector3::new(0.0, 0.1, 0.0))
}

/// Markings on a wall in front of the source camera, in its frame.
fn markings(random: &mut Random, n: usize) -> Room {
    let mut at = |half_width_m: f64| half_width_m * random.signed();
    (0..n)
        .map(|_| {
            let middle = Point3::new(at(0.7), at(0.5), WALL_M);
            let half = Vector3::new(at(0.3), at(0.3), 0.0).normalize() * 0.25;
            [middle - half, middle + half]
        })
        .collect()
}

/// What a camera measures of a wall with markings; `nearer_m` brings the surface (not the markings) nearer.
fn wall_view(random: &mut Random, room: &Room, source_from_camera: &Motion, nearer_m: f64) -> CameraView {
    let normal = source_from_camera.inverse() * Vector3::z();
    let distance_m = WALL_M - nearer_m - source_from_camera.translation.vector.z;
    let pixels = (0..30).flat_map(|row| {
        (0..40).map(move |column| (8.0 + 16.0 * f64::from(column), 8.0 + 16.0 * f64::from(row)))
    });
    let surface = pixels.map(|(x, y)| {
        let ray = camera().ray_from_pixel(PixelPoint { x, y });
        let inverse_depth_per_m = (normal.x * ray.x + normal.y * ray.y + normal.z) / distance_m;
        SurfaceSample { pixel: PixelPoint { x, y }, inverse_depth_per_m }
    });
    CameraView { surface: surface.collect(), ..view(random, room, source_from_camera) }
}

/// One frame set of a target and a source camera before a wall; the target's surface may be nearer than its markings.
fn before_a_wall(name: &str, n_seen_by_target: usize, nearer_m: f64) -> Evidence {
    let mut random = Random::named(name);
    let room = markings(&mut random, 40);
    let source = wall_view(&mut random, &room, &Motion::identity(), 0.0);
    let seen = room[..n_seen_by_target].to_vec();
    let target = wall_view(&mut random, &seen, &truth().inverse(), nearer_m);
    let mut evidence = Evidence::new(EvidenceLimits { max_lines_per_view: 100, max_sets: 8 });
    assert!(evidence.add(&[Some(target), Some(source)]), "two views with lines");
    evidence
}

fn count(evidence: &Evidence, target_from_source: &Motion) -> MissingLines {
    missing_lines(&PairEvidence { evidence, target: 0, source: 1 }, &[camera(); 2], target_from_source)
}

#[test]
fn with_the_true_pose_no_line_in_plain_sight_is_missing() {
    let found = count(&before_a_wall("true pose", 40, 0.0), &truth());
    assert!(found.expected >= 30 && found.missing == 0, "{found:?}");
    assert!(found.penalty() < 1e-9 && !found.is_too_much(0.3));
}

#[test]
fn with_a_pose_along_the_wall_most_lines_are_missing() {
    let mut impostor = truth();
    impostor.translation.vector.x += 0.15;
    let found = count(&before_a_wall("impostor", 40, 0.0), &impostor);
    assert!(found.expected >= 30 && found.share() > 0.6, "{found:?}");
    assert!(found.is_too_much(0.3) && found.penalty() > 20.0, "{found:?}");
}

#[test]
fn a_few_lost_lines_take_nothing() {
    let found = count(&before_a_wall("lost", 37, 0.0), &truth());
    assert!((1..=3).contains(&found.missing) && found.penalty() < 1e-9, "{found:?}");
}

#[test]
fn what_a_nearer_surface_hides_is_not_missing() {
    let found = count(&before_a_wall("hidden", 2, 1.0), &truth());
    assert_eq!(found.missing, 0, "{found:?}");
}
