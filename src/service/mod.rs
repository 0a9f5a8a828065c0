//! The daemon's life: configuration, log, state, and the run from start to a clean stop.

pub mod config;
pub mod logging;
