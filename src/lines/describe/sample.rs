//! Sums of the logarithm of light over rows of pixels beside an edge.

use crate::image::RgbView;

/// Distance between samples of a row, px.
const STEP_PX: f64 = 2.0;
/// Most samples of a row.
const MAX_SAMPLES: f64 = 12.0;
/// Light that is added before the logarithm, as a share of white: below it there is mostly noise.
const DARKEST: f64 = 0.02;

/// The logarithm of the light that an 8-bit value stands for.
#[derive(Debug, Clone)]
pub(super) struct LogLight([f32; 256]);

impl Default for LogLight {
    /// By the tone curve of sRGB, which cameras follow roughly.
    fn default() -> Self {
        Self(std::array::from_fn(|level| {
            let encoded = level as f64 / 255.0;
            let linear =
                if encoded <= 0.04045 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) };
            (linear + DARKEST).ln() as f32
        }))
    }
}

/// Sums over samples.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sums {
    /// Samples in the image.
    pub(super) n: f32,
    /// Samples asked for.
    pub(super) n_possible: f32,
    pub(super) light: f32,
    pub(super) light2: f32,
    pub(super) red_green: f32,
    pub(super) blue_green: f32,
}

impl Sums {
    pub(super) fn add(&mut self, other: &Self) {
        self.n += other.n;
        self.n_possible += other.n_possible;
        self.light += other.light;
        self.light2 += other.light2;
        self.red_green += other.red_green;
        self.blue_green += other.blue_green;
    }

    /// A sum per sample; 0 without samples.
    pub(super) fn mean(&self, sum: f32) -> f32 {
        if self.n > 0.0 { sum / self.n } else { 0.0 }
    }

    /// Standard deviation of light.
    pub(super) fn deviation(&self) -> f32 {
        let mean = self.mean(self.light);
        (self.mean(self.light2) - mean * mean).max(0.0).sqrt()
    }
}

impl LogLight {
    /// Sums over a row between two pixel positions.
    pub(super) fn sums(&self, image: &RgbView<'_>, [from, to]: [[f64; 2]; 2]) -> Sums {
        let length_px = (to[0] - from[0]).hypot(to[1] - from[1]);
        let count = (length_px / STEP_PX).clamp(1.0, MAX_SAMPLES) as usize;
        let step = [0, 1].map(|i| ((to[i] - from[i]) / count as f64) as f32);
        // Half a pixel is for rounding to the nearest.
        let [mut x, mut y] = [0, 1].map(|i| from[i] as f32 + 0.5 * step[i] + 0.5);
        let mut sums = Sums { n_possible: count as f32, ..Sums::default() };
        for _ in 0..count {
            if x >= 0.0
                && y >= 0.0
                && let Some(rgb) = image.pixel(x as usize, y as usize)
            {
                let [red, green, blue] = rgb.map(|level| self.0[usize::from(level)]);
                let light = (red + green + blue) * (1.0 / 3.0);
                sums.n += 1.0;
                sums.light += light;
                sums.light2 += light * light;
                sums.red_green += red - green;
                sums.blue_green += blue - green;
            }
            x += step[0];
            y += step[1];
        }
        sums
    }
}
