//! Targetless extrinsic calibration of RGB-D cameras that hardly overlap, from straight edges that run through two views
//! ("penetrating lines"; PeLiCal, ICRA 2024).
//!
//! The programs `pelicald` (daemon) and `pelical` (client) are thin shells of this library. It can be used in two ways.
//!
//! # A recording, without a daemon
//!
//! ```no_run
//! use pelical::capture::recording::Recording;
//! use pelical::pipeline::PipelineOptions;
//! use pelical::pipeline::offline::{RecordedSets, run_offline};
//!
//! let recording = Recording::open("my_recording".as_ref())?;
//! let mut sets = RecordedSets::new(&recording);
//! let rig = sets.rig();
//! let run = run_offline(&mut sets, &rig, &PipelineOptions::default(), &mut |_| {})?;
//! println!("{}", run.calibration.state.name());
//! for (info, pose) in recording.cameras().iter().zip(&run.calibration.cameras) {
//!     println!("{}: {:?}", info.name, pose.as_ref().map(|pose| pose.reference_from_camera));
//! }
//! # Ok::<(), pelical::capture::CaptureError>(())
//! ```
//!
//! # A running daemon, from another process
//!
//! ```no_run
//! use std::time::Duration;
//!
//! use pelical::ipc::{Client, InstanceName};
//!
//! let mut client = Client::connect(&InstanceName::default())?;
//! while let Some(message) = client.wait_calibration(Duration::from_secs(60))? {
//!     println!("calibration {}: {}", message.sequence, message.calibration.state.name());
//! }
//! # Ok::<(), pelical::ipc::ClientError>(())
//! ```
//!
//! A pose is trustworthy when its calibration's state is [`solver::State::Converged`], and only then; [`solver::State::Stored`] is one
//! of an earlier run that live lines have not confirmed yet; else the [reason](solver::Reason) says what is missing. Frames, units and names are those of [`geometry`].
//!
//! # Modules, in reading order
//!
//! - [`geometry`]: points, lines, cameras, motions. [`image`]: views of pixels. [`lines`]: from images to 3D lines. [`solver`]:
//!   from lines of several cameras to the extrinsics of the rig, with a verdict. These four are pure: no file, clock or thread.
//! - [`learned`]: which lines of two images are one edge, by networks in ONNX Runtime where that is installed.
//! - [`capture`]: cameras and recordings. [`pipeline`]: the threads of the live run, and the offline run.
//! - [`ipc`]: the result in shared memory, for other processes. [`store`]: accepted results on disk. [`service`]: the daemon's life and config. [`cli`]: the client.

pub mod capture;
pub mod cli;
pub mod geometry;
pub mod image;
pub mod ipc;
pub mod learned;
pub mod lines;
pub mod pipeline;
pub mod service;
pub mod solver;
pub mod store;
#[cfg(test)]
mod tests;
