//! Rooms of straight edges, and what a rig measures of them.

use nalgebra::{Isometry3, Matrix2, Point3, Translation3, UnitQuaternion, Vector3};

use crate::geometry::camera::Pinhole;
use crate::geometry::motion::Motion;
use crate::geometry::{
    Camera, CameraView, DepthFit, Distortion, EdgeSide, LineObservation, RayPoint, Segment,
};
use crate::solver::RigCamera;

/// Offsets across a segment's ends, px.
const SIGMA_ACROSS_PX: f64 = 0.3;
/// Inverse depth at a segment's ends, 1/m.
const SIGMA_INVERSE_DEPTH_PER_M: f64 = 0.002;
const FOCAL_PX: f64 = 600.0;

/// splitmix64, seeded by a name.
pub struct Random(u64);

impl Random {
    pub fn named(name: &str) -> Self {
        Self(
            name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
                (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3)
            }),
        )
    }

    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in -1..1.
    pub fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    pub fn gaussian(&mut self) -> f64 {
        let radius = (-2.0 * (0.5 * (self.signed() + 1.0)).max(1e-300).ln()).sqrt();
        radius * (std::f64::consts::PI * self.signed()).cos()
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.signed(), self.signed(), self.signed())
    }

    /// Uniform over all rotations.
    pub fn rotation(&mut self) -> UnitQuaternion<f64> {
        let q = nalgebra::Quaternion::new(self.gaussian(), self.gaussian(), self.gaussian(), self.gaussian());
        UnitQuaternion::new_normalize(q)
    }
}

pub fn camera() -> Camera {
    let pinhole = Pinhole { fx_px: FOCAL_PX, fy_px: FOCAL_PX, cx_px: 319.5, cy_px: 239.5 };
    Camera::try_new((640, 480), pinhole, Distortion::None).expect("valid intrinsics")
}

/// Cameras named `camera 0`, `camera 1`, ...
pub fn rig(n_cameras: usize) -> Vec<RigCamera> {
    (0..n_cameras).map(|i| RigCamera { name: format!("camera {i}"), camera: camera() }).collect()
}

/// Straight edges by their end points, m.
pub type Room = Vec<[Point3<f64>; 2]>;

/// Half of the edges along the axes, half anyhow, around the origin.
pub fn room(random: &mut Random, n_edges: usize) -> Room {
    edges(random, n_edges, |random, k| match k % 6 {
        0 => Vector3::x(),
        1 => Vector3::y(),
        2 => Vector3::z(),
        _ => random.vector(),
    })
}

/// Edges with the given directions.
pub fn edges(
    random: &mut Random,
    n_edges: usize,
    direction: impl Fn(&mut Random, usize) -> Vector3<f64>,
) -> Room {
    (0..n_edges)
        .map(|k| {
            let middle = Point3::from(random.vector() * 2.0);
            // Long enough to run through cameras that look away from each other.
            let half = direction(random, k).normalize() * (3.0 + 1.5 * random.signed());
            [middle - half, middle + half]
        })
        .collect()
}

/// A rig somewhere in the room, looking anywhere.
pub fn world_from_rig(random: &mut Random) -> Motion {
    Isometry3::from_parts(Translation3::from(random.vector() * 0.7), random.rotation())
}

/// What a camera measures of the room.
pub fn view(random: &mut Random, room: &Room, world_from_camera: &Motion) -> CameraView {
    let camera_from_world = world_from_camera.inverse();
    let seen = room.iter().filter_map(|edge| {
        let [a, b] = visible(&edge.map(|end| camera_from_world * end))?;
        Some(measured(random, a, b))
    });
    CameraView { lines: seen.collect(), surface: Vec::new() }
}

/// The part of an edge that lies in the image and at 0.3 to 5 m; `None` when shorter than 60 px.
pub fn visible(edge: &[Point3<f64>; 2]) -> Option<[Point3<f64>; 2]> {
    let camera = camera();
    let on_edge = |k: usize| edge[0] + (edge[1] - edge[0]) * (k as f64 / 100.0);
    let is_seen = |point: &Point3<f64>| {
        (0.3..5.0).contains(&point.z)
            && camera.project(point).is_some_and(|pixel| camera.contains(pixel, 2.0))
    };
    let first = (0..=100).map(on_edge).find(is_seen)?;
    let last = (0..=100).rev().map(on_edge).find(is_seen)?;
    let (start, end) = (camera.project(&first)?, camera.project(&last)?);
    ((end.x - start.x).hypot(end.y - start.y) >= 60.0).then_some([first, last])
}

/// What a camera measures of the visible part of an edge.
pub fn measured(random: &mut Random, a: Point3<f64>, b: Point3<f64>) -> LineObservation {
    let camera = camera();
    let ray = |point: &Point3<f64>| (point.x / point.z, point.y / point.z);
    let ((ax, ay), (bx, by)) = (ray(&a), ray(&b));
    let length = (bx - ax).hypot(by - ay);
    let across = ((ay - by) / length, (bx - ax) / length);
    let mut shifted = |x: f64, y: f64| {
        let shift = random.gaussian() * SIGMA_ACROSS_PX / FOCAL_PX;
        RayPoint { x: x + shift * across.0, y: y + shift * across.1 }
    };
    let ends = [shifted(ax, ay), shifted(bx, by)];
    let [start, end] = ends.map(|end| camera.pixel_from_ray(end));
    let noisy = |random: &mut Random, point: &Point3<f64>| {
        1.0 / point.z + random.gaussian() * SIGMA_INVERSE_DEPTH_PER_M
    };
    LineObservation {
        segment: Segment { start, end, sigma_across_px: SIGMA_ACROSS_PX },
        ends,
        sigma_across: SIGMA_ACROSS_PX / FOCAL_PX,
        depth: Some(DepthFit {
            inverse_depth_per_m: [noisy(random, &a), noisy(random, &b)],
            covariance_per_m2: Matrix2::identity() * SIGMA_INVERSE_DEPTH_PER_M.powi(2),
            inlier_ratio: 1.0,
            n_inliers: 40,
            side: EdgeSide::Both,
        }),
    }
}

/// Frame sets of a rig that looks around in a room: a view per camera.
pub fn frame_sets(
    random: &mut Random,
    room: &Room,
    reference_from_camera: &[Motion],
    n_sets: usize,
) -> Vec<Vec<Option<CameraView>>> {
    let path: Vec<Motion> = (0..n_sets).map(|_| world_from_rig(random)).collect();
    frame_sets_along(random, room, reference_from_camera, &path)
}

/// Frame sets of a rig at the given places, `world_from_rig`.
pub fn frame_sets_along(
    random: &mut Random,
    room: &Room,
    reference_from_camera: &[Motion],
    path: &[Motion],
) -> Vec<Vec<Option<CameraView>>> {
    let set = |world_from_rig: &Motion| {
        let views =
            reference_from_camera.iter().map(|pose| Some(view(random, room, &(world_from_rig * pose))));
        views.collect()
    };
    path.iter().map(set).collect()
}
