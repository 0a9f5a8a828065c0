//! What a client may ask the daemon, and what the daemon answers.

use super::message::{CalibrationMessage, FrameSetCounts};
use crate::solver::{Reason, State, WatchReport};

/// What is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RequestKind {
    /// How are you? Always accepted; the answer is in the snapshot.
    Status,
    /// Forget the evidence and calibrate again.
    Recalibrate,
    /// Stop the running calibration and keep the last result.
    Cancel,
    /// Go back to an older calibration of the history.
    Rollback,
}

impl RequestKind {
    /// Every kind, in the order of the wire format.
    pub const ALL: [RequestKind; 4] =
        [RequestKind::Status, RequestKind::Recalibrate, RequestKind::Cancel, RequestKind::Rollback];
}

/// A client's request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Request {
    /// Counts the requests of one client; the answer carries it back.
    pub id: u64,
    /// What is asked.
    pub kind: RequestKind,
    /// Rollback: the number of the calibration to go back to. Not looked at for other kinds.
    pub calibration: u64,
}

/// The answer to the question for an older calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum Archived {
    /// The newest one below the number that was asked for.
    Found(Box<CalibrationMessage>),
    /// There is no older one.
    NoOlder,
    /// No history is kept.
    NotKept {
        /// Why, and what to do.
        sentence: String,
    },
}

/// The daemon's answer.
#[derive(Debug, Clone, PartialEq)]
pub struct Response {
    /// Whether it does what was asked.
    pub outcome: Outcome,
    /// How the daemon is at that moment.
    pub snapshot: Snapshot,
}

/// Whether the daemon does what was asked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    /// It does (or has done) it.
    Accepted,
    /// It is at it already: a calibration runs.
    Busy,
    /// It does not.
    Refused {
        /// Which of the closed list.
        code: RefusalCode,
        /// One sentence: why, and what to do.
        sentence: String,
    },
}

/// Why a request is refused: a closed list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RefusalCode {
    /// Nothing runs that could be cancelled.
    NothingToCancel,
    /// Fewer than two cameras deliver frames.
    NoCameras,
    /// The daemon is about to stop.
    Stopping,
    /// The request could not be read: another version, or damaged.
    Unreadable,
    /// The cameras are still being opened.
    Starting,
    /// The history has no calibration of this number.
    UnknownCalibration,
    /// That calibration is of other cameras, or in another camera's frame.
    OtherRig,
}

impl RefusalCode {
    /// Every code, in the order of the wire format.
    pub const ALL: [RefusalCode; 7] = [
        RefusalCode::NothingToCancel,
        RefusalCode::NoCameras,
        RefusalCode::Stopping,
        RefusalCode::Unreadable,
        RefusalCode::Starting,
        RefusalCode::UnknownCalibration,
        RefusalCode::OtherRig,
    ];

    /// The name in output.
    pub fn name(self) -> &'static str {
        match self {
            RefusalCode::NothingToCancel => "nothing_to_cancel",
            RefusalCode::NoCameras => "no_cameras",
            RefusalCode::Stopping => "stopping",
            RefusalCode::Unreadable => "unreadable",
            RefusalCode::Starting => "starting",
            RefusalCode::UnknownCalibration => "unknown_calibration",
            RefusalCode::OtherRig => "other_rig",
        }
    }
}

/// How the daemon is at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// What it does.
    pub activity: Activity,
    /// The verdict of the newest calibration, or of collecting so far.
    pub state: State,
    /// Why that is not converged.
    pub reason: Option<Reason>,
    /// Whether the converged result still stands; `None` while there is none.
    pub watch: Option<WatchReport>,
    /// The newest published calibration; 0 before the first.
    pub calibration_sequence: u64,
    /// Its number in the history; `None` where it is not kept.
    pub calibration_id: Option<u64>,
    /// When it was made, ns since 1970; `None` before the first.
    pub calibration_stamp_ns: Option<u64>,
    /// Why the history cannot be written at present; `None` while it can, or none is kept.
    pub store_fault: Option<String>,
    /// Since the daemon started, ns.
    pub uptime_ns: u64,
    /// What became of the frame sets since collecting began.
    pub frame_sets: FrameSetCounts,
    /// Cameras of the rig.
    pub cameras: u32,
    /// Of these, delivering frames.
    pub cameras_streaming: u32,
}

/// What the daemon does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activity {
    /// Opens its cameras.
    Starting,
    /// Collects evidence for a calibration.
    Collecting,
    /// Has a converged result, and compares it with what the cameras see.
    Watching,
    /// Waits for a request: the last calibration was cancelled.
    Idle,
    /// Is about to end.
    Stopping,
}

impl Activity {
    /// Every activity, in the order of the wire format.
    pub const ALL: [Activity; 5] =
        [Activity::Starting, Activity::Collecting, Activity::Watching, Activity::Idle, Activity::Stopping];

    /// The name in output.
    pub fn name(self) -> &'static str {
        match self {
            Activity::Starting => "starting",
            Activity::Collecting => "collecting",
            Activity::Watching => "watching",
            Activity::Idle => "idle",
            Activity::Stopping => "stopping",
        }
    }
}
