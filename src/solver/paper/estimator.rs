//! The paper's outer loop (Fig. 3): gate, quadratic system, RE3Q3, refinement of the roots, convergence voting, cost.
//!
//! It ends when enough pairs vote for one translation *and* the cost of the voters is below its limit. Voters whose cost is too high
//! go on alone: what is optimised and judged is the set that was pruned. Of the roots that pass, the one with the least cost wins,
//! and none does where another explains the same voters as well, or where an axis stays open. There is no consensus start: what cannot
//! be reached from the least squares over the pairs is not found.

use nalgebra::Matrix3;

use super::convergence_vote::convergence_vote;
use super::gate::{GateRule, gate};
use super::hypotheses::hypotheses;
use super::options::PaperOptions;
use super::outcome::{PaperOutcome, PaperSolution};
use super::pair_geometry::PairGeometry;
use super::refine::{Objective, ReadPair, Refined, refine};
use super::rotation_roots::Starts;
use super::translation_candidate::TranslationCandidate;
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};
use crate::solver::LinePair;

/// Hypotheses whose voters are counted in one round, best first.
const MAX_VOTES: usize = 2;
/// Steps that bring a hypothesis near enough to its minimum for the vote, which tolerates millimetres.
const STEPS_TO_THE_VOTE: usize = 4;
/// Steps from there to the minimum of the voters (3 to 6 are needed).
const STEPS_TO_THE_MINIMUM: usize = 10;
/// A pair whose direction is further off than this has no vote, rad: beyond what noise does to a usable line (11 deg).
const MAX_ANGLE_RAD: f64 = 0.2;
/// Poses further apart than this in rotation, rad (3 deg) ...
const OTHER_POSE_RAD: f64 = 0.05;
/// ... or in translation, m, are different answers.
const OTHER_POSE_M: f64 = 0.1;
/// A rival whose cost for the winner's voters is beyond this many limits before it is refined over them is none.
const HOPELESS_RIVAL: f64 = 3.0;

/// Estimates `target_from_source` from matched pairs, wrong ones among them.
///
/// Everything costly is tried only when what is cheap finds nothing: first the roots of the system, then all minima of its least
/// squares, then these with the gate on ([`GateRule::WhenStuck`]).
pub fn solve_pairs(pairs: &[LinePair], options: &PaperOptions) -> PaperSolution {
    let attempts = match options.gate {
        GateRule::WhenStuck { n_sigmas } => vec![
            (GateRule::Off, Starts::Roots),
            (GateRule::Off, Starts::RootsAndCube),
            (GateRule::WithinNoise { n_sigmas }, Starts::RootsAndCube),
        ],
        rule => vec![(rule, Starts::Roots), (rule, Starts::RootsAndCube)],
    };
    let all = ActiveSet::new(pairs);
    let mut stuck: Option<PaperSolution> = None;
    for (rule, starts) in attempts {
        let solution = outer_loop(all.kept(&gate(&all.pairs, rule)), starts, options);
        if !solution.outcome.is_stuck() {
            return solution;
        }
        // What the first attempt says is about all pairs.
        stuck.get_or_insert(solution);
    }
    stuck.unwrap_or_else(|| without_pose(PaperOutcome::NoRoot))
}

fn without_pose(outcome: PaperOutcome) -> PaperSolution {
    PaperSolution {
        outcome,
        target_from_source: None,
        inliers: Vec::new(),
        mean_cost: f64::INFINITY,
        rounds: 0,
    }
}

fn outer_loop(mut set: ActiveSet<'_>, starts: Starts, options: &PaperOptions) -> PaperSolution {
    let (mut rounds, mut mean_cost) = (0, f64::INFINITY);
    let (outcome, target_from_source) = loop {
        rounds += 1;
        let n_before = set.pairs.len();
        let voted = match voted(&set.pairs, starts, options) {
            Ok(voted) => voted,
            Err(outcome) => break (outcome, None),
        };
        set = set.kept(&voted.voters);
        let objective = objective(&set.pairs, options);
        let refined = refine(&objective, &voted.target_from_source, STEPS_TO_THE_MINIMUM);
        mean_cost = refined.mean_cost;
        if mean_cost <= options.max_mean_cost {
            break judged(&objective, &refined, (&voted.rivals, options));
        }
        if set.pairs.len() == n_before {
            break (PaperOutcome::CostTooHigh { mean_cost, limit: options.max_mean_cost }, None);
        }
    };
    let inliers = if target_from_source.is_some() { set.indices } else { Vec::new() };
    PaperSolution { outcome, target_from_source, inliers, mean_cost, rounds }
}

/// The pairs that take part, with their indices in what was given.
struct ActiveSet<'a> {
    indices: Vec<usize>,
    pairs: Vec<ReadPair<'a>>,
}

impl<'a> ActiveSet<'a> {
    fn new(pairs: &'a [LinePair]) -> Self {
        let readable = pairs.iter().enumerate();
        let readable = readable
            .filter_map(|(idx, pair)| Some((idx, ReadPair { pair, geometry: PairGeometry::try_new(pair)? })));
        let (indices, pairs) = readable.unzip();
        Self { indices, pairs }
    }

    fn kept(&self, positions: &[usize]) -> Self {
        Self {
            indices: positions.iter().map(|&position| self.indices[position]).collect(),
            pairs: positions.iter().map(|&position| self.pairs[position]).collect(),
        }
    }
}

fn objective<'a>(pairs: &'a [ReadPair<'a>], options: &PaperOptions) -> Objective<'a> {
    Objective { pairs, weighting: options.weighting, loss_width: options.loss_width }
}

/// The best pose that makes enough translation candidates meet.
struct Voted {
    target_from_source: Motion,
    /// Positions among the pairs.
    voters: Vec<usize>,
    /// The other hypotheses.
    rivals: Vec<Motion>,
}

/// One round up to the vote. The hypotheses come best first, so the first one with enough voters is the best that has them.
fn voted(pairs: &[ReadPair<'_>], starts: Starts, options: &PaperOptions) -> Result<Voted, PaperOutcome> {
    if pairs.len() < options.min_pairs {
        return Err(PaperOutcome::TooFewPairs { pairs: pairs.len(), needed: options.min_pairs });
    }
    let mut rivals = hypotheses(pairs, starts);
    if rivals.is_empty() {
        return Err(PaperOutcome::NoRoot);
    }
    let mut most = 0;
    for rank in 0..rivals.len().min(MAX_VOTES) {
        let refined = refine(&objective(pairs, options), &rivals[rank], STEPS_TO_THE_VOTE);
        let voters = voters(pairs, &refined.target_from_source, options);
        if voters.len() >= options.min_voters {
            rivals.remove(rank);
            return Ok(Voted { target_from_source: refined.target_from_source, voters, rivals });
        }
        most = most.max(voters.len());
    }
    Err(PaperOutcome::TooFewVoters { voters: most, needed: options.min_voters })
}

/// Positions of the pairs whose translation candidates meet in one point (paper, Algorithm 1).
fn voters(pairs: &[ReadPair<'_>], target_from_source: &Motion, options: &PaperOptions) -> Vec<usize> {
    let rotation = target_from_source.rotation.to_rotation_matrix();
    let candidate = |pair: &ReadPair<'_>| TranslationCandidate::try_new(pair.pair, &rotation, MAX_ANGLE_RAD);
    let (positions, candidates): (Vec<usize>, Vec<TranslationCandidate>) =
        pairs.iter().enumerate().filter_map(|(position, pair)| Some((position, candidate(pair)?))).unzip();
    let vote = convergence_vote(&candidates, options.tolerance);
    vote.map_or(Vec::new(), |vote| vote.inliers.into_iter().map(|idx| positions[idx]).collect())
}

/// A pose that meets both conditions converged, unless its voters leave an axis open or allow another pose.
fn judged(
    objective: &Objective<'_>,
    refined: &Refined,
    (rivals, options): (&[Motion], &PaperOptions),
) -> (PaperOutcome, Option<Motion>) {
    let pose = &refined.target_from_source;
    let (sigma_translation_m, sigma_rotation_rad) = sigmas(objective, pose);
    let observable = sigma_translation_m <= options.max_sigma_translation_m
        && sigma_rotation_rad <= options.max_sigma_rotation_rad;
    if !observable {
        return (PaperOutcome::NotObservable { sigma_translation_m, sigma_rotation_rad }, None);
    }
    match rivals.iter().find_map(|rival| equal_rival(objective, pose, (rival, options.max_mean_cost))) {
        Some((rotation_gap_rad, translation_gap_m)) => {
            (PaperOutcome::Ambiguous { rotation_gap_rad, translation_gap_m }, None)
        }
        None => (PaperOutcome::Converged, Some(*pose)),
    }
}

/// How far another pose is away that explains the winner's voters below the limit, too; `None` where it does not, or refines into it.
fn equal_rival(
    objective: &Objective<'_>,
    winner: &Motion,
    (rival, limit): (&Motion, f64),
) -> Option<(f64, f64)> {
    let gaps = |rival: &Motion| {
        let gaps = (rotation_gap_rad(winner, rival), translation_gap_m(winner, rival));
        (gaps.0 > OTHER_POSE_RAD || gaps.1 > OTHER_POSE_M).then_some(gaps)
    };
    gaps(rival)?;
    if objective.at(rival).cost > HOPELESS_RIVAL * limit * objective.pairs.len() as f64 {
        return None;
    }
    let refined = refine(objective, rival, STEPS_TO_THE_MINIMUM);
    gaps(&refined.target_from_source).filter(|_| refined.mean_cost <= limit)
}

/// Standard deviations of the pose in its worst directions, translation (m) and rotation (rad): from the information of the objective and
/// the scatter that it leaves, so they hold in any units; infinite where the pairs leave a direction open.
fn sigmas(objective: &Objective<'_>, target_from_source: &Motion) -> (f64, f64) {
    let open = (f64::INFINITY, f64::INFINITY);
    let system = objective.at(target_from_source);
    let Some(cholesky) = system.information.cholesky() else { return open };
    // Of the six numbers of e_L four are independent.
    let n_numbers: usize =
        objective.pairs.iter().map(|pair| if pair.pair.full_target().is_some() { 4 } else { 2 }).sum();
    let Some(n_free) = n_numbers.checked_sub(6).filter(|n_free| *n_free > 0) else { return open };
    let covariance = cholesky.inverse() * (system.weighted_error2 / n_free as f64);
    let worst = |first: usize| {
        let block: Matrix3<f64> = covariance.fixed_view::<3, 3>(first, first).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    (worst(0), worst(3))
}

#[cfg(test)]
mod tests;
