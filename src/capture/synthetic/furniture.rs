//! The furniture of the synthetic room, made of blocks: what stands at each wall, in the corners and on the floor.
//!
//! Much of it is turned, leaning or sloping on purpose: edges in many directions are what the estimator lives on.

use super::room::{Wall, between, picture};
use super::scene::{Builder, FreeSpace, Part, turned};
use super::texture::{Grain, Pattern, Rgb};
use crate::geometry::motion::Motion;

/// Four bars around an opening or picture: centre, outer size, bar width and thickness.
struct Frame {
    center_m: [f64; 3],
    size_m: [f64; 2],
    bar_m: [f64; 2],
    material: u16,
}

fn frame(builder: &mut Builder, world_from_parent: &Motion, frame: &Frame) {
    let ([x, y, z], [width_m, height_m], [bar_m, thick_m]) = (frame.center_m, frame.size_m, frame.bar_m);
    let (dx, dz) = (0.5 * (width_m - bar_m), 0.5 * (height_m - bar_m));
    let upright = [bar_m, thick_m, height_m];
    let level = [width_m - 2.0 * bar_m, thick_m, bar_m];
    for (shift, size_m) in
        [([-dx, 0.0], upright), ([dx, 0.0], upright), ([0.0, -dz], level), ([0.0, dz], level)]
    {
        let center_m = [x + shift[0], y, z + shift[1]];
        builder.add(world_from_parent, Part { center_m, size_m, material: frame.material });
    }
}

fn glass(builder: &mut Builder, base: Rgb) -> u16 {
    builder.material(base, Pattern::Glass, Grain { contrast: 0.0, per_m: [1.0, 1.0] })
}

/// A picture somewhere on each third of the wall, behind the furniture where that is in its way.
pub(super) fn pictures(builder: &mut Builder, wall: &Wall) {
    for third in 0..3 {
        let x = wall.length_m * (f64::from(third) + builder.random.between(0.3, 0.7)) / 3.0;
        let z = builder.random.between(0.5, 1.95);
        hang_picture(builder, wall, [x, z]);
    }
}

/// A framed picture that hangs a little crooked, centred at (x, z) on the wall.
fn hang_picture(builder: &mut Builder, wall: &Wall, [x, z]: [f64; 2]) {
    let size_m = [builder.random.between(0.45, 1.0), builder.random.between(0.4, 0.7)];
    let roll_rad = builder.random.between(-0.3, 0.3);
    let rotation = nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), roll_rad);
    let world_from_picture = wall.world_from_wall * turned([x, 0.0, z], 0.0) * rotation;
    let drawn = picture(builder, size_m);
    let material = builder.any_paint(0.03, 0.15);
    // Two that overlap lie one before the other.
    let center_m = [0.0, builder.random.between(0.008, 0.02), 0.0];
    let board = Part { center_m, size_m: [size_m[0], 0.012, size_m[1]], material: drawn };
    builder.add(&world_from_picture, board);
    frame(builder, &world_from_picture, &Frame { center_m, size_m, bar_m: [0.03, 0.03], material });
}

/// A door in its frame, a tall cabinet.
pub(super) fn door_wall(builder: &mut Builder, wall: &Wall) {
    let x = 0.5 * wall.length_m - builder.random.between(0.35, 0.6);
    let white = builder.paint([0.7, 0.7, 0.68]);
    let center_m = [x, 0.03, 1.03];
    frame(
        builder,
        &wall.world_from_wall,
        &Frame { center_m, size_m: [1.0, 2.06], bar_m: [0.07, 0.06], material: white },
    );
    let panel = Pattern::Border { inset_m: 0.12, width_m: 0.02, other: [0.1, 0.08, 0.06] };
    let leaf = builder.material([0.42, 0.3, 0.2], panel, Grain { contrast: 0.2, per_m: [1.0, 0.3] });
    builder.add(
        &wall.world_from_wall,
        Part { center_m: [x, 0.015, 1.0], size_m: [0.86, 0.03, 2.0], material: leaf },
    );
    let right_m = x + 0.55;
    cabinet(builder, wall, [right_m + 0.5, 1.75]);
}

/// A cabinet with two panelled doors at x, of the given height.
fn cabinet(builder: &mut Builder, wall: &Wall, [x, height_m]: [f64; 2]) {
    let base = builder.color(0.25, 0.6);
    let other = base.map(|c| 0.35 * c);
    let body = builder.paint(base);
    let panel = Pattern::Border { inset_m: 0.05, width_m: 0.012, other };
    let door = builder.material(base, panel, Grain { contrast: 0.12, per_m: [1.0, 1.0] });
    let center_m = [x, 0.21, 0.5 * height_m];
    builder.add(&wall.world_from_wall, Part { center_m, size_m: [0.8, 0.42, height_m], material: body });
    for side in [-1.0, 1.0] {
        let center_m = [x + 0.2 * side, 0.43, 0.5 * height_m];
        let size_m = [0.385, 0.02, height_m - 0.06];
        builder.add(&wall.world_from_wall, Part { center_m, size_m, material: door });
    }
}

/// A window with sill, a long desk below with a screen and boxes on it.
pub(super) fn window_wall(builder: &mut Builder, wall: &Wall) {
    let middle_m = 0.5 * wall.length_m;
    let white = builder.paint([0.72, 0.72, 0.7]);
    let pane = glass(builder, [0.85, 0.88, 0.9]);
    let center_m = [middle_m, 0.025, 1.5];
    let size_m = [1.5, 1.05];
    builder.add(&wall.world_from_wall, Part { center_m, size_m: [1.44, 0.01, 1.0], material: pane });
    frame(builder, &wall.world_from_wall, &Frame { center_m, size_m, bar_m: [0.06, 0.05], material: white });
    let bar = Part { center_m, size_m: [0.05, 0.04, 1.0], material: white };
    builder.add(&wall.world_from_wall, bar);
    let sill = Part { center_m: [middle_m, 0.1, 0.95], size_m: [1.7, 0.2, 0.03], material: white };
    builder.add(&wall.world_from_wall, sill);
    let length_m = (wall.length_m - 2.0).min(2.6);
    desk(builder, &(wall.world_from_wall * turned([middle_m, 0.38, 0.0], 0.0)), [length_m, 0.6]);
}

/// A desk centred at its parent's origin: top, side panels, a screen and two turned boxes.
fn desk(builder: &mut Builder, world_from_desk: &Motion, [length_m, depth_m]: [f64; 2]) {
    let (wood, dark, display) =
        (builder.wood(), builder.any_paint(0.05, 0.2), glass(builder, [0.04, 0.05, 0.07]));
    let top = Part { center_m: [0.0, 0.0, 0.735], size_m: [length_m, depth_m, 0.03], material: wood };
    builder.add(world_from_desk, top);
    for side in [-1.0, 1.0] {
        let center_m = [side * (0.5 * length_m - 0.06), 0.0, 0.36];
        builder.add(world_from_desk, Part { center_m, size_m: [0.04, depth_m - 0.06, 0.72], material: dark });
    }
    let yaw_rad = builder.random.between(-0.5, 0.5);
    let screen = world_from_desk * turned([-0.25 * length_m, 0.0, 0.75], yaw_rad);
    builder.add(&screen, Part { center_m: [0.0, 0.0, 0.27], size_m: [0.55, 0.04, 0.33], material: dark });
    builder.add(&screen, Part { center_m: [0.0, 0.02, 0.27], size_m: [0.5, 0.004, 0.28], material: display });
    builder.add(&screen, Part { center_m: [0.0, 0.0, 0.06], size_m: [0.06, 0.06, 0.12], material: dark });
    for _ in 0..2 {
        let at_m = [length_m * builder.random.between(-0.05, 0.4), builder.random.between(-0.1, 0.1), 0.75];
        let world_from_box = world_from_desk * turned(at_m, builder.random.between(-0.8, 0.8));
        let material = builder.any_paint(0.1, 0.7);
        let height_m = builder.random.between(0.08, 0.3);
        let size_m = [builder.random.between(0.15, 0.35), 0.18, height_m];
        builder.add(&world_from_box, Part { center_m: [0.0, 0.0, 0.5 * height_m], size_m, material });
    }
}

/// An open bookcase, a white board, two low cabinets below it.
pub(super) fn bookcase_wall(builder: &mut Builder, wall: &Wall) {
    let left_m = 0.5 * wall.length_m - 0.8;
    bookcase(builder, wall, left_m);
    let white = builder.material(
        [0.75, 0.75, 0.73],
        Pattern::Border { inset_m: 0.15, width_m: 0.01, other: [0.2, 0.1, 0.3] },
        Grain { contrast: 0.05, per_m: [1.0, 1.0] },
    );
    let (x, material) = (left_m + 1.4, builder.any_paint(0.05, 0.2));
    let center_m = [x, 0.02, 1.45];
    builder.add(&wall.world_from_wall, Part { center_m, size_m: [1.5, 0.02, 0.9], material: white });
    let rim = Frame { center_m, size_m: [1.56, 0.96], bar_m: [0.035, 0.035], material };
    frame(builder, &wall.world_from_wall, &rim);
    cabinet(builder, wall, [x - 0.3, 0.8]);
    cabinet(builder, wall, [x + 0.5, 0.8]);
}

fn bookcase(builder: &mut Builder, wall: &Wall, x: f64) {
    let wood = builder.wood();
    for side in [-1.0, 1.0] {
        let center_m = [x + 0.53 * side, 0.15, 0.95];
        builder.add(&wall.world_from_wall, Part { center_m, size_m: [0.03, 0.3, 1.9], material: wood });
    }
    for level in 0..6 {
        let z_m = 0.08 + 0.36 * f64::from(level);
        let board = Part { center_m: [x, 0.15, z_m], size_m: [1.03, 0.3, 0.025], material: wood };
        builder.add(&wall.world_from_wall, board);
        if level < 5 {
            books(builder, &(wall.world_from_wall * turned([x, 0.12, z_m + 0.0125], 0.0)), 0.95);
        }
    }
}

/// A row of books that fills a part of `space_m`.
fn books(builder: &mut Builder, world_from_board: &Motion, space_m: f64) {
    let (length_m, height_m) =
        (space_m * builder.random.between(0.5, 0.95), builder.random.between(0.2, 0.29));
    let seed = builder.random.next_u64();
    let grain = Grain { contrast: 0.2, per_m: [2.0, 2.0] };
    let material = builder.material([0.3; 3], Pattern::Row { period_m: 0.042, seed }, grain);
    let x = 0.5 * (length_m - space_m);
    let part = Part { center_m: [x, 0.0, 0.5 * height_m], size_m: [length_m, 0.18, height_m], material };
    builder.add(world_from_board, part);
}

/// Sloping boards as along a stair, wall shelves with books.
pub(super) fn slanted_wall(builder: &mut Builder, wall: &Wall) {
    let middle_m = 0.5 * wall.length_m;
    let slope_m = builder.random.between(0.55, 0.95);
    for (low_m, side) in [(0.35, 1.0), (0.6, 1.0), (0.75, -1.0)] {
        let material = builder.any_paint(0.05, 0.25);
        let ends = [[middle_m - 1.35 * side, 0.03, low_m], [middle_m + 1.1 * side, 0.03, low_m + slope_m]];
        let (wall_from_board, length_m) = between(ends[0], ends[1]);
        let part = Part { center_m: [0.0; 3], size_m: [0.09, 0.03, length_m], material };
        builder.add(&(wall.world_from_wall * wall_from_board), part);
    }
    let wood = builder.wood();
    for (x, z, length_m) in [(middle_m - 0.5, 1.72, 1.5), (middle_m + 0.9, 1.95, 1.2)] {
        let board = Part { center_m: [x, 0.13, z], size_m: [length_m, 0.26, 0.03], material: wood };
        builder.add(&wall.world_from_wall, board);
        books(builder, &(wall.world_from_wall * turned([x, 0.12, z + 0.015], 0.0)), length_m - 0.2);
    }
}

/// A pillar in the left corner of a wall.
pub(super) fn pillar(builder: &mut Builder, wall: &Wall, height_m: f64) {
    let base = builder.color(0.3, 0.6);
    let stripes =
        Pattern::Stripes { direction: [0.0, 1.0], period_m: 0.5, duty: 0.12, other: base.map(|c| 0.3 * c) };
    let material = builder.material(base, stripes, Grain { contrast: 0.15, per_m: [1.5, 1.5] });
    let world_from_pillar = wall.world_from_wall * turned([0.4, 0.4, 0.0], 0.3);
    let center_m = [0.0, 0.0, 0.5 * height_m];
    builder.add(&world_from_pillar, Part { center_m, size_m: [0.28, 0.28, height_m], material });
}

/// Planks that lean on a wall near its left corner, each at another angle.
pub(super) fn leaning_planks(builder: &mut Builder, wall: &Wall) {
    for _ in 0..2 {
        let material = builder.plank_wood();
        let foot_m = [builder.random.between(0.2, 0.9), builder.random.between(0.35, 0.6), 0.0];
        let head_m = [builder.random.between(0.15, 1.3), 0.04, builder.random.between(1.5, 2.05)];
        let (wall_from_plank, length_m) = between(foot_m, head_m);
        let part = Part { center_m: [0.0; 3], size_m: [0.13, 0.025, length_m], material };
        builder.add(&(wall.world_from_wall * wall_from_plank), part);
    }
}

/// Turned cabinets, boxes and a table in what space the corners leave.
pub(super) fn free_standing(builder: &mut Builder, free: &FreeSpace, (margin_m, room_m): (f64, [f64; 3])) {
    let mut centers_m: Vec<[f64; 2]> = Vec::new();
    for size_m in [[0.55, 0.4, 1.1], [0.45, 0.45, 0.5], [0.9, 0.3, 0.75], [0.5, 0.35, 1.6], [0.4, 0.3, 0.35]]
    {
        for _ in 0..60 {
            let at_m = [0, 1].map(|k| {
                let from_wall_m = builder.random.between(0.3, 1.2);
                if builder.random.below(2) == 0 { from_wall_m } else { room_m[k] - from_wall_m }
            });
            let world_from_piece = turned([at_m[0], at_m[1], 0.0], builder.random.between(0.0, 3.1));
            let apart = centers_m.iter().all(|c| (c[0] - at_m[0]).hypot(c[1] - at_m[1]) > 0.9);
            if apart && stands_clear(&world_from_piece, size_m, (free, margin_m, room_m)) {
                let material = if size_m[2] > 1.0 { builder.wood() } else { builder.any_paint(0.15, 0.65) };
                let center_m = [0.0, 0.0, 0.5 * size_m[2]];
                builder.add(&world_from_piece, Part { center_m, size_m, material });
                centers_m.push(at_m);
                break;
            }
        }
    }
}

/// Whether a piece lies inside the room and outside the free space.
fn stands_clear(
    world_from_piece: &Motion,
    size_m: [f64; 3],
    (free, margin_m, room_m): (&FreeSpace, f64, [f64; 3]),
) -> bool {
    (0..25).all(|i| {
        let (u, v) = (f64::from(i % 5) / 4.0 - 0.5, f64::from(i / 5) / 4.0 - 0.5);
        let p = world_from_piece * nalgebra::Point3::new(u * size_m[0], v * size_m[1], 0.0);
        let in_room = (0..2).all(|k| p[k] > 0.05 && p[k] < room_m[k] - 0.05);
        in_room && !free.contains_in_plan([p.x, p.y], -margin_m)
    })
}

/// A turned rug and boards lying on the floor.
pub(super) fn floor_pieces(builder: &mut Builder, room_m: [f64; 3]) {
    let base = builder.color(0.15, 0.45);
    let border = Pattern::Border { inset_m: 0.1, width_m: 0.06, other: [0.6, 0.55, 0.45] };
    let rug = builder.material(base, border, Grain { contrast: 0.4, per_m: [3.0, 3.0] });
    let middle_m = [0.5 * room_m[0], 0.5 * room_m[1], 0.0];
    let yaw_rad = builder.random.between(0.2, 1.2);
    let part = Part { center_m: [0.0, 0.0, 0.004], size_m: [2.0, 1.3, 0.008], material: rug };
    builder.add(&turned(middle_m, yaw_rad), part);
    for _ in 0..3 {
        let material = builder.wood();
        let at_m = [
            middle_m[0] + builder.random.between(-1.2, 1.2),
            middle_m[1] + builder.random.between(-1.0, 1.0),
            0.0,
        ];
        let world_from_board = turned(at_m, builder.random.between(0.0, 3.1));
        let size_m = [builder.random.between(1.0, 1.6), 0.16, 0.04];
        builder.add(&world_from_board, Part { center_m: [0.0, 0.0, 0.02], size_m, material });
    }
}
