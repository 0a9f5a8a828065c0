//! From lines seen by several cameras to the extrinsics of the rig.

pub mod association;
mod axes;
pub mod candidates;
pub mod consensus;
pub mod evidence;
pub mod free_space;
pub mod joint;
pub mod line_pair;
pub mod matched;
pub mod paper;
pub mod refine;
pub mod residual;
pub mod result;
pub mod rig;
pub mod rotation_vote;
pub mod translation_vote;
pub mod verdict;

pub use evidence::EvidenceLimits;
pub use line_pair::{LinePair, TargetSide};
pub use result::*;
pub use rig::{EstimateOptions, RigCamera, RigEstimator};
pub use verdict::VerdictLimits;

#[cfg(test)]
mod tests;
