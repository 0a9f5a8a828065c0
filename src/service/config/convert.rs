//! The sections `cameras.synthetic`, `sync`, `lines` and `estimate` as options of the parts: ranges checked, units converted, once.

use std::time::Duration;

use super::error::Refusal;
use super::sections::{
    ConfigFile, EstimateSection, LinesSection, Pace, SyncSection, SyntheticNoise, SyntheticRig,
    SyntheticSection,
};
use crate::capture::synthetic::{self, Noise, SyntheticOptions};
use crate::lines::{DetectOptions, LiftOptions};
use crate::pipeline::{AssociateOptions, MotionOptions, PipelineOptions, SolveOptions, SyncOptions};
use crate::solver::{EstimateOptions, EvidenceLimits, VerdictLimits};

/// Everything between frames and results.
///
/// # Errors
/// Names the first value out of range.
pub(super) fn pipeline_options(file: &ConfigFile) -> Result<PipelineOptions, Refusal> {
    within("lines.threads", file.lines.threads as f64, (0.0, 64.0))?;
    within("sync.max_turn_deg_per_s", file.sync.max_turn_deg_per_s, (0.1, 10_000.0))?;
    within("estimate.min_new_sets", f64::from(file.estimate.min_new_sets), (1.0, 1_000.0))?;
    Ok(PipelineOptions {
        detect: detect_options(&file.lines)?,
        lift: lift_options(&file.lines)?,
        associate: AssociateOptions {
            association: file.estimate.association.into(),
            learned: super::matcher::learned_options(&file.matcher)?,
        },
        estimate: estimate_options(&file.estimate)?,
        motion: MotionOptions { max_turn_rad_per_s: file.sync.max_turn_deg_per_s.to_radians() },
        sync: sync_options(&file.sync)?,
        solve: SolveOptions { min_new_sets: file.estimate.min_new_sets, ..SolveOptions::default() },
        watch: super::watch::watch_limits(&file.watch)?,
        recovery: super::realsense::recovery(&file.cameras.recovery)?,
        n_line_threads: file.lines.threads,
    })
}

fn sync_options(file: &SyncSection) -> Result<SyncOptions, Refusal> {
    let SyncSection { max_skew_ms, wait_ms, stalled_after_ms, reopen_after_ms, .. } = *file;
    within("sync.max_skew_ms", max_skew_ms, (0.0, 1_000.0))?;
    within("sync.wait_ms", wait_ms, (1.0, 10_000.0))?;
    within("sync.stalled_after_ms", stalled_after_ms, (10.0, 60_000.0))?;
    within("sync.reopen_after_ms", reopen_after_ms, (10.0, 3_600_000.0))?;
    if max_skew_ms >= stalled_after_ms {
        let what = format!("{max_skew_ms} must be below sync.stalled_after_ms ({stalled_after_ms})");
        return Err(Refusal::new("sync.max_skew_ms", what));
    }
    Ok(SyncOptions {
        max_skew: from_ms(max_skew_ms),
        wait: from_ms(wait_ms),
        stalled_after: from_ms(stalled_after_ms),
        reopen_after: from_ms(reopen_after_ms),
    })
}

fn detect_options(file: &LinesSection) -> Result<DetectOptions, Refusal> {
    let LinesSection { min_length_px, min_gradient_levels_per_px, max_segments, .. } = *file;
    within("lines.min_length_px", min_length_px, (10.0, 1_000.0))?;
    within("lines.min_gradient_levels_per_px", min_gradient_levels_per_px, (0.1, 100.0))?;
    within("lines.max_segments", max_segments as f64, (1.0, 10_000.0))?;
    Ok(DetectOptions { min_length_px, min_gradient_levels_per_px, max_segments })
}

fn lift_options(file: &LinesSection) -> Result<LiftOptions, Refusal> {
    let LinesSection {
        sigma_inverse_depth_per_m, relative_systematic, min_inlier_ratio, min_coverage, ..
    } = *file;
    within("lines.sigma_inverse_depth_per_m", sigma_inverse_depth_per_m, (1e-5, 1.0))?;
    within("lines.relative_systematic", relative_systematic, (0.0, 0.5))?;
    within("lines.min_inlier_ratio", min_inlier_ratio, (0.1, 1.0))?;
    within("lines.min_coverage", min_coverage, (0.1, 1.0))?;
    Ok(LiftOptions { sigma_inverse_depth_per_m, relative_systematic, min_inlier_ratio, min_coverage })
}

fn estimate_options(file: &EstimateSection) -> Result<EstimateOptions, Refusal> {
    // Translations are voted in a grid: memory grows with the third power, and at 5 m it takes 0.5 GB.
    within("estimate.max_baseline_m", file.max_baseline_m, (0.01, 5.0))?;
    within("estimate.max_lines_per_view", file.max_lines_per_view as f64, (10.0, 1_000.0))?;
    within("estimate.max_sets", file.max_sets as f64, (1.0, 10_000.0))?;
    let evidence = EvidenceLimits { max_lines_per_view: file.max_lines_per_view, max_sets: file.max_sets };
    Ok(EstimateOptions {
        estimator: file.estimator.into(),
        max_baseline_m: file.max_baseline_m,
        evidence,
        verdict: verdict_limits(file)?,
    })
}

fn verdict_limits(file: &EstimateSection) -> Result<VerdictLimits, Refusal> {
    within("estimate.min_matches", file.min_matches as f64, (3.0, 10_000.0))?;
    within("estimate.min_views", file.min_views as f64, (1.0, 1_000.0))?;
    within("estimate.min_lead", file.min_lead, (1.0, 100.0))?;
    within("estimate.max_sigma_translation_mm", file.max_sigma_translation_mm, (0.01, 1_000.0))?;
    within("estimate.max_sigma_rotation_deg", file.max_sigma_rotation_deg, (0.001, 45.0))?;
    within("estimate.max_free_space_violated", file.max_free_space_violated, (0.0, 1.0))?;
    Ok(VerdictLimits {
        min_matches: file.min_matches,
        min_views: file.min_views,
        min_lead: file.min_lead,
        max_sigma_translation_m: file.max_sigma_translation_mm * 1e-3,
        max_sigma_rotation_rad: file.max_sigma_rotation_deg.to_radians(),
        max_free_space_violated: file.max_free_space_violated,
        ..VerdictLimits::default()
    })
}

/// The options of the synthetic back end.
///
/// # Errors
/// Names the first value out of range.
pub(super) fn synthetic_options(file: &SyntheticSection) -> Result<SyntheticOptions, Refusal> {
    let key = |name: &str| format!("cameras.synthetic.{name}");
    within(&key("yaw_deg"), file.yaw_deg, (-180.0, 180.0))?;
    within(&key("baseline_m"), file.baseline_m, (-1.0, 1.0))?;
    within(&key("disparity_sigma_px"), file.disparity_sigma_px, (0.0, 10.0))?;
    within(&key("rate_hz"), file.rate_hz, (0.1, 1_000.0))?;
    within(&key("frame_sets"), file.frame_sets.unwrap_or(1) as f64, (1.0, 1e12))?;
    within(&key("view_step"), file.view_step, (0.0, 100.0))?;
    within(&key("frames_per_view"), file.frames_per_view as f64, (1.0, 1e6))?;
    // 1.5 MB a frame: 1000 frames of two cameras are 3 GB.
    within(&key("render_ahead"), file.render_ahead.unwrap_or(1) as f64, (1.0, 1_000.0))?;
    let rig = match file.rig {
        SyntheticRig::ThreeCameras => SyntheticOptions { seed: file.seed, ..SyntheticOptions::demo() },
        SyntheticRig::Pair => SyntheticOptions::pair(file.yaw_deg, file.baseline_m, file.seed),
    };
    Ok(SyntheticOptions {
        noise: match file.noise {
            SyntheticNoise::Off => Noise::Off,
            SyntheticNoise::D435i => Noise::D435i { disparity_sigma_px: file.disparity_sigma_px },
        },
        pace: match file.pace {
            Pace::RealTime => synthetic::Pace::RealTime,
            Pace::Unpaced => synthetic::Pace::Unpaced,
        },
        period: Duration::from_secs_f64(1.0 / file.rate_hz),
        frame_sets: file.frame_sets,
        view_step: file.view_step,
        frames_per_view: file.frames_per_view,
        render_ahead: file.render_ahead,
        has_gyro: file.gyro,
        has_accel: file.accel,
        moves: super::synthetic::moves(file, &rig)?,
        ..rig
    })
}

/// Refuses a value outside a range, not-a-number included.
pub(super) fn within(key: &str, value: f64, (low, high): (f64, f64)) -> Result<(), Refusal> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Refusal::new(key, format!("{value} is out of range: allowed is {low} to {high}")))
}

fn from_ms(milliseconds: f64) -> Duration {
    Duration::from_secs_f64(milliseconds * 1e-3)
}
