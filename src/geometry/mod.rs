#![doc = include_str!("../../docs/conventions.md")]

pub mod camera;
pub mod depth_camera;
pub mod line3;
pub mod motion;
pub mod observation;
pub mod scored_match;
pub mod view;

pub use camera::{Camera, CameraError, Distortion, PixelPoint, RayPoint};
pub use depth_camera::DepthCamera;
pub use line3::Line3;
pub use observation::{DepthFit, EdgeSide, LineObservation, Segment};
pub use scored_match::{PairScores, ScoredMatch};
pub use view::{CameraView, SurfaceSample};
