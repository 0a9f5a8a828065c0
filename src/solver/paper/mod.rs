//! The paper's own estimator (sections III-B to III-D, corrected), one step of it a module.

pub mod cgr;
pub mod convergence_vote;
pub mod re3q3;
pub mod translation_candidate;
