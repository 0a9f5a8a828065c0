//! What all trials of the grid come to: absolute errors per configuration, errors of change per step, false convergence.

use serde::Serialize;

use super::change::{distance_change_error_mm, rotation_change_error_deg};
use super::configuration::Configuration;
use super::trial::Trial;
use crate::cli::evaluate::{WRONG_BEYOND_DEG, WRONG_BEYOND_MM};
use crate::geometry::motion::Motion;
use crate::solver::State;

/// Median and worst of several rooms.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    /// The middle value; of an even number the mean of the two in the middle.
    pub median: f64,
    /// The largest.
    pub worst: f64,
}

impl Spread {
    /// `None` of nothing.
    pub fn of(mut values: Vec<f64>) -> Option<Self> {
        values.sort_by(f64::total_cmp);
        let (low, high) = (values.get(values.len().checked_sub(1)? / 2)?, values.get(values.len() / 2)?);
        Some(Self { median: 0.5 * (low + high), worst: *values.last()? })
    }
}

/// All trials of all configurations.
#[derive(Debug)]
pub struct Grid<'a> {
    /// In ascending order.
    pub angles_deg: &'a [u32],
    /// In ascending order.
    pub distances_cm: &'a [u32],
    /// Every configuration in every room.
    pub trials: &'a [Trial],
}

/// A step from one setting to the next, the other setting fixed.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// The setting that stays: cm where the angle changes, deg where the distance does.
    pub fixed: u32,
    /// The setting that changes: before and after.
    pub step: [u32; 2],
    /// Per room in which both configurations converged: deg where the angle changes, mm where the distance does.
    pub errors: Vec<f64>,
}

impl Grid<'_> {
    /// The trials of a configuration, by room.
    pub fn of(&self, configuration: Configuration) -> impl Iterator<Item = &Trial> {
        self.trials.iter().filter(move |trial| trial.configuration == configuration)
    }

    /// Errors of change of the rotation: for each distance every step of the angle.
    pub fn rotation_changes(&self) -> Vec<Change> {
        let step = |(distance_cm, step): (u32, [u32; 2])| {
            let at = |angle_deg| Configuration { angle_deg, distance_cm };
            let step_deg = f64::from(step[1]) - f64::from(step[0]);
            let error = |poses: [&Motion; 2]| rotation_change_error_deg(poses, step_deg);
            Change { fixed: distance_cm, step, errors: self.errors(step.map(at), error) }
        };
        steps(self.distances_cm, self.angles_deg).map(step).collect()
    }

    /// Errors of change of the distance: for each angle every step of the distance.
    pub fn distance_changes(&self) -> Vec<Change> {
        let step = |(angle_deg, step): (u32, [u32; 2])| {
            let at = |distance_cm| Configuration { angle_deg, distance_cm };
            let step_mm = 10.0 * (f64::from(step[1]) - f64::from(step[0]));
            let error = |poses: [&Motion; 2]| distance_change_error_mm(poses, step_mm);
            Change { fixed: angle_deg, step, errors: self.errors(step.map(at), error) }
        };
        steps(self.angles_deg, self.distances_cm).map(step).collect()
    }

    /// One error per room in which both configurations converged.
    fn errors(&self, [first, second]: [Configuration; 2], error: impl Fn([&Motion; 2]) -> f64) -> Vec<f64> {
        let converged = |trial: &&Trial| trial.state == State::Converged;
        let pairs = self.of(first).filter(converged).filter_map(|before| {
            let after = self.of(second).filter(converged).find(|after| after.seed == before.seed)?;
            Some(error([before.target_from_source.as_ref()?, after.target_from_source.as_ref()?]))
        });
        pairs.collect()
    }

    /// How many trials converged in the end.
    pub fn converged(&self) -> usize {
        self.trials.iter().filter(|trial| trial.state == State::Converged).count()
    }

    /// How many trials had, at any time, a converged solution that was wrong.
    pub fn wrong(&self) -> usize {
        let is_wrong = |trial: &&Trial| {
            trial.worst_converged.is_some_and(|worst| {
                worst.rotation_deg > WRONG_BEYOND_DEG || worst.translation_mm > WRONG_BEYOND_MM
            })
        };
        self.trials.iter().filter(is_wrong).count()
    }
}

/// Every fixed setting with every step between neighbouring settings of the other kind.
fn steps<'a>(fixed: &'a [u32], changing: &'a [u32]) -> impl Iterator<Item = (u32, [u32; 2])> + 'a {
    fixed.iter().flat_map(move |&fixed| changing.windows(2).map(move |step| (fixed, [step[0], step[1]])))
}

/// The largest error of several changes.
pub fn worst(changes: &[Change]) -> Option<f64> {
    changes.iter().flat_map(|change| change.errors.iter().copied()).reduce(f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::paper::trial::Error;

    fn trial(angle_deg: u32, distance_cm: u32, (x_m, yaw_deg): (f64, f64)) -> Trial {
        let rotation =
            nalgebra::UnitQuaternion::from_axis_angle(&nalgebra::Vector3::y_axis(), f64::to_radians(yaw_deg));
        Trial {
            configuration: Configuration { angle_deg, distance_cm },
            seed: 1,
            state: State::Converged,
            reason: None,
            target_from_source: Some(Motion::from_parts(
                nalgebra::Translation3::new(x_m, 0.0, 0.0),
                rotation,
            )),
            sigma: None,
            error: None,
            first_converged: Some(6),
            worst_converged: None,
            matches: 20,
        }
    }

    #[test]
    fn changes_are_taken_between_neighbouring_settings() {
        let trials = [
            trial(0, 20, (0.200, 0.1)),
            trial(0, 25, (0.252, 0.0)),
            trial(20, 20, (0.201, 20.0)),
            trial(20, 25, (0.250, 20.2)),
        ];
        let grid = Grid { angles_deg: &[0, 20], distances_cm: &[20, 25], trials: &trials };
        let near = |changes: &[Change], expected: [(u32, f64); 2]| {
            for (change, (fixed, error)) in changes.iter().zip(expected) {
                assert!(change.fixed == fixed && (change.errors[0] - error).abs() < 1e-9, "{change:?}");
            }
        };
        near(&grid.rotation_changes(), [(20, 0.1), (25, 0.2)]);
        near(&grid.distance_changes(), [(0, 2.0), (20, 1.0)]);
    }

    #[test]
    fn what_has_not_converged_has_no_error_of_change() {
        let lost = Trial { state: State::Collecting, ..trial(20, 20, (0.2, 20.0)) };
        let trials = [trial(0, 20, (0.2, 0.0)), lost];
        let grid = Grid { angles_deg: &[0, 20], distances_cm: &[20], trials: &trials };
        assert!(grid.rotation_changes()[0].errors.is_empty());
        assert_eq!(grid.converged(), 1);
    }

    #[test]
    fn a_wrong_solution_on_the_way_counts() {
        let error = |translation_mm| Some(Error { rotation_deg: 0.01, translation_mm });
        let of = |worst_converged| Trial { worst_converged, ..trial(0, 20, (0.2, 0.0)) };
        let trials = [of(error(1.0)), of(error(16.0)), of(None)];
        assert_eq!(Grid { angles_deg: &[0], distances_cm: &[20], trials: &trials }.wrong(), 1);
    }

    #[test]
    fn the_median_of_an_even_number_lies_between_the_middle_two() {
        assert_eq!(Spread::of(vec![4.0, 1.0, 2.0, 3.0]), Some(Spread { median: 2.5, worst: 4.0 }));
        assert_eq!(Spread::of(vec![5.0]), Some(Spread { median: 5.0, worst: 5.0 }));
        assert_eq!(Spread::of(Vec::new()), None);
    }
}
