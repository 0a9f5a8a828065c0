//! Black-box tests: one binary, so that there is one link step.

mod cli;
mod config;
mod daemon;
mod env;
mod pipeline;
