//! `pelical/<instance>/v3/archive`: the daemon's history, one calibration an answer.

use iceoryx2::prelude::ZeroCopySend;

use super::calibration::CalibrationWire;
use super::parts::FixedText;
use super::{MAX_SENTENCE_BYTES, VERSION, WireError, check_version};
use crate::ipc::message::CalibrationMessage;
use crate::ipc::request::Archived;

const FOUND: u32 = 1;
const NO_OLDER: u32 = 2;
const NOT_KEPT: u32 = 3;

/// A question for an older calibration, in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalArchiveRequestV3")]
pub struct ArchiveRequestWire {
    /// [`VERSION`].
    pub version: u32,
    /// Zero.
    pub reserved: u32,
    /// Asked for is the newest one with a number below this.
    pub below: u64,
}

/// An older calibration in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalArchiveResponseV3")]
pub struct ArchiveResponseWire {
    /// [`VERSION`].
    pub version: u32,
    /// 1 found, 2 there is none, 3 nothing is kept at all.
    pub outcome: u32,
    /// The number that was asked for, as it came.
    pub below: u64,
    /// Zero.
    pub reserved: u32,
    /// Nothing is kept: why.
    pub sentence: FixedText<MAX_SENTENCE_BYTES>,
    /// Found: the calibration; else zeros.
    pub calibration: CalibrationWire,
}

impl ArchiveRequestWire {
    /// The question for the newest calibration with a number below this.
    pub fn new(below: u64) -> Self {
        Self { version: VERSION, reserved: 0, below }
    }

    /// The number, when the question can be read.
    pub fn below(&self) -> Result<u64, WireError> {
        check_version(self.version).map(|()| self.below)
    }
}

impl ArchiveResponseWire {
    /// The answer to `request`.
    pub fn encode(request: &ArchiveRequestWire, answer: &Archived) -> Result<Self, WireError> {
        let mut wire = Self {
            version: VERSION,
            outcome: NO_OLDER,
            below: request.below,
            reserved: 0,
            sentence: FixedText::EMPTY,
            calibration: CalibrationWire::EMPTY,
        };
        match answer {
            Archived::NoOlder => {}
            Archived::NotKept { sentence } => {
                (wire.outcome, wire.sentence) = (NOT_KEPT, FixedText::cut(sentence));
            }
            Archived::Found(message) => {
                (wire.outcome, wire.calibration) = (FOUND, CalibrationWire::try_from(message.as_ref())?);
            }
        }
        Ok(wire)
    }

    /// The answer, when it is one to the question for a number below this.
    pub fn decode(&self, below: u64) -> Result<Archived, WireError> {
        check_version(self.version)?;
        if self.below != below {
            return Err(WireError::Value { field: "archive below", allowed: "that of the request" });
        }
        match self.outcome {
            FOUND => {
                let message = CalibrationMessage::try_from(&self.calibration)?;
                // What is not older would be asked for again and again.
                if message.provenance.id.is_none_or(|id| id >= below) {
                    return Err(WireError::Value { field: "archive id", allowed: "below the one asked for" });
                }
                Ok(Archived::Found(Box::new(message)))
            }
            NO_OLDER => Ok(Archived::NoOlder),
            NOT_KEPT => Ok(Archived::NotKept { sentence: self.sentence.text("archive sentence")? }),
            code => Err(WireError::Code { field: "archive outcome", code }),
        }
    }
}
