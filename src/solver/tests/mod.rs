//! The estimator on rooms of lines with known truth: no images, the noise exactly as the observations say.

mod degenerate;
mod honesty;
mod poses;
pub mod room;
