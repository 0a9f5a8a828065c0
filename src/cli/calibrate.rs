//! `pelical calibrate`: one recording through the offline pipeline. The estimator never sees the ground truth.

use super::args::CalibrateArgs;
use super::error::CliError;
use super::exit::Exit;
use super::output::document::{CalibrationDocument, Findings, FrameSets, TimingMs};
use super::talk::say;
use super::{output, progress};
use crate::capture::recording::Recording;
use crate::ipc::CameraIdentity;
use crate::pipeline::PipelineOptions;
use crate::pipeline::offline::{self, OfflineProgress, OfflineRun, RecordedSets};
use crate::service::config;

/// Calibrates and prints the result.
///
/// # Errors
/// When the config or the recording is not usable.
pub fn run(args: &CalibrateArgs) -> Result<Exit, CliError> {
    let options = config::load_or_default(args.config.as_deref())?.pipeline;
    let document = calibrate(&args.recording.open()?, &options)?;
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::text::calibration(&document))?;
    }
    Ok(if document.is_converged() { Exit::Done } else { Exit::NoResult })
}

/// Calibrates from one recording; with truth when it lies beside.
///
/// # Errors
/// When a frame or the ground truth is not usable.
pub fn calibrate(recording: &Recording, options: &PipelineOptions) -> Result<CalibrationDocument, CliError> {
    let truth = recording.ground_truth()?;
    let run = run_offline(recording, options)?;
    let cameras: Vec<CameraIdentity> = recording
        .cameras()
        .iter()
        .map(|info| CameraIdentity {
            name: info.name.clone(),
            serial: info.serial.clone(),
            firmware: info.firmware.clone(),
        })
        .collect();
    let counts = run.frame_sets;
    let time = run.timing_ms;
    Ok(CalibrationDocument::new(&Findings {
        cameras: &cameras,
        calibration: &run.calibration,
        frame_sets: FrameSets {
            seen: counts.seen as u64,
            used: counts.used as u64,
            refused: counts.refused.total() as u64,
            refused_for: Some(counts.refused.into()),
        },
        pair_skews: &run.pair_skews,
        timing_ms: TimingMs {
            detect: Some(time.detect),
            lift: Some(time.lift),
            associate: Some(time.associate),
            estimate: Some(time.estimate),
            total: Some(time.total),
        },
        truth: truth.as_ref().map(|truth| truth.reference_from_camera.as_slice()),
        provenance: None,
    }))
}

fn run_offline(recording: &Recording, options: &PipelineOptions) -> Result<OfflineRun, CliError> {
    let bar = progress::bar(Some(recording.frame_sets().len() as u64), "frame sets");
    let mut sets = RecordedSets::new(recording);
    let rig = sets.rig();
    let run = offline::run_offline(&mut sets, &rig, options, &mut |progress| match progress {
        OfflineProgress::Set(counts) => bar.set_position(counts.seen as u64),
        OfflineProgress::Solving => bar.set_message("solving"),
    });
    bar.finish_and_clear();
    let run = run?;
    if let Some(complaint) = &run.complaint {
        say(format_args!("pelical: {complaint}"));
    }
    Ok(run)
}
