//! Whether the rig turned fast when a frame set was taken: by gyro where a camera has one, else by its images. Pure.
//!
//! Colour sensors are not triggered together: in a fast turn the cameras of a set look from different places.

pub mod flow;
#[cfg(test)]
mod tests;

use crate::capture::{StampNs, TurnRate};
use flow::{Glimpse, Thumbnail, image_speed_px_per_s};

/// Limit of the motion test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionOptions {
    /// Sets taken while the rig turns faster than this are not used, rad/s. At 60 deg/s two cameras that are 8 ms apart disagree by
    /// half a degree.
    pub max_turn_rad_per_s: f64,
}

impl Default for MotionOptions {
    fn default() -> Self {
        Self { max_turn_rad_per_s: 60f64.to_radians() }
    }
}

/// What tells how fast a rig turns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TurnSense {
    /// A gyro.
    Gyro,
    /// How far an image moved: a shift of the rig counts as well.
    Image,
}

/// How fast a rig turned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// That of the camera with the largest rate, rad/s.
    pub rad_per_s: f64,
    /// What tells it.
    pub sense: TurnSense,
}

/// One frame of a set, as the test sees it.
#[derive(Debug, Clone, Copy)]
pub struct SeenFrame<'a> {
    /// Index of the camera.
    pub camera: usize,
    /// When the image was taken.
    pub stamp: StampNs,
    /// Mean focal length of the camera, px.
    pub focal_px: f64,
    /// The coarse image.
    pub thumbnail: &'a Thumbnail,
    /// What the camera's gyro says.
    pub turn_rate: Option<TurnRate>,
}

/// The motion test of one rig, and what it remembers of each camera's set before.
#[derive(Debug)]
pub struct MotionTest {
    options: MotionOptions,
    last: Vec<Option<Glimpse>>,
}

impl MotionTest {
    /// Before the first set; allocates all it will ever need.
    pub fn new(n_cameras: usize, options: MotionOptions) -> Self {
        Self { options, last: vec![None; n_cameras] }
    }

    /// How fast the rig turned when this set was taken; `None` where nothing tells. Where any camera has a gyro, images are not asked.
    pub fn turn<'a>(&mut self, set: impl Iterator<Item = SeenFrame<'a>>) -> Option<Turn> {
        let (mut gyro, mut image) = (None, None);
        for frame in set {
            gyro = larger(gyro, frame.turn_rate.map(|rate| rate.max_rad_per_s));
            image = larger(image, self.image_turn(&frame));
        }
        let of = |sense| move |rad_per_s| Turn { rad_per_s, sense };
        gyro.map(of(TurnSense::Gyro)).or(image.map(of(TurnSense::Image)))
    }

    /// What refuses a set that was taken in this turn; `None` where nothing does.
    pub fn refuses(&self, turn: Option<Turn>) -> Option<TurnSense> {
        turn.filter(|turn| turn.rad_per_s > self.options.max_turn_rad_per_s).map(|turn| turn.sense)
    }

    /// The turn that moves the image as far as it moved since the camera's set before.
    fn image_turn(&mut self, frame: &SeenFrame<'_>) -> Option<f64> {
        let now = Glimpse { stamp: frame.stamp, thumbnail: *frame.thumbnail };
        let before = self.last.get_mut(frame.camera)?.replace(now)?;
        image_speed_px_per_s(&before, &now).map(|speed| speed / frame.focal_px)
    }
}

fn larger(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    a.into_iter().chain(b.filter(|rate| !rate.is_nan())).reduce(f64::max)
}
