//! What a scene consists of: blocks (turned boxes) with a material per face, lamps, and the space that stays free.
//!
//! Decides the frame of the world: x and y along two walls, z up, origin in a corner of the room's floor, metres.

use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use super::noise_picture::NoisePicture;
use super::random::Random;
use super::texture::{Grain, Material, Pattern, Rgb};
use crate::geometry::motion::Motion;

/// A box anywhere in the world.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub(super) world_from_block: Motion,
    pub(super) half_m: Vector3<f64>,
    /// Material of the faces -x, +x, -y, +y, -z, +z.
    pub(super) faces: [u16; 6],
}

/// A lamp that shines in all directions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lamp {
    pub(super) at_m: Point3<f64>,
    /// Radiance at 1 m.
    pub(super) strength: f32,
}

/// Number of lamps of every scene.
pub(super) const LAMPS: usize = 3;

/// An upright elliptic column in which nothing stands.
#[derive(Debug, Clone, Copy)]
pub(super) struct FreeSpace {
    pub(super) center_m: [f64; 2],
    pub(super) radii_m: [f64; 2],
    /// Lowest and highest free height.
    pub(super) heights_m: [f64; 2],
}

impl FreeSpace {
    pub(super) fn middle_height_m(&self) -> f64 {
        0.5 * (self.heights_m[0] + self.heights_m[1])
    }

    /// Whether the point is inside, the column made narrower by `margin_m` (wider when negative).
    pub(super) fn contains_in_plan(&self, [x, y]: [f64; 2], margin_m: f64) -> bool {
        let u = (x - self.center_m[0]) / (self.radii_m[0] - margin_m).max(0.01);
        let v = (y - self.center_m[1]) / (self.radii_m[1] - margin_m).max(0.01);
        u * u + v * v < 1.0
    }
}

/// Everything a ray can meet.
#[derive(Debug, Clone)]
pub(super) struct Scene {
    /// The first block is the room, seen from inside.
    pub(super) blocks: Vec<Block>,
    pub(super) materials: Vec<Material>,
    pub(super) lamps: [Lamp; LAMPS],
    pub(super) noise: NoisePicture,
    pub(super) free: FreeSpace,
}

impl Scene {
    /// Distance along `ray_m` (in units of its length) to the first block, `None` when it leaves the room unhindered.
    pub(super) fn first_hit(&self, from_m: &Point3<f64>, ray_m: &Vector3<f64>) -> Option<f64> {
        let hits = self.blocks.iter().enumerate().filter_map(|(i, block)| {
            let (near, far) = block.crossing(from_m, ray_m);
            let at = if i == 0 { far } else { near };
            (near <= far && at > 0.0).then_some(at)
        });
        hits.reduce(f64::min)
    }
}

impl Block {
    /// Where a ray enters and leaves the block, in units of the ray's length; it misses where the first exceeds the second.
    fn crossing(&self, from_m: &Point3<f64>, ray_m: &Vector3<f64>) -> (f64, f64) {
        let from = self.world_from_block.inverse_transform_point(from_m);
        let ray = self.world_from_block.inverse_transform_vector(ray_m);
        (0..3).fold((f64::NEG_INFINITY, f64::INFINITY), |(near, far), k| {
            let (a, b) = ((-self.half_m[k] - from[k]) / ray[k], (self.half_m[k] - from[k]) / ray[k]);
            (near.max(a.min(b)), far.min(a.max(b)))
        })
    }

    /// The corner with these signs (0 is minus, 1 is plus), in the world.
    pub(super) fn corner_m(&self, signs: [usize; 3]) -> Point3<f64> {
        let side = |k: usize| self.half_m[k] * (2.0 * signs[k] as f64 - 1.0);
        self.world_from_block * Point3::new(side(0), side(1), side(2))
    }

    /// All eight corners, in the world.
    pub(super) fn corners_m(&self) -> [Point3<f64>; 8] {
        std::array::from_fn(|i| self.corner_m([i & 1, i >> 1 & 1, i >> 2]))
    }

    /// The twelve edges, in the world.
    pub(super) fn edges_m(&self) -> impl Iterator<Item = [Point3<f64>; 2]> + '_ {
        (0..12).map(|edge| {
            let (axis, others) = (edge / 4, edge % 4);
            let mut signs = [0; 3];
            signs[(axis + 1) % 3] = others & 1;
            signs[(axis + 2) % 3] = others >> 1;
            let start = self.corner_m(signs);
            signs[axis] = 1;
            [start, self.corner_m(signs)]
        })
    }
}

/// A box given in its parent's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub(super) center_m: [f64; 3],
    pub(super) size_m: [f64; 3],
    pub(super) material: u16,
}

/// Collects blocks and materials.
#[derive(Debug)]
pub(super) struct Builder {
    pub(super) random: Random,
    pub(super) blocks: Vec<Block>,
    pub(super) materials: Vec<Material>,
}

impl Builder {
    pub(super) fn new(seed: u64) -> Self {
        Self { random: Random::keyed(seed, &[0x5CE4E]), blocks: Vec::new(), materials: Vec::new() }
    }

    /// Adds a box that is parallel to the axes of its parent.
    pub(super) fn add(&mut self, world_from_parent: &Motion, part: Part) {
        self.add_with_faces(world_from_parent, part, [part.material; 6]);
    }

    /// Adds a box with a material for each face.
    pub(super) fn add_with_faces(&mut self, world_from_parent: &Motion, part: Part, faces: [u16; 6]) {
        let center = Translation3::from(Vector3::from(part.center_m));
        let world_from_block = world_from_parent * Motion::from_parts(center, UnitQuaternion::identity());
        self.blocks.push(Block { world_from_block, half_m: 0.5 * Vector3::from(part.size_m), faces });
    }

    pub(super) fn material(&mut self, base: Rgb, pattern: Pattern, grain: Grain) -> u16 {
        self.materials.push(Material { base, pattern, grain });
        (self.materials.len() - 1) as u16
    }

    /// A painted surface with slight unevenness.
    pub(super) fn paint(&mut self, base: Rgb) -> u16 {
        self.material(base, Pattern::Plain, Grain { contrast: 0.06, per_m: [0.7, 0.7] })
    }

    /// A paint of random colour with a reflectance between the two.
    pub(super) fn any_paint(&mut self, dark: f64, bright: f64) -> u16 {
        let color = self.color(dark, bright);
        self.paint(color)
    }

    /// Wood with its grain along the first axis of each face.
    pub(super) fn wood(&mut self) -> u16 {
        self.wood_of([0.35, 4.0])
    }

    /// Wood with its grain along the second axis of each face: of planks that run along z.
    pub(super) fn plank_wood(&mut self) -> u16 {
        self.wood_of([4.0, 0.35])
    }

    fn wood_of(&mut self, per_m: [f32; 2]) -> u16 {
        let brown = self.random.between(0.1, 0.55) as f32;
        let grain = Grain { contrast: 0.35, per_m };
        self.material([brown, brown * 0.72, brown * 0.45], Pattern::Plain, grain)
    }

    /// A random colour, not strongly saturated.
    pub(super) fn color(&mut self, dark: f64, bright: f64) -> Rgb {
        let level = self.random.between(dark, bright);
        std::array::from_fn(|_| (level * self.random.between(0.65, 1.1)).min(0.9) as f32)
    }
}

/// `parent_from_child` for a child at `at_m`, turned about the parent's z axis.
pub(super) fn turned(at_m: [f64; 3], yaw_rad: f64) -> Motion {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw_rad);
    Motion::from_parts(Translation3::from(Vector3::from(at_m)), rotation)
}
