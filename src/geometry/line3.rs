//! Lines of space in Pluecker form.

use nalgebra::{Point3, Unit, Vector3};

use super::motion::Motion;

/// An unoriented 3D line in one frame: unit direction and moment `m = p × d`, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line3 {
    /// Unit direction; its sign carries no meaning.
    pub direction: Unit<Vector3<f64>>,
    /// `p × d` for any point `p` of the line, m.
    pub moment_m: Vector3<f64>,
}

impl Line3 {
    /// The line through two points, or `None` when they are closer than `min_gap_m`: the direction would be noise.
    pub fn through(a_m: &Point3<f64>, b_m: &Point3<f64>, min_gap_m: f64) -> Option<Self> {
        let direction = Unit::try_new(b_m - a_m, min_gap_m)?;
        Some(Self { direction, moment_m: a_m.coords.cross(&direction) })
    }

    /// The point of the line closest to the origin, m.
    pub fn closest_to_origin_m(&self) -> Point3<f64> {
        Point3::from(self.direction.cross(&self.moment_m))
    }

    /// The same line in another frame (paper eq. 13: `m' = R m + t × R d`).
    pub fn moved(&self, to_from_from: &Motion) -> Self {
        let direction = to_from_from.rotation * self.direction;
        let moment_m =
            to_from_from.rotation * self.moment_m + to_from_from.translation.vector.cross(&direction);
        Self { direction, moment_m }
    }

    /// Distance of a point from the line, m.
    pub fn distance_m(&self, point_m: &Point3<f64>) -> f64 {
        (point_m.coords.cross(&self.direction) - self.moment_m).norm()
    }

    /// Angle between two unoriented lines, 0 to 90 degrees, rad.
    pub fn angle_rad(&self, other: &Self) -> f64 {
        let sine = self.direction.cross(&other.direction).norm();
        let cosine = self.direction.dot(&other.direction).abs();
        sine.atan2(cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_the_line_stay_on_it_when_both_move() {
        let (a, b) = (Point3::new(0.3, -0.2, 1.5), Point3::new(1.0, 0.4, 2.0));
        let line = Line3::through(&a, &b, 1e-6).expect("distinct points");
        let to_from_from = Motion::new(Vector3::new(0.3, -0.1, 0.2), Vector3::new(0.2, 1.9, -0.4));
        let moved = line.moved(&to_from_from);
        for point in [a, b, a + (b - a) * 3.7] {
            assert!(line.distance_m(&point) < 1e-12);
            assert!(moved.distance_m(&(to_from_from * point)) < 1e-12);
        }
        assert!(line.distance_m(&line.closest_to_origin_m()) < 1e-12);
    }

    #[test]
    fn two_equal_points_have_no_line() {
        let point = Point3::new(0.0, 0.0, 1.0);
        assert!(Line3::through(&point, &point, 1e-9).is_none());
    }
}
