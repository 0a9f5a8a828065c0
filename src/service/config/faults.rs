//! The section `cameras.faults`: what cameras shall suffer on purpose, so that an installation can be tried before it matters.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::error::Refusal;
use super::serial::Serial;
use crate::capture::scripted::{Fault, FaultScript, Replug};
use crate::pipeline::FRAME_TIMEOUT;

/// Longest stall or absence, s.
const MAX_FOR_S: f64 = 86_400.0;
/// Largest jump of a clock, ms: a day.
const MAX_BY_MS: f64 = 86_400_000.0;

/// `cameras.faults`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct FaultsSection {
    /// Seed of the chances.
    pub seed: u64,
    /// The faults; empty plays none.
    pub list: Vec<FaultEntry>,
}

/// One fault of one camera: at one frame, or by chance at any.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, expecting = "a fault: {serial: \"...\", fault: ..., at_frame: ...}")]
pub struct FaultEntry {
    /// Serial number of the camera.
    pub serial: Serial,
    /// What happens.
    pub fault: FaultKind,
    /// At which frame, counted from 0.
    #[serde(default)]
    pub at_frame: Option<u64>,
    /// With which probability at each frame.
    #[serde(default)]
    pub chance: Option<f64>,
    /// How long a stall, a hang or an absence lasts; without it a camera that is unplugged or hangs does so for good.
    #[serde(default)]
    pub for_s: Option<f64>,
    /// By how much the camera's clock jumps, ms, either sign.
    #[serde(default)]
    pub by_ms: Option<f64>,
}

/// What can happen to a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The frame is lost.
    Drop,
    /// No frame comes for some time.
    Stall,
    /// The device hangs: no call comes back.
    Hang,
    /// No frame comes until the camera is reset.
    Wedge,
    /// The camera goes away.
    Unplug,
    /// No depth in the frame.
    ZeroDepth,
    /// Half of the picture is black.
    HalfBlack,
    /// The camera's clock starts again.
    ClockWrap,
    /// The camera's clock is off by so much more from now on.
    StampJump,
}

/// The script of each camera that has one, by serial number.
///
/// # Errors
/// Names the first value that is not allowed.
pub(super) fn scripts(section: &FaultsSection) -> Result<BTreeMap<String, FaultScript>, Refusal> {
    let mut scripts = BTreeMap::new();
    for (index, entry) in section.list.iter().enumerate() {
        let refusal =
            |(key, what): (&str, String)| Refusal::new(format!("cameras.faults.list[{index}].{key}"), what);
        entry.check().map_err(refusal)?;
        let script: &mut FaultScript =
            scripts.entry(entry.serial.0.clone()).or_insert_with(|| FaultScript::with_seed(section.seed));
        let (before, fault) = (std::mem::take(script), entry.played());
        *script = match (entry.at_frame, entry.chance) {
            (Some(number), None) => before.at(number, fault),
            (None, Some(chance)) if (0.0..=1.0).contains(&chance) => before.by_chance(chance, fault),
            (None, Some(chance)) => {
                return Err(refusal(("chance", format!("{chance} is out of range: allowed is 0 to 1"))));
            }
            _ => return Err(refusal(("fault", "needs either at_frame or chance".to_owned()))),
        };
    }
    Ok(scripts)
}

impl FaultEntry {
    /// The first key with a value that is not allowed, and what is.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let for_s = self.for_s.unwrap_or(1.0);
        if !(0.001..=MAX_FOR_S).contains(&for_s) {
            let what = format!("{for_s} is out of range: allowed is 0.001 to {MAX_FOR_S}");
            return Err(("for_s", what));
        }
        let is_jump = self.fault == FaultKind::StampJump;
        if is_jump != self.by_ms.is_some() {
            return Err(("by_ms", "stamp_jump needs it, and no other fault has it".to_owned()));
        }
        let by_ms = self.by_ms.unwrap_or(0.0);
        if !(-MAX_BY_MS..=MAX_BY_MS).contains(&by_ms) {
            let what = format!("{by_ms} is out of range: allowed is -{MAX_BY_MS} to {MAX_BY_MS}");
            return Err(("by_ms", what));
        }
        Ok(())
    }

    fn played(&self) -> Fault {
        let duration = self.for_s.map(Duration::from_secs_f64);
        match self.fault {
            FaultKind::Drop => Fault::Drop,
            FaultKind::Stall => {
                let calls =
                    duration.unwrap_or(Duration::from_secs(1)).as_secs_f64() / FRAME_TIMEOUT.as_secs_f64();
                Fault::Stall { timeouts: calls.ceil() as u32 }
            }
            FaultKind::Hang => {
                Fault::Hang { duration: duration.unwrap_or(Duration::from_secs_f64(MAX_FOR_S)) }
            }
            FaultKind::Wedge => Fault::Wedge,
            FaultKind::Unplug => Fault::Unplug(duration.map_or(Replug::Never, Replug::AfterTime)),
            FaultKind::ZeroDepth => Fault::ZeroDepth,
            FaultKind::HalfBlack => Fault::HalfBlack,
            FaultKind::ClockWrap => Fault::ClockWrap,
            FaultKind::StampJump => Fault::StampJump { by_ns: (self.by_ms.unwrap_or(0.0) * 1e6) as i64 },
        }
    }
}
