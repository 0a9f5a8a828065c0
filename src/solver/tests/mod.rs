//! The estimator on rooms of lines with known truth: no images, the noise exactly as the observations say.

mod closure;
mod degenerate;
mod honesty;
mod poses;
mod prior;
mod retention;
mod rigs;
pub mod room;
mod watch;
