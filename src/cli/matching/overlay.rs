//! The picture of a matched frame set: the cameras' images side by side, every segment, and each matched edge in a colour and with a
//! number of its own.

use std::convert::Infallible;

use embedded_graphics::Drawable;
use embedded_graphics::geometry::{Point, Size};
use embedded_graphics::mono_font::ascii::FONT_9X15_BOLD;
use embedded_graphics::mono_font::{MonoFont, MonoTextStyleBuilder};
use embedded_graphics::pixelcolor::Rgb888;
use embedded_graphics::primitives::{Primitive, PrimitiveStyle, Rectangle};
use embedded_graphics::text::{Alignment, Baseline, Text, TextStyleBuilder};
use image::imageops::{self, FilterType};
use image::{ImageError, Rgb, RgbImage};

use super::MatchedSet;
use super::tracks::{Standing, tracks};
use crate::capture::{CameraInfo, RgbdFrame};
use crate::cli::canvas::{self, Canvas, Stroke};
use crate::geometry::{PixelPoint, Segment};

const FONT: &MonoFont<'_> = &FONT_9X15_BOLD;
/// Between images and around them.
const GAP_PX: u32 = 12;
/// Room for the words above and below an image.
const HEAD_PX: u32 = 28;
const FOOT_PX: u32 = 30;
/// Images are enlarged by a whole number to about this width, so that numbers do not hide lines.
const WIDTH_PX: u32 = 1280;
/// Height of a number's plate.
const PLATE_PX: i32 = 15;
const PAPER: canvas::Rgb = [18, 18, 20];
const INK: canvas::Rgb = [225, 225, 225];
/// Segments that are in no match: with depth, and without.
const LIFTED: canvas::Rgb = [120, 170, 190];
const UNLIFTED: canvas::Rgb = [110, 100, 95];
const MISSED: canvas::Rgb = [255, 255, 255];
const WRONG: canvas::Rgb = [255, 40, 40];
/// How bright the backdrop is.
const DIMMED: f64 = 0.42;

/// The frame set as a PNG file.
///
/// # Errors
/// What the encoder says.
pub fn png(cameras: &[CameraInfo], matched: &MatchedSet, title: &str) -> Result<Vec<u8>, ImageError> {
    let views: Vec<View> = views(cameras);
    let width = views.last().map_or(0, |view| view.at[0] + view.size[0]) + GAP_PX;
    let height = views.iter().map(|view| view.size[1]).max().unwrap_or(0) + HEAD_PX + 2 * FOOT_PX;
    let mut picture = Picture { canvas: Canvas(RgbImage::from_pixel(width, height, Rgb(PAPER))), views };
    for (camera, info) in cameras.iter().enumerate() {
        picture.backdrop(camera, &matched.frames[camera]);
        let lines = &matched.found[camera].view.lines;
        let n_lifted = lines.iter().filter(|line| line.depth.is_some()).count();
        let head = format!("{}: {} segments, {n_lifted} with depth", info.name, lines.len());
        picture.text([picture.views[camera].at[0] as i32, HEAD_PX as i32 / 2], &head, (INK, Alignment::Left));
        for line in lines {
            picture.unmatched(camera, &line.segment, line.depth.is_some());
        }
    }
    picture.matches(matched);
    let foot = [GAP_PX as i32, (height - 2 * FOOT_PX + FOOT_PX / 2) as i32];
    picture.text(foot, title, (INK, Alignment::Left));
    picture.legend([foot[0], foot[1] + FOOT_PX as i32], has_truth(matched));
    picture.canvas.as_png()
}

fn has_truth(matched: &MatchedSet) -> bool {
    matched.pairs.iter().any(|pair| pair.truth.is_some())
}

/// Where an image stands.
struct View {
    at: [u32; 2],
    size: [u32; 2],
    scale: u32,
}

fn views(cameras: &[CameraInfo]) -> Vec<View> {
    let mut left = GAP_PX;
    let mut view = |info: &CameraInfo| {
        let (width, height) = (info.camera.width_px(), info.camera.height_px());
        let scale = ((f64::from(WIDTH_PX) / f64::from(width)).round() as u32).clamp(1, 4);
        let view = View { at: [left, HEAD_PX], size: [width * scale, height * scale], scale };
        left += view.size[0] + GAP_PX;
        view
    };
    cameras.iter().map(&mut view).collect()
}

struct Picture {
    canvas: Canvas,
    views: Vec<View>,
}

impl Picture {
    /// The image in dimmed gray, enlarged.
    fn backdrop(&mut self, camera: usize, frame: &RgbdFrame) {
        let view = &self.views[camera];
        let pixel = |x: u32, y: u32| {
            let at = 3 * (y as usize * frame.width + x as usize);
            let sum: u32 = frame.rgb.get(at..at + 3).unwrap_or_default().iter().map(|&v| u32::from(v)).sum();
            Rgb([(DIMMED * f64::from(sum) / 3.0) as u8; 3])
        };
        let gray = RgbImage::from_fn(frame.width as u32, frame.height as u32, pixel);
        let large = imageops::resize(&gray, view.size[0], view.size[1], FilterType::Triangle);
        imageops::replace(&mut self.canvas.0, &large, i64::from(view.at[0]), i64::from(view.at[1]));
    }

    fn place(&self, camera: usize, pixel: PixelPoint) -> [f64; 2] {
        let view = &self.views[camera];
        // The middle of a pixel stays the middle of what it became.
        let along =
            |value: f64, axis: usize| f64::from(view.at[axis]) + (value + 0.5) * f64::from(view.scale) - 0.5;
        [along(pixel.x, 0), along(pixel.y, 1)]
    }

    fn ends(&self, camera: usize, segment: &Segment) -> [[f64; 2]; 2] {
        [self.place(camera, segment.start), self.place(camera, segment.end)]
    }

    fn unmatched(&mut self, camera: usize, segment: &Segment, is_lifted: bool) {
        let color = if is_lifted { LIFTED } else { UNLIFTED };
        let ends = self.ends(camera, segment);
        self.canvas.stroke(ends, &Stroke { color, width_px: 1.0, dash_px: None });
        if is_lifted {
            ends.iter().for_each(|end| self.dot(*end, (color, 4.0)));
        }
    }

    fn dot(&mut self, [x, y]: [f64; 2], (color, width_px): (canvas::Rgb, f64)) {
        self.canvas.stroke([[x - 0.01, y], [x + 0.01, y]], &Stroke { color, width_px, dash_px: None });
    }

    fn matches(&mut self, matched: &MatchedSet) {
        let tracks = tracks(&matched.pairs);
        let (mut labels, mut taken) = (Vec::new(), Vec::new());
        for (number, track) in tracks.iter().enumerate() {
            let color = if track.standing == Standing::Missed { MISSED } else { color(number) };
            for &(camera, line) in &track.members {
                let observed = &matched.found[camera].view.lines[line];
                let ends = self.ends(camera, &observed.segment);
                self.canvas.stroke(ends, &stroke(track.standing, color));
                if observed.depth.is_some() {
                    ends.iter().for_each(|end| self.dot(*end, (color, 7.0)));
                }
                let middle = [0, 1].map(|axis| 0.5 * (ends[0][axis] + ends[1][axis]));
                if track.standing == Standing::Wrong {
                    self.cross(middle);
                }
                let number = (number + 1).to_string();
                let at = free_place(&ends, plate_width(&number), &taken);
                taken.push((at, plate_width(&number)));
                labels.push((at, number, color));
            }
        }
        // Over all lines.
        labels.iter().for_each(|(at, number, color)| self.label(*at, number, *color));
    }

    fn cross(&mut self, [x, y]: [f64; 2]) {
        let stroke = Stroke { color: WRONG, width_px: 3.0, dash_px: None };
        for side in [-1.0, 1.0] {
            self.canvas.stroke([[x - 9.0, y - 9.0 * side], [x + 9.0, y + 9.0 * side]], &stroke);
        }
    }

    /// A number on a dark plate.
    fn label(&mut self, at: [i32; 2], number: &str, color: canvas::Rgb) {
        let width = plate_width(number);
        let corner = Point::new(at[0] - width / 2, at[1] - PLATE_PX / 2);
        let plate = PrimitiveStyle::with_fill(Rgb888::new(PAPER[0], PAPER[1], PAPER[2]));
        // Painting into memory cannot fail: its error has no value.
        let Ok(()) = Rectangle::new(corner, Size::new(width as u32, PLATE_PX as u32))
            .into_styled(plate)
            .draw(&mut self.canvas);
        self.text(at, number, (color, Alignment::Center));
    }

    fn text(&mut self, at: [i32; 2], text: &str, (color, alignment): (canvas::Rgb, Alignment)) {
        let letters = MonoTextStyleBuilder::new()
            .font(FONT)
            .text_color(Rgb888::new(color[0], color[1], color[2]))
            .build();
        let style = TextStyleBuilder::new().alignment(alignment).baseline(Baseline::Middle).build();
        let text = Text::with_text_style(text, Point::new(at[0], at[1]), letters, style);
        let drawn: Result<_, Infallible> = text.draw(&mut self.canvas);
        let Ok(_) = drawn;
    }

    /// What the strokes mean.
    fn legend(&mut self, [mut x, y]: [i32; 2], has_truth: bool) {
        let judged = [
            (Standing::Right, "match, right"),
            (Standing::Wrong, "match, wrong"),
            (Standing::Unjudged, "match, not to be judged"),
            (Standing::Missed, "shared, not matched"),
        ];
        let unknown = [(Standing::Unjudged, "match")];
        let standings = if has_truth { &judged[..] } else { &unknown[..] };
        for (index, &(standing, words)) in standings.iter().enumerate() {
            let color = if standing == Standing::Missed { MISSED } else { color(index) };
            let ends = [[f64::from(x), f64::from(y)], [f64::from(x + 60), f64::from(y)]];
            self.canvas.stroke(ends, &stroke(standing, color));
            if standing == Standing::Wrong {
                self.cross([f64::from(x + 30), f64::from(y)]);
            }
            self.text([x + 70, y], words, (INK, Alignment::Left));
            x += 70 + 9 * words.len() as i32 + 28;
        }
        for (color, words) in [(LIFTED, "no match, with depth"), (UNLIFTED, "no match, no depth")] {
            let ends = [[f64::from(x), f64::from(y)], [f64::from(x + 60), f64::from(y)]];
            self.canvas.stroke(ends, &Stroke { color, width_px: 1.0, dash_px: None });
            if color == LIFTED {
                ends.iter().for_each(|end| self.dot(*end, (color, 4.0)));
            }
            self.text([x + 70, y], words, (INK, Alignment::Left));
            x += 70 + 9 * words.len() as i32 + 28;
        }
    }
}

fn stroke(standing: Standing, color: canvas::Rgb) -> Stroke {
    let dash_px = match standing {
        Standing::Right => None,
        Standing::Wrong => Some([12.0, 7.0]),
        Standing::Unjudged => Some([3.0, 4.0]),
        Standing::Missed => Some([1.0, 3.0]),
    };
    Stroke { color, width_px: 3.0, dash_px }
}

/// Width of the plate of a number, px.
fn plate_width(number: &str) -> i32 {
    9 * number.len() as i32 + 4
}

/// A place for a plate beside a segment that hides no other plate: near the middle if there is room, else further out.
fn free_place(ends: &[[f64; 2]; 2], width: i32, taken: &[([i32; 2], i32)]) -> [i32; 2] {
    let [dx, dy] = [ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]];
    let length = dx.hypot(dy).max(1.0);
    let beside = |share: f64, away_px: f64| {
        let along =
            |axis: usize, step: f64| (ends[0][axis] + share * (ends[1][axis] - ends[0][axis]) + step) as i32;
        [along(0, -away_px * dy / length), along(1, away_px * dx / length)]
    };
    let is_free = |at: &[i32; 2]| {
        taken.iter().all(|(other, other_width)| {
            2 * (at[0] - other[0]).abs() > width + other_width || (at[1] - other[1]).abs() >= PLATE_PX
        })
    };
    let shares = [0.5, 0.35, 0.65, 0.2, 0.8, 0.05, 0.95, -0.1, 1.1];
    let places = [15.0, -15.0, 26.0, -26.0].map(|away_px| shares.map(|share| beside(share, away_px)));
    places.as_flattened().iter().copied().find(is_free).unwrap_or_else(|| beside(0.5, 15.0))
}

/// Colours that follow each other differ: each turns by the golden angle.
fn color(number: usize) -> canvas::Rgb {
    let hue = (number as f64 * 0.618_034 + 0.33).fract() * 6.0;
    let shade = if number.is_multiple_of(2) { 0.25 } else { 0.5 };
    let channel = |offset: f64| {
        let place = (hue + offset) % 6.0;
        let strength = (place.min(4.0 - place)).clamp(0.0, 1.0);
        (255.0 * (shade + (1.0 - shade) * strength)) as u8
    };
    [channel(2.0), channel(0.0), channel(4.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_follow_each_other_have_different_colours() {
        let gap = |a: canvas::Rgb, b: canvas::Rgb| {
            a.iter().zip(b).map(|(a, b)| u32::from(a.abs_diff(b))).sum::<u32>()
        };
        for number in 0..60 {
            for ahead in 1..3 {
                let (a, b) = (color(number), color(number + ahead));
                assert!(gap(a, b) > 90, "{number}: {a:?} and {b:?}");
            }
        }
    }
}
