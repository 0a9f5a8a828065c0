//! The paper's own estimator (sections III-B to III-D, corrected), one step of it a module; [`solve_pairs`] is all of it.

pub mod cgr;
pub mod convergence_vote;
pub mod estimator;
pub mod gate;
pub mod hypotheses;
pub mod options;
pub mod outcome;
pub mod pair_geometry;
pub mod quadratic;
pub mod re3q3;
pub mod refine;
pub mod rotation_roots;
pub mod translation_candidate;

pub use estimator::solve_pairs;
pub use options::PaperOptions;
pub use outcome::{PaperOutcome, PaperSolution};

#[cfg(test)]
mod tests;
