//! `pelical.paper/1`: both experiments as one JSON document, a contract with scripts. Every number is finite or null.

use serde::Serialize;

use super::configuration::Configuration;
use super::grid::{Change, Grid, Spread, worst};
use super::published;
use super::stereo::{self, Metrics, StereoTrial};
use super::trial::{Error, Trial};
use crate::cli::output::document::MotionEntry;
use crate::solver::State;

/// The document.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PaperDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// Rooms.
    pub seeds: u64,
    /// Frame sets of each trial.
    pub sets: u64,
    /// Trials in all, and how many of them converged.
    pub trials: usize,
    /// See `trials`.
    pub converged: usize,
    /// Trials with a converged solution, at any time, more than 0.5 deg or 15 mm from the truth.
    pub wrong: usize,
    /// The largest errors of all.
    pub worst: WorstEntry,
    /// Every configuration, by angle and then distance.
    pub configurations: Vec<ConfigurationEntry>,
    /// Errors of change of the angle.
    pub rotation_changes: Vec<RotationChangeEntry>,
    /// Errors of change of the distance.
    pub distance_changes: Vec<DistanceChangeEntry>,
    /// Per baseline; empty where its configuration was not tried.
    pub stereo: Vec<StereoEntry>,
}

/// The largest errors of all; null without a converged trial or step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct WorstEntry {
    /// Of the paper's errors of change.
    pub rotation_change_deg: Option<f64>,
    /// See above.
    pub distance_change_mm: Option<f64>,
    /// Against the truth.
    pub rotation_error_deg: Option<f64>,
    /// See above.
    pub translation_error_mm: Option<f64>,
}

/// One configuration over all rooms; spreads are over the trials that converged.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ConfigurationEntry {
    /// Between the cameras.
    pub angle_deg: u32,
    /// Between the cameras.
    pub distance_cm: u32,
    /// 0 to 1.
    pub converged_share: Option<f64>,
    /// Frame sets after which the first converged solution came.
    pub sets_until_converged: Option<Spread>,
    /// Against the truth.
    pub rotation_error_deg: Option<Spread>,
    /// Against the truth.
    pub translation_error_mm: Option<Spread>,
    /// By room.
    pub trials: Vec<TrialEntry>,
}

/// One trial.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrialEntry {
    /// The room.
    pub seed: u64,
    /// Name of the last verdict.
    pub state: &'static str,
    /// Why it is not converged.
    pub reason: Option<String>,
    /// Frame sets after which the first converged solution came.
    pub sets_until_converged: Option<u64>,
    /// The last pose, converged or not.
    pub target_from_source: Option<MotionEntry>,
    /// Against the truth.
    pub rotation_error_deg: Option<f64>,
    /// Against the truth.
    pub translation_error_mm: Option<f64>,
    /// What the estimator claims, worst axis.
    pub sigma_deg: Option<f64>,
    /// What the estimator claims, worst axis.
    pub sigma_mm: Option<f64>,
    /// Lines that agree.
    pub matches: usize,
}

/// One step of the angle over all rooms.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RotationChangeEntry {
    /// What stays.
    pub distance_cm: u32,
    /// Before and after.
    pub step_deg: [u32; 2],
    /// The paper's error.
    pub error_deg: Option<Spread>,
    /// By room.
    pub errors_deg: Vec<f64>,
    /// What the paper reports for the same step.
    pub paper_deg: Option<f64>,
}

/// One step of the distance over all rooms.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DistanceChangeEntry {
    /// What stays.
    pub angle_deg: u32,
    /// Before and after.
    pub step_cm: [u32; 2],
    /// The paper's error.
    pub error_mm: Option<Spread>,
    /// By room.
    pub errors_mm: Vec<f64>,
    /// What the paper reports for the same step.
    pub paper_mm: Option<f64>,
}

/// The stereo experiment at one baseline.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StereoEntry {
    /// Between the cameras.
    pub baseline_cm: u32,
    /// Rooms with a converged calibration and a board in view.
    pub rooms: usize,
    /// With the estimated extrinsics.
    pub estimated: MetricsEntry,
    /// With the true extrinsics: what noise of depth and corners alone leaves.
    pub exact: MetricsEntry,
    /// The paper's table.
    pub paper: Vec<PaperStereoEntry>,
}

/// The paper's metrics over all rooms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MetricsEntry {
    /// Error of the mean square.
    pub l_mm: Option<Spread>,
    /// Difference of the planes' distances.
    pub d_mm: Option<Spread>,
    /// Angle between the planes.
    pub theta_deg: Option<Spread>,
}

/// A line of the paper's stereo table; units as printed, which is without.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PaperStereoEntry {
    /// Who calibrated.
    pub method: &'static str,
    /// As printed.
    pub l: f64,
    /// As printed.
    pub d: f64,
    /// As printed.
    pub theta: f64,
}

impl PaperDocument {
    /// Of all trials.
    pub fn new(grid: &Grid<'_>, (seeds, sets): (u64, u64), stereo: &[StereoTrial]) -> Self {
        let (rotation, distance) = (grid.rotation_changes(), grid.distance_changes());
        let configurations = Configuration::grid(grid.angles_deg, grid.distances_cm);
        let worst_error = |of: fn(&Error) -> f64| {
            converged(grid.trials.iter()).filter_map(|trial| trial.error.as_ref().map(of)).reduce(f64::max)
        };
        Self {
            schema: "pelical.paper/1",
            seeds,
            sets,
            trials: grid.trials.len(),
            converged: grid.converged(),
            wrong: grid.wrong(),
            worst: WorstEntry {
                rotation_change_deg: worst(&rotation),
                distance_change_mm: worst(&distance),
                rotation_error_deg: worst_error(|error| error.rotation_deg),
                translation_error_mm: worst_error(|error| error.translation_mm),
            },
            configurations: configurations.into_iter().map(|one| configuration(grid, one)).collect(),
            rotation_changes: rotation.into_iter().map(rotation_change).collect(),
            distance_changes: distance.into_iter().map(distance_change).collect(),
            stereo: stereo::BASELINES_CM
                .iter()
                .filter_map(|&baseline| stereo_entry(baseline, stereo))
                .collect(),
        }
    }
}

fn converged<'a>(trials: impl Iterator<Item = &'a Trial>) -> impl Iterator<Item = &'a Trial> {
    trials.filter(|trial| trial.state == State::Converged)
}

fn configuration(grid: &Grid<'_>, which: Configuration) -> ConfigurationEntry {
    let all: Vec<&Trial> = grid.of(which).collect();
    let good: Vec<&Trial> = converged(all.iter().copied()).collect();
    let spread = |of: fn(&Error) -> f64| {
        Spread::of(good.iter().filter_map(|trial| trial.error.as_ref().map(of)).collect())
    };
    let sets = good.iter().filter_map(|trial| trial.first_converged.map(|sets| sets as f64));
    ConfigurationEntry {
        angle_deg: which.angle_deg,
        distance_cm: which.distance_cm,
        converged_share: (!all.is_empty()).then(|| good.len() as f64 / all.len() as f64),
        sets_until_converged: Spread::of(sets.collect()),
        rotation_error_deg: spread(|error| error.rotation_deg),
        translation_error_mm: spread(|error| error.translation_mm),
        trials: all.into_iter().map(trial_entry).collect(),
    }
}

fn trial_entry(trial: &Trial) -> TrialEntry {
    TrialEntry {
        seed: trial.seed,
        state: trial.state.name(),
        reason: trial.reason.clone(),
        sets_until_converged: trial.first_converged,
        target_from_source: trial.target_from_source.as_ref().map(MotionEntry::from),
        rotation_error_deg: trial.error.map(|error| error.rotation_deg),
        translation_error_mm: trial.error.map(|error| error.translation_mm),
        sigma_deg: trial.sigma.map(|sigma| sigma.rotation_deg),
        sigma_mm: trial.sigma.map(|sigma| sigma.translation_mm),
        matches: trial.matches,
    }
}

fn rotation_change(change: Change) -> RotationChangeEntry {
    let Change { fixed, step, errors } = change;
    RotationChangeEntry {
        distance_cm: fixed,
        step_deg: step,
        error_deg: Spread::of(errors.clone()),
        errors_deg: errors,
        paper_deg: published::rotation_change_deg(fixed, step),
    }
}

fn distance_change(change: Change) -> DistanceChangeEntry {
    let Change { fixed, step, errors } = change;
    DistanceChangeEntry {
        angle_deg: fixed,
        step_cm: step,
        error_mm: Spread::of(errors.clone()),
        errors_mm: errors,
        paper_mm: published::distance_change_mm(fixed, step),
    }
}

fn stereo_entry(baseline_cm: u32, trials: &[StereoTrial]) -> Option<StereoEntry> {
    let of_baseline: Vec<&StereoTrial> =
        trials.iter().filter(|trial| trial.baseline_cm == baseline_cm).collect();
    let metrics = |which: fn(&StereoTrial) -> Metrics| {
        let spread =
            |of: fn(&Metrics) -> f64| Spread::of(of_baseline.iter().map(|trial| of(&which(trial))).collect());
        MetricsEntry {
            l_mm: spread(|m| m.l_mm),
            d_mm: spread(|m| m.d_mm),
            theta_deg: spread(|m| m.theta_deg),
        }
    };
    let paper = published::STEREO.iter().filter(|known| known.baseline_cm == baseline_cm).map(|known| {
        let [l, d, theta] = known.l_d_theta;
        PaperStereoEntry { method: known.method, l, d, theta }
    });
    (!of_baseline.is_empty()).then(|| StereoEntry {
        baseline_cm,
        rooms: of_baseline.len(),
        estimated: metrics(|trial| trial.estimated),
        exact: metrics(|trial| trial.exact),
        paper: paper.collect(),
    })
}
