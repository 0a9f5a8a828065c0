//! GlueStick's graph network: the ends of an image's segments, merged where they meet, are its nodes (arXiv 2304.02008).
//!
//! The nodes are junctions only. Ordinary key points would be more of them, but need a detector that no dense model promises.

use super::dense::DescriptorMap;
use super::model::{Inputs, Model};
use super::scores::Scores;
use super::{ImageFeatures, LearnedError, Sampled};
use crate::geometry::{PixelPoint, Segment};

/// Ends closer than this are one junction, px.
const MERGE_PX: f64 = 3.0;

/// The segments of an image as a graph.
#[derive(Debug, Clone, PartialEq)]
struct Wireframe {
    /// Means of the ends that were merged, px.
    junctions: Vec<PixelPoint>,
    /// Mean scores of the lines that end there.
    scores: Vec<f32>,
    /// Start and end of each line, as indices of junctions.
    lines: Vec<[usize; 2]>,
    /// Square root of each line's length, relative to the longest.
    line_scores: Vec<f32>,
}

/// Probabilities of pairs of lines, from the model's log assignment without its row and column of the unmatched.
///
/// # Errors
/// When the model fails.
pub(super) fn score(
    model: &mut Model,
    target: &Sampled<'_>,
    source: &Sampled<'_>,
) -> Result<Scores, LearnedError> {
    let mut inputs = Inputs::new();
    for (suffix, side) in [("0", target), ("1", source)] {
        let chosen: Vec<Segment> = side.lines().iter().map(|&line| side.segments[line]).collect();
        let wireframe = Wireframe::of(&chosen);
        for (name, input) in wireframe.inputs(model, side.features)? {
            inputs.push((format!("{name}{suffix}").into(), input));
        }
    }
    let (rows, cols) = (target.lines().to_vec(), source.lines().to_vec());
    let (n_rows, n_cols) = (rows.len(), cols.len());
    let answer = model.run(inputs, |shape| *shape == [1, n_rows + 1, n_cols + 1])?;
    Ok(Scores::new(rows, cols, |row, col| answer.values[row * (n_cols + 1) + col].exp()))
}

impl Wireframe {
    fn of(segments: &[Segment]) -> Self {
        let ends: Vec<PixelPoint> =
            segments.iter().flat_map(|segment| [segment.start, segment.end]).collect();
        let longest = segments.iter().map(Segment::length_px).fold(f64::MIN_POSITIVE, f64::max);
        let line_scores: Vec<f32> =
            segments.iter().map(|segment| (segment.length_px() / longest).sqrt() as f32).collect();
        let (junction_of, n_junctions) = clusters(&ends);
        let mut junctions = vec![PixelPoint { x: 0.0, y: 0.0 }; n_junctions];
        let (mut scores, mut counts) = (vec![0.0_f32; n_junctions], vec![0_u32; n_junctions]);
        for (end, &junction) in junction_of.iter().enumerate() {
            junctions[junction].x += ends[end].x;
            junctions[junction].y += ends[end].y;
            scores[junction] += line_scores[end / 2];
            counts[junction] += 1;
        }
        for ((junction, score), &count) in junctions.iter_mut().zip(&mut scores).zip(&counts) {
            junction.x /= f64::from(count);
            junction.y /= f64::from(count);
            *score /= count as f32;
        }
        let lines = junction_of.as_chunks::<2>().0.to_vec();
        Self { junctions, scores, lines, line_scores }
    }

    /// Named inputs of one image, without the suffix that tells the images apart.
    fn inputs(
        &self,
        model: &Model,
        features: &ImageFeatures,
    ) -> Result<[(&'static str, ort::session::SessionInputValue<'static>); 7], LearnedError> {
        let map = features.map(model)?;
        let (n_junctions, n_lines) = (self.junctions.len(), self.lines.len());
        let flat = |point: PixelPoint| [point.x as f32, point.y as f32];
        let points = self.junctions.iter().copied().flat_map(flat).collect();
        let ends = self.lines.iter().flatten().flat_map(|&junction| flat(self.junctions[junction]));
        let indices: Vec<i64> = self.lines.iter().flatten().map(|&junction| junction as i64).collect();
        let (width, height) = features.size_px;
        Ok([
            ("kpts", model.tensor(&[1, n_junctions, 2], points)?),
            ("kpt_scores", model.tensor(&[1, n_junctions], self.scores.clone())?),
            ("desc", model.tensor(&[1, map.len, n_junctions], self.descriptors(map))?),
            ("lines", model.tensor(&[1, n_lines, 2, 2], ends.collect())?),
            ("line_scores", model.tensor(&[1, n_lines], self.line_scores.clone())?),
            ("junc", model.tensor(&[1, n_lines, 2], indices)?),
            ("size", model.tensor(&[1, 2], vec![width as f32, height as f32])?),
        ])
    }

    /// Number by number, junction by junction.
    fn descriptors(&self, map: &DescriptorMap) -> Vec<f32> {
        let mut by_junction = Vec::with_capacity(self.junctions.len() * map.len);
        self.junctions.iter().for_each(|&junction| map.sample(junction, &mut by_junction));
        (0..map.len).flat_map(|number| by_junction.iter().skip(number).step_by(map.len)).copied().collect()
    }
}

/// The cluster of each point, and how many there are: points closer than [`MERGE_PX`] share one, also through others.
fn clusters(points: &[PixelPoint]) -> (Vec<usize>, usize) {
    let mut parents: Vec<usize> = (0..points.len()).collect();
    for (a, point) in points.iter().enumerate() {
        for (b, other) in points.iter().enumerate().take(a) {
            if (point.x - other.x).hypot(point.y - other.y) <= MERGE_PX {
                let (a, b) = (root(&parents, a), root(&parents, b));
                // The first point of a cluster stays its root.
                parents[a.max(b)] = a.min(b);
            }
        }
    }
    let (mut of_point, mut n_clusters) = (Vec::with_capacity(points.len()), 0);
    for point in 0..points.len() {
        let root = root(&parents, point);
        of_point.push(if root == point { n_clusters } else { of_point[root] });
        n_clusters += usize::from(root == point);
    }
    (of_point, n_clusters)
}

fn root(parents: &[usize], mut point: usize) -> usize {
    while parents[point] != point {
        point = parents[point];
    }
    point
}
