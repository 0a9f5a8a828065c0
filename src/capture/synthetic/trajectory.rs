//! How the rig moves: from key pose to key pose through the free space of the room, each aimed as a user would, so that
//! long edges of the scene run through two cameras and directions differ from pose to pose.

use nalgebra::{Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::random::Random;
use super::scene::Scene;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::geometry::{Camera, PixelPoint};

/// Key poses of one lap.
const KEY_POSES: usize = 64;
/// Poses tried for each key pose.
const CANDIDATES: usize = 14;
/// Edges shorter than this are not aimed at, m.
const LONG_EDGE_M: f64 = 0.6;
/// An edge counts in a camera when it is visible over this length, px.
const VISIBLE_PX: f64 = 80.0;
/// Edges are aimed at in this range of depth, m.
const AIM_RANGE_M: [f64; 2] = [0.4, 3.5];
/// Points looked at along an edge.
const EDGE_POINTS: usize = 13;

/// A camera of the rig, as the planner needs it.
#[derive(Debug, Clone, Copy)]
pub(super) struct RigCamera {
    pub(super) camera: Camera,
    pub(super) reference_from_camera: Motion,
}

impl RigCamera {
    /// Whether the image shows every point with a margin.
    pub(super) fn sees_all(
        &self,
        world_from_reference: &Motion,
        points_m: &[Point3<f64>],
        margin_px: f64,
    ) -> bool {
        let camera_from_world = (world_from_reference * self.reference_from_camera).inverse();
        points_m.iter().all(|point| {
            let pixel = self.camera.project(&(camera_from_world * point));
            pixel.is_some_and(|pixel| self.camera.contains(pixel, margin_px))
        })
    }
}

/// The closed path of the rig.
#[derive(Debug, Clone)]
pub(super) struct Trajectory {
    world_from_reference: Vec<Motion>,
}

impl Trajectory {
    /// Plans a lap through the scene.
    pub(super) fn plan(scene: &Scene, rig: &[RigCamera], seed: u64) -> Self {
        let mut random = Random::keyed(seed, &[0x7A74]);
        let center = rig_center_m(rig.iter().map(|camera| &camera.reference_from_camera));
        let mut planner = Planner::new(scene, rig);
        for _ in 0..KEY_POSES {
            let tried = (0..CANDIDATES).map(|_| random_pose(scene, &center, &mut random));
            let scored = tried.map(|pose| (planner.score(&pose), pose));
            let best = scored.reduce(|best, next| if next.0 > best.0 { next } else { best });
            planner.remember(best.map_or_else(Motion::identity, |(_, pose)| pose));
        }
        Self { world_from_reference: planner.chosen }
    }

    /// A lap through given poses, at least one.
    pub(super) fn through(world_from_reference: Vec<Motion>) -> Self {
        Self { world_from_reference }
    }

    /// The pose of the reference camera at a time counted in key poses; smooth, at rest at the whole numbers.
    pub(super) fn world_from_reference(&self, time: f64) -> Motion {
        let count = self.world_from_reference.len();
        let place = time.rem_euclid(count as f64);
        let (key, share) = (place.floor() as usize % count, place.fract());
        let eased = share * share * (3.0 - 2.0 * share);
        let (from, to) = (&self.world_from_reference[key], &self.world_from_reference[(key + 1) % count]);
        let translation = from.translation.vector.lerp(&to.translation.vector, eased);
        // Half a turn has no shortest way; staying is as good as any.
        let rotation = from.rotation.try_slerp(&to.rotation, eased, 1e-9).unwrap_or(from.rotation);
        Motion::from_parts(Translation3::from(translation), rotation)
    }
}

/// The middle of the cameras in the reference frame, m.
pub(super) fn rig_center_m<'a>(cameras: impl ExactSizeIterator<Item = &'a Motion>) -> Vector3<f64> {
    let count = cameras.len().max(1) as f64;
    cameras.map(|pose| pose.translation.vector).sum::<Vector3<f64>>() / count
}

/// How far the cameras are from the middle of the rig at most, m.
pub(super) fn rig_radius_m(rig: &[Motion]) -> f64 {
    let center = rig_center_m(rig.iter());
    rig.iter().map(|pose| (pose.translation.vector - center).norm()).fold(0.0, f64::max)
}

/// Anywhere in the free space, any heading, moderate pitch and roll.
fn random_pose(scene: &Scene, center_in_reference: &Vector3<f64>, random: &mut Random) -> Motion {
    let free = &scene.free;
    let around = random.between(0.0, std::f64::consts::TAU);
    let out = random.between(0.0, 1.0).sqrt();
    let center = Vector3::new(
        free.center_m[0] + out * free.radii_m[0] * around.cos(),
        free.center_m[1] + out * free.radii_m[1] * around.sin(),
        random.between(free.heights_m[0], free.heights_m[1]),
    );
    let heading_rad = random.between(0.0, std::f64::consts::TAU);
    let pitch_rad = (0.25 * f64::from(random.gaussian()) - 0.1).clamp(-0.6, 0.5);
    let roll_rad = (0.25 * f64::from(random.gaussian())).clamp(-0.7, 0.7);
    rig_pose((center, center_in_reference), Attitude { heading_rad, pitch_rad, roll_rad })
}

/// How the reference camera is turned.
#[derive(Debug, Clone, Copy)]
pub(super) struct Attitude {
    /// From the world's x axis to where the camera looks, about the world's z axis.
    pub(super) heading_rad: f64,
    pub(super) pitch_rad: f64,
    pub(super) roll_rad: f64,
}

/// `world_from_reference` of a rig whose middle is at a place in the world.
pub(super) fn rig_pose(
    (center_m, center_in_reference): (Vector3<f64>, &Vector3<f64>),
    Attitude { heading_rad, pitch_rad, roll_rad }: Attitude,
) -> Motion {
    let (sin, cos) = heading_rad.sin_cos();
    // Columns: the optical axes x right, y down, z forward of a level camera that looks along the heading.
    let level = Rotation3::from_matrix_unchecked(Matrix3::new(
        sin, 0.0, cos, //
        -cos, 0.0, sin, //
        0.0, -1.0, 0.0,
    ));
    let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), pitch_rad)
        * Rotation3::from_axis_angle(&Vector3::z_axis(), roll_rad);
    let rotation = UnitQuaternion::from_rotation_matrix(&(level * tilt));
    Motion::from_parts(Translation3::from(center_m - rotation * center_in_reference), rotation)
}

fn long_edges(scene: &Scene) -> Vec<[Point3<f64>; 2]> {
    let edges = scene.blocks.iter().flat_map(|block| block.edges_m());
    edges.filter(|[a, b]| (b - a).norm() > LONG_EDGE_M).collect()
}

struct Planner<'a> {
    scene: &'a Scene,
    rig: &'a [RigCamera],
    edges: Vec<[Point3<f64>; 2]>,
    /// Directions seen so far through each pair of cameras, as scatter matrices in the reference frame.
    known: Vec<Matrix3<f64>>,
    chosen: Vec<Motion>,
}

impl<'a> Planner<'a> {
    fn new(scene: &'a Scene, rig: &'a [RigCamera]) -> Self {
        let known = vec![Matrix3::zeros(); rig.len() * rig.len()];
        Self { scene, rig, edges: long_edges(scene), known, chosen: Vec::with_capacity(KEY_POSES) }
    }

    /// More for more shared edges, near ones, directions that a pair has not seen yet, and places not yet looked at.
    fn score(&self, world_from_reference: &Motion) -> f64 {
        let mut gain = vec![0.0; self.known.len()];
        self.for_each_shared(world_from_reference, |pair, direction, depth_m| {
            let known = (direction.transpose() * self.known[pair] * direction).x;
            gain[pair] += 1.0 / ((1.0 + known) * (0.5 + depth_m));
        });
        let shared: f64 = gain.iter().map(|g| g.ln_1p()).sum();
        // A radian of turn shows as much that is new as a metre of way.
        let news = self.chosen.iter().map(|other| {
            translation_gap_m(other, world_from_reference) + rotation_gap_rad(other, world_from_reference)
        });
        shared * news.fold(1.0, f64::min)
    }

    fn remember(&mut self, world_from_reference: Motion) {
        let mut known = std::mem::take(&mut self.known);
        self.for_each_shared(&world_from_reference, |pair, direction, _| {
            known[pair] += direction * direction.transpose();
        });
        self.known = known;
        self.chosen.push(world_from_reference);
    }

    /// Calls with the pair, the direction in the reference frame and the mean depth of each edge that two cameras see.
    fn for_each_shared(
        &self,
        world_from_reference: &Motion,
        mut call: impl FnMut(usize, &Vector3<f64>, f64),
    ) {
        let eyes: Vec<Eye> = self.rig.iter().map(|camera| Eye::new(camera, world_from_reference)).collect();
        for edge in &self.edges {
            let seen: Vec<Option<f64>> = eyes.iter().map(|eye| eye.depth_of_visible_m(edge)).collect();
            if seen.iter().flatten().count() < 2 {
                continue;
            }
            let is_clear: Vec<bool> = eyes
                .iter()
                .zip(&seen)
                .map(|(eye, depth)| depth.is_some() && eye.is_unoccluded(edge, self.scene))
                .collect();
            let direction = world_from_reference.inverse_transform_vector(&(edge[1] - edge[0]).normalize());
            for first in 0..eyes.len() {
                for second in first + 1..eyes.len() {
                    if let (true, true, Some(a), Some(b)) =
                        (is_clear[first], is_clear[second], seen[first], seen[second])
                    {
                        call(first * eyes.len() + second, &direction, 0.5 * (a + b));
                    }
                }
            }
        }
    }
}

/// A camera at its place in the world.
struct Eye {
    camera: Camera,
    world_from_camera: Motion,
}

impl Eye {
    fn new(camera: &RigCamera, world_from_reference: &Motion) -> Self {
        Self { camera: camera.camera, world_from_camera: world_from_reference * camera.reference_from_camera }
    }

    /// Pixels of the points of an edge that lie in the image and in range, with their depth, in order.
    fn points_in_view(
        &self,
        [a, b]: &[Point3<f64>; 2],
    ) -> impl Iterator<Item = (Point3<f64>, PixelPoint, f64)> {
        let (a, step) = (*a, (b - a) / (EDGE_POINTS - 1) as f64);
        (0..EDGE_POINTS).filter_map(move |i| {
            let point = a + step * i as f64;
            let in_camera = self.world_from_camera.inverse_transform_point(&point);
            let pixel = self.camera.project(&in_camera)?;
            let is_in_range = (AIM_RANGE_M[0]..AIM_RANGE_M[1]).contains(&in_camera.z);
            (is_in_range && self.camera.contains(pixel, 2.0)).then_some((point, pixel, in_camera.z))
        })
    }

    /// Mean depth of the part in view, `None` when that is too short.
    fn depth_of_visible_m(&self, edge: &[Point3<f64>; 2]) -> Option<f64> {
        let (_, first, near_m) = self.points_in_view(edge).next()?;
        let (_, last, far_m) = self.points_in_view(edge).last()?;
        (length_px(first, last) > VISIBLE_PX).then_some(0.5 * (near_m + far_m))
    }

    /// Whether a long enough stretch of the edge is hidden by nothing.
    fn is_unoccluded(&self, edge: &[Point3<f64>; 2], scene: &Scene) -> bool {
        let eye = Point3::from(self.world_from_camera.translation.vector);
        let mut start: Option<PixelPoint> = None;
        self.points_in_view(edge).any(|(point, pixel, _)| {
            let is_clear = scene.first_hit(&eye, &(point - eye)).is_none_or(|at| at > 0.998);
            start = if is_clear { start.or(Some(pixel)) } else { None };
            start.is_some_and(|start| length_px(start, pixel) > VISIBLE_PX)
        })
    }
}

fn length_px(a: PixelPoint, b: PixelPoint) -> f64 {
    (a.x - b.x).hypot(a.y - b.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::synthetic::SyntheticOptions;
    use crate::capture::synthetic::room::furnished_room;

    /// In most key poses the two cameras share a long edge, and the edges of all poses span space.
    #[track_caller]
    fn check_shared_edges(options: &SyntheticOptions, (first, second): (usize, usize)) {
        let rig: Vec<RigCamera> = options.cameras.iter().map(|camera| camera.rig_camera()).collect();
        let scene = furnished_room(options.seed, 0.2);
        let path = Trajectory::plan(&scene, &rig, options.seed);
        let planner = Planner::new(&scene, &rig);
        let (mut poses, mut scatter) = (0, Matrix3::zeros());
        for pose in &path.world_from_reference {
            let mut edges = 0;
            planner.for_each_shared(pose, |pair, direction, _| {
                if pair == first * rig.len() + second {
                    edges += 1;
                    scatter += direction * direction.transpose();
                }
            });
            poses += usize::from(edges > 0);
        }
        let spread = scatter.symmetric_eigenvalues();
        let share = spread.min() / spread.sum();
        assert!(poses * 10 > KEY_POSES * 6 && share > 0.03, "{poses} poses, least share {share}");
    }

    #[test]
    fn neighbours_of_the_demo_rig_share_long_edges_of_many_directions() {
        check_shared_edges(&SyntheticOptions::demo(), (0, 1));
        check_shared_edges(&SyntheticOptions::demo(), (0, 2));
    }

    #[test]
    fn pairs_share_long_edges_of_many_directions() {
        check_shared_edges(&SyntheticOptions::pair(60.0, 0.3, 2), (0, 1));
        check_shared_edges(&SyntheticOptions::pair(0.0, 0.2, 3), (0, 1));
    }
}
