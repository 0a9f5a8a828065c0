//! What a synthetic rig can be told, and two ready-made rigs.

use std::time::Duration;

use nalgebra::{Translation3, UnitQuaternion, Vector3};

use super::board::Checkerboard;
use super::random::Random;
use super::trajectory::RigCamera;
use crate::capture::CameraInfo;
use crate::geometry::camera::Pinhole;
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, Distortion};

/// What a rendered camera gives for its firmware.
const FIRMWARE: &str = "synthetic-1";

/// Noise of the pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Noise {
    /// Exact depth (rounded to its unit) and clean colour.
    Off,
    /// Colour and depth noise of the D435i class.
    D435i {
        /// Standard deviation of the disparity, px; 0.08 to 0.12 for real cameras.
        disparity_sigma_px: f64,
    },
}

/// How fast frames come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pace {
    /// One frame per period; who asks late loses frames, as with a real camera.
    RealTime,
    /// As fast as they are asked for; none is lost.
    Unpaced,
}

/// One camera of the rig.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticCamera {
    /// Name, serial, intrinsics, depth unit.
    pub info: CameraInfo,
    /// The exact pose in the rig.
    pub reference_from_camera: Motion,
}

impl SyntheticCamera {
    pub(super) fn rig_camera(&self) -> RigCamera {
        RigCamera { camera: self.info.camera, reference_from_camera: self.reference_from_camera }
    }
}

/// A camera of the rig is knocked: from a frame on it stands elsewhere.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraMove {
    /// Index of the camera.
    pub camera: usize,
    /// The first frame set for which it stands there.
    pub at_frame: u64,
    /// Its new frame in its old one; several moves of a camera add up.
    pub before_from_after: Motion,
}

impl CameraMove {
    /// A move by so much along the camera's own axes and a turn by pitch, yaw and roll.
    pub fn by((camera, at_frame): (usize, u64), by_m: [f64; 3], turn_deg: [f64; 3]) -> Self {
        Self { camera, at_frame, before_from_after: pose(by_m, turn_deg) }
    }
}

/// A rig, its room and its motion.
#[derive(Debug, Clone, PartialEq)]
pub struct SyntheticOptions {
    /// Decides the room, the path and the noise.
    pub seed: u64,
    /// The rig; the first is usually the reference.
    pub cameras: Vec<SyntheticCamera>,
    /// What is moved in the rig on the way.
    pub moves: Vec<CameraMove>,
    /// Noise of the pictures.
    pub noise: Noise,
    /// How fast frames come.
    pub pace: Pace,
    /// Between two stamps.
    pub period: Duration,
    /// Draws the noise of the frames; `None` takes `seed`. Another one gives the same pictures with other noise.
    pub noise_seed: Option<u64>,
    /// The room is laid out for a rig of at least this radius, m, so that rigs of different sizes can stand in the same room.
    pub least_rig_radius_m: f64,
    /// A checkerboard for the rig to look at, in place of the path through the room.
    pub board: Option<Checkerboard>,
    /// Frame sets until the end of the stream; `None` is endless.
    pub frame_sets: Option<u64>,
    /// Key poses of the path that lie between two views: 1 jumps from aimed pose to aimed pose, 0.01 moves
    /// smoothly. A lap has 64 key poses; the next lap repeats the views with other noise.
    pub view_step: f64,
    /// Frame sets for which the rig stands still at each view (step and stop); 1 changes the view with every frame.
    pub frames_per_view: u64,
    /// Frames rendered when a camera is opened and then repeated with rising stamps, so that rendering costs nothing while
    /// frames are taken; `None` renders each frame when it is asked for.
    pub render_ahead: Option<usize>,
    /// Whether the cameras have a gyro: each frame then says how fast the rig turned since the one before.
    pub has_gyro: bool,
    /// Whether the cameras have an accelerometer: each frame then says where up is, as if the rig stood still at each of its poses.
    pub has_accel: bool,
}

impl SyntheticOptions {
    /// A rig of the given cameras with the defaults of all other options: every frame set another aimed view, D435i noise,
    /// unpaced and endless.
    pub fn new(seed: u64, cameras: Vec<SyntheticCamera>) -> Self {
        Self {
            seed,
            cameras,
            moves: Vec::new(),
            noise: Noise::D435i { disparity_sigma_px: 0.1 },
            pace: Pace::Unpaced,
            period: Duration::from_nanos(33_333_333),
            noise_seed: None,
            least_rig_radius_m: 0.0,
            board: None,
            frame_sets: None,
            view_step: 1.0,
            frames_per_view: 1,
            render_ahead: None,
            has_gyro: false,
            has_accel: false,
        }
    }

    /// Three cameras on a small robot: front, left and right, which hardly overlap.
    pub fn demo() -> Self {
        let seed = 20_240_513;
        let poses = [
            ("front", [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
            ("left", [-0.1473, 0.0127, -0.0912], [3.4, -62.7, -2.1]),
            ("right", [0.1386, -0.0214, -0.0835], [-2.6, 64.9, 3.8]),
        ];
        let cameras = poses
            .iter()
            .zip(1..)
            .map(|((name, at_m, turn_deg), number)| camera((name, number), seed, pose(*at_m, *turn_deg)));
        Self::new(seed, cameras.collect())
    }

    /// Two cameras: the right one looks exactly `yaw_deg` further to the right and stands exactly `baseline_m` along x, as
    /// on the paper's rig with protractor and ruler.
    pub fn exact_pair(yaw_deg: f64, baseline_m: f64, seed: u64) -> Self {
        let right = pose([baseline_m, 0.0, 0.0], [0.0, yaw_deg, 0.0]);
        let left = camera(("left", 1), seed, Motion::identity());
        Self::new(seed, vec![left, camera(("right", 2), seed, right)])
    }

    /// Two cameras: the right one looks `yaw_deg` further to the right, `baseline_m` along x, plus a mount's inaccuracy.
    pub fn pair(yaw_deg: f64, baseline_m: f64, seed: u64) -> Self {
        let mut random = Random::keyed(seed, &[0x9A12]);
        let mut scatter =
            |size: f64| std::array::from_fn::<f64, 3, _>(|_| size * f64::from(random.gaussian()));
        let (shift_m, turn_deg) = (scatter(0.005), scatter(0.8));
        let at_m = [baseline_m + shift_m[0], shift_m[1], shift_m[2]];
        let right = pose(at_m, [turn_deg[0], yaw_deg + turn_deg[1], turn_deg[2]]);
        Self::new(
            seed,
            vec![camera(("left", 1), seed, Motion::identity()), camera(("right", 2), seed, right)],
        )
    }
}

/// `reference_from_camera` from a place and pitch, yaw and roll about the optical axes x, y and z.
fn pose(at_m: [f64; 3], turn_deg: [f64; 3]) -> Motion {
    let [pitch, yaw, roll] = turn_deg.map(f64::to_radians);
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), yaw)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), pitch)
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), roll);
    Motion::from_parts(Translation3::from(Vector3::from(at_m)), rotation)
}

/// A 640 x 480 camera with slightly different intrinsics for each number.
fn camera((name, number): (&str, u64), seed: u64, reference_from_camera: Motion) -> SyntheticCamera {
    let mut random = Random::keyed(seed, &[0xCA3E4A, number]);
    let fx_px = random.between(601.0, 610.0);
    let pinhole = Pinhole {
        fx_px,
        fy_px: fx_px * random.between(0.998, 1.002),
        cx_px: random.between(316.5, 323.5),
        cy_px: random.between(240.0, 246.0),
    };
    #[allow(clippy::expect_used, reason = "the ranges above are all valid intrinsics")]
    let camera = Camera::try_new((640, 480), pinhole, Distortion::None).expect("valid intrinsics");
    let info = CameraInfo {
        name: name.to_owned(),
        serial: format!("synthetic-{number:02}"),
        camera,
        depth_camera: None,
        depth_unit_m: 0.001,
        firmware: Some(FIRMWARE.to_owned()),
    };
    SyntheticCamera { info, reference_from_camera }
}
