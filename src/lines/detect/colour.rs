//! Edges between colours that are equally bright: the gray image does not show them.
//!
//! Cameras and JPEG keep colour at half the resolution, so its gradient is taken at half the resolution too, of red against green
//! and of blue against both, and put between the gray gradient where it is clear and gray shows hardly anything.
use super::gradient::{BORDER_PX, COUNTS_PER_LEVEL, Gradient, sobel_row};
use crate::image::RgbView;

/// Least gradient of a colour, counts: what compression leaves of a plain surface stays below.
const MIN_COLOUR: i16 = 4 * COUNTS_PER_LEVEL as i16;
/// A colour counts where its gradient is more than so many times that of gray, which is sharper.
const OVER_GRAY: i16 = 2;

/// The gradient of the colours at half the resolution.
#[derive(Debug, Default)]
pub struct Colour {
    /// Pixels of half the size.
    width: usize,
    height: usize,
    /// Red less green, and blue less the mean of both; sums over four pixels, so that Sobel's sums are counts as of gray.
    differences: [Vec<i16>; 2],
    /// Of the stronger one; zero in the border of one pixel.
    vector: Vec<[i16; 2]>,
    magnitude: Vec<i16>,
    /// Sums of two rows of the image.
    column_sums: Vec<i16>,
    /// One row of the other one.
    row_vector: Vec<[i16; 2]>,
    row_magnitude: Vec<i16>,
}

impl Colour {
    /// Puts the gradient of the colours into that of the gray form of the same image.
    pub fn add(&mut self, rgb: &RgbView<'_>, gradient: &mut Gradient) {
        self.resize((rgb.width() / 2, rgb.height() / 2));
        for y in 0..self.height {
            self.differ(rgb, y);
        }
        for y in 1..self.height - 1 {
            self.differentiate_row(y);
        }
        for y in BORDER_PX / 2 + 1..self.height - BORDER_PX / 2 - 1 {
            self.fill_row(y, gradient);
        }
    }

    fn resize(&mut self, (width, height): (usize, usize)) {
        if (width, height) == (self.width, self.height) {
            return;
        }
        (self.width, self.height) = (width, height);
        let [red_green, blue] = &mut self.differences;
        for plane in [red_green, blue, &mut self.magnitude] {
            plane.clear();
            plane.resize(width * height, 0);
        }
        self.vector.clear();
        self.vector.resize(width * height, [0; 2]);
        self.column_sums.resize(6 * width, 0);
        self.row_vector.resize(width - 2, [0; 2]);
        self.row_magnitude.resize(width - 2, 0);
    }

    /// One row of both differences.
    fn differ(&mut self, rgb: &RgbView<'_>, y: usize) {
        let n = self.width;
        let [upper, lower] = [2 * y, 2 * y + 1].map(|y| &rgb.row(y)[..2 * n].as_flattened()[..6 * n]);
        let sums = &mut self.column_sums[..6 * n];
        for i in 0..6 * n {
            sums[i] = i16::from(upper[i]) + i16::from(lower[i]);
        }
        let [red_green, blue] = self.differences.each_mut().map(|plane| &mut plane[y * n..(y + 1) * n]);
        let pairs = self.column_sums.as_chunks::<6>().0;
        for ((&[r0, g0, b0, r1, g1, b1], red_green), blue) in pairs.iter().zip(red_green).zip(blue) {
            let [r, g, b] = [r0 + r1, g0 + g1, b0 + b1];
            *red_green = r - g;
            *blue = b - (r + g) / 2;
        }
    }

    fn differentiate_row(&mut self, y: usize) {
        let n = self.width;
        let inner = y * n + 1..(y + 1) * n - 1;
        let [red_green, blue] =
            self.differences.each_ref().map(|plane| [y - 1, y, y + 1].map(|y| &plane[y * n..(y + 1) * n]));
        let (vectors, magnitudes) = (&mut self.vector[inner.clone()], &mut self.magnitude[inner]);
        sobel_row(red_green, vectors, magnitudes);
        sobel_row(blue, &mut self.row_vector, &mut self.row_magnitude);
        if self.row_magnitude.iter().fold(0, |a, &b| a.max(b)) < MIN_COLOUR {
            return;
        }
        let other = self.row_vector.iter().zip(&self.row_magnitude);
        for ((vector, magnitude), (&of_blue, &by_blue)) in vectors.iter_mut().zip(magnitudes).zip(other) {
            let is_blue = by_blue > *magnitude;
            *vector = if is_blue { of_blue } else { *vector };
            *magnitude = if is_blue { by_blue } else { *magnitude };
        }
    }

    /// The pixels under one row, where a colour is clear.
    fn fill_row(&self, y: usize, gradient: &mut Gradient) {
        let n = self.width;
        for x in BORDER_PX / 2 + 1..n - BORDER_PX / 2 - 1 {
            // Between two pixels of half the size it is weaker than at the stronger one.
            if self.magnitude[y * n + x] < MIN_COLOUR {
                continue;
            }
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let vector = self.between((x, y), (2 * dx, 2 * dy));
                let magnitude = vector[0].abs() + vector[1].abs();
                let at = (2 * y + dy) * gradient.width + 2 * x + dx;
                if magnitude / OVER_GRAY > gradient.magnitude[at] {
                    (gradient.vector[at], gradient.magnitude[at]) = (vector, magnitude);
                }
            }
        }
    }

    /// The gradient a quarter of a pixel off the centre of one, towards the neighbours at `side - 1`, linearly between four.
    fn between(&self, (x, y): (usize, usize), (side_x, side_y): (usize, usize)) -> [i16; 2] {
        let at = |x: usize, y: usize| self.vector[y * self.width + x].map(i32::from);
        let (beside, above) = (x + side_x - 1, y + side_y - 1);
        let corners = [at(x, y), at(beside, y), at(x, above), at(beside, above)];
        [0, 1].map(|k| {
            let [near, aside, over, far] = corners.map(|corner| corner[k]);
            ((9 * near + 3 * (aside + over) + far) >> 4) as i16
        })
    }
}
