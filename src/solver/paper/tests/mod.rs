//! Scenes that the tests of several steps share.

pub mod scenes;
