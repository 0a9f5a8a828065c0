//! The synthetic back end: a ray-cast furnished room with textures, a moving rig of any number of cameras, exact truth, and
//! colour and depth noise of the D435i class.
//!
//! Everything follows from the options and the seed: which camera is opened first, on which thread, and how often changes
//! no bit of any frame.

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

pub use options::{CameraMove, Noise, Pace, SyntheticCamera, SyntheticOptions};

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
        let poses: Vec<Motion> = options.cameras.iter().map(|camera| camera.reference_from_camera).collect();
        let scene = room::furnished_room(options.seed, trajectory::rig_radius_m(&poses));
        let rig: Vec<RigCamera> = options.cameras.iter().map(SyntheticCamera::rig_camera).collect();
        let trajectory = Trajectory::plan(&scene, &rig, options.seed);
        Self { world: Arc::new(World { options, scene, trajectory, epoch: OnceLock::new() }) }
    }

    /// The exact `reference_from_camera` of every camera, in the order of [`DeviceFactory::list`], before any move.
    pub fn truth(&self) -> Vec<Motion> {
        self.world.options.cameras.iter().map(|camera| camera.reference_from_camera).collect()
    }
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
