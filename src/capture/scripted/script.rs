//! Which fault meets which frame of a camera, by number or by seeded chance.
//!
//! The answer depends on nothing but the script, the serial and the frame's number.

use std::time::Duration;

/// What happens to one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// The frame is lost; the sequence shows it.
    Drop,
    /// Before the frame comes, so many calls wait in vain.
    Stall {
        /// Calls that answer `Timeout`.
        timeouts: u32,
    },
    /// Before the frame comes, the device hangs: the call does not come back for so long, whatever its timeout.
    Hang {
        /// How long.
        duration: Duration,
    },
    /// From this frame on no frame comes, however often the camera is opened, until it is reset.
    Wedge,
    /// From this frame on, the camera's clock is off by so much more.
    StampJump {
        /// ns, either sign.
        by_ns: i64,
    },
    /// From this frame on, the camera's 32-bit clock of microseconds has wrapped.
    ClockWrap,
    /// Not one reading in the depth image.
    ZeroDepth,
    /// The lower half of the colour image is black, as after half a transfer.
    HalfBlack,
    /// The camera goes away with this frame, until it is plugged in again.
    Unplug(Replug),
}

/// When a camera that was unplugged is back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Replug {
    /// After so many vain attempts to open it.
    AfterAttempts(u32),
    /// After this time.
    AfterTime(Duration),
    /// Not any more.
    Never,
}

/// Which faults meet which frames of one camera; empty by default.
#[derive(Debug, Clone, Default)]
pub struct FaultScript {
    seed: u64,
    at: Vec<(u64, Fault)>,
    /// Chance of each frame, 0 to 1.
    by_chance: Vec<(f64, Fault)>,
}

impl FaultScript {
    /// An empty script whose chances will be drawn from this seed.
    pub fn with_seed(seed: u64) -> Self {
        Self { seed, ..Self::default() }
    }

    /// Adds a fault at one frame, counted from 0.
    #[must_use]
    pub fn at(mut self, frame_number: u64, fault: Fault) -> Self {
        self.at.push((frame_number, fault));
        self
    }

    /// Adds a fault that meets each frame with this probability, 0 to 1.
    #[must_use]
    pub fn by_chance(mut self, probability: f64, fault: Fault) -> Self {
        self.by_chance.push((probability, fault));
        self
    }

    /// The faults that meet a frame of a camera, in the order they were added, fixed ones first.
    pub fn faults(&self, serial: &str, frame_number: u64) -> impl Iterator<Item = Fault> {
        let at = self.at.iter().filter(move |(number, _)| *number == frame_number).map(|(_, fault)| *fault);
        let camera = serial.bytes().fold(self.seed, |hash, byte| mixed(hash ^ u64::from(byte)));
        let drawn = self.by_chance.iter().enumerate().filter(move |(rule, (probability, _))| {
            let bits = mixed(mixed(camera ^ frame_number).wrapping_add(*rule as u64));
            // 53 bits fill the mantissa: uniform in 0 to 1.
            (bits >> 11) as f64 / (1u64 << 53) as f64 <= *probability && *probability > 0.0
        });
        at.chain(drawn.map(|(_, (_, fault))| *fault))
    }
}

/// One step of splitmix64: every input bit changes every output bit.
fn mixed(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}
