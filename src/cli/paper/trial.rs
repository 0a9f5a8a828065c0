//! One configuration in one room: frame sets one by one into the estimator, a solution every few sets, errors at the end.
//!
//! The truth is compared with what the estimator answered; it never reaches the estimator.

use std::time::Duration;

use super::configuration::Configuration;
use crate::capture::synthetic::SyntheticFactory;
use crate::capture::{CaptureError, DeviceFactory, FrameSource, RgbdFrame};
use crate::geometry::CameraView;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::pipeline::{
    AssociateOptions, Association, FoundLines, LineFinder, PipelineOptions, SegmentLineFinder,
};
use crate::solver::{CameraPose, RigCalibration, RigCamera, RigEstimator, State};

/// The first solution is asked for after so many frame sets ...
const FIRST_SOLUTION: u64 = 6;
/// ... and then, until it has converged, after so many more.
const SETS_PER_SOLUTION: u64 = 3;
/// Longest wait for a rendered frame: it is there at once.
const FRAME_WITHIN: Duration = Duration::from_secs(60);

/// What to try.
#[derive(Debug, Clone, Copy)]
pub struct Task {
    /// The rig.
    pub configuration: Configuration,
    /// The room.
    pub seed: u64,
    /// Frame sets in all.
    pub sets: u64,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// The rig.
    pub configuration: Configuration,
    /// The room.
    pub seed: u64,
    /// Verdict after the last frame set.
    pub state: State,
    /// Why it is not converged.
    pub reason: Option<String>,
    /// The source camera in the target camera's frame, converged or not; `None` where no lines agree.
    pub target_from_source: Option<Motion>,
    /// Standard deviations that the estimator claims, in the worst direction.
    pub sigma: Option<Error>,
    /// Distance from the truth.
    pub error: Option<Error>,
    /// Frame sets after which a solution was converged for the first time.
    pub first_converged: Option<u64>,
    /// The largest error that a converged solution ever had, the last one included.
    pub worst_converged: Option<Error>,
    /// Matched lines of the last solution.
    pub matches: usize,
}

/// How far a pose is from the truth, or may be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Error {
    /// Angle of the relative rotation, deg.
    pub rotation_deg: f64,
    /// Length of the difference of the translations, mm.
    pub translation_mm: f64,
}

impl Error {
    fn between(found: &Motion, truth: &Motion) -> Self {
        Self {
            rotation_deg: rotation_gap_rad(found, truth).to_degrees(),
            translation_mm: translation_gap_m(found, truth) * 1e3,
        }
    }

    /// Each number the larger of two.
    fn max(self, other: Self) -> Self {
        Self {
            rotation_deg: self.rotation_deg.max(other.rotation_deg),
            translation_mm: self.translation_mm.max(other.translation_mm),
        }
    }
}

/// Runs one trial.
///
/// # Errors
/// When a camera gives no frame, which synthetic cameras do not do.
pub fn run(task: &Task, options: &PipelineOptions) -> Result<Trial, CaptureError> {
    let factory = task.configuration.factory(task.seed);
    let mut rig = Rig::open(&factory, options)?;
    let mut progress = Progress::new(factory.truth());
    for set in 1..=task.sets {
        rig.take_set()?;
        let is_due = set >= FIRST_SOLUTION && (set - FIRST_SOLUTION).is_multiple_of(SETS_PER_SOLUTION);
        if set < task.sets && is_due && progress.first_converged.is_none() {
            progress.take(set, &rig.estimator.solve());
        }
    }
    let calibration = rig.estimator.solve();
    progress.take(task.sets, &calibration);
    Ok(progress.trial(task, &calibration))
}

/// Two open cameras and the estimator behind them.
struct Rig {
    eyes: Vec<Eye>,
    estimator: RigEstimator,
}

struct Eye {
    source: Box<dyn FrameSource>,
    frame: RgbdFrame,
    finder: SegmentLineFinder,
    found: FoundLines,
}

impl Rig {
    fn open(factory: &SyntheticFactory, options: &PipelineOptions) -> Result<Self, CaptureError> {
        // The paper's estimator has no use for appearance.
        let associate = AssociateOptions { association: Association::Geometric, ..options.associate.clone() };
        let options = &PipelineOptions { associate, ..options.clone() };
        let (mut eyes, mut cameras) = (Vec::new(), Vec::new());
        for info in factory.list()? {
            eyes.push(Eye {
                source: factory.open(&info.serial)?,
                frame: RgbdFrame::default(),
                finder: SegmentLineFinder::new(options),
                found: FoundLines::default(),
            });
            cameras.push(RigCamera { name: info.name, camera: info.camera });
        }
        Ok(Self { eyes, estimator: RigEstimator::new(cameras, options.estimate) })
    }

    fn take_set(&mut self) -> Result<(), CaptureError> {
        let views = self.eyes.iter_mut().map(|eye| eye.look().map(Some)).collect::<Result<Vec<_>, _>>()?;
        self.estimator.add(&views, &[]);
        Ok(())
    }
}

impl Eye {
    fn look(&mut self) -> Result<CameraView, CaptureError> {
        self.source.next_frame(&mut self.frame, FRAME_WITHIN)?;
        self.finder.find(&self.frame, &self.source.info().camera, &mut self.found);
        Ok(std::mem::take(&mut self.found.view))
    }
}

/// What the solutions so far are worth.
struct Progress {
    truth: Motion,
    first_converged: Option<u64>,
    worst_converged: Option<Error>,
}

impl Progress {
    /// From the poses of target and source camera.
    fn new(reference_from_camera: Vec<Motion>) -> Self {
        let place = |camera: usize| reference_from_camera.get(camera).copied().unwrap_or_default();
        Self { truth: place(0).inv_mul(&place(1)), first_converged: None, worst_converged: None }
    }

    fn take(&mut self, sets: u64, calibration: &RigCalibration) {
        if calibration.state != State::Converged {
            return;
        }
        self.first_converged = self.first_converged.or(Some(sets));
        if let Some(pose) = source_pose(calibration) {
            let error = Error::between(&pose.reference_from_camera, &self.truth);
            self.worst_converged = Some(self.worst_converged.map_or(error, |worst| worst.max(error)));
        }
    }

    fn trial(self, task: &Task, calibration: &RigCalibration) -> Trial {
        let pair = calibration.pairs.first();
        let target_from_source = source_pose(calibration)
            .map(|pose| pose.reference_from_camera)
            .or_else(|| pair.and_then(|pair| pair.target_from_source));
        Trial {
            configuration: task.configuration,
            seed: task.seed,
            state: calibration.state,
            reason: calibration.reason.as_ref().map(|reason| reason.sentence.clone()),
            target_from_source,
            sigma: source_pose(calibration).map(sigma),
            error: target_from_source.map(|found| Error::between(&found, &self.truth)),
            first_converged: self.first_converged,
            worst_converged: self.worst_converged,
            matches: pair.map_or(0, |pair| pair.matches),
        }
    }
}

fn source_pose(calibration: &RigCalibration) -> Option<&CameraPose> {
    calibration.cameras.get(1)?.as_ref()
}

fn sigma(pose: &CameraPose) -> Error {
    let worst = |first: usize| {
        let block = pose.covariance.fixed_view::<3, 3>(first, first).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    Error { rotation_deg: worst(3).to_degrees(), translation_mm: worst(0) * 1e3 }
}
