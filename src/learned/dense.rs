//! The map of descriptors of an image, and unit descriptors at any of its points.

use super::LearnedError;
use super::model::Model;
use super::picture::Picture;
use crate::geometry::PixelPoint;
use crate::image::GrayView;

/// Descriptors on a grid; cell (j, i) is centred at pixel (stride j + (stride - 1) / 2, likewise i).
#[derive(Debug, Clone)]
pub(super) struct DescriptorMap {
    /// Numbers per descriptor.
    pub(super) len: usize,
    rows: usize,
    cols: usize,
    stride_px: usize,
    /// Number by number, row by row.
    values: Vec<f32>,
}

/// The map of one image.
///
/// # Errors
/// When the model fails, or its map does not belong to the image.
pub(super) fn describe(model: &mut Model, image: &GrayView<'_>) -> Result<DescriptorMap, LearnedError> {
    let picture = Picture::new(image, &model.facts).map_err(|what| model.failure(what))?;
    let (width, height) = (picture.width, picture.height);
    let input = model.tensor(&picture.shape(), picture.values)?;
    let said_px = model.facts.stride_px;
    let stride_of = move |shape: &[usize]| match *shape {
        [1, len, rows, cols] if len > 0 && rows > 0 && cols > 0 => {
            let stride_px = height / rows;
            let fits = stride_px * rows == height && stride_px * cols == width;
            (fits && said_px.is_none_or(|said_px| said_px == stride_px)).then_some(stride_px)
        }
        _ => None,
    };
    let answer = model.run(vec![("image".into(), input)], |shape| stride_of(shape).is_some())?;
    let (Some(stride_px), &[_, len, rows, cols]) = (stride_of(&answer.shape), &*answer.shape) else {
        return Err(model.failure("its map has no stride".to_owned()));
    };
    Ok(DescriptorMap { len, rows, cols, stride_px, values: answer.values })
}

impl DescriptorMap {
    /// Appends the unit descriptor at a point: bilinear between the four nearest cells, then normalised.
    pub(super) fn sample(&self, point: PixelPoint, out: &mut Vec<f32>) {
        let (left, a) = place(point.x, self.stride_px, self.cols);
        let (top, b) = place(point.y, self.stride_px, self.rows);
        let (right, bottom) = ((left + 1).min(self.cols - 1), (top + 1).min(self.rows - 1));
        let cells = [(top, left), (top, right), (bottom, left), (bottom, right)];
        let weights = [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b];
        let start = out.len();
        for plane in self.values.chunks_exact(self.rows * self.cols) {
            let at = |(row, col): (usize, usize)| plane[row * self.cols + col];
            out.push(cells.iter().zip(weights).map(|(&cell, weight)| at(cell) * weight).sum());
        }
        let norm = out[start..].iter().map(|value| value * value).sum::<f32>().sqrt();
        // A descriptor of zeros says nothing, and stays so.
        out[start..].iter_mut().for_each(|value| *value /= norm.max(f32::MIN_POSITIVE));
    }
}

/// The cell before a coordinate, and how far it is towards the next one, 0 to 1; outside the map its border counts.
fn place(coordinate_px: f64, stride_px: usize, n_cells: usize) -> (usize, f32) {
    let position = (coordinate_px + 0.5) / stride_px as f64 - 0.5;
    let position = position.clamp(0.0, (n_cells - 1) as f64);
    let cell = position.floor();
    (cell as usize, (position - cell) as f32)
}
