//! Parts that several payloads share: bounded text, a reason, a motion, the verdict.

use iceoryx2::prelude::ZeroCopySend;
use nalgebra::{Quaternion, Translation3, UnitQuaternion};

use super::{MAX_SENTENCE_BYTES, WireError, code_of, count, value_of};
use crate::geometry::motion::Motion;
use crate::ipc::message::{FrameSetCounts, RefusedCounts};
use crate::solver::{Reason, ReasonCode, State};

/// How far the norm of a quaternion may be from 1: far above rounding in double precision.
const NORM_TOLERANCE: f64 = 1e-9;

/// Verdicts in the order of the wire format.
const STATES: [State; 6] =
    [State::Collecting, State::Converged, State::Degenerate, State::Ambiguous, State::Failed, State::Stored];

/// UTF-8 text of at most `N` bytes, followed by zeros.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalTextV3")]
pub struct FixedText<const N: usize> {
    /// Bytes in use.
    pub len: u32,
    /// The text.
    pub bytes: [u8; N],
}

impl<const N: usize> FixedText<N> {
    /// No text.
    pub const EMPTY: Self = Self { len: 0, bytes: [0; N] };

    /// The text as it is, or an error where it is too long.
    pub(super) fn exact(field: &'static str, text: &str) -> Result<Self, WireError> {
        if text.len() > N {
            return Err(WireError::Count { field, found: text.len(), limit: N });
        }
        Ok(Self::cut(text))
    }

    /// The text, cut before the character that would not fit.
    pub(super) fn cut(text: &str) -> Self {
        let kept = text.floor_char_boundary(N);
        let mut wire = Self::EMPTY;
        for (to, from) in wire.bytes.iter_mut().zip(text.bytes().take(kept)) {
            *to = from;
        }
        // At most N, which is an array length of this file: it fits.
        wire.len = kept as u32;
        wire
    }

    /// The text, checked.
    pub(super) fn text(&self, field: &'static str) -> Result<String, WireError> {
        let len = count(field, self.len, N)?;
        let bytes = self.bytes.get(..len).unwrap_or_default();
        std::str::from_utf8(bytes).map(str::to_owned).map_err(|_| WireError::Text { field })
    }
}

/// Why something is not converged; code 0 is no reason.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalReasonV3")]
pub struct ReasonWire {
    /// Position in `ReasonCode::ALL` plus 1; 0 for no reason.
    pub code: u32,
    /// The sentence.
    pub sentence: FixedText<MAX_SENTENCE_BYTES>,
}

impl ReasonWire {
    /// No reason.
    pub const NONE: Self = Self { code: 0, sentence: FixedText::EMPTY };

    pub(super) fn encode(reason: Option<&Reason>) -> Self {
        reason.map_or(Self::NONE, |reason| Self {
            code: code_of(&ReasonCode::ALL, &reason.code),
            sentence: FixedText::cut(&reason.sentence),
        })
    }

    pub(super) fn decode(&self, field: &'static str) -> Result<Option<Reason>, WireError> {
        if self.code == 0 {
            return Ok(None);
        }
        let code = value_of(&ReasonCode::ALL, self.code, field)?;
        Ok(Some(Reason { code, sentence: self.sentence.text(field)? }))
    }
}

/// A rigid motion.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalMotionV3")]
pub struct MotionWire {
    /// m.
    pub translation_m: [f64; 3],
    /// Unit quaternion, x y z w.
    pub rotation_xyzw: [f64; 4],
}

impl MotionWire {
    /// Where there is no motion: zeros, which is no rotation either.
    pub const NONE: Self = Self { translation_m: [0.0; 3], rotation_xyzw: [0.0; 4] };

    pub(super) fn encode(motion: &Motion) -> Self {
        Self {
            translation_m: motion.translation.vector.into(),
            rotation_xyzw: motion.rotation.into_inner().coords.into(),
        }
    }

    pub(super) fn decode(&self, field: &'static str) -> Result<Motion, WireError> {
        let quaternion = Quaternion::from(self.rotation_xyzw);
        let is_unit = (quaternion.norm() - 1.0).abs() <= NORM_TOLERANCE;
        if !is_unit || !self.translation_m.iter().all(|x| x.is_finite()) {
            return Err(WireError::Value { field, allowed: "a finite translation and a unit quaternion" });
        }
        // Not normalised again: what was sent comes out to the bit.
        Ok(Motion::from_parts(
            Translation3::from(self.translation_m),
            UnitQuaternion::new_unchecked(quaternion),
        ))
    }
}

/// Position of a verdict in the wire's list, from 1.
pub(super) fn state_code(state: State) -> u32 {
    code_of(&STATES, &state)
}

/// The verdict of a code.
pub(super) fn state_of(code: u32, field: &'static str) -> Result<State, WireError> {
    value_of(&STATES, code, field)
}

/// What became of the frame sets since collecting began.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalFrameSetsV3")]
pub struct FrameSetsWire {
    /// Put together.
    pub seen: u64,
    /// Taken as evidence.
    pub used: u64,
    /// Refused for skew.
    pub refused_skew: u64,
    /// Refused because a gyro said that the rig turned fast.
    pub refused_gyro: u64,
    /// Refused because an image moved fast.
    pub refused_image: u64,
    /// Refused because nothing was new in them.
    pub refused_repeated: u64,
    /// Lost because a stage was busy.
    pub dropped: u64,
}

impl From<FrameSetCounts> for FrameSetsWire {
    fn from(counts: FrameSetCounts) -> Self {
        let FrameSetCounts { seen, used, refused, dropped } = counts;
        Self {
            seen,
            used,
            refused_skew: refused.skew,
            refused_gyro: refused.gyro,
            refused_image: refused.image,
            refused_repeated: refused.repeated,
            dropped,
        }
    }
}

impl From<FrameSetsWire> for FrameSetCounts {
    fn from(wire: FrameSetsWire) -> Self {
        Self {
            seen: wire.seen,
            used: wire.used,
            refused: RefusedCounts {
                skew: wire.refused_skew,
                gyro: wire.refused_gyro,
                image: wire.refused_image,
                repeated: wire.refused_repeated,
            },
            dropped: wire.dropped,
        }
    }
}
