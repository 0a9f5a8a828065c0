//! A matched pair of lines: what both cameras saw of (supposedly) the same straight edge, in the paper's two cases.

use super::evidence::EvidenceLine;
use crate::geometry::LineObservation;

/// What the target camera saw.
#[derive(Debug, Clone, PartialEq)]
// Most pairs are full: boxing them would cost more than the smaller case wastes.
#[allow(clippy::large_enum_variant)]
pub enum TargetSide {
    /// A lifted line: the full 3D case (paper, III-B.1).
    Full(EvidenceLine),
    /// A segment without depth: the PnL case (paper, III-B.2).
    Pnl(LineObservation),
}

/// A source line with what the target saw of it. Wrong matches are to be expected.
#[derive(Debug, Clone, PartialEq)]
pub struct LinePair {
    /// In the target camera.
    pub target: TargetSide,
    /// In the source camera.
    pub source: EvidenceLine,
    /// The frame set it was seen in: lines of one set share a rig view.
    pub set: u32,
}

impl LinePair {
    /// Classifies a match by what is lifted; `None` when the source is not (such pairs constrain nothing this way round).
    pub fn try_new(target: &LineObservation, source: &LineObservation, set: u32) -> Option<Self> {
        let source = EvidenceLine::try_new(source)?;
        let target = match EvidenceLine::try_new(target) {
            Some(lifted) => TargetSide::Full(lifted),
            None => TargetSide::Pnl(*target),
        };
        Some(Self { target, source, set })
    }

    /// The target line where it is lifted.
    pub fn full_target(&self) -> Option<&EvidenceLine> {
        match &self.target {
            TargetSide::Full(line) => Some(line),
            TargetSide::Pnl(_) => None,
        }
    }

    /// What the target camera measured, lifted or not.
    pub fn target_observation(&self) -> &LineObservation {
        match &self.target {
            TargetSide::Full(line) => &line.observation,
            TargetSide::Pnl(observation) => observation,
        }
    }
}
