//! Smoothing and gradient in integers, written row by row so that the compiler vectorises them.
//!
//! A binomial filter of five taps (sigma 1 px), then Sobel. One gray level per pixel is 128 counts.
use crate::image::GrayView;

/// Counts of gradient per gray level and pixel: 16 from the smoothing, 8 from Sobel.
pub const COUNTS_PER_LEVEL: f64 = 128.0;

/// Width of the image border without a gradient, px: reach of the two filters.
pub const BORDER_PX: usize = 3;

/// The gradient of one image; zero in the border.
#[derive(Debug, Default)]
pub struct Gradient {
    /// Width, px.
    pub width: usize,
    /// Height, px.
    pub height: usize,
    /// Along x and y, together because they are read together.
    pub vector: Vec<[i16; 2]>,
    /// `|x| + |y|`; at most 32640.
    pub magnitude: Vec<i16>,
    smooth: Vec<i16>,
    column_sums: Vec<u16>,
}

impl Gradient {
    /// Replaces the gradient by that of `gray`; the image is larger than twice the border on both sides.
    pub fn compute(&mut self, gray: &GrayView<'_>) {
        self.resize((gray.width(), gray.height()));
        for y in 2..self.height - 2 {
            self.smooth_row(gray, y);
        }
        let n = self.width;
        for y in BORDER_PX..self.height - BORDER_PX {
            let inner = y * n + BORDER_PX..(y + 1) * n - BORDER_PX;
            let rows = [y - 1, y, y + 1].map(|y| &self.smooth[y * n + 2..(y + 1) * n - 2]);
            sobel_row(rows, &mut self.vector[inner.clone()], &mut self.magnitude[inner]);
        }
    }

    fn resize(&mut self, (width, height): (usize, usize)) {
        if (width, height) == (self.width, self.height) {
            return;
        }
        (self.width, self.height) = (width, height);
        self.vector.clear();
        self.vector.resize(width * height, [0; 2]);
        for plane in [&mut self.magnitude, &mut self.smooth] {
            plane.clear();
            plane.resize(width * height, 0);
        }
        self.column_sums.clear();
        self.column_sums.resize(width, 0);
    }

    /// Binomial 1 4 6 4 1 in both directions; keeps four fractional bits.
    fn smooth_row(&mut self, gray: &GrayView<'_>, y: usize) {
        let n = self.width;
        let rows = [y - 2, y - 1, y, y + 1, y + 2].map(|row| &gray.row(row)[..n]);
        let sums = &mut self.column_sums[..n];
        for (i, sum) in sums.iter_mut().enumerate() {
            let [a, b, c, d, e] = rows.map(|row| u16::from(row[i]));
            *sum = a + e + 4 * (b + d) + 6 * c;
        }
        let m = n - 4;
        let taps = [0, 1, 2, 3, 4].map(|shift| &sums[shift..shift + m]);
        let out = &mut self.smooth[y * n + 2..y * n + 2 + m];
        for (i, out) in out.iter_mut().enumerate() {
            let [a, b, c, d, e] = taps.map(|tap| tap[i]);
            // At most 65280: fits.
            *out = ((a + e + 4 * (b + d) + 6 * c) >> 4) as i16;
        }
    }
}

/// Sobel's gradient of the middle one of three rows, and `|x| + |y|`: one pixel less on both sides.
pub fn sobel_row([above, row, below]: [&[i16]; 3], vector: &mut [[i16; 2]], magnitude: &mut [i16]) {
    let m = row.len() - 2;
    let [above_l, above, above_r] = [0, 1, 2].map(|shift| &above[shift..shift + m]);
    let [left, right] = [0, 2].map(|shift| &row[shift..shift + m]);
    let [below_l, below, below_r] = [0, 1, 2].map(|shift| &below[shift..shift + m]);
    let (vector, magnitude) = (&mut vector[..m], &mut magnitude[..m]);
    for i in 0..m {
        let x = (above_r[i] - above_l[i]) + 2 * (right[i] - left[i]) + (below_r[i] - below_l[i]);
        let y = (below_l[i] - above_l[i]) + 2 * (below[i] - above[i]) + (below_r[i] - above_r[i]);
        vector[i] = [x, y];
        magnitude[i] = x.abs() + y.abs();
    }
}
