//! Scenes that the tests of several steps share, and what the whole estimator makes of degenerate ones.

mod degenerate;
pub mod scenes;
