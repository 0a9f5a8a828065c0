//! The payloads in shared memory: fixed layouts, versioned, readable from any language.
//!
//! Only integers, `f64` and arrays, so that any bytes are a value and nothing of it is trusted: decoding checks versions, lengths,
//! UTF-8, numbers, rotations and covariances, and answers with a [`WireError`]. No padding; unused room is zero. Codes of closed
//! lists start at 1 in the order of their `ALL`, so that zeroed memory is never a value. Encoding decodes what it made: what a
//! reader would refuse is never sent.

mod archive;
mod calibration;
mod control;
mod health;
mod parts;
mod progress;
mod watch;

pub use archive::{ArchiveRequestWire, ArchiveResponseWire};
pub use calibration::{CalibrationWire, CameraWire, PairWire};
pub use control::{RequestWire, ResponseWire};
pub use health::{CameraHealthWire, HealthWire, PairSkewWire, StageWire};
pub use parts::{FixedText, FrameSetsWire, MotionWire, ReasonWire};
pub use progress::{CameraLinesWire, ProgressWire};
pub use watch::{MovedWire, WatchWire};

/// Version of every payload and of the service names.
pub const VERSION: u32 = 3;
/// Most cameras of a rig.
pub const MAX_CAMERAS: usize = 16;
/// Most pairs: every pair of [`MAX_CAMERAS`] cameras once.
pub const MAX_PAIRS: usize = MAX_CAMERAS * (MAX_CAMERAS - 1) / 2;
/// Most moves that are told at a time; of more, the first.
pub const MAX_MOVED: usize = 8;
/// Most stages of the pipeline.
pub const MAX_STAGES: usize = 8;
/// Longest name or serial number, bytes.
pub const MAX_NAME_BYTES: usize = 32;
/// Longest hash, bytes: SHA-256 in hex.
pub const MAX_HASH_BYTES: usize = 64;
/// Longest sentence of a reason, bytes; longer ones are cut.
pub const MAX_SENTENCE_BYTES: usize = 504;

/// A payload that is not one: which field, and what is allowed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WireError {
    /// Written by another version of the program.
    #[error(
        "payload version is {found}, this program reads {VERSION}: use client and daemon of the same release"
    )]
    Version {
        /// Version of the payload.
        found: u32,
    },
    /// A count or an index is beyond its limit.
    #[error("{field} is {found}, allowed are at most {limit}")]
    Count {
        /// Which.
        field: &'static str,
        /// What it was.
        found: usize,
        /// Largest allowed.
        limit: usize,
    },
    /// A code is not in its closed list.
    #[error("{field} has the unknown code {code}")]
    Code {
        /// Which.
        field: &'static str,
        /// What it was.
        code: u32,
    },
    /// A text is not UTF-8.
    #[error("{field} is not UTF-8")]
    Text {
        /// Which.
        field: &'static str,
    },
    /// A number or a group of numbers is outside of what it can mean.
    #[error("{field} must be {allowed}")]
    Value {
        /// Which.
        field: &'static str,
        /// What would be accepted.
        allowed: &'static str,
    },
}

fn check_version(found: u32) -> Result<(), WireError> {
    if found == VERSION { Ok(()) } else { Err(WireError::Version { found }) }
}

/// A count or index as it is used in memory, at most `limit`.
fn count(field: &'static str, found: u32, limit: usize) -> Result<usize, WireError> {
    let found = found as usize;
    if found <= limit { Ok(found) } else { Err(WireError::Count { field, found, limit }) }
}

/// An index below `n`.
fn index(field: &'static str, found: u32, n: usize) -> Result<usize, WireError> {
    let Some(limit) = n.checked_sub(1) else {
        return Err(WireError::Value { field: "cameras", allowed: "at least one" });
    };
    count(field, found, limit)
}

/// The indices of target and source: two of `n` cameras.
fn pair_indices([target, source]: [u32; 2], n: usize) -> Result<(usize, usize), WireError> {
    if target == source {
        return Err(WireError::Value { field: "pair source", allowed: "another camera than the target" });
    }
    Ok((index("pair target", target, n)?, index("pair source", source, n)?))
}

/// A count as it goes on the wire, at most `limit`.
fn count_wire(field: &'static str, found: usize, limit: usize) -> Result<u32, WireError> {
    match u32::try_from(found) {
        Ok(wire) if found <= limit => Ok(wire),
        _ => Err(WireError::Count { field, found, limit }),
    }
}

/// The code of a value of a closed list: its position, from 1. A value that the list lacks gets 0, which no reader takes.
fn code_of<T: PartialEq>(all: &[T], value: &T) -> u32 {
    all.iter().zip(1..).find_map(|(listed, code)| (listed == value).then_some(code)).unwrap_or(0)
}

/// The value with a code of a closed list.
fn value_of<T: Copy>(all: &[T], code: u32, field: &'static str) -> Result<T, WireError> {
    let index = (code as usize).checked_sub(1);
    index.and_then(|i| all.get(i)).copied().ok_or(WireError::Code { field, code })
}

/// A flag: 0 or 1.
fn flag(field: &'static str, code: u32) -> Result<bool, WireError> {
    match code {
        0 => Ok(false),
        1 => Ok(true),
        code => Err(WireError::Code { field, code }),
    }
}

/// A finite number that is not negative.
fn not_negative(field: &'static str, value: f64) -> Result<f64, WireError> {
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(WireError::Value { field, allowed: "a finite number, not negative" })
    }
}

#[cfg(test)]
mod tests;
