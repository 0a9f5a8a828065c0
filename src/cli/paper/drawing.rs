//! A drawing of rectangles and words, written as SVG or painted as PNG; no font of the system is needed for the latter.

use std::convert::Infallible;
use std::fmt::Write as _;

use embedded_graphics::Drawable;
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::mono_font::MonoTextStyle;
use embedded_graphics::mono_font::ascii::FONT_8X13;
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::primitives::{Primitive, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyle, TextStyleBuilder};
use image::{ImageError, RgbImage};

use crate::cli::canvas::{Canvas, Rgb};

#[derive(Debug, Clone, PartialEq)]
enum Mark {
    Rectangle {
        at: [u32; 2],
        size: [u32; 2],
        color: Rgb,
    },
    /// `at` is the middle of the left end, or the middle of all.
    Text {
        at: [u32; 2],
        is_centered: bool,
        text: String,
        color: Rgb,
    },
}

/// What is drawn, from the background up; places and sizes in px from the upper left corner.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    size: [u32; 2],
    marks: Vec<Mark>,
}

impl Drawing {
    /// An empty drawing.
    pub fn new(size: [u32; 2], background: Rgb) -> Self {
        Self { size, marks: vec![Mark::Rectangle { at: [0, 0], size, color: background }] }
    }

    /// A filled rectangle.
    pub fn rectangle(&mut self, at: [u32; 2], size: [u32; 2], color: Rgb) {
        self.marks.push(Mark::Rectangle { at, size, color });
    }

    /// A line of ASCII that begins at a place.
    pub fn text(&mut self, at: [u32; 2], text: &str, color: Rgb) {
        self.marks.push(Mark::Text { at, is_centered: false, text: text.to_owned(), color });
    }

    /// A line of ASCII around a place.
    pub fn centered_text(&mut self, at: [u32; 2], text: &str, color: Rgb) {
        self.marks.push(Mark::Text { at, is_centered: true, text: text.to_owned(), color });
    }

    /// The drawing as an SVG file.
    pub fn as_svg(&self) -> String {
        let [width, height] = self.size;
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"monospace\" font-size=\"13\">\n"
        );
        for mark in &self.marks {
            // Writing to a string does not fail.
            let _ = match mark {
                Mark::Rectangle { at: [x, y], size: [width, height], color } => writeln!(
                    svg,
                    "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{}\"/>",
                    hex(*color)
                ),
                Mark::Text { at: [x, y], is_centered, text, color } => writeln!(
                    svg,
                    "<text x=\"{x}\" y=\"{y}\" text-anchor=\"{}\" dominant-baseline=\"central\" fill=\"{}\">{}</text>",
                    if *is_centered { "middle" } else { "start" },
                    hex(*color),
                    escaped(text)
                ),
            };
        }
        svg + "</svg>\n"
    }

    /// The drawing as a PNG file.
    ///
    /// # Errors
    /// What the encoder says.
    pub fn as_png(&self) -> Result<Vec<u8>, ImageError> {
        let mut canvas = Canvas(RgbImage::new(self.size[0], self.size[1]));
        for mark in &self.marks {
            // Painting into memory cannot fail: its error has no value.
            let Ok(()) = paint(&mut canvas, mark);
        }
        canvas.as_png()
    }
}

fn hex([red, green, blue]: Rgb) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn paint(canvas: &mut Canvas, mark: &Mark) -> Result<(), Infallible> {
    let rgb = |[red, green, blue]: Rgb| Rgb888::new(red, green, blue);
    let point = |[x, y]: [u32; 2]| Point::new(x as i32, y as i32);
    match mark {
        Mark::Rectangle { at, size, color } => Rectangle::new(point(*at), Size::new(size[0], size[1]))
            .into_styled(PrimitiveStyle::with_fill(rgb(*color)))
            .draw(canvas),
        Mark::Text { at, is_centered, text, color } => {
            let alignment = if *is_centered { Alignment::Center } else { Alignment::Left };
            let style: TextStyle =
                TextStyleBuilder::new().alignment(alignment).baseline(Baseline::Middle).build();
            let character = MonoTextStyle::new(&FONT_8X13, rgb(*color));
            Text::with_text_style(text, point(*at), character, style).draw(canvas).map(|_| ())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drawing() -> Drawing {
        let mut drawing = Drawing::new([60, 40], [255, 255, 255]);
        drawing.rectangle([10, 10], [20, 8], [200, 0, 0]);
        drawing.text([2, 30], "0->20 & <5", [0, 0, 0]);
        // Beyond the border: cut off.
        drawing.centered_text([58, 38], "wide", [0, 0, 0]);
        drawing
    }

    #[test]
    fn the_png_decodes_and_has_the_rectangle_and_ink() {
        let png = image::load_from_memory(&drawing().as_png().unwrap()).unwrap().into_rgb8();
        assert_eq!(png.dimensions(), (60, 40));
        assert_eq!(png.get_pixel(15, 12).0, [200, 0, 0]);
        assert_eq!(png.get_pixel(5, 5).0, [255, 255, 255]);
        assert!((2..50).any(|x| (24..36).any(|y| png.get_pixel(x, y).0 == [0, 0, 0])), "no words");
    }

    #[test]
    fn words_are_escaped_in_the_svg() {
        assert!(drawing().as_svg().contains(">0-&gt;20 &amp; &lt;5</text>"));
    }
}
