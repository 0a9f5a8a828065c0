//! Models that take two images with their segments and answer with scores of pairs of lines.

use super::model::{Inputs, Model};
use super::scores::Scores;
use super::{LearnedError, Sampled};
use crate::geometry::Segment;

/// The model's own scores.
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
        let (segments, lines) = (side.segments, side.lines());
        let picture = side.features.picture(model)?;
        let image = model.tensor(&picture.shape(), picture.values.clone())?;
        let ends = lines.iter().flat_map(|&line| {
            let Segment { start, end, .. } = segments[line];
            [start.x, start.y, end.x, end.y].map(|value| value as f32)
        });
        let ends = model.tensor(&[1, lines.len(), 2, 2], ends.collect())?;
        inputs.push((format!("image{suffix}").into(), image));
        inputs.push((format!("lines{suffix}").into(), ends));
    }
    let (rows, cols) = (target.lines().to_vec(), source.lines().to_vec());
    let answer = model.run(inputs, |shape| *shape == [1, rows.len(), cols.len()])?;
    Ok(Scores { target: rows, source: cols, values: answer.values })
}
