//! The outside view over shared memory (iceoryx2): the daemon's side ([`Server`]) and everybody else's ([`Client`]).
//!
//! Per instance of the daemon there are three published topics (calibration, progress, health; the newest of each reaches a late
//! subscriber), two request-response channels (control: status, recalibrate, cancel, rollback; archive: older calibrations) and two
//! events that wake the waiting side. They meet over a [`Transport`]: open shared memory, or files in a folder whose permissions
//! decide who may connect.
//! Plain types of [`message`] and [`request`] go in and come out; the layout in memory is the matter of [`wire`] alone.

pub mod client;
mod file_service;
pub mod message;
pub mod names;
mod ports;
mod remains;
pub mod request;
mod room;
pub mod server;
mod services;
pub mod transport;
pub mod wire;

pub use client::{Client, ClientError};
pub use message::{
    BestPair, CalibrationMessage, CameraHealth, CameraIdentity, CameraLines, CameraState, FrameClock,
    FrameSetCounts, HealthMessage, PairSkew, ProgressMessage, Provenance, RefusedCounts, Skew, StageLatency,
    TurnSense, Turning,
};
pub use names::{InstanceName, InstanceNameError};
pub use request::{Activity, Archived, Outcome, RefusalCode, Request, RequestKind, Response, Snapshot};
pub use server::{Server, ServerError};
pub use transport::{MIN_CLIENT_ROOM_BYTES, MIN_ROOM_BYTES, Transport};
pub use wire::{MAX_CAMERAS, MAX_NAME_BYTES, MAX_PAIRS, MAX_SENTENCE_BYTES, MAX_STAGES, WireError};
