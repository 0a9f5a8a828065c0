//! Rotation voting: which rotations bring many source directions onto target directions at once.
//!
//! One candidate match leaves a circle of rotations (two, since a line has no orientation). All circles are drawn into a
//! histogram over SO(3); its strongest cells are refined on the directions they align. Nothing here knows of translation.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use super::candidates::Candidate;

/// Cells per axis of each of the four faces: 3.8 degrees in the middle of a face, less towards its corners.
const CELLS_PER_AXIS: usize = 60;
/// Steps of a circle: one per cell.
const CIRCLE_STEPS: usize = 96;
/// Raw modes kept before refinement; the true rotation was among the first 150 in every rendered recording.
const MAX_RAW_MODES: usize = 400;
/// Raw modes closer than this are one, rad.
const RAW_MODE_GAP_RAD: f64 = 0.07;
/// Refined modes closer than this are one, rad.
const MODE_GAP_RAD: f64 = 0.026;
/// Widths of the direction gate while refining, rad: from the size of a cell down to good directions.
const REFINE_GATES_RAD: [f64; 4] = [0.10, 0.07, 0.05, 0.035];

/// A rotation that many directions support.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RotationMode {
    /// The rotation.
    pub target_from_source: UnitQuaternion<f64>,
    /// Summed weight of the supporting candidates.
    pub support: f64,
}

/// The strongest rotations, best first, at most `max_modes`; incomplete once `keep_going` says no.
pub fn rotation_modes(
    candidates: &[Candidate],
    max_modes: usize,
    keep_going: &dyn Fn() -> bool,
) -> Vec<RotationMode> {
    let histogram = histogram(candidates);
    let mut modes: Vec<RotationMode> = raw_modes(&histogram)
        .into_iter()
        .take_while(|_| keep_going())
        .map(|rotation| refine(candidates, rotation))
        .collect();
    modes.sort_by(|a, b| b.support.total_cmp(&a.support));
    let mut kept: Vec<RotationMode> = Vec::new();
    for mode in modes {
        let is_new = kept
            .iter()
            .all(|other| other.target_from_source.angle_to(&mode.target_from_source) > MODE_GAP_RAD);
        if is_new && kept.len() < max_modes {
            kept.push(mode);
        }
    }
    kept
}

/// What a rotation near this one has of support.
pub fn support(candidates: &[Candidate], target_from_source: &UnitQuaternion<f64>) -> f64 {
    refine(candidates, *target_from_source).support
}

/// Votes per cell.
fn histogram(candidates: &[Candidate]) -> Vec<f32> {
    let mut cells = vec![0.0_f32; 4 * CELLS_PER_AXIS.pow(3)];
    let circle: Vec<(f64, f64)> = (0..CIRCLE_STEPS)
        .map(|step| (std::f64::consts::PI * step as f64 / CIRCLE_STEPS as f64).sin_cos())
        .collect();
    for candidate in candidates {
        for sign in [1.0, -1.0] {
            let to = candidate.target_direction * sign;
            let start = shortest_rotation(&candidate.source_direction, &to);
            let turned = Quaternion::from_imag(to) * start;
            for (sine, cosine) in &circle {
                let rotation = start * *cosine + turned * *sine;
                cells[cell_of(&rotation)] += candidate.weight as f32;
            }
        }
    }
    cells
}

/// The shortest rotation from one unit vector to another; for opposite vectors a half turn about any normal.
fn shortest_rotation(from: &Vector3<f64>, to: &Vector3<f64>) -> Quaternion<f64> {
    let cosine = from.dot(to);
    if cosine > -0.999_999 {
        let imaginary = from.cross(to);
        return Quaternion::from_parts(1.0 + cosine, imaginary).normalize();
    }
    let (normal, _) = crate::geometry::motion::normal_basis(from);
    Quaternion::from_imag(normal)
}

/// The cell of a rotation: the face of its largest component, and the other three divided by it.
fn cell_of(rotation: &Quaternion<f64>) -> usize {
    let q = &rotation.coords;
    let face = q.iamax();
    let scale = 0.5 * CELLS_PER_AXIS as f64;
    let mut index = face;
    for axis in (0..4).filter(|&axis| axis != face) {
        let place = ((q[axis] / q[face] + 1.0) * scale) as usize;
        index = index * CELLS_PER_AXIS + place.min(CELLS_PER_AXIS - 1);
    }
    index
}

/// The rotation in the middle of a cell.
fn centre_of(mut index: usize) -> UnitQuaternion<f64> {
    let mut places = [0.0; 3];
    for place in places.iter_mut().rev() {
        *place = ((index % CELLS_PER_AXIS) as f64 + 0.5) / (0.5 * CELLS_PER_AXIS as f64) - 1.0;
        index /= CELLS_PER_AXIS;
    }
    let mut q = nalgebra::Vector4::zeros();
    q[index] = 1.0;
    let others = (0..4).filter(|&axis| axis != index);
    for (axis, place) in others.zip(places) {
        q[axis] = place;
    }
    UnitQuaternion::new_normalize(Quaternion::from(q))
}

/// Cells in descending order of votes, without those close to a stronger one.
fn raw_modes(cells: &[f32]) -> Vec<UnitQuaternion<f64>> {
    // Cells below a tenth of the best never held a truth; skipping them keeps the sort short.
    let least = 0.1 * cells.iter().copied().fold(0.0_f32, f32::max);
    let mut order: Vec<usize> = (0..cells.len()).filter(|&cell| cells[cell] > least).collect();
    order.sort_by(|&a, &b| cells[b].total_cmp(&cells[a]).then(a.cmp(&b)));
    let most_equal = (0.5 * RAW_MODE_GAP_RAD).cos();
    let mut kept: Vec<UnitQuaternion<f64>> = Vec::new();
    for cell in order {
        let centre = centre_of(cell);
        if kept.iter().all(|other| other.coords.dot(&centre.coords).abs() < most_equal) {
            kept.push(centre);
            if kept.len() == MAX_RAW_MODES {
                break;
            }
        }
    }
    kept
}

/// Turns a rotation to fit the directions that it nearly aligns (weighted orthogonal Procrustes within shrinking gates).
fn refine(candidates: &[Candidate], start: UnitQuaternion<f64>) -> RotationMode {
    let mut mode = RotationMode { target_from_source: start, support: 0.0 };
    for gate_rad in REFINE_GATES_RAD {
        let rotation = mode.target_from_source.to_rotation_matrix();
        let least_cosine = gate_rad.cos();
        let mut correlation = Matrix3::zeros();
        let mut support = 0.0;
        for candidate in candidates {
            let turned = rotation * candidate.source_direction;
            let cosine = turned.dot(&candidate.target_direction);
            if cosine.abs() < least_cosine {
                continue;
            }
            // Directions known well pull more; one degree keeps short lines from being ignored.
            let sharpness = 1.0 / (1.0 + (candidate.sigma_angle_rad / 0.0175).powi(2));
            let weight = candidate.weight * sharpness;
            let closeness = (1.0 - (1.0 - cosine.abs()) / (1.0 - least_cosine)).max(0.0);
            support += weight * closeness;
            correlation += candidate.target_direction
                * candidate.source_direction.transpose()
                * (weight * closeness * cosine.signum());
        }
        mode.support = support;
        let Some(next) = nearest_rotation(&correlation) else { return mode };
        mode.target_from_source = next;
    }
    mode
}

/// The rotation that maximises `trace(Rᵀ C)`; `None` when fewer than two directions fix it.
fn nearest_rotation(correlation: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let svd = correlation.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    if svd.singular_values[1] < 1e-3 * svd.singular_values[0] {
        return None;
    }
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant().signum()));
    let rotation = Rotation3::from_matrix_unchecked(u * flip * v_t);
    Some(UnitQuaternion::from_rotation_matrix(&rotation))
}
