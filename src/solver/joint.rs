//! All cameras of the rig at once: poses along the strongest pairs, then one refinement over the matches of every converged pair.

use nalgebra::{DMatrix, DVector, Matrix6, Vector6};

use super::refine::NormalEquations;
use crate::geometry::motion::{Motion, hat, updated};

/// Most steps tried.
const MAX_STEPS: usize = 20;
/// A step this small ends the iteration: m and rad.
const SMALL_STEP: f64 = 1e-9;

/// A converged pair, as the joint refinement needs it.
pub struct Edge<'a> {
    /// Index of the target camera.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
    /// The pair's own estimate.
    pub target_from_source: Motion,
    /// Evidence for it; the strongest edges carry the poses.
    pub score: f64,
    /// The pair's robust normal equations at a pose.
    pub equations: Box<dyn Fn(&Motion) -> NormalEquations + 'a>,
}

/// The rig: poses and covariances of the cameras that the edges connect to the reference.
pub struct JointPoses {
    /// `reference_from_camera` per camera; `None` where no edge leads.
    pub poses: Vec<Option<Motion>>,
    /// Covariance of a step per camera (x y z rx ry rz); zero for the reference.
    pub covariances: Vec<Matrix6<f64>>,
}

/// Poses of all cameras that the edges connect to the reference, refined together.
pub fn solve_joint(n_cameras: usize, reference: usize, edges: &[Edge<'_>]) -> JointPoses {
    let mut poses = spanning_poses(n_cameras, reference, edges);
    let columns = columns(&poses, reference);
    let n_unknowns = 6 * columns.iter().flatten().count();
    let mut covariances = vec![Matrix6::zeros(); n_cameras];
    if n_unknowns == 0 {
        return JointPoses { poses, covariances };
    }
    let mut system = System::at(&poses, edges, (&columns, n_unknowns));
    let mut damping = 1e-6;
    for _ in 0..MAX_STEPS {
        let Some(step) = system.step(damping) else { break };
        let next_poses = stepped(&poses, &columns, &step);
        let next = System::at(&next_poses, edges, (&columns, n_unknowns));
        if next.cost <= system.cost {
            poses = next_poses;
            system = next;
            damping = (damping * 0.2_f64).max(1e-12);
            if step.amax() < SMALL_STEP {
                break;
            }
        } else {
            damping *= 10.0;
        }
    }
    let covariance = system.information.cholesky().map(|cholesky| cholesky.inverse());
    for (camera, column) in columns.iter().enumerate() {
        let Some(column) = column else { continue };
        match &covariance {
            Some(covariance) => {
                covariances[camera] = covariance.fixed_view::<6, 6>(*column, *column).into_owned();
            }
            // Never a pose that looks perfectly sure; pairs that fix their own pose do not lead here.
            None => poses[camera] = None,
        }
    }
    JointPoses { poses, covariances }
}

/// Poses along a tree of the strongest edges from the reference (Prim).
fn spanning_poses(n_cameras: usize, reference: usize, edges: &[Edge<'_>]) -> Vec<Option<Motion>> {
    let mut poses = vec![None; n_cameras];
    if let Some(pose) = poses.get_mut(reference) {
        *pose = Some(Motion::identity());
    }
    loop {
        let open = edges.iter().filter(|edge| poses[edge.target].is_some() != poses[edge.source].is_some());
        let Some(edge) = open.max_by(|a, b| a.score.total_cmp(&b.score)) else { return poses };
        match (poses[edge.target], poses[edge.source]) {
            (Some(reference_from_target), None) => {
                poses[edge.source] = Some(reference_from_target * edge.target_from_source);
            }
            (None, Some(reference_from_source)) => {
                poses[edge.target] = Some(reference_from_source * edge.target_from_source.inverse());
            }
            _ => return poses,
        }
    }
}

/// First column of each free camera in the system.
fn columns(poses: &[Option<Motion>], reference: usize) -> Vec<Option<usize>> {
    let mut next = 0;
    poses
        .iter()
        .enumerate()
        .map(|(camera, pose)| {
            if camera == reference || pose.is_none() {
                return None;
            }
            next += 6;
            Some(next - 6)
        })
        .collect()
}

fn stepped(poses: &[Option<Motion>], columns: &[Option<usize>], step: &DVector<f64>) -> Vec<Option<Motion>> {
    poses
        .iter()
        .zip(columns)
        .map(|(pose, column)| match (pose, column) {
            (Some(pose), Some(column)) => Some(updated(pose, &step.fixed_rows::<6>(*column).into_owned())),
            _ => *pose,
        })
        .collect()
}

/// Normal equations over all free cameras.
struct System {
    cost: f64,
    information: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl System {
    fn at(
        poses: &[Option<Motion>],
        edges: &[Edge<'_>],
        (columns, n_unknowns): (&[Option<usize>], usize),
    ) -> Self {
        let mut sum = Self {
            cost: 0.0,
            information: DMatrix::zeros(n_unknowns, n_unknowns),
            gradient: DVector::zeros(n_unknowns),
        };
        for edge in edges {
            let (Some(from_target), Some(from_source)) = (poses[edge.target], poses[edge.source]) else {
                continue;
            };
            let pair = (edge.equations)(&(from_target.inverse() * from_source));
            sum.cost += pair.cost;
            let derivatives = d_pair_step_d_steps(&from_target, &from_source);
            let ends = [(columns[edge.target], derivatives[0]), (columns[edge.source], derivatives[1])];
            for (row, by_row) in ends {
                let Some(row) = row else { continue };
                let gradient: Vector6<f64> = by_row.transpose() * pair.gradient;
                let mut rows = sum.gradient.fixed_rows_mut::<6>(row);
                rows += gradient;
                for (column, by_column) in ends {
                    let Some(column) = column else { continue };
                    let mut block = sum.information.fixed_view_mut::<6, 6>(row, column);
                    block += by_row.transpose() * pair.information * by_column;
                }
            }
        }
        sum
    }

    fn step(&self, damping: f64) -> Option<DVector<f64>> {
        let mut damped = self.information.clone();
        for axis in 0..damped.nrows() {
            damped[(axis, axis)] += damping * self.information[(axis, axis)] + 1e-9;
        }
        Some(-damped.cholesky()?.solve(&self.gradient))
    }
}

/// How a step of `target_from_source` follows from steps of `reference_from_target` and `reference_from_source`.
///
/// With `R = R_tᵀ R_s` and `t = R_tᵀ (t_s - t_t)`: a source step turns into `R_tᵀ` times itself; a target step into minus that,
/// plus `R_tᵀ [t_s - t_t]x dr` of translation.
pub fn d_pair_step_d_steps(from_target: &Motion, from_source: &Motion) -> [Matrix6<f64>; 2] {
    let turn_back = from_target.rotation.inverse().to_rotation_matrix().into_inner();
    let mut by_source = Matrix6::zeros();
    by_source.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn_back);
    by_source.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn_back);
    let mut by_target = -by_source;
    let lever = from_source.translation.vector - from_target.translation.vector;
    by_target.fixed_view_mut::<3, 3>(0, 3).copy_from(&(turn_back * hat(&lever)));
    [by_target, by_source]
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn the_step_of_a_pair_follows_from_the_steps_of_its_cameras() {
        let from_target = Motion::new(Vector3::new(0.1, 0.2, -0.3), Vector3::new(0.3, -1.0, 0.2));
        let from_source = Motion::new(Vector3::new(-0.4, 0.1, 0.2), Vector3::new(-0.7, 0.4, 1.1));
        let pair = |a: &Motion, b: &Motion| a.inverse() * b;
        let start = pair(&from_target, &from_source);
        let [by_target, by_source] = d_pair_step_d_steps(&from_target, &from_source);
        for axis in 0..6 {
            let mut step = Vector6::zeros();
            step[axis] = 1e-7;
            for (moved, derivative) in [
                (pair(&updated(&from_target, &step), &from_source), by_target),
                (pair(&from_target, &updated(&from_source, &step)), by_source),
            ] {
                let expected = updated(&start, &(derivative * step));
                assert!((moved.translation.vector - expected.translation.vector).norm() < 1e-12);
                assert!(moved.rotation.angle_to(&expected.rotation) < 1e-12);
            }
        }
    }
}
