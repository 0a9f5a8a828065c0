//! Targetless extrinsic calibration of RGB-D cameras that hardly overlap, from straight edges that run through two views
//! ("penetrating lines"; PeLiCal, ICRA 2024).
//!
//! Modules in reading order: [`geometry`], [`image`], [`lines`] and [`solver`] are pure; [`capture`] reads cameras,
//! [`pipeline`] runs the threads, [`ipc`] shows the result to other processes, [`service`] is the daemon, [`cli`] the client.

pub mod capture;
pub mod cli;
pub mod geometry;
pub mod image;
pub mod ipc;
pub mod lines;
pub mod pipeline;
pub mod service;
pub mod solver;
