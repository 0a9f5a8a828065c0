//! From lines seen by several cameras to the extrinsics of the rig.

pub mod appearance;
pub mod association;
mod axes;
pub mod candidates;
pub mod closure;
pub mod consensus;
pub mod evidence;
pub mod free_space;
pub mod joint;
pub mod line_pair;
pub mod matched;
pub mod missing;
pub mod noise;
pub mod pair_graph;
pub mod paper;
pub mod place;
pub mod pnl;
pub mod prior;
pub mod refine;
pub mod residual;
pub mod result;
pub mod retention;
pub mod rig;
pub mod rotation_vote;
pub mod shared_lines;
pub mod sides;
pub mod starts;
pub mod translation_vote;
pub mod verdict;
pub mod watch;

pub use evidence::EvidenceLimits;
pub use line_pair::{LinePair, TargetSide};
pub use result::*;
pub use rig::{EstimateOptions, Estimator, RigCamera, RigEstimator};
pub use verdict::VerdictLimits;
pub use watch::{Moved, Watch, WatchEffort, WatchLimits, WatchReport, Who};

#[cfg(test)]
mod tests;
