//! The one integration binary: the library and the programs from outside, one module per subject.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "clippy's leave for tests stops at #[test]"
)]

mod bad_bags;
mod bad_recording;
mod bag_bytes;
mod bags;
mod cli;
mod closed_stderr;
mod config;
mod daemon;
mod doctor;
mod env;
mod faults;
mod fixture;
mod frame_source;
mod fuzz_bag;
mod history;
#[path = "../../src/tests/hostile.rs"]
#[expect(dead_code, reason = "the library's own tests, whose file it is, use all of it")]
mod hostile;
mod ipc;
mod lifting;
mod matching;
mod motion_gate;
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
