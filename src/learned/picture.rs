//! An image as models want it: numbers from 0 to 1, its sides padded to multiples by repeating the last row and column.

use super::model::Facts;
use crate::image::GrayView;

/// A padded image. Padding is at the right and below, so pixels keep their places.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    /// 1 or 3 equal channels.
    pub(super) channels: usize,
    /// Padded width, px.
    pub(super) width: usize,
    /// Padded height, px.
    pub(super) height: usize,
    /// Channel by channel, row by row.
    pub(super) values: Vec<f32>,
}

impl Picture {
    /// The image for a model with these facts.
    ///
    /// # Errors
    /// One sentence, when the model takes images of one size only and this one is larger.
    pub(super) fn new(image: &GrayView<'_>, facts: &Facts) -> Result<Self, String> {
        let [height, width] = facts.fixed_size_px;
        let padded = |size: usize, fixed: Option<usize>| {
            fixed.unwrap_or_else(|| size.next_multiple_of(facts.multiple_px))
        };
        let (width, height) = (padded(image.width(), width), padded(image.height(), height));
        if image.width() > width || image.height() > height {
            let (w, h) = (image.width(), image.height());
            return Err(format!(
                "it takes images of up to {width} x {height} px, and this one has {w} x {h}"
            ));
        }
        let mut plane = Vec::with_capacity(width * height);
        for y in 0..height {
            let row = image.row(y.min(image.height() - 1));
            let last = row.last().copied().unwrap_or(0);
            let padding = std::iter::repeat_n(&last, width - row.len());
            plane.extend(row.iter().chain(padding).map(|&level| f32::from(level) / 255.0));
        }
        let values = plane.repeat(facts.channels);
        Ok(Self { channels: facts.channels, width, height, values })
    }

    /// As the shape of an input.
    pub(super) fn shape(&self) -> [usize; 4] {
        [1, self.channels, self.height, self.width]
    }
}
