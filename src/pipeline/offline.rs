//! The whole way from frames to extrinsics without threads' timing: every frame set is used, and the same sets give the same bits.

use std::time::{Duration, Instant};

use crate::capture::recording::Recording;
use crate::capture::{CaptureError, RgbdFrame};
use crate::geometry::{Camera, CameraView};
use crate::solver::{Reason, ReasonCode, RigCalibration, RigCamera, RigEstimator, State};

use super::apart::Skews;
use super::associate::{self, MatchSource, SeenLines};
use super::buffers::FoundLines;
use super::finder::{FindTimes, LineFinder, SegmentLineFinder};
use super::motion::{MotionTest, SeenFrame, TurnSense};
use super::options::PipelineOptions;
use super::skew::{PairSkew, SkewBook};

/// Frame sets one after the other.
pub trait FrameSetReader {
    /// Overwrites `frames`, one per camera, with the next set; `false` at the end. A missing camera's frame gets width 0.
    ///
    /// # Errors
    /// What the recording says.
    fn next_set(&mut self, frames: &mut [RgbdFrame]) -> Result<bool, CaptureError>;
}

/// The frame sets of a recording, in their order.
#[derive(Debug)]
pub struct RecordedSets<'a> {
    recording: &'a Recording,
    next: usize,
}

impl<'a> RecordedSets<'a> {
    /// Begins with the first set.
    pub fn new(recording: &'a Recording) -> Self {
        Self { recording, next: 0 }
    }

    /// The recording's cameras as the estimator takes them.
    pub fn rig(&self) -> Vec<RigCamera> {
        let cameras = self.recording.cameras().iter();
        cameras.map(|info| RigCamera { name: info.name.clone(), camera: info.camera }).collect()
    }
}

impl FrameSetReader for RecordedSets<'_> {
    fn next_set(&mut self, frames: &mut [RgbdFrame]) -> Result<bool, CaptureError> {
        let Some(stamps) = self.recording.frame_sets().get(self.next) else { return Ok(false) };
        self.next += 1;
        for (camera_idx, (stamp, frame)) in stamps.iter().zip(frames).enumerate() {
            self.recording.read_frame(camera_idx, *stamp, frame)?;
        }
        Ok(true)
    }
}

/// How far an offline run is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OfflineProgress {
    /// So many sets have been read.
    Set(SetCounts),
    /// All sets have been read; the solution is being computed.
    Solving,
}

/// What became of the frame sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SetCounts {
    /// Read.
    pub seen: usize,
    /// Given to the estimator.
    pub used: usize,
    /// Not used, by reason.
    pub refused: RefusedSets,
}

/// Why frame sets were not used: for each the first reason that applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct RefusedSets {
    /// Fewer than two frames in it.
    pub incomplete: usize,
    /// Stamps too far apart.
    pub skew: usize,
    /// A gyro said that the rig turned fast.
    pub gyro: usize,
    /// An image moved fast.
    pub image: usize,
}

impl RefusedSets {
    /// All of them.
    pub fn total(&self) -> usize {
        self.incomplete + self.skew + self.gyro + self.image
    }
}

/// Where the time went, ms in total over the run; detection and lifting are summed over threads.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TimingMs {
    /// Gray conversion and segments.
    pub detect: f64,
    /// Lifting and surfaces.
    pub lift: f64,
    /// Scoring candidate matches, and taking the sets into the estimator.
    pub associate: f64,
    /// Solving.
    pub estimate: f64,
    /// Everything, reading included.
    pub total: f64,
}

/// Result of an offline run.
#[derive(Debug, Clone, PartialEq)]
pub struct OfflineRun {
    /// What the estimator answers.
    pub calibration: RigCalibration,
    /// Where the time went.
    pub timing_ms: TimingMs,
    /// What became of the frame sets.
    pub frame_sets: SetCounts,
    /// How far apart the frames of each two cameras are, in all sets.
    pub pair_skews: Vec<PairSkew>,
    /// Lines found per camera, in all sets.
    pub lines: Vec<u64>,
    /// What had to be done without, in a sentence for the user.
    pub complaint: Option<String>,
}

/// Reads all sets, then solves. `options.n_line_threads` changes the time, never the result; frames that do not have their camera's
/// size count as missing.
///
/// # Errors
/// The first frame set that cannot be read.
pub fn run_offline(
    sets: &mut dyn FrameSetReader,
    cameras: &[RigCamera],
    options: &PipelineOptions,
    progress: &mut dyn FnMut(OfflineProgress),
) -> Result<OfflineRun, CaptureError> {
    let start = Instant::now();
    let mut run = Run::new(cameras, options);
    let mut frames: Vec<RgbdFrame> = cameras.iter().map(|_| RgbdFrame::default()).collect();
    while sets.next_set(&mut frames)? {
        run.take(&frames);
        progress(OfflineProgress::Set(run.counts));
    }
    progress(OfflineProgress::Solving);
    let solving = Instant::now();
    let calibration = run.solve();
    let timing_ms = TimingMs {
        detect: ms(run.times.gray + run.times.detect),
        lift: ms(run.times.lift + run.times.describe),
        associate: ms(run.associate),
        estimate: ms(solving.elapsed()),
        total: ms(start.elapsed()),
    };
    let lines = run.cameras.iter().map(|camera| camera.n_lines).collect();
    let (complaint, pair_skews) = (run.source.complaint(), run.skews.pairs());
    Ok(OfflineRun { calibration, timing_ms, frame_sets: run.counts, pair_skews, lines, complaint })
}

/// When a growing number of frame sets was enough for the first time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FirstConverged {
    /// Frame sets read until then.
    pub frame_sets: usize,
    /// Finding, scoring and taking in their lines, and the one solution that converged, ms.
    pub ms: f64,
}

/// Solves after each frame set until a solution is converged; `None` when none is.
///
/// # Errors
/// The first frame set that cannot be read.
pub fn first_converged(
    sets: &mut dyn FrameSetReader,
    cameras: &[RigCamera],
    options: &PipelineOptions,
) -> Result<Option<FirstConverged>, CaptureError> {
    let mut run = Run::new(cameras, options);
    let mut frames: Vec<RgbdFrame> = cameras.iter().map(|_| RgbdFrame::default()).collect();
    while sets.next_set(&mut frames)? {
        let used_before = run.counts.used;
        run.take(&frames);
        if run.counts.used == used_before || run.counts.used < options.estimate.verdict.min_views {
            continue;
        }
        let solving = Instant::now();
        if run.solve().state == State::Converged {
            let spent = run.times.detect + run.times.lift + run.associate + solving.elapsed();
            return Ok(Some(FirstConverged { frame_sets: run.counts.seen, ms: ms(spent) }));
        }
    }
    Ok(None)
}

fn ms(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}

/// One camera's part of the run.
struct CameraRun {
    camera: Camera,
    finder: SegmentLineFinder,
    found: FoundLines,
    times: FindTimes,
    n_lines: u64,
}

impl CameraRun {
    fn find(&mut self, frame: &RgbdFrame) {
        if frame.is_of(&self.camera) {
            let times = self.finder.find(frame, &self.camera, &mut self.found);
            self.times += times;
            self.n_lines += self.found.view.lines.len() as u64;
        }
    }
}

struct Run {
    options: PipelineOptions,
    names: Vec<String>,
    cameras: Vec<CameraRun>,
    n_threads: usize,
    source: Box<dyn MatchSource>,
    estimator: RigEstimator,
    views: Vec<Option<CameraView>>,
    motion: MotionTest,
    skews: SkewBook,
    counts: SetCounts,
    times: FindTimes,
    associate: Duration,
}

impl Run {
    fn new(cameras: &[RigCamera], options: &PipelineOptions) -> Self {
        let of_camera = |camera: &RigCamera| CameraRun {
            camera: camera.camera,
            finder: SegmentLineFinder::new(options),
            found: FoundLines::default(),
            times: FindTimes::default(),
            n_lines: 0,
        };
        Self {
            options: options.clone(),
            names: cameras.iter().map(|camera| camera.name.clone()).collect(),
            cameras: cameras.iter().map(of_camera).collect(),
            n_threads: options.line_threads(cameras.len()),
            source: associate::source(&options.associate),
            estimator: RigEstimator::new(cameras.to_vec(), options.estimate),
            views: vec![None; cameras.len()],
            motion: MotionTest::new(cameras.len(), options.motion),
            skews: SkewBook::new(cameras.len()),
            counts: SetCounts::default(),
            times: FindTimes::default(),
            associate: Duration::ZERO,
        }
    }

    /// Where sets were refused, the estimator has not seen them and cannot know why.
    fn solve(&self) -> RigCalibration {
        let mut calibration = self.estimator.solve();
        let (pairs, max_skew) = (&self.skews.pairs(), self.options.sync.max_skew);
        Skews { pairs, names: &self.names, max_skew }.explain(&mut calibration);
        let SetCounts { seen, used, refused } = self.counts;
        if used > 0 || refused.gyro + refused.image == 0 || self.cameras.len() < 2 {
            return calibration;
        }
        let deg_per_s = self.options.motion.max_turn_rad_per_s.to_degrees();
        let sentence = format!(
            "all {seen} frame sets were refused, most of them while the rig turned faster than {deg_per_s:.1} deg/s: turn it slowly"
        );
        let reason = Some(Reason { code: ReasonCode::NotEnoughEvidence, sentence });
        RigCalibration { reason, ..calibration }
    }

    fn take(&mut self, frames: &[RgbdFrame]) {
        self.counts.seen += 1;
        if let Some(reason) = self.refused_for(frames) {
            *reason(&mut self.counts.refused) += 1;
            return;
        }
        self.counts.used += 1;
        let start = Instant::now();
        self.swap_views(frames);
        let (views, cameras, source) = (&self.views, &self.cameras, &mut self.source);
        self.estimator.add_and_score(views, &mut || {
            let seen = views.iter().zip(cameras);
            let seen = seen.map(|(view, camera)| Some(SeenLines::new(view.as_ref()?, &camera.found)));
            source.score(&seen.collect::<Vec<_>>(), &|| true)
        });
        self.swap_views(frames);
        self.associate += start.elapsed();
    }

    /// Finds the lines of a set, unless there is a reason not to use it: where that is counted.
    fn refused_for(&mut self, frames: &[RgbdFrame]) -> Option<fn(&mut RefusedSets) -> &mut usize> {
        let stamps = self.cameras.iter().zip(frames);
        let stamps = stamps.map(|(camera, frame)| frame.is_of(&camera.camera).then_some(frame.stamp));
        let max_skew = self.options.sync.max_skew;
        self.skews.note_set(stamps.clone(), max_skew);
        let present = || stamps.clone().flatten().map(|stamp| stamp.0);
        let (Some(oldest), Some(newest)) = (present().min(), present().max()) else {
            return Some(|refused| &mut refused.incomplete);
        };
        if present().count() < self.cameras.len().min(2) {
            return Some(|refused| &mut refused.incomplete);
        }
        if Duration::from_nanos(newest.abs_diff(oldest)) > max_skew {
            return Some(|refused| &mut refused.skew);
        }
        self.find_lines(frames);
        match self.refused_by_motion(frames)? {
            TurnSense::Gyro => Some(|refused| &mut refused.gyro),
            TurnSense::Image => Some(|refused| &mut refused.image),
        }
    }

    /// Each thread takes its share of the cameras; a camera's result depends on its own frames only.
    fn find_lines(&mut self, frames: &[RgbdFrame]) {
        let n_threads = self.n_threads.min(self.cameras.len());
        if n_threads < 2 {
            self.cameras.iter_mut().zip(frames).for_each(|(camera, frame)| camera.find(frame));
        } else {
            let share = self.cameras.len().div_ceil(n_threads);
            std::thread::scope(|scope| {
                for (cameras, frames) in self.cameras.chunks_mut(share).zip(frames.chunks(share)) {
                    scope.spawn(move || {
                        cameras.iter_mut().zip(frames).for_each(|(camera, frame)| camera.find(frame))
                    });
                }
            });
        }
        for camera in &mut self.cameras {
            let times = std::mem::take(&mut camera.times);
            self.times += times;
        }
    }

    fn refused_by_motion(&mut self, frames: &[RgbdFrame]) -> Option<TurnSense> {
        let usable = self.cameras.iter().zip(frames).enumerate();
        let usable = usable.filter(|(_, (camera, frame))| frame.is_of(&camera.camera));
        let seen = usable.map(|(index, (camera, frame))| SeenFrame {
            camera: index,
            stamp: frame.stamp,
            focal_px: camera.camera.mean_focal_px(),
            thumbnail: &camera.found.thumbnail,
            turn_rate: frame.turn_rate,
        });
        let turn = self.motion.turn(seen);
        self.motion.refuses(turn)
    }

    /// Moves the views of the usable frames to the form the estimator takes, or back: no view is copied.
    fn swap_views(&mut self, frames: &[RgbdFrame]) {
        for ((view, camera), frame) in self.views.iter_mut().zip(&mut self.cameras).zip(frames) {
            if frame.is_of(&camera.camera) {
                match view.take() {
                    None => *view = Some(std::mem::take(&mut camera.found.view)),
                    Some(moved) => camera.found.view = moved,
                }
            }
        }
    }
}
