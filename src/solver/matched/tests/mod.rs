//! Matches of lines in rooms with known truth: no images, the noise exactly as the observations say.

mod honesty;
mod poses;
mod scene;
