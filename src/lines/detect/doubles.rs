//! One edge, one segment: of two that lie on each other the longer one stays.
//!
//! A pixel belongs to one segment, so doubles are rare: a segment that bridges a gap may find an earlier one in it.
use crate::geometry::Segment;

/// Least cosine between the directions of doubles (4 degrees).
const MIN_COSINE: f64 = 0.9976;
/// Largest distance of the middle and the ends of the shorter one from the line of the longer one, px: nearer edges of the same
/// sense are one edge in the smoothed image.
const MAX_APART_PX: f64 = 2.0;
/// Least share of the shorter one that lies beside the longer one.
const MIN_OVERLAP: f64 = 0.5;

/// A segment that stays, prepared for comparison.
#[derive(Debug, Clone, Copy)]
pub struct Kept {
    start: [f64; 2],
    direction: [f64; 2],
    length_px: f64,
}

impl Kept {
    fn new(segment: &Segment) -> Self {
        let length_px = segment.length_px();
        let along = [segment.end.x - segment.start.x, segment.end.y - segment.start.y];
        let direction = along.map(|part| part / length_px.max(1e-9));
        Self { start: [segment.start.x, segment.start.y], direction, length_px }
    }

    /// Position along and distance to the right of this segment's line, px.
    fn place(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let (dx, dy) = (x - self.start[0], y - self.start[1]);
        let [along_x, along_y] = self.direction;
        [dx * along_x + dy * along_y, dy * along_x - dx * along_y]
    }

    /// Whether a segment that is no longer lies on this one.
    fn covers(&self, shorter: &Self) -> bool {
        let [ax, ay] = self.direction;
        let [bx, by] = shorter.direction;
        if ax * bx + ay * by < MIN_COSINE {
            return false;
        }
        let [from, apart_start] = self.place(shorter.start);
        let end = [0, 1].map(|k| shorter.start[k] + shorter.direction[k] * shorter.length_px);
        let [to, apart_end] = self.place(end);
        let overlap_px = to.min(self.length_px) - from.max(0.0);
        apart_start.abs().max(apart_end.abs()) <= MAX_APART_PX
            && overlap_px >= MIN_OVERLAP * shorter.length_px
    }
}

/// Drops doubles of longer segments; `segments` are sorted, longest first, and `kept` is scratch memory.
pub fn drop_doubles(segments: &mut Vec<Segment>, kept: &mut Vec<Kept>) {
    kept.clear();
    kept.reserve(segments.len());
    segments.retain(|segment| {
        let candidate = Kept::new(segment);
        let is_double = kept.iter().any(|longer| longer.covers(&candidate));
        if !is_double {
            kept.push(candidate);
        }
        !is_double
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::PixelPoint;

    fn left([start, end]: [[f64; 2]; 2], second: [[f64; 2]; 2]) -> usize {
        let mut segments = [[start, end], second]
            .map(|ends| {
                let [start, end] = ends.map(|[x, y]| PixelPoint { x, y });
                Segment { start, end, sigma_across_px: 0.1 }
            })
            .to_vec();
        drop_doubles(&mut segments, &mut Vec::new());
        segments.len()
    }

    const LONG: [[f64; 2]; 2] = [[10.0, 20.0], [110.0, 30.0]];

    #[test]
    fn the_shorter_of_two_on_each_other_goes() {
        assert_eq!(left(LONG, [[40.0, 23.5], [80.0, 27.6]]), 1);
    }

    #[test]
    fn the_two_sides_of_a_line_and_neighbours_stay() {
        // The other sense, three pixels beside, and the same line farther on.
        assert_eq!(left(LONG, [[80.0, 27.6], [40.0, 23.5]]), 2);
        assert_eq!(left(LONG, [[40.0, 26.5], [80.0, 30.6]]), 2);
        assert_eq!(left(LONG, [[120.0, 31.0], [160.0, 35.0]]), 2);
    }
}
