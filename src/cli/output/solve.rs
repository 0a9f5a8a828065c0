//! `pelical.solve/1`, and the same as text.

use std::fmt::Write as _;

use serde::Serialize;

use super::document::{MotionEntry, ReasonEntry};
use super::text::table;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::{Reason, State};

/// A converged pose further from the truth than this is wrong, deg.
const WRONG_BEYOND_DEG: f64 = 0.5;
/// See [`WRONG_BEYOND_DEG`]; mm.
const WRONG_BEYOND_MM: f64 = 20.0;

/// What an estimator found, and how long it took.
#[derive(Debug)]
pub struct Answer {
    /// The verdict.
    pub state: State,
    /// Why it is not converged.
    pub reason: Option<Reason>,
    /// The pose; `None` unless converged.
    pub target_from_source: Option<Motion>,
    /// Positions in the file's list of lines of those that agree.
    pub inliers: Vec<usize>,
    /// The solving alone.
    pub solve_us: f64,
}

/// `pelical.solve/1`.
#[derive(Debug, Serialize)]
pub struct SolveDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// In the order of the file; with several estimators, one after the other for each problem.
    pub problems: Vec<SolvedProblem>,
}

/// One problem with the answer of one estimator.
#[derive(Debug, Serialize)]
pub struct SolvedProblem {
    /// Name in the file.
    pub id: String,
    /// Which estimator.
    pub estimator: &'static str,
    /// Name of the verdict.
    pub state: &'static str,
    /// Why it is not converged.
    pub reason: Option<ReasonEntry>,
    /// The pose; null unless converged.
    pub target_from_source: Option<MotionEntry>,
    /// Positions in the problem's list of lines of those that agree with the best pose; without a pose, maybe none.
    pub inliers: Vec<usize>,
    /// The solving alone, µs.
    pub solve_us: f64,
    /// Errors against the truth, where the file gives it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<ErrorEntry>,
}

/// How far a pose is from the truth; null without pose.
#[derive(Debug, Serialize)]
pub struct ErrorEntry {
    /// Angle of the relative rotation.
    pub rotation_error_deg: Option<f64>,
    /// Length of the difference of the translations.
    pub translation_error_mm: Option<f64>,
}

impl SolvedProblem {
    /// The entry of an answer.
    pub fn new((id, estimator): (&str, &'static str), answer: &Answer, truth: Option<&Motion>) -> Self {
        let Answer { state, reason, target_from_source, inliers, solve_us } = answer;
        let error = |truth: &Motion| ErrorEntry {
            rotation_error_deg: target_from_source.map(|found| rotation_gap_rad(&found, truth).to_degrees()),
            translation_error_mm: target_from_source.map(|found| 1e3 * translation_gap_m(&found, truth)),
        };
        Self {
            id: id.to_owned(),
            estimator,
            state: state.name(),
            reason: reason.as_ref().map(ReasonEntry::from),
            target_from_source: target_from_source.as_ref().map(MotionEntry::from),
            inliers: inliers.clone(),
            solve_us: (10.0 * solve_us).round() / 10.0,
            truth: truth.map(error),
        }
    }

    /// Whether every test was passed.
    pub fn is_converged(&self) -> bool {
        self.target_from_source.is_some()
    }

    /// Whether it says converged, but the truth is elsewhere.
    pub fn is_wrong(&self) -> bool {
        let beyond = |error: Option<f64>, limit: f64| error.is_some_and(|error| error > limit);
        self.truth.as_ref().is_some_and(|truth| {
            beyond(truth.rotation_error_deg, WRONG_BEYOND_DEG)
                || beyond(truth.translation_error_mm, WRONG_BEYOND_MM)
        })
    }
}

/// One line per answer and a summary per estimator.
pub fn text(document: &SolveDocument) -> String {
    let header = ["problem", "estimator", "state", "inliers", "off by deg", "off by mm", "us", "reason"];
    let mut text = table(&header, &document.problems.iter().map(row).collect::<Vec<_>>());
    let mut told: Vec<&str> = Vec::new();
    for SolvedProblem { estimator, .. } in &document.problems {
        if !told.contains(estimator) {
            told.push(estimator);
            text.push('\n');
            let of_estimator = document.problems.iter().filter(|solved| solved.estimator == *estimator);
            text += &summary(estimator, &of_estimator.collect::<Vec<_>>());
        }
    }
    text
}

fn row(solved: &SolvedProblem) -> Vec<String> {
    let error = |pick: fn(&ErrorEntry) -> Option<f64>| cell(solved.truth.as_ref().and_then(pick));
    vec![
        solved.id.clone(),
        solved.estimator.to_owned(),
        solved.state.to_owned(),
        solved.inliers.len().to_string(),
        error(|truth| truth.rotation_error_deg),
        error(|truth| truth.translation_error_mm),
        format!("{:.0}", solved.solve_us),
        solved.reason.as_ref().map_or_else(String::new, |reason| reason.sentence.clone()),
    ]
}

fn summary(estimator: &str, solved: &[&SolvedProblem]) -> String {
    let converged = solved.iter().filter(|solved| solved.is_converged()).count();
    let mut text = format!("{estimator}: {converged} of {} problems converged", solved.len());
    let errors = || solved.iter().filter_map(|solved| solved.truth.as_ref());
    if errors().next().is_some() {
        let wrong = solved.iter().filter(|solved| solved.is_wrong()).count();
        let deg = median(errors().filter_map(|truth| truth.rotation_error_deg));
        let mm = median(errors().filter_map(|truth| truth.translation_error_mm));
        let _ = write!(text, ", {wrong} wrong");
        if converged > 0 {
            let _ = write!(text, "; median error {} deg, {} mm", cell(deg), cell(mm));
        }
    }
    let us = median(solved.iter().map(|solved| solved.solve_us));
    let _ = writeln!(text, "; median {:.0} us", us.unwrap_or(0.0));
    text
}

fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => None,
        n if n % 2 == 1 => Some(values[middle]),
        _ => Some(0.5 * (values[middle - 1] + values[middle])),
    }
}

fn cell(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.3}"))
}
