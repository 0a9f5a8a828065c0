//! Pixels to paint on: words and shapes by `embedded-graphics`, smooth strokes, and PNG. No font of the system is needed.

use std::convert::Infallible;
use std::io::Cursor;

use embedded_graphics::Pixel;
use embedded_graphics::draw_target::DrawTarget;
use embedded_graphics::geometry::{OriginDimensions, Point, Size};
use embedded_graphics::pixelcolor::{Rgb888, RgbColor};
use image::{ImageError, ImageFormat, RgbImage};

/// Red, green, blue.
pub type Rgb = [u8; 3];

/// A picture that is painted; what lies outside is cut off.
#[derive(Debug, Clone)]
pub struct Canvas(pub RgbImage);

/// How a line is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stroke {
    /// Its colour.
    pub color: Rgb,
    /// Its width, px.
    pub width_px: f64,
    /// Length of dashes and of the gaps between them, px; `None` draws through.
    pub dash_px: Option<[f64; 2]>,
}

impl Canvas {
    /// A line between two places, px from the middle of the upper left pixel, with smooth borders.
    pub fn stroke(&mut self, [from, to]: [[f64; 2]; 2], stroke: &Stroke) {
        let half_px = 0.5 * stroke.width_px + 0.5;
        let [dx, dy] = [to[0] - from[0], to[1] - from[1]];
        let length_px = dx.hypot(dy);
        if !(length_px.is_finite() && length_px > 0.0) {
            return;
        }
        let range = |a: f64, b: f64, size: u32| {
            // A cast of a number below 0 gives 0.
            ((a.min(b) - half_px).floor() as u32)..((a.max(b) + half_px + 1.0).ceil() as u32).min(size)
        };
        let (width, height) = self.0.dimensions();
        for y in range(from[1], to[1], height) {
            for x in range(from[0], to[0], width) {
                let [px, py] = [f64::from(x) - from[0], f64::from(y) - from[1]];
                let along_px = (px * dx + py * dy) / length_px;
                let is_gap = |[dash, gap]: [f64; 2]| along_px.max(0.0) % (dash + gap) > dash;
                if stroke.dash_px.is_some_and(is_gap) {
                    continue;
                }
                let beyond_px = along_px - along_px.clamp(0.0, length_px);
                let distance_px = beyond_px.hypot((px * dy - py * dx) / length_px);
                self.blend([x, y], stroke.color, half_px - distance_px);
            }
        }
    }

    fn blend(&mut self, [x, y]: [u32; 2], color: Rgb, share: f64) {
        let share = share.clamp(0.0, 1.0);
        let Some(pixel) = self.0.get_pixel_mut_checked(x, y) else { return };
        for (old, new) in pixel.0.iter_mut().zip(color) {
            *old = (f64::from(*old) + share * (f64::from(new) - f64::from(*old))).round() as u8;
        }
    }

    /// The picture as a PNG file.
    ///
    /// # Errors
    /// What the encoder says.
    pub fn as_png(&self) -> Result<Vec<u8>, ImageError> {
        let mut png = Cursor::new(Vec::new());
        self.0.write_to(&mut png, ImageFormat::Png)?;
        Ok(png.into_inner())
    }
}

impl OriginDimensions for Canvas {
    fn size(&self) -> Size {
        Size::new(self.0.width(), self.0.height())
    }
}

impl DrawTarget for Canvas {
    type Color = Rgb888;
    type Error = Infallible;

    fn draw_iter<I: IntoIterator<Item = Pixel<Rgb888>>>(&mut self, pixels: I) -> Result<(), Infallible> {
        for Pixel(Point { x, y }, color) in pixels {
            let place = u32::try_from(x).ok().zip(u32::try_from(y).ok());
            if let Some(pixel) = place.and_then(|(x, y)| self.0.get_pixel_mut_checked(x, y)) {
                pixel.0 = [color.r(), color.g(), color.b()];
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const INK: Rgb = [200, 0, 0];

    fn painted(ends: [[f64; 2]; 2], dash_px: Option<[f64; 2]>) -> Vec<(u32, u32)> {
        let mut canvas = Canvas(RgbImage::new(40, 30));
        canvas.stroke(ends, &Stroke { color: INK, width_px: 1.0, dash_px });
        canvas.0.enumerate_pixels().filter(|(.., pixel)| pixel.0 == INK).map(|(x, y, _)| (x, y)).collect()
    }

    #[test]
    fn a_stroke_runs_from_end_to_end_and_no_further() {
        let expected: Vec<_> = (5..=20).map(|x| (x, 7)).collect();
        assert_eq!(painted([[5.0, 7.0], [20.0, 7.0]], None), expected);
        assert_eq!(painted([[20.0, 7.0], [5.0, 7.0]], None), expected);
    }

    #[test]
    fn dashes_leave_gaps() {
        let columns: Vec<_> =
            painted([[0.0, 3.0], [30.0, 3.0]], Some([4.0, 5.0])).iter().map(|(x, _)| *x).collect();
        assert_eq!(columns[..7], [0, 1, 2, 3, 4, 9, 10]);
    }

    #[test]
    fn strokes_outside_and_without_length_paint_nothing() {
        assert!(painted([[-50.0, -9.0], [-20.0, -9.0]], None).is_empty());
        assert!(painted([[90.0, 90.0], [90.0, 99.0]], None).is_empty());
        assert!(painted([[9.0, 9.0], [9.0, 9.0]], None).is_empty());
        assert!(painted([[f64::NAN, 9.0], [9.0, 9.0]], None).is_empty());
    }
}
