//! Line samples: points along the segments are the key points of an attention matcher, and its assignment is summed per pair of
//! lines. A sum over all points of both lines needs no care for their direction: it is the same in both polarities.

use super::model::{Answer, Model};
use super::samples::Samples;
use super::scores::Scores;
use super::{LearnedError, Sampled};

/// The assigned share of the shorter line's points, for every pair of lines.
///
/// # Errors
/// When the model fails.
pub(super) fn score(
    glue: &mut Model,
    target: &Sampled<'_>,
    source: &Sampled<'_>,
) -> Result<Scores, LearnedError> {
    let (in_target, in_source) = (&target.samples, &source.samples);
    let (n_target, n_source) = (in_target.points.len(), in_source.points.len());
    let mut inputs = Vec::new();
    for (suffix, features, samples) in [("0", target.features, in_target), ("1", source.features, in_source)]
    {
        let map = features.map(glue)?;
        let n = samples.points.len();
        let points = glue.tensor(&[1, n, 2], normalised(samples, features.size_px, glue.facts.kpt_scale))?;
        let descriptors = glue.tensor(&[1, n, map.len], samples.descriptors(map))?;
        inputs.push((format!("kpts{suffix}").into(), points));
        inputs.push((format!("desc{suffix}").into(), descriptors));
    }
    let assignment = glue.run(inputs, |shape| *shape == [1, n_target, n_source])?;
    Ok(pooled(&assignment, in_target, in_source))
}

/// Places relative to the centre of the image, in units of half its longer side.
fn normalised(samples: &Samples, (width, height): (usize, usize), scale: f64) -> Vec<f32> {
    let (width, height) = (width as f64, height as f64);
    let unit_px = scale * width.max(height) / 2.0;
    let place = |value: f64, size: f64| ((value - size / 2.0) / unit_px) as f32;
    samples.points.iter().flat_map(|point| [place(point.x, width), place(point.y, height)]).collect()
}

fn pooled(assignment: &Answer, target: &Samples, source: &Samples) -> Scores {
    let n_source = source.points.len();
    // First over the points of each source line, so that every number is read once.
    let rows = assignment.values.chunks_exact(n_source).map(|row| {
        source.of_line.iter().map(|of_line| row[of_line.clone()].iter().sum()).collect::<Vec<f32>>()
    });
    let by_point: Vec<Vec<f32>> = rows.collect();
    Scores::new(target.lines.clone(), source.lines.clone(), |row, col| {
        let (points, others) = (target.of_line[row].clone(), source.of_line[col].len());
        let shorter = points.len().min(others) as f32;
        by_point[points].iter().map(|sums| sums[col]).sum::<f32>() / shorter
    })
}
