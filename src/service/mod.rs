//! The daemon's life: configuration, log, state, and the run from start to a clean stop.

pub mod config;
mod daemon;
mod error;
pub mod logging;
mod state;
mod stop;
mod telling;

pub use daemon::{StopCause, run};
pub use error::ServiceError;
pub use stop::Stop;
