//! A checkerboard before the rig: how it looks, where it hangs, and from where the rig looks at it.
//!
//! It hangs upright at one end of the room's free space, the rig stands at the other, so nothing is between them.

use nalgebra::{Point3, Vector3};

use super::random::Random;
use super::scene::{Block, FreeSpace, Scene, turned};
use super::texture::{Grain, Material, Pattern, Rgb};
use super::trajectory::{Attitude, RigCamera, Trajectory, rig_center_m, rig_pose};
use crate::geometry::motion::Motion;

const DARK: Rgb = [0.04; 3];
const BRIGHT: Rgb = [0.8; 3];
/// Bright rim around the squares, m.
const RIM_M: f64 = 0.03;
const THICKNESS_M: f64 = 0.02;
/// From the middle of the free space to the board, m.
const BOARD_AT_M: f64 = 0.85;
/// From the middle of the free space to the rig, m: a metre of board fills half of an image from there.
const RIG_AT_M: f64 = -0.7;
/// Views of one lap.
const VIEWS: usize = 16;
/// Poses tried for each view, until every camera sees the whole board.
const TRIES: usize = 200;
/// Corners stay this far from the border of the image, px.
const MARGIN_PX: f64 = 24.0;

/// A flat checkerboard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Checkerboard {
    /// Squares along a row and along a column.
    pub squares: [u32; 2],
    /// Side of a square, m.
    pub square_m: f64,
}

impl Checkerboard {
    /// Inner corners in the frame of the board (y out of the board, z up, origin in its middle), m: row by row from the top,
    /// each from left to right for who looks at it.
    pub(super) fn corners_in_board(&self) -> Vec<Point3<f64>> {
        let [columns, rows] = self.squares;
        let at = |i: u32, count: u32| (0.5 * f64::from(count) - f64::from(i)) * self.square_m;
        let row = |row: u32| {
            (1..columns).map(move |column| Point3::new(at(column, columns), 0.5 * THICKNESS_M, at(row, rows)))
        };
        (1..rows).flat_map(row).collect()
    }

    /// Puts the board into the scene.
    pub(super) fn hang(&self, scene: &mut Scene) {
        let pattern =
            Pattern::Checkers { squares: self.squares, square_m: self.square_m as f32, other: DARK };
        let grain = Grain { contrast: 0.0, per_m: [1.0, 1.0] };
        scene.materials.push(Material { base: BRIGHT, pattern, grain });
        let material = (scene.materials.len() - 1) as u16;
        let half = |count: u32| 0.5 * f64::from(count) * self.square_m + RIM_M;
        let half_m = Vector3::new(half(self.squares[0]), 0.5 * THICKNESS_M, half(self.squares[1]));
        let world_from_block = world_from_board(&scene.free);
        scene.blocks.push(Block { world_from_block, half_m, faces: [material; 6] });
    }
}

/// Upright, its front towards the rig.
pub(super) fn world_from_board(free: &FreeSpace) -> Motion {
    let [x, y] = free.center_m;
    turned([x + BOARD_AT_M, y, free.middle_height_m()], std::f64::consts::FRAC_PI_2)
}

/// Views of the board, a little different from each other; the whole board is in every image where the rig allows that.
pub(super) fn views(scene: &Scene, rig: &[RigCamera], (board, seed): (&Checkerboard, u64)) -> Trajectory {
    let mut random = Random::keyed(seed, &[0xB0A2D]);
    let center = rig_center_m(rig.iter().map(|camera| &camera.reference_from_camera));
    let world_from_board = world_from_board(&scene.free);
    let corners_m: Vec<Point3<f64>> =
        board.corners_in_board().iter().map(|corner| world_from_board * corner).collect();
    let view = |_| {
        let mut pose = Motion::identity();
        for _ in 0..TRIES {
            pose = pose_before_board(&scene.free, &center, &mut random);
            if rig.iter().all(|camera| camera.sees_all(&pose, &corners_m, MARGIN_PX)) {
                break;
            }
        }
        pose
    };
    Trajectory::through((0..VIEWS).map(view).collect())
}

fn pose_before_board(free: &FreeSpace, center_in_reference: &Vector3<f64>, random: &mut Random) -> Motion {
    let [x, y] = free.center_m;
    let center_m = Vector3::new(
        x + RIG_AT_M + random.between(-0.12, 0.12),
        y + random.between(-0.1, 0.1),
        free.middle_height_m() + random.between(-0.08, 0.08),
    );
    let attitude = Attitude {
        heading_rad: random.between(-0.06, 0.06),
        pitch_rad: random.between(-0.05, 0.05),
        roll_rad: random.between(-0.08, 0.08),
    };
    rig_pose((center_m, center_in_reference), attitude)
}
