//! Models that take two images with their segments and answer with scores of pairs of lines.

use super::model::{Inputs, Model};
use super::samples::Samples;
use super::scores::Scores;
use super::{ImageFeatures, LearnedError};
use crate::geometry::Segment;

/// The model's own scores.
///
/// # Errors
/// When the model fails.
pub(super) fn score(
    model: &mut Model,
    target: (&ImageFeatures, &[Segment]),
    source: (&ImageFeatures, &[Segment]),
) -> Result<Scores, LearnedError> {
    let (rows, cols) = (Samples::along(target.1).lines, Samples::along(source.1).lines);
    if rows.is_empty() || cols.is_empty() {
        return Ok(Scores::none());
    }
    let mut inputs = Inputs::new();
    for (suffix, (features, segments), lines) in [("0", target, &rows), ("1", source, &cols)] {
        let picture = features.picture(model)?;
        let image = model.tensor(&picture.shape(), picture.values.clone())?;
        let ends = lines.iter().flat_map(|&line| {
            let Segment { start, end, .. } = segments[line];
            [start.x, start.y, end.x, end.y].map(|value| value as f32)
        });
        let ends = model.tensor(&[1, lines.len(), 2, 2], ends.collect())?;
        inputs.push((format!("image{suffix}").into(), image));
        inputs.push((format!("lines{suffix}").into(), ends));
    }
    let answer = model.run(inputs, |shape| *shape == [1, rows.len(), cols.len()])?;
    Ok(Scores { target: rows, source: cols, values: answer.values })
}
