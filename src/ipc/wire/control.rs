//! `pelical/<instance>/v3/control`: requests and answers.

use iceoryx2::prelude::ZeroCopySend;

use super::parts::{FixedText, FrameSetsWire, ReasonWire, state_code, state_of};
use super::watch::WatchWire;
use super::{
    MAX_CAMERAS, MAX_SENTENCE_BYTES, VERSION, WireError, check_version, code_of, count, flag, value_of,
};
use crate::ipc::request::{Activity, Outcome, RefusalCode, Request, RequestKind, Response, Snapshot};

const ACCEPTED: u32 = 1;
const BUSY: u32 = 2;
const REFUSED: u32 = 3;

/// A request in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalRequestV3")]
pub struct RequestWire {
    /// [`VERSION`].
    pub version: u32,
    /// 1 status, 2 recalibrate, 3 cancel, 4 rollback.
    pub kind: u32,
    /// The client's own number; the answer carries it back.
    pub id: u64,
    /// Rollback: the number of the calibration to go back to.
    pub calibration: u64,
}

/// An answer in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalResponseV3")]
pub struct ResponseWire {
    /// [`VERSION`].
    pub version: u32,
    /// Kind of the request, as it came.
    pub kind: u32,
    /// Number of the request, as it came.
    pub id: u64,
    /// 1 accepted, 2 busy, 3 refused.
    pub outcome: u32,
    /// Refused: 1 nothing to cancel, 2 no cameras, 3 stopping, 4 unreadable, 5 starting, 6 unknown calibration, 7 other rig; else 0.
    pub refusal: u32,
    /// Refused: why.
    pub sentence: FixedText<MAX_SENTENCE_BYTES>,
    /// 1 starting, 2 collecting, 3 watching, 4 idle, 5 stopping.
    pub activity: u32,
    /// Verdict: 1 collecting, 2 converged, 3 degenerate, 4 ambiguous, 5 failed, 6 stored.
    pub state: u32,
    /// Cameras of the rig.
    pub cameras: u32,
    /// Of these, delivering frames.
    pub cameras_streaming: u32,
    /// Zero.
    pub reserved: u32,
    /// The newest published calibration; 0 for none.
    pub calibration_sequence: u64,
    /// Its number in the history; 0 where it is not kept.
    pub calibration_id: u64,
    /// When it was made, ns since 1970; 0 for none.
    pub calibration_stamp_ns: u64,
    /// Since the daemon started, ns.
    pub uptime_ns: u64,
    /// What became of the frame sets.
    pub frame_sets: FrameSetsWire,
    /// Why the verdict is not converged.
    pub reason: ReasonWire,
    /// Whether the converged result still stands.
    pub watch: WatchWire,
    /// 1 where the history cannot be written.
    pub has_store_fault: u32,
    /// Why.
    pub store_fault: FixedText<MAX_SENTENCE_BYTES>,
}

impl From<Request> for RequestWire {
    fn from(request: Request) -> Self {
        let kind = code_of(&RequestKind::ALL, &request.kind);
        Self { version: VERSION, kind, id: request.id, calibration: request.calibration }
    }
}

impl TryFrom<&RequestWire> for Request {
    type Error = WireError;

    fn try_from(wire: &RequestWire) -> Result<Self, WireError> {
        check_version(wire.version)?;
        let kind = value_of(&RequestKind::ALL, wire.kind, "request kind")?;
        Ok(Self { id: wire.id, kind, calibration: wire.calibration })
    }
}

impl ResponseWire {
    /// The answer to `request`, which may be one that could not be read.
    pub fn encode(request: &RequestWire, response: &Response) -> Result<Self, WireError> {
        let (outcome, refusal, sentence) = match &response.outcome {
            Outcome::Accepted => (ACCEPTED, 0, FixedText::EMPTY),
            Outcome::Busy => (BUSY, 0, FixedText::EMPTY),
            Outcome::Refused { code, sentence } => {
                (REFUSED, code_of(&RefusalCode::ALL, code), FixedText::cut(sentence))
            }
        };
        let snapshot = &response.snapshot;
        let wire = Self {
            version: VERSION,
            kind: request.kind,
            id: request.id,
            outcome,
            refusal,
            sentence,
            activity: code_of(&Activity::ALL, &snapshot.activity),
            state: state_code(snapshot.state),
            cameras: snapshot.cameras,
            cameras_streaming: snapshot.cameras_streaming,
            reserved: 0,
            calibration_sequence: snapshot.calibration_sequence,
            calibration_id: snapshot.calibration_id.unwrap_or(0),
            calibration_stamp_ns: snapshot.calibration_stamp_ns.unwrap_or(0),
            uptime_ns: snapshot.uptime_ns,
            frame_sets: snapshot.frame_sets.into(),
            reason: ReasonWire::encode(snapshot.reason.as_ref()),
            watch: WatchWire::encode(snapshot.watch.as_ref())?,
            has_store_fault: u32::from(snapshot.store_fault.is_some()),
            store_fault: FixedText::cut(snapshot.store_fault.as_deref().unwrap_or("")),
        };
        wire.snapshot()?;
        Ok(wire)
    }

    /// The answer, when it is one to `request`.
    pub fn decode(&self, request: Request) -> Result<Response, WireError> {
        check_version(self.version)?;
        if (self.id, self.kind) != (request.id, code_of(&RequestKind::ALL, &request.kind)) {
            return Err(WireError::Value { field: "response id", allowed: "that of the request" });
        }
        let outcome = match self.outcome {
            ACCEPTED => Outcome::Accepted,
            BUSY => Outcome::Busy,
            REFUSED => Outcome::Refused {
                code: value_of(&RefusalCode::ALL, self.refusal, "refusal")?,
                sentence: self.sentence.text("refusal sentence")?,
            },
            code => return Err(WireError::Code { field: "outcome", code }),
        };
        Ok(Response { outcome, snapshot: self.snapshot()? })
    }

    fn snapshot(&self) -> Result<Snapshot, WireError> {
        let cameras = count("cameras", self.cameras, MAX_CAMERAS)?;
        count("cameras_streaming", self.cameras_streaming, cameras)?;
        let has_fault = flag("has_store_fault", self.has_store_fault)?;
        let store_fault = has_fault.then(|| self.store_fault.text("store fault")).transpose()?;
        Ok(Snapshot {
            activity: value_of(&Activity::ALL, self.activity, "activity")?,
            state: state_of(self.state, "state")?,
            reason: self.reason.decode("reason")?,
            watch: self.watch.decode()?,
            calibration_sequence: self.calibration_sequence,
            calibration_id: Some(self.calibration_id).filter(|id| *id > 0),
            calibration_stamp_ns: Some(self.calibration_stamp_ns).filter(|stamp_ns| *stamp_ns > 0),
            store_fault,
            uptime_ns: self.uptime_ns,
            frame_sets: self.frame_sets.into(),
            cameras: self.cameras,
            cameras_streaming: self.cameras_streaming,
        })
    }
}
