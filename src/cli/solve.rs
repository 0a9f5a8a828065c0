//! `pelical solve`: the estimators alone, on matched line pairs. None sees which matches are wrong, nor the truth.

use std::time::Instant;

use super::args::{Estimator, SolveArgs};
use super::error::CliError;
use super::exit::Exit;
use super::output;
use super::output::solve::{Answer, SolveDocument, SolvedProblem};
use super::pairs_file::{self, KnownProblem, Problem};
use crate::solver::LinePair;
use crate::solver::matched::{MatchedLimits, MatchedSolution, solve_matches};

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
    let solution = solve(&problem.pairs, estimator);
    let solve_us = start.elapsed().as_secs_f64() * 1e6;
    let inliers =
        solution.inliers.iter().filter_map(|&index| problem.positions.get(index).copied()).collect();
    Answer { solution: MatchedSolution { inliers, ..solution }, solve_us }
}

fn solve(pairs: &[LinePair], estimator: Estimator) -> MatchedSolution {
    match estimator {
        Estimator::Consensus => solve_matches(pairs, &MatchedLimits::default()),
    }
}
