//! Where in its image a line was: tells whether a later frame shows the same line from the same place.

use crate::geometry::LineObservation;

/// A line is where it was when its ends lie this close to the old one, across, px: about 2 degrees of rig rotation.
const SAME_PLACE_ACROSS_PX: f64 = 20.0;
/// ... and its direction this close, rad.
const SAME_PLACE_ANGLE_RAD: f64 = 0.05;
/// ... and its inverse depth within this share.
const SAME_PLACE_DEPTH_RATIO: f64 = 0.1;

/// The image line of a lifted segment and its depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    start_px: [f64; 2],
    /// Unit vector from start to end.
    along: [f64; 2],
    length_px: f64,
    /// Mean of both ends.
    inverse_depth_per_m: f64,
}

impl Place {
    /// Where an observation lies; `None` when it is not lifted or shorter than a pixel.
    pub fn try_new(observation: &LineObservation) -> Option<Self> {
        let depth = observation.depth?;
        let (start, end) = (observation.segment.start, observation.segment.end);
        let length_px = observation.segment.length_px();
        (length_px >= 1.0).then(|| Self {
            start_px: [start.x, start.y],
            along: [(end.x - start.x) / length_px, (end.y - start.y) / length_px],
            length_px,
            inverse_depth_per_m: 0.5 * (depth.inverse_depth_per_m[0] + depth.inverse_depth_per_m[1]),
        })
    }

    /// Whether another observation of the same camera lies on the same image line at the same depth, and overlaps.
    pub fn is_same(&self, other: &Place) -> bool {
        let [x, y] = self.along;
        if (x * other.along[1] - y * other.along[0]).abs() > SAME_PLACE_ANGLE_RAD
            || x * other.along[0] + y * other.along[1] < 0.0
        {
            return false;
        }
        let (dx, dy) = (other.start_px[0] - self.start_px[0], other.start_px[1] - self.start_px[1]);
        let across_start_px = dy * x - dx * y;
        let across_end_px = across_start_px + other.length_px * (other.along[1] * x - other.along[0] * y);
        if across_start_px.abs().max(across_end_px.abs()) > SAME_PLACE_ACROSS_PX {
            return false;
        }
        let from_px = dx * x + dy * y;
        let to_px = from_px + other.length_px * (other.along[0] * x + other.along[1] * y);
        let overlap_px = to_px.min(self.length_px) - from_px.max(0.0);
        overlap_px >= 0.5 * self.length_px.min(other.length_px)
            && (self.inverse_depth_per_m - other.inverse_depth_per_m).abs()
                < SAME_PLACE_DEPTH_RATIO * self.inverse_depth_per_m.abs()
    }
}
