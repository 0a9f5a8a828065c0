//! The one integration binary: the library and the programs from outside, one module per subject.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "clippy's leave for tests stops at #[test]"
)]

mod bad_recording;
mod cli;
mod closed_stderr;
mod config;
mod daemon;
mod env;
mod faults;
mod fixture;
mod frame_source;
mod history;
mod ipc;
mod lifting;
mod matching;
mod packaging;
mod paper;
mod pipeline;
mod recovery;
mod replay;
mod scripted;
mod solve;
mod supervision;
mod synthetic_pair;
mod watching;
mod writer;
