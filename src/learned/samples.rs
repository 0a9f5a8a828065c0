//! Points along segments: which segments, which points, and their descriptors.

use super::dense::DescriptorMap;
use crate::geometry::{PixelPoint, Segment};

/// Distance of the points along a segment where there is room for all, px.
const STEP_PX: f64 = 12.0;
/// Largest distance, px: then the shortest segments are left out.
const MAX_STEP_PX: f64 = 40.0;
/// Most points of one segment.
const MAX_PER_LINE: usize = 40;
/// Most points of one image: the glue's time grows with the square of it.
const MAX_PER_IMAGE: usize = 800;

/// Points along the longest segments of an image.
#[derive(Debug, Clone)]
pub(super) struct Samples {
    /// Indices of the segments that are used, ascending.
    pub(super) lines: Vec<usize>,
    /// For each of them, its points in `points`.
    pub(super) of_line: Vec<std::ops::Range<usize>>,
    /// Places, px.
    pub(super) points: Vec<PixelPoint>,
}

/// How many points a segment of this length has at this distance, both ends among them.
fn n_points(length_px: f64, step_px: f64) -> usize {
    // A length that is no number becomes 0.
    ((length_px / step_px) as usize).clamp(1, MAX_PER_LINE - 1) + 1
}

/// The distance at which there is room for all lengths, at most [`MAX_STEP_PX`].
fn step_px(lengths_px: &[f64]) -> f64 {
    let n = |step_px: f64| lengths_px.iter().map(|&length_px| n_points(length_px, step_px)).sum::<usize>();
    let mut step_px = STEP_PX;
    while n(step_px) > MAX_PER_IMAGE && step_px < MAX_STEP_PX {
        step_px = (1.05 * step_px).min(MAX_STEP_PX);
    }
    step_px
}

impl Samples {
    /// Points along the longest of the segments, as many as there is room for.
    pub(super) fn along(segments: &[Segment]) -> Self {
        let lengths_px: Vec<f64> = segments.iter().map(Segment::length_px).collect();
        let step_px = step_px(&lengths_px);
        let mut lines: Vec<usize> = (0..segments.len()).collect();
        lines.sort_by(|&a, &b| lengths_px[b].total_cmp(&lengths_px[a]));
        let mut n_used = 0;
        let n_lines = lines.iter().take_while(|&&line| {
            n_used += n_points(lengths_px[line], step_px);
            n_used <= MAX_PER_IMAGE
        });
        lines.truncate(n_lines.count());
        lines.sort_unstable();
        let (mut points, mut of_line) = (Vec::new(), Vec::new());
        for &line in &lines {
            let (segment, n) = (&segments[line], n_points(lengths_px[line], step_px));
            of_line.push(points.len()..points.len() + n);
            points.extend((0..n).map(|k| point_at(segment, k as f64 / (n - 1) as f64)));
        }
        Self { lines, of_line, points }
    }

    /// The unit descriptors of the points, one after the other.
    pub(super) fn descriptors(&self, map: &DescriptorMap) -> Vec<f32> {
        let mut out = Vec::with_capacity(self.points.len() * map.len);
        self.points.iter().for_each(|&point| map.sample(point, &mut out));
        out
    }
}

fn point_at(Segment { start, end, .. }: &Segment, share: f64) -> PixelPoint {
    PixelPoint { x: start.x + (end.x - start.x) * share, y: start.y + (end.y - start.y) * share }
}
