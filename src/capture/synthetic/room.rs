//! The shell of the synthetic room: floor, walls, ceiling, skirtings, rails, beams, and the order of the furniture.

use nalgebra::{Point3, Translation3, UnitQuaternion, Vector3};

use super::furniture;
use super::noise_picture::NoisePicture;
use super::scene::{Builder, FreeSpace, LAMPS, Lamp, Part, Scene, turned};
use super::texture::{Bar, Grain, Pattern, Rgb};
use crate::geometry::motion::Motion;

/// Furniture reaches this far from the walls at most, m.
pub(super) const FURNITURE_DEPTH_M: f64 = 0.75;
/// A camera comes no closer to furniture than this, m: the depth sensor sees nothing below 0.25 m.
const CLEARANCE_M: f64 = 0.25;

/// One wall: x along it, y out of it into the room, z up; the origin at its left end on the floor.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wall {
    pub(super) world_from_wall: Motion,
    pub(super) length_m: f64,
}

/// A furnished room in which a rig of this radius has space to move.
pub(super) fn furnished_room(seed: u64, rig_radius_m: f64) -> Scene {
    let mut builder = Builder::new(seed);
    let extra_m = 2.0 * (rig_radius_m - 0.2).max(0.0);
    let size_m = [
        builder.random.between(4.3, 5.3) + extra_m,
        builder.random.between(4.0, 4.8) + extra_m,
        builder.random.between(2.5, 2.8),
    ];
    let keep_m = FURNITURE_DEPTH_M + CLEARANCE_M + rig_radius_m;
    let free = FreeSpace {
        center_m: [0.5 * size_m[0], 0.5 * size_m[1]],
        radii_m: [0.5 * size_m[0] - keep_m, 0.5 * size_m[1] - keep_m],
        heights_m: [0.3 + rig_radius_m, (1.8 - rig_radius_m).max(0.5 + rig_radius_m)],
    };
    shell(&mut builder, size_m);
    let walls = walls(size_m);
    for wall in &walls {
        trims(&mut builder, wall, size_m[2]);
    }
    beams(&mut builder, size_m);
    furnish(&mut builder, &walls, size_m[2]);
    furniture::free_standing(&mut builder, &free, (CLEARANCE_M + rig_radius_m, size_m));
    furniture::floor_pieces(&mut builder, size_m);
    let lamps = lamps(&mut builder, size_m);
    Scene {
        blocks: builder.blocks,
        materials: builder.materials,
        lamps,
        noise: NoisePicture::new(seed),
        free,
    }
}

fn walls([width_m, depth_m, _]: [f64; 3]) -> [Wall; 4] {
    let quarter = std::f64::consts::FRAC_PI_2;
    [
        Wall { world_from_wall: turned([0.0, 0.0, 0.0], 0.0), length_m: width_m },
        Wall { world_from_wall: turned([width_m, 0.0, 0.0], quarter), length_m: depth_m },
        Wall { world_from_wall: turned([width_m, depth_m, 0.0], 2.0 * quarter), length_m: width_m },
        Wall { world_from_wall: turned([0.0, depth_m, 0.0], -quarter), length_m: depth_m },
    ]
}

fn shell(builder: &mut Builder, size_m: [f64; 3]) {
    let floor = floor_material(builder);
    let ceiling = builder.paint([0.75, 0.74, 0.72]);
    let walls = [0, 1, 2, 3].map(|which| wall_material(builder, which));
    let part = Part { center_m: size_m.map(|side| 0.5 * side), size_m, material: ceiling };
    let faces = [walls[0], walls[1], walls[2], walls[3], floor, ceiling];
    builder.add_with_faces(&Motion::identity(), part, faces);
}

fn floor_material(builder: &mut Builder) -> u16 {
    let angle = builder.random.between(0.15, 1.4) as f32;
    let direction = [angle.cos(), angle.sin()];
    let boards = builder.random.below(2) == 0;
    let (size_m, other): ([f32; 2], Rgb) =
        if boards { ([1.6, 0.14], [0.05, 0.04, 0.03]) } else { ([0.45, 0.45], [0.55, 0.53, 0.5]) };
    let base = if boards { [0.36, 0.25, 0.15] } else { [0.3, 0.29, 0.27] };
    let grain = Grain { contrast: 0.35, per_m: [1.1, 1.1] };
    builder.material(base, Pattern::Tiles { direction, size_m, joint_m: 0.006, other }, grain)
}

/// Walls differ: plain plaster, upright stripes, slanted stripes, panels.
fn wall_material(builder: &mut Builder, which: usize) -> u16 {
    let base = builder.color(0.45, 0.75);
    let other = base.map(|c| 0.72 * c);
    let grain = Grain { contrast: 0.18, per_m: [1.3, 1.3] };
    let slant = builder.random.between(0.3, 1.2) as f32;
    let pattern = match which {
        0 => Pattern::Stripes { direction: [1.0, 0.0], period_m: 0.52, duty: 0.5, other },
        1 => Pattern::Plain,
        2 => Pattern::Stripes { direction: [slant.cos(), slant.sin()], period_m: 0.9, duty: 0.4, other },
        _ => Pattern::Tiles {
            direction: [1.0, 0.0],
            size_m: [0.9, 0.62],
            joint_m: 0.012,
            other: base.map(|c| 0.4 * c),
        },
    };
    builder.material(base, pattern, grain)
}

/// Skirting, a picture rail, a cornice.
fn trims(builder: &mut Builder, wall: &Wall, height_m: f64) {
    let material = builder.any_paint(0.08, 0.3);
    let along = |z_m: f64, [out_m, tall_m]: [f64; 2]| Part {
        center_m: [0.5 * wall.length_m, 0.5 * out_m, z_m],
        size_m: [wall.length_m, out_m, tall_m],
        material,
    };
    let rail_m = builder.random.between(2.12, 2.25);
    builder.add(&wall.world_from_wall, along(0.05, [0.018, 0.10]));
    builder.add(&wall.world_from_wall, along(rail_m, [0.02, 0.05]));
    builder.add(&wall.world_from_wall, along(height_m - 0.03, [0.06, 0.06]));
}

/// Ceiling beams that are not parallel to the walls.
fn beams(builder: &mut Builder, [width_m, depth_m, height_m]: [f64; 3]) {
    let yaw_rad = builder.random.between(0.25, 0.6);
    let material = builder.wood();
    for shift_m in [-0.8, 0.1, 0.9] {
        let world_from_beam = turned([0.5 * width_m, 0.5 * depth_m, height_m], yaw_rad);
        let length_m = builder.random.between(2.2, 3.2);
        let part =
            Part { center_m: [0.1 * shift_m, shift_m, -0.07], size_m: [length_m, 0.11, 0.14], material };
        builder.add(&world_from_beam, part);
    }
}

/// Gives every wall another set of furniture, in seeded order, and fills the corners.
fn furnish(builder: &mut Builder, walls: &[Wall; 4], height_m: f64) {
    let mut order = [0, 1, 2, 3];
    for i in (1..order.len()).rev() {
        order.swap(i, builder.random.below(i + 1));
    }
    for (wall, kind) in walls.iter().zip(order) {
        match kind {
            0 => furniture::door_wall(builder, wall),
            1 => furniture::window_wall(builder, wall),
            2 => furniture::bookcase_wall(builder, wall),
            _ => furniture::slanted_wall(builder, wall),
        }
    }
    for (corner, wall) in walls.iter().enumerate() {
        furniture::pictures(builder, wall);
        match corner {
            0 => furniture::pillar(builder, wall, height_m),
            _ => furniture::leaning_planks(builder, wall),
        }
    }
}

fn lamps(builder: &mut Builder, [width_m, depth_m, height_m]: [f64; 3]) -> [Lamp; LAMPS] {
    let strengths = [1.6f32, 1.0, 0.8];
    std::array::from_fn(|i| {
        let at_m = Point3::new(
            width_m * builder.random.between(0.2, 0.8),
            depth_m * builder.random.between(0.2, 0.8),
            height_m - 0.35,
        );
        Lamp { at_m, strength: strengths[i] }
    })
}

/// A material with a picture of random bars for a face of this size.
pub(super) fn picture(builder: &mut Builder, [width_m, height_m]: [f64; 2]) -> u16 {
    let reach_m = 0.35 * width_m.min(height_m);
    let count = 3 + builder.random.below(4);
    let bars = (0..count)
        .map(|_| {
            let angle = builder.random.between(0.0, std::f64::consts::PI) as f32;
            Bar {
                normal: [angle.cos(), angle.sin()],
                offset_m: builder.random.between(-reach_m, reach_m) as f32,
                half_width_m: builder.random.between(0.03, 0.25) as f32 * reach_m as f32,
                color: builder.color(0.05, 0.8),
            }
        })
        .collect();
    let base = builder.color(0.2, 0.7);
    builder.material(base, Pattern::Picture { bars }, Grain { contrast: 0.25, per_m: [1.5, 1.5] })
}

/// `parent_from_child` whose z axis runs from one point to the other, its origin half-way; also the distance.
pub(super) fn between(from_m: [f64; 3], to_m: [f64; 3]) -> (Motion, f64) {
    let (from, to) = (Vector3::from(from_m), Vector3::from(to_m));
    // The two are never opposite: everything here leads upwards or sideways.
    let rotation = UnitQuaternion::rotation_between(&Vector3::z(), &(to - from)).unwrap_or_default();
    (Motion::from_parts(Translation3::from(0.5 * (from + to)), rotation), (to - from).norm())
}
