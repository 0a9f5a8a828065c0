//! The synthetic back end: a ray-cast furnished room with textures, a moving rig of any number of cameras, exact truth, and
//! colour and depth noise of the D435i class.
//!
//! Everything follows from the options and the seed: which camera is opened first, on which thread, and how often changes
//! no bit of any frame.

mod board;
mod furniture;
mod noise_color;
mod noise_depth;
mod noise_field;
mod noise_picture;
mod options;
mod random;
mod raycast;
mod room;
mod scene;
mod shade;
mod source;
mod texture;
mod trajectory;
mod view;

#[cfg(test)]
mod tests;

use std::sync::{Arc, OnceLock};
use std::time::Instant;

pub use board::Checkerboard;
pub use options::{CameraMove, Noise, Pace, SyntheticCamera, SyntheticOptions};

use nalgebra::Point3;

use super::{CameraInfo, CaptureError, DeviceFactory, FrameSource};
use crate::geometry::motion::Motion;
use scene::Scene;
use source::SyntheticSource;
use trajectory::{RigCamera, Trajectory};

/// What all cameras of one rig share.
#[derive(Debug)]
struct World {
    options: SyntheticOptions,
    scene: Scene,
    trajectory: Trajectory,
    /// When frame 0 is due in real time: the moment the first camera is asked for a frame.
    epoch: OnceLock<Instant>,
}

/// Lists and opens the cameras of one synthetic rig.
#[derive(Debug, Clone)]
pub struct SyntheticFactory {
    world: Arc<World>,
}

impl SyntheticFactory {
    /// Builds the room and plans the path of the rig.
    pub fn new(options: SyntheticOptions) -> Self {
        let mut scene = room_of(&options);
        let rig: Vec<RigCamera> = options.cameras.iter().map(SyntheticCamera::rig_camera).collect();
        let trajectory = match &options.board {
            None => Trajectory::plan(&scene, &rig, options.seed),
            Some(board) => {
                board.hang(&mut scene);
                board::views(&scene, &rig, (board, options.seed))
            }
        };
        Self { world: Arc::new(World { options, scene, trajectory, epoch: OnceLock::new() }) }
    }

    /// The exact `reference_from_camera` of every camera, in the order of [`DeviceFactory::list`], before any move.
    pub fn truth(&self) -> Vec<Motion> {
        self.world.options.cameras.iter().map(|camera| camera.reference_from_camera).collect()
    }

    /// The exact inner corners of the board in the frame of a camera at a frame set, m: row by row from the top, each from left
    /// to right. Empty without a board, or where the image does not show all of it.
    pub fn board_corners_in_camera_m(&self, camera: usize, frame_set: u64) -> Vec<Point3<f64>> {
        let World { options, scene, .. } = &*self.world;
        let (Some(board), Some(made)) = (options.board, options.cameras.get(camera)) else {
            return Vec::new();
        };
        let world_from_camera = self.world.world_from_camera(camera, frame_set);
        let camera_from_board = world_from_camera.inv_mul(&board::world_from_board(&scene.free));
        let corners: Vec<Point3<f64>> =
            board.corners_in_board().iter().map(|corner| camera_from_board * corner).collect();
        let is_seen = |corner: &Point3<f64>| {
            made.info.camera.project(corner).is_some_and(|pixel| made.info.camera.contains(pixel, 0.0))
        };
        if corners.iter().all(is_seen) { corners } else { Vec::new() }
    }
}

/// The room in which the rig has space to move.
fn room_of(options: &SyntheticOptions) -> Scene {
    let poses: Vec<Motion> = options.cameras.iter().map(|camera| camera.reference_from_camera).collect();
    let radius_m = trajectory::rig_radius_m(&poses).max(options.least_rig_radius_m);
    room::furnished_room(options.seed, radius_m)
}

impl DeviceFactory for SyntheticFactory {
    fn name(&self) -> &'static str {
        "synthetic"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        Ok(self.world.options.cameras.iter().map(|camera| camera.info.clone()).collect())
    }

    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        let cameras = &self.world.options.cameras;
        match cameras.iter().position(|camera| camera.info.serial == serial) {
            Some(index) => Ok(Box::new(SyntheticSource::new(Arc::clone(&self.world), index))),
            None => Err(CaptureError::not_found(serial, &self.list()?)),
        }
    }
}
