//! `pelical/<instance>/v3/health`: how the daemon and its cameras are.

use iceoryx2::prelude::ZeroCopySend;

use super::parts::FixedText;
use super::watch::WatchWire;
use super::{
    MAX_CAMERAS, MAX_NAME_BYTES, MAX_PAIRS, MAX_STAGES, VERSION, WireError, check_version, code_of, count,
    count_wire, not_negative, pair_indices, value_of,
};
use crate::ipc::message::{CameraHealth, CameraState, FrameClock, HealthMessage, PairSkew, StageLatency};

/// Share of depth, or angle to gravity, that is not known.
const UNKNOWN: f64 = -1.0;
/// Age of the last frame of a camera that never sent one.
const NEVER_NS: u64 = u64::MAX;

/// How the daemon and its cameras are, in shared memory.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalHealthV3")]
pub struct HealthWire {
    /// [`VERSION`].
    pub version: u32,
    /// Cameras in use.
    pub n_cameras: u32,
    /// Stages in use.
    pub n_stages: u32,
    /// Pairs in use.
    pub n_pairs: u32,
    /// Counts the health messages of this daemon, from 1.
    pub sequence: u64,
    /// Since the daemon started, ns.
    pub uptime_ns: u64,
    /// How the result stands.
    pub watch: WatchWire,
    /// The cameras.
    pub cameras: [CameraHealthWire; MAX_CAMERAS],
    /// The stages.
    pub stages: [StageWire; MAX_STAGES],
    /// The pairs of cameras.
    pub pair_skews: [PairSkewWire; MAX_PAIRS],
}

/// How far apart the frames of two cameras are.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalPairSkewV3")]
pub struct PairSkewWire {
    /// Index of the first camera.
    pub first: u32,
    /// Index of the second camera.
    pub second: u32,
    /// Frame sets that both are in.
    pub sets: u64,
    /// ns.
    pub p50_ns: u64,
    /// ns.
    pub p99_ns: u64,
    /// ns.
    pub max_ns: u64,
    /// How often the nearest frames were further apart than the limit.
    pub beyond: u64,
    /// How far the last time, ns.
    pub last_beyond_ns: u64,
}

/// How one camera is.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, ZeroCopySend)]
#[type_name("PelicalCameraHealthV3")]
pub struct CameraHealthWire {
    /// Name from the config.
    pub name: FixedText<MAX_NAME_BYTES>,
    /// 1 waiting, 2 streaming, 3 stalled, 4 unplugged, 5 failed, 6 ended.
    pub state: u32,
    /// Frames it delivered.
    pub frames: u64,
    /// Frames dropped.
    pub dropped: u64,
    /// How long ago its last frame came, ns; the largest number for never.
    pub last_frame_age_ns: u64,
    /// Frames per second.
    pub fps_hz: f64,
    /// Frames that were numbered and never came.
    pub lost: u64,
    /// Damaged frames.
    pub bad: u64,
    /// Share of the depth image with a reading; below 0 for unknown.
    pub valid_depth: f64,
    /// 0 unknown, 1 source, 2 device, 3 translated, 4 host.
    pub clock: u32,
    /// Zero.
    pub reserved: u32,
    /// Between up here and up in the reference camera, deg, 0 to 180; -1 for unknown.
    pub gravity_off_deg: f64,
}

/// How long one stage takes.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, ZeroCopySend)]
#[type_name("PelicalStageV3")]
pub struct StageWire {
    /// Name of the stage.
    pub stage: FixedText<MAX_NAME_BYTES>,
    /// Zero.
    pub reserved: u32,
    /// ns.
    pub p50_ns: u64,
    /// ns.
    pub p99_ns: u64,
    /// ns.
    pub total_ns: u64,
}

const NO_CAMERA: CameraHealthWire = CameraHealthWire {
    name: FixedText::EMPTY,
    state: 0,
    frames: 0,
    dropped: 0,
    last_frame_age_ns: 0,
    fps_hz: 0.0,
    lost: 0,
    bad: 0,
    valid_depth: UNKNOWN,
    clock: 0,
    reserved: 0,
    gravity_off_deg: UNKNOWN,
};

const NO_STAGE: StageWire =
    StageWire { stage: FixedText::EMPTY, reserved: 0, p50_ns: 0, p99_ns: 0, total_ns: 0 };

const NO_PAIR: PairSkewWire = PairSkewWire {
    first: 0,
    second: 0,
    sets: 0,
    p50_ns: 0,
    p99_ns: 0,
    max_ns: 0,
    beyond: 0,
    last_beyond_ns: 0,
};

impl TryFrom<&HealthMessage> for HealthWire {
    type Error = WireError;

    fn try_from(message: &HealthMessage) -> Result<Self, WireError> {
        let mut wire = HealthWire {
            version: VERSION,
            n_cameras: count_wire("cameras", message.cameras.len(), MAX_CAMERAS)?,
            n_stages: count_wire("stages", message.stages.len(), MAX_STAGES)?,
            n_pairs: count_wire("pairs", message.pair_skews.len(), MAX_PAIRS)?,
            sequence: message.sequence,
            uptime_ns: message.uptime_ns,
            watch: WatchWire::encode(message.watch.as_ref())?,
            cameras: [NO_CAMERA; MAX_CAMERAS],
            stages: [NO_STAGE; MAX_STAGES],
            pair_skews: [NO_PAIR; MAX_PAIRS],
        };
        for (slot, pair) in wire.pair_skews.iter_mut().zip(&message.pair_skews) {
            *slot = pair_wire(pair)?;
        }
        for (slot, camera) in wire.cameras.iter_mut().zip(&message.cameras) {
            *slot = CameraHealthWire {
                name: FixedText::exact("camera name", &camera.name)?,
                state: code_of(&CameraState::ALL, &camera.state),
                frames: camera.frames,
                dropped: camera.dropped,
                last_frame_age_ns: camera.last_frame_age_ns.unwrap_or(NEVER_NS),
                fps_hz: camera.fps_hz,
                lost: camera.lost,
                bad: camera.bad,
                valid_depth: camera.valid_depth.unwrap_or(UNKNOWN),
                clock: camera.clock.map_or(0, |clock| code_of(&FrameClock::ALL, &clock)),
                reserved: 0,
                gravity_off_deg: camera.gravity_off_deg.unwrap_or(UNKNOWN),
            };
        }
        for (slot, stage) in wire.stages.iter_mut().zip(&message.stages) {
            *slot = StageWire {
                stage: FixedText::exact("stage name", &stage.stage)?,
                reserved: 0,
                p50_ns: stage.p50_ns,
                p99_ns: stage.p99_ns,
                total_ns: stage.total_ns,
            };
        }
        HealthMessage::try_from(&wire)?;
        Ok(wire)
    }
}

impl TryFrom<&HealthWire> for HealthMessage {
    type Error = WireError;

    fn try_from(wire: &HealthWire) -> Result<Self, WireError> {
        check_version(wire.version)?;
        let n_cameras = count("cameras", wire.n_cameras, MAX_CAMERAS)?;
        let n_stages = count("stages", wire.n_stages, MAX_STAGES)?;
        let n_pairs = count("pairs", wire.n_pairs, MAX_PAIRS)?;
        let pairs = wire.pair_skews.iter().take(n_pairs);
        Ok(Self {
            sequence: wire.sequence,
            uptime_ns: wire.uptime_ns,
            watch: wire.watch.decode()?,
            cameras: wire.cameras.iter().take(n_cameras).map(camera_of).collect::<Result<_, _>>()?,
            stages: wire.stages.iter().take(n_stages).map(stage_of).collect::<Result<_, _>>()?,
            pair_skews: pairs.map(|pair| pair_of(pair, n_cameras)).collect::<Result<_, _>>()?,
        })
    }
}

fn camera_of(wire: &CameraHealthWire) -> Result<CameraHealth, WireError> {
    Ok(CameraHealth {
        name: wire.name.text("camera name")?,
        state: value_of(&CameraState::ALL, wire.state, "camera state")?,
        frames: wire.frames,
        dropped: wire.dropped,
        last_frame_age_ns: (wire.last_frame_age_ns != NEVER_NS).then_some(wire.last_frame_age_ns),
        fps_hz: not_negative("camera fps_hz", wire.fps_hz)?,
        lost: wire.lost,
        bad: wire.bad,
        valid_depth: known("camera valid_depth", wire.valid_depth, (1.0, "0 to 1, or -1 for unknown"))?,
        clock: match wire.clock {
            0 => None,
            code => Some(value_of(&FrameClock::ALL, code, "camera clock")?),
        },
        gravity_off_deg: known(
            "camera gravity_off_deg",
            wire.gravity_off_deg,
            (180.0, "0 to 180, or -1 for unknown"),
        )?,
    })
}

/// A value from 0 to a limit, or that it is unknown.
fn known(
    field: &'static str,
    value: f64,
    (limit, allowed): (f64, &'static str),
) -> Result<Option<f64>, WireError> {
    if value == UNKNOWN {
        return Ok(None);
    }
    if not_negative(field, value)? <= limit {
        Ok(Some(value))
    } else {
        Err(WireError::Value { field, allowed })
    }
}

fn pair_wire(pair: &PairSkew) -> Result<PairSkewWire, WireError> {
    Ok(PairSkewWire {
        first: count_wire("pair's first camera", pair.cameras.0, MAX_CAMERAS)?,
        second: count_wire("pair's second camera", pair.cameras.1, MAX_CAMERAS)?,
        sets: pair.sets,
        p50_ns: pair.p50_ns,
        p99_ns: pair.p99_ns,
        max_ns: pair.max_ns,
        beyond: pair.beyond,
        last_beyond_ns: pair.last_beyond_ns,
    })
}

fn pair_of(wire: &PairSkewWire, n_cameras: usize) -> Result<PairSkew, WireError> {
    Ok(PairSkew {
        cameras: pair_indices([wire.first, wire.second], n_cameras)?,
        sets: wire.sets,
        p50_ns: wire.p50_ns,
        p99_ns: wire.p99_ns,
        max_ns: wire.max_ns,
        beyond: wire.beyond,
        last_beyond_ns: wire.last_beyond_ns,
    })
}

fn stage_of(wire: &StageWire) -> Result<StageLatency, WireError> {
    Ok(StageLatency {
        stage: wire.stage.text("stage name")?,
        p50_ns: wire.p50_ns,
        p99_ns: wire.p99_ns,
        total_ns: wire.total_ns,
    })
}
