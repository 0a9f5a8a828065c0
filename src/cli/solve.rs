//! `pelical solve`: the estimators alone, on matched line pairs. None sees which matches are wrong, nor the truth.

use std::time::Instant;

use super::args::{Estimator, SolveArgs};
use super::error::CliError;
use super::exit::Exit;
use super::output;
use super::output::solve::{Answer, SolveDocument, SolvedProblem};
use super::pairs_file::{self, KnownProblem, Problem};
use crate::solver::matched::{MatchedLimits, MatchedSolution, solve_matches};
use crate::solver::paper::{PaperOptions, PaperSolution, solve_pairs};
use crate::solver::{LinePair, State};

/// Solves every problem of a file with each estimator asked for, and prints the answers.
///
/// # Errors
/// When the file is not usable.
pub fn run(args: &SolveArgs) -> Result<Exit, CliError> {
    let known = pairs_file::read(&args.pairs)?;
    let estimators = args.estimator.estimators();
    let mut problems = Vec::with_capacity(known.len() * estimators.len());
    for KnownProblem { problem, truth } in &known {
        for &estimator in estimators {
            let answer = timed(problem, estimator);
            problems.push(SolvedProblem::new((&problem.id, estimator.name()), &answer, truth.as_ref()));
        }
    }
    let document = SolveDocument { schema: "pelical.solve/1", problems };
    if args.output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::solve::text(&document))?;
    }
    Ok(exit(&document, estimators.len()))
}

/// Done only if every problem was solved, by one estimator at least, and no answer is known to be wrong.
fn exit(document: &SolveDocument, n_estimators: usize) -> Exit {
    let mut answers = document.problems.chunks(n_estimators);
    if document.problems.iter().any(SolvedProblem::is_wrong) {
        Exit::Failed
    } else if answers.all(|answers| answers.iter().any(SolvedProblem::is_converged)) {
        Exit::Done
    } else {
        Exit::NoResult
    }
}

/// Solves on this thread; only the solving is timed.
fn timed(problem: &Problem, estimator: Estimator) -> Answer {
    let start = Instant::now();
    let mut answer = solve(&problem.pairs, estimator);
    answer.solve_us = start.elapsed().as_secs_f64() * 1e6;
    answer.inliers = answer.inliers.iter().filter_map(|&at| problem.positions.get(at).copied()).collect();
    answer
}

fn solve(pairs: &[LinePair], estimator: Estimator) -> Answer {
    match estimator {
        Estimator::Consensus => {
            let MatchedSolution { state, reason, target_from_source, inliers, .. } =
                solve_matches(pairs, &MatchedLimits::default());
            Answer { state, reason, target_from_source, inliers, solve_us: 0.0 }
        }
        Estimator::Pelical => {
            let solution = solve_pairs(pairs, &PaperOptions::default());
            let (state, reason) = match solution.pose() {
                Ok(_) => (State::Converged, None),
                Err((state, reason)) => (state, Some(reason)),
            };
            let PaperSolution { target_from_source, inliers, .. } = solution;
            Answer { state, reason, target_from_source, inliers, solve_us: 0.0 }
        }
    }
}
