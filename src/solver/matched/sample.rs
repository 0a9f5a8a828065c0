//! Poses from two matches lifted on both sides: the angle and the distance between two lines are the same in every frame.
//!
//! Lines carry no orientation, so the two can be laid on each other in several ways; which is right only other lines tell.

use nalgebra::{Matrix3, Vector3};

use super::sight::{PlacedLine, PlacedPair};

/// Two lines closer to parallel than this fix no rotation: cosine of 14 degrees.
pub const MAX_COSINE: f64 = 0.97;
/// Angles between lines of one frame and the other may differ by this many standard deviations ...
const MAX_SIGMAS: f64 = 4.0;
/// ... and by this, rad and m, which noise models leave out.
const SLACK: f64 = 0.005;

/// A pose in the form that scoring applies fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// Rotation, target from source.
    pub rotation: Matrix3<f64>,
    /// Translation, target from source, m.
    pub translation_m: Vector3<f64>,
}

/// How two lines of one camera lie to each other.
struct Mutual {
    cosine: f64,
    sigma_angle_rad: f64,
    /// Distance of the two lines; its sign turns with either direction.
    distance_m: f64,
    sigma_distance_m: f64,
}

impl Mutual {
    /// `None` where the lines are nearly parallel.
    fn new(first: &PlacedLine, second: &PlacedLine) -> Option<Self> {
        let cosine = first.direction.dot(&second.direction);
        if cosine.abs() > MAX_COSINE {
            return None;
        }
        let sine2 = 1.0 - cosine * cosine;
        let between_m = second.middle_m - first.middle_m;
        let distance_m = between_m.dot(&first.direction.cross(&second.direction)) / sine2.sqrt();
        // From each middle to the point closest to the other line: the lever of the direction's noise.
        let along = [between_m.dot(&first.direction), between_m.dot(&second.direction)];
        let levers_m = [(along[0] - cosine * along[1]) / sine2, (cosine * along[0] - along[1]) / sine2];
        let variance = |line: &PlacedLine, lever_m: f64| {
            line.sigma_position_m.powi(2) + (line.sigma_direction_rad * lever_m).powi(2)
        };
        Some(Self {
            cosine,
            sigma_angle_rad: first.sigma_direction_rad.hypot(second.sigma_direction_rad),
            distance_m,
            sigma_distance_m: (variance(first, levers_m[0]) + variance(second, levers_m[1])).sqrt(),
        })
    }

    /// Whether the other may be the same two lines, with one direction turned round where `flip` is -1.
    fn agrees(&self, other: &Self, flip: f64) -> bool {
        // Near parallel the cosine is blind to small angles, so angles are compared.
        let turn_rad = (self.cosine.acos() - (flip * other.cosine).acos()).abs();
        let apart_m = (self.distance_m - flip * other.distance_m).abs();
        turn_rad < SLACK + MAX_SIGMAS * self.sigma_angle_rad.hypot(other.sigma_angle_rad)
            && apart_m < SLACK + MAX_SIGMAS * self.sigma_distance_m.hypot(other.sigma_distance_m)
    }
}

/// Calls `found` with every pose that lays the two source lines on the two target lines: none when the lines do not lie to each
/// other alike, else two or four.
pub fn for_each_pose(first: &PlacedPair, second: &PlacedPair, mut found: impl FnMut(&Placement)) {
    let Some(source) = Mutual::new(&first.source, &second.source) else { return };
    let Some(target) = Mutual::new(&first.target, &second.target) else { return };
    let in_source = frame(&first.source.direction, &second.source.direction);
    for flip in [1.0, -1.0] {
        if !target.agrees(&source, flip) {
            continue;
        }
        for sign in [1.0, -1.0] {
            let in_target =
                frame(&(first.target.direction * sign), &(second.target.direction * (sign * flip)));
            let rotation = in_target * in_source.transpose();
            if let Some(translation_m) = translation([first, second], &rotation) {
                found(&Placement { rotation, translation_m });
            }
        }
    }
}

/// The orthonormal frame of two unit directions that treats both alike: half way between them, across, and the normal.
fn frame(first: &Vector3<f64>, second: &Vector3<f64>) -> Matrix3<f64> {
    let between = (first + second).normalize();
    let across = (first - second).normalize();
    Matrix3::from_columns(&[between, across, between.cross(&across)])
}

/// Least squares of the distances of the moved source middles from the target lines.
fn translation(pairs: [&PlacedPair; 2], rotation: &Matrix3<f64>) -> Option<Vector3<f64>> {
    let (mut matrix, mut right_m) = (Matrix3::zeros(), Vector3::zeros());
    for pair in pairs {
        let direction = pair.target.direction;
        let gap_m = pair.target.middle_m - rotation * pair.source.middle_m;
        matrix += Matrix3::identity() - direction * direction.transpose();
        right_m += gap_m - direction * direction.dot(&gap_m);
    }
    Some(matrix.try_inverse()? * right_m)
}
