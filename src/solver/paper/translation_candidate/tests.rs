use nalgebra::{Point3, UnitQuaternion};

use super::*;
use crate::geometry::motion::Motion;
use crate::geometry::{DepthFit, EdgeSide, PixelPoint, RayPoint, Segment};
use crate::solver::tests::room::Random;

const MAX_ANGLE_RAD: f64 = 0.2;

/// A candidate line through a translation, 4 mm and 0.01 rad uncertain.
pub fn line(through_m: Vector3<f64>, direction: Unit<Vector3<f64>>) -> TranslationCandidate {
    let point_m = through_m - *direction * through_m.dot(&direction);
    TranslationCandidate::Line(TranslationLine {
        point_m,
        direction,
        sigma_m: 0.004,
        best_at_m: 0.3,
        sigma_per_m: 0.01,
    })
}

/// A candidate plane through a translation, 4 mm uncertain and more with the distance.
pub fn plane(through_m: Vector3<f64>, normal: Unit<Vector3<f64>>) -> TranslationCandidate {
    let by_end = [normal.cross(&Vector3::x()) * 0.002, normal.cross(&Vector3::y()) * 0.001];
    TranslationCandidate::Plane(TranslationPlane { normal, turned_m: -through_m, sigma_m: 0.004, by_end })
}

/// Noise of the four measured numbers: offsets across on the plane z = 1, inverse depths in 1/m.
const SIGMAS: [f64; 4] = [0.0005, 0.0005, 0.004, 0.004];

/// What a camera measures of the edge between two points of its frame, off by this noise.
fn observed(a_m: &Point3<f64>, b_m: &Point3<f64>, noise: [f64; 4]) -> LineObservation {
    let along = Vector3::new(b_m.x / b_m.z - a_m.x / a_m.z, b_m.y / b_m.z - a_m.y / a_m.z, 0.0).normalize();
    let ray =
        |p: &Point3<f64>, off: f64| RayPoint { x: p.x / p.z - along.y * off, y: p.y / p.z + along.x * off };
    let ends = [ray(a_m, noise[0]), ray(b_m, noise[1])];
    let [start, end] = ends.map(|ray| PixelPoint { x: 600.0 * ray.x + 320.0, y: 600.0 * ray.y + 240.0 });
    LineObservation {
        segment: Segment { start, end, sigma_across_px: 0.3 },
        ends,
        sigma_across: SIGMAS[0],
        depth: Some(DepthFit {
            inverse_depth_per_m: [1.0 / a_m.z + noise[2], 1.0 / b_m.z + noise[3]],
            covariance_per_m2: nalgebra::Matrix2::identity() * SIGMAS[2].powi(2),
            inlier_ratio: 1.0,
            n_inliers: 50,
            side: EdgeSide::Both,
        }),
    }
}

fn target_from_source() -> Motion {
    Motion::new(Vector3::new(0.3, -0.05, 0.1), Vector3::new(0.1, 0.6, -0.2))
}

fn rotation() -> Rotation3<f64> {
    target_from_source().rotation.to_rotation_matrix()
}

fn translation_m() -> Vector3<f64> {
    target_from_source().translation.vector
}

/// Two parts of one edge in both cameras.
struct Edge {
    source_m: [Point3<f64>; 2],
    target_m: [Point3<f64>; 2],
}

impl Edge {
    fn random(random: &mut Random) -> Self {
        let mut point =
            |z: f64| Point3::new(random.signed() * 0.8, random.signed() * 0.6, z + 0.5 * random.signed());
        let source_m = [point(1.6), point(2.0)];
        let extent_m = source_m[1] - source_m[0];
        let part = |k: f64| target_from_source() * (source_m[0] + extent_m * k);
        Self { source_m, target_m: [part(0.2), part(1.1)] }
    }

    fn pair(&self, (target_noise, source_noise): ([f64; 4], [f64; 4]), is_full: bool) -> LinePair {
        let source = observed(&self.source_m[0], &self.source_m[1], source_noise);
        let mut target = observed(&self.target_m[0], &self.target_m[1], target_noise);
        if !is_full {
            target.depth = None;
        }
        LinePair::try_new(&target, &source, 0).expect("the source is lifted")
    }
}

const NONE: ([f64; 4], [f64; 4]) = ([0.0; 4], [0.0; 4]);

fn candidate(pair: &LinePair) -> TranslationCandidate {
    TranslationCandidate::try_new(pair, &rotation(), MAX_ANGLE_RAD).expect("directions agree")
}

#[test]
fn the_true_translation_is_on_the_line_of_a_full_pair_and_on_the_plane_of_a_pnl_pair() {
    let mut random = Random::named("candidates");
    for _ in 0..100 {
        let edge = Edge::random(&mut random);
        let (full, pnl) = (candidate(&edge.pair(NONE, true)), candidate(&edge.pair(NONE, false)));
        assert!(
            matches!(full, TranslationCandidate::Line(_)) && matches!(pnl, TranslationCandidate::Plane(_))
        );
        for candidate in [full, pnl] {
            assert!(candidate.distance_m(&translation_m()) < 1e-12, "{candidate:?}");
        }
    }
}

#[test]
fn a_target_line_seen_the_other_way_round_gives_the_same_candidate() {
    let mut random = Random::named("orientation");
    for is_full in [true, false] {
        let edge = Edge::random(&mut random);
        let turned = Edge { source_m: edge.source_m, target_m: [edge.target_m[1], edge.target_m[0]] };
        let (one, other) = (candidate(&edge.pair(NONE, is_full)), candidate(&turned.pair(NONE, is_full)));
        let elsewhere = translation_m() + Vector3::new(0.1, 0.2, -0.15);
        assert!((one.distance_m(&elsewhere) - other.distance_m(&elsewhere)).abs() < 1e-12);
        assert!((one.sigma_m(&elsewhere) - other.sigma_m(&elsewhere)).abs() < 1e-12);
    }
}

#[test]
fn a_translation_along_the_edge_stays_a_candidate_and_one_across_does_not() {
    let mut random = Random::named("along");
    let edge = Edge::random(&mut random);
    let direction = (edge.target_m[1] - edge.target_m[0]).normalize();
    let moment = edge.target_m[0].coords.cross(&direction).normalize();
    for is_full in [true, false] {
        let candidate = candidate(&edge.pair(NONE, is_full));
        assert!(candidate.distance_m(&(translation_m() + direction * 0.7)) < 1e-12);
        assert!((candidate.distance_m(&(translation_m() + moment * 0.1)) - 0.1).abs() < 1e-12);
        // Towards the camera in the plane through its centre: only the line notices.
        let inward = translation_m() + direction.cross(&moment) * 0.1;
        let expected_m = if is_full { 0.1 } else { 0.0 };
        assert!((candidate.distance_m(&inward) - expected_m).abs() < 1e-12);
    }
}

#[test]
fn both_planes_of_a_pnl_pair_are_one() {
    // Paper, eq. 15 with its sign corrected: ((R d_s) × K_L^T x)^T t = - x^T K_L R m_s, written on the plane z = 1 where K_L = I.
    let mut random = Random::named("eq. 15");
    for _ in 0..100 {
        let edge = Edge::random(&mut random);
        let pair = edge.pair(NONE, false);
        let TranslationCandidate::Plane(plane) = candidate(&pair) else { panic!("a pair without depth") };
        let direction = rotation() * pair.source.direction;
        let moment_m = rotation() * moment_m(&pair.source);
        for end in pair.target_observation().ends {
            let ray = Vector3::new(end.x, end.y, 1.0);
            let normal = direction.cross(&ray);
            let right = -ray.dot(&moment_m);
            assert!((normal.dot(&translation_m()) - right).abs() < 1e-12);
            assert!(normal.normalize().cross(&plane.normal).norm() < 1e-9, "the planes differ");
        }
    }
}

#[test]
fn directions_that_disagree_leave_no_candidate() {
    let mut random = Random::named("disagree");
    let edge = Edge::random(&mut random);
    for is_full in [true, false] {
        let pair = edge.pair(NONE, is_full);
        let normal = edge.target_m[0].coords.cross(&edge.target_m[1].coords).normalize();
        let axis = (edge.target_m[1] - edge.target_m[0]).normalize().cross(&normal);
        let wrong = Rotation3::new(axis * 0.4) * rotation();
        assert_eq!(TranslationCandidate::try_new(&pair, &wrong, MAX_ANGLE_RAD), None);
        assert!(TranslationCandidate::try_new(&pair, &wrong, 0.5).is_some());
    }
}

/// Root mean square over noise of the distance of the truth, by what the candidate says it is: 1 when it is right.
fn spread_by_sigma(is_full: bool, at_m: impl Fn(&Edge) -> Vector3<f64>) -> f64 {
    let mut random = Random::named("spread");
    let (mut sum, mut n_samples) = (0.0, 0.0);
    for _ in 0..12 {
        let edge = Edge::random(&mut random);
        // Where the noise-free line runs as well: the distance there is all noise.
        let at_m = at_m(&edge);
        let sigma_m = candidate(&edge.pair(NONE, is_full)).sigma_m(&at_m);
        for _ in 0..400 {
            let mut noise = || SIGMAS.map(|sigma| 0.2 * sigma * random.gaussian());
            let noise = (noise(), noise());
            let distance_m = candidate(&edge.pair(noise, is_full)).distance_m(&at_m) / 0.2;
            sum += (distance_m / sigma_m).powi(2);
            n_samples += 1.0;
        }
    }
    f64::sqrt(sum / n_samples)
}

#[test]
fn the_deviation_is_that_of_noisy_lines_at_the_truth_and_far_along_the_line() {
    for is_full in [true, false] {
        for along_m in [0.0, 2.0, -3.0] {
            let spread = spread_by_sigma(is_full, |edge| {
                translation_m() + (edge.target_m[1] - edge.target_m[0]).normalize() * along_m
            });
            assert!((0.95..1.05).contains(&spread), "full {is_full}, {along_m} m: {spread}");
        }
    }
}

#[test]
fn the_deviation_changes_no_faster_than_its_slope() {
    let mut random = Random::named("slope");
    for is_full in [true, false] {
        let candidate = candidate(&Edge::random(&mut random).pair(NONE, is_full));
        for _ in 0..200 {
            let mut point = || Vector3::new(random.gaussian(), random.gaussian(), random.gaussian());
            let (a_m, b_m) = (point(), point());
            let change_m = (candidate.sigma_m(&a_m) - candidate.sigma_m(&b_m)).abs();
            assert!(change_m <= candidate.sigma_slope() * (a_m - b_m).norm() + 1e-12);
        }
    }
}

#[test]
fn a_segment_of_no_length_leaves_no_plane() {
    let mut random = Random::named("no length");
    let edge = Edge::random(&mut random);
    let mut pair = edge.pair(NONE, false);
    if let TargetSide::Pnl(observation) = &mut pair.target {
        observation.ends[1] = observation.ends[0];
    }
    assert_eq!(TranslationCandidate::try_new(&pair, &UnitQuaternion::identity().into(), 2.0), None);
}

#[test]
fn the_derivatives_of_direction_and_moment_agree_with_central_differences() {
    let mut random = Random::named("line derivatives");
    for _ in 0..20 {
        let [a_m, b_m] = Edge::random(&mut random).source_m;
        let line = |number: usize, step: f64| {
            let mut noise = [0.0; 4];
            noise[number] = step;
            EvidenceLine::try_new(&observed(&a_m, &b_m, noise)).expect("lifted")
        };
        let (d_direction, d_moment) = derivatives(&line(0, 0.0));
        for number in 0..4 {
            let (before, after) = (line(number, -1e-6), line(number, 1e-6));
            let direction = (after.direction.into_inner() - before.direction.into_inner()) / 2e-6;
            assert!(
                (direction - d_direction.column(number)).amax() < 1e-6,
                "{number}: {direction} {d_direction}"
            );
            let moment = (moment_m(&after) - moment_m(&before)) / 2e-6;
            assert!((moment - d_moment.column(number)).amax() < 1e-6, "{number}: {moment} {d_moment}");
        }
    }
}
