//! The client's commands.

pub mod args;
pub mod exit;
pub mod output;
