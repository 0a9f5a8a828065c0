//! Matched pairs of lines with known truth, noise exactly as the observations say.

use nalgebra::{Matrix2, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::geometry::{DepthFit, EdgeSide, LineObservation, PixelPoint, RayPoint, Segment};
use crate::solver::LinePair;
use crate::solver::paper::pair_geometry::PairGeometry;
use crate::solver::paper::refine::ReadPair;
use crate::solver::paper::{PaperOptions, PaperSolution};
use crate::solver::tests::room::Random;

/// Noise across a segment's ends on the plane z = 1: half a pixel.
const SIGMA_ACROSS: f64 = 0.5 / 600.0;
/// Noise of the inverse depth at a segment's ends, 1/m.
const SIGMA_INVERSE_DEPTH_PER_M: f64 = 0.001;

/// Two points of each camera's part of one line, in the source's frame, m.
pub type Parts = ([Point3<f64>; 2], [Point3<f64>; 2]);

/// What a camera measures of a part of a line in its own frame; `noise` 0 for nothing, 1 for what the covariance says.
fn observed(random: &mut Random, ends_m: [Point3<f64>; 2], noise: f64) -> LineObservation {
    let [a, b] = ends_m.map(|end_m| Vector3::new(end_m.x / end_m.z, end_m.y / end_m.z, 0.0));
    let along = (b - a).normalize();
    let ends = [a, b].map(|end| {
        let off = noise * SIGMA_ACROSS * random.gaussian();
        RayPoint { x: end.x - along.y * off, y: end.y + along.x * off }
    });
    let [start, end] = ends.map(|ray| PixelPoint { x: 600.0 * ray.x + 320.0, y: 600.0 * ray.y + 240.0 });
    let inverse_depth_per_m =
        ends_m.map(|end_m| 1.0 / end_m.z + noise * SIGMA_INVERSE_DEPTH_PER_M * random.gaussian());
    LineObservation {
        segment: Segment { start, end, sigma_across_px: 0.5 },
        ends,
        sigma_across: SIGMA_ACROSS,
        depth: Some(DepthFit {
            inverse_depth_per_m,
            covariance_per_m2: Matrix2::identity() * SIGMA_INVERSE_DEPTH_PER_M.powi(2),
            inlier_ratio: 1.0,
            n_inliers: 50,
            side: EdgeSide::Both,
        }),
    }
}

/// A matched pair of two parts; every fourth is a PnL pair.
pub fn pair(
    random: &mut Random,
    (idx, parts): (usize, Parts),
    target_from_source: &Motion,
    noise: f64,
) -> Option<LinePair> {
    let source = observed(random, parts.0, noise);
    let mut target = observed(random, parts.1.map(|end_m| target_from_source * end_m), noise);
    if idx % 4 == 3 {
        target.depth = None;
    }
    LinePair::try_new(&target, &source, idx as u32)
}

/// Any rotation, half a metre at most.
pub fn any_motion(random: &mut Random) -> Motion {
    let translation_m = Vector3::new(random.signed(), random.signed(), random.signed()) * 0.3;
    Motion::from_parts(Translation3::from(translation_m), random.rotation())
}

/// A point in front of a camera, m.
pub fn in_view(random: &mut Random) -> Point3<f64> {
    let z_m = 2.0 + 0.7 * random.signed();
    Point3::new(0.5 * random.signed() * z_m, 0.4 * random.signed() * z_m, z_m)
}

/// The parts around two points of one line, 0.8 m long.
pub fn parts(near_source_m: Point3<f64>, near_target_m: Point3<f64>) -> Parts {
    let half = (near_target_m - near_source_m).normalize() * 0.4;
    ([near_source_m - half, near_source_m + half], [near_target_m - half, near_target_m + half])
}

/// Lines that run from the source's view into the target's, wherever that looks.
pub fn penetrating(
    random: &mut Random,
    target_from_source: &Motion,
    (n, noise): (usize, f64),
) -> Vec<LinePair> {
    let mut pairs = Vec::new();
    while pairs.len() < n {
        let parts = parts(in_view(random), target_from_source.inverse() * in_view(random));
        pairs.extend(pair(random, (pairs.len(), parts), target_from_source, noise));
    }
    pairs
}

/// As above, with this share of the targets exchanged among each other.
pub fn with_wrong(pairs: &[LinePair], n_wrong: usize) -> Vec<LinePair> {
    let mut mixed = pairs.to_vec();
    for i in 0..n_wrong {
        mixed[i].target = pairs[(i + 1) % n_wrong].target.clone();
    }
    mixed
}

pub fn read(pairs: &[LinePair]) -> Vec<ReadPair<'_>> {
    let read = |pair| ReadPair { pair, geometry: PairGeometry::try_new(pair).expect("finite numbers") };
    pairs.iter().map(read).collect()
}

/// The Cayley vector of a rotation, the quaternion's (x, y, z) / w; `None` within 1e-6 deg of half a turn.
pub fn cgr_of(rotation: &Rotation3<f64>) -> Option<Vector3<f64>> {
    let quaternion = UnitQuaternion::from_rotation_matrix(rotation);
    (quaternion.w.abs() > 1e-8).then(|| quaternion.imag() / quaternion.w)
}

/// The options that every test of the whole estimator is run with.
pub fn variants() -> [PaperOptions; 2] {
    [PaperOptions::as_published(), PaperOptions::whitened()]
}

/// That there is a pose, and near the truth.
#[track_caller]
pub fn check_near(solution: &PaperSolution, truth: &Motion, (max_rad, max_m): (f64, f64)) {
    let found = solution.target_from_source.unwrap_or_else(|| panic!("{}", solution.outcome));
    let gaps = (rotation_gap_rad(&found, truth), translation_gap_m(&found, truth));
    assert!(gaps.0 < max_rad && gaps.1 < max_m, "{gaps:?} {solution:?}");
}
