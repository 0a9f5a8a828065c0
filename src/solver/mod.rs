//! From lines seen by several cameras to the extrinsics of the rig.

pub mod result;
pub mod rig;

pub use result::*;
pub use rig::{EstimateOptions, RigEstimator};
