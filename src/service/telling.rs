//! From the pipeline's words to those of shared memory.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::capture::StampClock;
use crate::ipc::{
    BestPair, CameraHealth, CameraIdentity, CameraLines, CameraState, FrameClock, FrameSetCounts,
    HealthMessage, PairSkew, ProgressMessage, RefusedCounts, Skew, StageLatency, TurnSense, Turning,
};
use crate::pipeline::{self, CameraSnapshot, Counts, LatencySummary, Progress, Snapshot};
use crate::solver::{Moved, RigCalibration, WatchReport, Who};
use crate::store;

use super::state::Life;

/// What is remembered between messages about collecting.
#[derive(Debug, Default)]
pub struct ProgressTeller {
    sequence: u64,
    /// Counts when collecting began.
    baseline: Counts,
    max_skew_ns: u64,
    best_pair: Option<BestPair>,
}

impl ProgressTeller {
    /// Collecting begins anew at these counts.
    pub fn restart(&mut self, counts: Counts) {
        *self = Self { sequence: self.sequence, baseline: counts, ..Self::default() };
    }

    /// Takes note of a solution.
    pub fn note(&mut self, calibration: &RigCalibration) {
        let best = calibration.pairs.iter().filter(|pair| pair.matches > 0).max_by_key(|pair| pair.matches);
        self.best_pair =
            best.map(|pair| BestPair { target: pair.target, source: pair.source, matches: pair.matches });
    }

    /// Frame sets since collecting began.
    pub fn frame_sets(&self, counts: &Counts) -> FrameSetCounts {
        let since = |count: fn(&Counts) -> u64| count(counts).saturating_sub(count(&self.baseline));
        FrameSetCounts {
            seen: since(|counts| counts.sets_formed),
            used: since(|counts| counts.accepted_sets),
            refused: RefusedCounts {
                skew: since(|counts| counts.refused_skew),
                gyro: since(|counts| counts.refused_gyro),
                image: since(|counts| counts.refused_image),
                repeated: since(|counts| counts.repeated_sets),
            },
            dropped: since(|counts| counts.dropped_sets + counts.skipped_sets),
        }
    }

    /// The message about one frame set.
    pub fn message(&mut self, progress: &Progress, n_cameras: usize, life: &Life) -> ProgressMessage {
        self.sequence += 1;
        let last_ns = ns(progress.skew);
        self.max_skew_ns = self.max_skew_ns.max(last_ns);
        let lines = progress.cameras.iter().take(n_cameras);
        ProgressMessage {
            sequence: self.sequence,
            newest_frame_ns: progress.newest_stamp.0,
            published_ns: monotonic_ns(),
            latency_ns: ns(progress.newest_arrival.elapsed()),
            state: life.state(),
            is_moved: life.is_moved(),
            frame_sets: self.frame_sets(&progress.counts),
            cameras: lines.map(|camera| CameraLines { lines: camera.lines, lifted: camera.lifted }).collect(),
            best_pair: self.best_pair,
            skew: Skew { last_ns, max_ns: self.max_skew_ns },
            turning: progress.turn.map(Turning::from),
        }
    }
}

/// What is remembered between messages about health.
#[derive(Debug)]
pub struct HealthTeller {
    sequence: u64,
    started: Instant,
    /// When health was told last.
    last: Option<Instant>,
    /// Frames of each camera at the last message.
    frames: Vec<u64>,
}

impl HealthTeller {
    /// Health is told from now on.
    pub fn new(now: Instant) -> Self {
        Self { sequence: 0, started: now, last: None, frames: Vec::new() }
    }

    /// Since the daemon started.
    pub fn uptime_ns(&self) -> u64 {
        ns(self.started.elapsed())
    }

    /// Whether it is time for the next message.
    pub fn is_due(&self, interval: Duration) -> bool {
        self.last.is_none_or(|last| last.elapsed() >= interval)
    }

    /// The message about the pipeline as it is now, how the result stands, and how far each camera's up is off.
    pub fn message(
        &mut self,
        pipeline: &Snapshot,
        watch: Option<&WatchReport>,
        gravity_off_deg: &[Option<f64>],
    ) -> HealthMessage {
        let elapsed_s = self.last.unwrap_or(self.started).elapsed().as_secs_f64().max(1e-3);
        self.last = Some(Instant::now());
        self.sequence += 1;
        let before = |index: usize| self.frames.get(index).copied().unwrap_or(0);
        let health = |(index, camera): (usize, &CameraSnapshot)| CameraHealth {
            name: camera.name.clone(),
            state: CameraState::from(camera.state),
            frames: camera.frames,
            dropped: camera.dropped,
            last_frame_age_ns: camera.last_frame_age.map(ns),
            // A restarted pipeline counts from zero again.
            fps_hz: camera.frames.saturating_sub(before(index)) as f64 / elapsed_s,
            lost: camera.frame_health.lost,
            bad: camera.frame_health.bad,
            valid_depth: camera.frame_health.valid_depth,
            clock: camera.frame_health.clock.map(FrameClock::from),
            gravity_off_deg: gravity_off_deg.get(index).copied().flatten(),
        };
        let cameras = pipeline.cameras.iter().enumerate().map(health).collect();
        self.frames = pipeline.cameras.iter().map(|camera| camera.frames).collect();
        HealthMessage {
            sequence: self.sequence,
            uptime_ns: self.uptime_ns(),
            watch: watch.cloned(),
            cameras,
            stages: stages(pipeline),
            pair_skews: pipeline.pair_skews.iter().map(PairSkew::from).collect(),
        }
    }
}

fn stages(pipeline: &Snapshot) -> Vec<StageLatency> {
    let latencies = &pipeline.latencies;
    let stage = |(stage, summary): (&str, LatencySummary)| StageLatency {
        stage: stage.to_owned(),
        p50_ns: (summary.p50_ms * 1e6) as u64,
        p99_ns: (summary.p99_ms * 1e6) as u64,
        total_ns: (summary.mean_ms * summary.count as f64 * 1e6) as u64,
    };
    let all = [
        ("frame_to_set", latencies.frame_to_set),
        ("detect", latencies.detect),
        ("lift", latencies.lift),
        ("frame_to_progress", latencies.frame_to_progress),
        ("associate", latencies.associate),
        ("solve", latencies.solve),
        ("watch", latencies.watch),
    ];
    all.into_iter().map(stage).collect()
}

impl From<FrameSetCounts> for store::FrameSets {
    fn from(counts: FrameSetCounts) -> Self {
        let FrameSetCounts { seen, used, refused, dropped } = counts;
        Self { seen, used, refused: refused.total(), dropped }
    }
}

impl From<pipeline::Turn> for Turning {
    fn from(turn: pipeline::Turn) -> Self {
        let sense = match turn.sense {
            pipeline::TurnSense::Gyro => TurnSense::Gyro,
            pipeline::TurnSense::Image => TurnSense::Image,
        };
        // A gyro's answer may be infinite, which the wire refuses.
        Self { rad_per_s: turn.rad_per_s.clamp(0.0, f64::MAX), sense }
    }
}

impl From<&pipeline::PairSkew> for PairSkew {
    fn from(pair: &pipeline::PairSkew) -> Self {
        let ns = |ms: f64| (ms * 1e6).round() as u64;
        Self {
            cameras: (pair.first, pair.second),
            sets: pair.within.count,
            p50_ns: ns(pair.within.p50_ms),
            p99_ns: ns(pair.within.p99_ms),
            max_ns: ns(pair.within.max_ms),
            beyond: pair.beyond,
            last_beyond_ns: ns(pair.last_beyond_ms),
        }
    }
}

impl From<StampClock> for FrameClock {
    fn from(clock: StampClock) -> Self {
        match clock {
            StampClock::Source => FrameClock::Source,
            StampClock::Device => FrameClock::Device,
            StampClock::Translated => FrameClock::Translated,
            StampClock::Host => FrameClock::Host,
        }
    }
}

impl From<pipeline::CameraState> for CameraState {
    fn from(state: pipeline::CameraState) -> Self {
        match state {
            pipeline::CameraState::Waiting => CameraState::Waiting,
            pipeline::CameraState::Streaming => CameraState::Streaming,
            pipeline::CameraState::Stalled => CameraState::Stalled,
            pipeline::CameraState::Unplugged => CameraState::Unplugged,
            pipeline::CameraState::Failed => CameraState::Failed,
            pipeline::CameraState::Ended => CameraState::Ended,
            pipeline::CameraState::Opened => CameraState::Opened,
        }
    }
}

/// ns since 1970; 0 on a machine whose clock stands before that.
pub fn wall_clock_ns() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, ns)
}

fn monotonic_ns() -> u64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    u64::try_from(now.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(now.tv_nsec).unwrap_or(0)
}

fn ns(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Says in the log which camera was moved, and how far.
pub fn log_moved(moved: &Moved, identities: &[CameraIdentity]) {
    let name = |camera: usize| identities.get(camera).map_or("?", |camera| camera.name.as_str());
    let rounded = |value: f64| (value * 100.0).round() / 100.0;
    let (deg, mm) = (rounded(moved.rotation_rad.to_degrees()), rounded(1e3 * moved.translation_m));
    let (sigma_deg, sigma_mm) =
        (rounded(moved.sigma_rotation_rad.to_degrees()), rounded(1e3 * moved.sigma_translation_m));
    match moved.who {
        Who::Camera(camera) => {
            let camera = name(camera);
            tracing::warn!(
                camera,
                deg,
                mm,
                sigma_deg,
                sigma_mm,
                "camera was moved: the result no longer holds"
            );
        }
        Who::OneOf(a, b) => {
            let cameras = format!("{}, {}", name(a), name(b));
            tracing::warn!(
                cameras,
                deg,
                mm,
                sigma_deg,
                sigma_mm,
                "one of two cameras was moved: the result no longer holds"
            );
        }
    }
}
