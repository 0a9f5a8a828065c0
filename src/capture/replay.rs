//! Plays a recording as if its cameras were there: in real time, or as fast as it is read.
//!
//! Decides when a frame is due. All sources of one factory share one clock, which starts with the first frame anybody asks
//! for, so cameras stay in step; no frame is skipped for being late, except by a source that is opened while the clock runs.

use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use super::recording::Recording;
use super::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame, StampNs};

/// A source opened later than this after a frame was due starts behind that frame, like a camera that is plugged in again;
/// below it, threads that start one after the other all begin with the first frame.
const START_GRACE: Duration = Duration::from_secs(1);
/// ns; what follows the only frame set of a recording that is repeated: 30 frames per second.
const LONE_INTERVAL_NS: i64 = 33_333_333;

/// When frames come.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pace {
    /// As far apart as they were recorded.
    #[default]
    RealTime,
    /// As soon as they are asked for.
    Unpaced,
}

/// How a recording is played.
#[derive(Debug, Clone, Copy, Default)]
pub struct ReplayOptions {
    /// When frames come.
    pub pace: Pace,
    /// Begin again at the end, for ever; stamps and sequence go on increasing.
    pub repeat: bool,
    /// Decode everything ahead, so that decoding is no part of a frame's cost: 1.5 MB per frame of 640 x 480.
    pub preload: bool,
}

/// The cameras of a recording.
#[derive(Debug)]
pub struct ReplayFactory {
    player: Arc<Player>,
}

/// What the sources of one factory share; nothing in it changes but the start of the clock.
#[derive(Debug)]
struct Player {
    recording: Recording,
    options: ReplayOptions,
    /// Per camera all frames; empty without `preload`.
    preloaded: Vec<Vec<RgbdFrame>>,
    first_stamp: StampNs,
    /// ns added to the stamps per repetition.
    period_ns: i64,
    started: OnceLock<Instant>,
}

impl ReplayFactory {
    /// Takes a recording; with `preload` all its images are read now.
    ///
    /// # Errors
    /// When an image to preload is not usable.
    pub fn new(recording: Recording, options: ReplayOptions) -> Result<Self, CaptureError> {
        let preloaded = if options.preload { preload(&recording)? } else { Vec::new() };
        let (first_stamp, period_ns) = span(recording.frame_sets());
        let started = OnceLock::new();
        let player = Player { recording, options, preloaded, first_stamp, period_ns, started };
        Ok(Self { player: Arc::new(player) })
    }
}

impl DeviceFactory for ReplayFactory {
    fn name(&self) -> &'static str {
        "replay"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        Ok(self.player.recording.cameras().to_vec())
    }

    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        let cameras = self.player.recording.cameras();
        let found = cameras.iter().enumerate().find(|(_, info)| info.serial == serial);
        let (camera_idx, info) = found.ok_or_else(|| CaptureError::not_found(serial, cameras))?;
        let mut source =
            ReplaySource { player: Arc::clone(&self.player), camera_idx, info: info.clone(), next_idx: 0 };
        source.skip_past();
        Ok(Box::new(source))
    }
}

/// One camera of a recording.
struct ReplaySource {
    player: Arc<Player>,
    camera_idx: usize,
    info: CameraInfo,
    /// Counts on over repetitions.
    next_idx: u64,
}

/// A frame that comes next.
struct Due {
    set_idx: usize,
    recorded: StampNs,
    /// As the reader sees it: later than recorded by what was repeated before.
    stamp: StampNs,
}

impl FrameSource for ReplaySource {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        (frame.width, frame.height) = (0, 0);
        let due = self.due(self.next_idx).ok_or(CaptureError::EndOfStream)?;
        self.wait_for(due.stamp, timeout)?;
        // An unreadable image is a lost frame, not a place to stay at.
        let sequence = self.next_idx;
        self.next_idx += 1;
        let preloaded = self.player.preloaded.get(self.camera_idx).and_then(|all| all.get(due.set_idx));
        match preloaded {
            Some(ready) => copy(ready, frame),
            None => self.player.recording.read_frame(self.camera_idx, due.recorded, frame)?,
        }
        (frame.stamp, frame.sequence) = (due.stamp, sequence);
        Ok(())
    }
}

impl ReplaySource {
    /// The frame of this number; `None` behind the end.
    fn due(&self, idx: u64) -> Option<Due> {
        let sets = self.player.recording.frame_sets();
        let n_sets = sets.len() as u64;
        let (round, set_idx) = (idx / n_sets, usize::try_from(idx % n_sets).ok()?);
        if round > 0 && !self.player.options.repeat {
            return None;
        }
        let recorded = *sets.get(set_idx)?.get(self.camera_idx)?;
        let later_ns = i64::try_from(round).ok()?.checked_mul(self.player.period_ns)?;
        Some(Due { set_idx, recorded, stamp: StampNs(recorded.0.checked_add(later_ns)?) })
    }

    /// Waits until the frame of this stamp is due, at most `timeout`.
    fn wait_for(&self, stamp: StampNs, timeout: Duration) -> Result<(), CaptureError> {
        if self.player.options.pace == Pace::Unpaced {
            return Ok(());
        }
        let started = *self.player.started.get_or_init(Instant::now);
        let wait = self.player.after_start(stamp).saturating_sub(started.elapsed());
        thread::sleep(wait.min(timeout));
        if wait > timeout { Err(CaptureError::Timeout(timeout)) } else { Ok(()) }
    }

    /// Passes over what is long past when the clock already runs.
    fn skip_past(&mut self) {
        let Some(started) = self.player.started.get() else { return };
        let now = started.elapsed();
        while self
            .due(self.next_idx)
            .is_some_and(|due| self.player.after_start(due.stamp) + START_GRACE < now)
        {
            self.next_idx += 1;
        }
    }
}

impl Player {
    /// When a stamp is due after the start of the clock.
    fn after_start(&self, stamp: StampNs) -> Duration {
        Duration::from_nanos(stamp.0.saturating_sub(self.first_stamp.0).unsigned_abs())
    }
}

fn preload(recording: &Recording) -> Result<Vec<Vec<RgbdFrame>>, CaptureError> {
    let read = |camera_idx: usize, set: &Vec<StampNs>| {
        let mut frame = RgbdFrame::default();
        let stamp = set.get(camera_idx).copied().unwrap_or_default();
        recording.read_frame(camera_idx, stamp, &mut frame).map(|()| frame)
    };
    let cameras = 0..recording.cameras().len();
    cameras.map(|idx| recording.frame_sets().iter().map(|set| read(idx, set)).collect()).collect()
}

/// The first stamp of all cameras, and how much later the recording begins again: one mean interval after its last stamp.
fn span(frame_sets: &[Vec<StampNs>]) -> (StampNs, i64) {
    let first = frame_sets.first().and_then(|set| set.iter().min()).copied().unwrap_or_default();
    let last = frame_sets.last().and_then(|set| set.iter().max()).copied().unwrap_or_default();
    let length_ns = last.0.saturating_sub(first.0);
    let n_gaps = i64::try_from(frame_sets.len()).unwrap_or(i64::MAX).saturating_sub(1);
    // One ns at least, so that stamps increase even where a recording's do by 1 ns.
    let interval_ns = if n_gaps > 0 { (length_ns / n_gaps).max(1) } else { LONE_INTERVAL_NS };
    (first, length_ns.saturating_add(interval_ns))
}

/// Copies into the buffers that are there.
fn copy(from: &RgbdFrame, to: &mut RgbdFrame) {
    to.rgb.clone_from(&from.rgb);
    to.depth.clone_from(&from.depth);
    to.depth_unit_m = from.depth_unit_m;
    to.depth_camera = from.depth_camera;
    (to.turn_rate, to.specific_force) = (from.turn_rate, from.specific_force);
    (to.width, to.height) = (from.width, from.height);
}
