//! A tileable picture of fractal noise with its pyramid: the grain of every surface.

use super::random::Random;

/// Levels of the pyramid, down to a single texel.
const LEVELS: usize = 8;
/// Texels along a side of the finest level.
const SIDE: usize = 1 << (LEVELS - 1);

/// A tileable picture of fractal noise, -1 to 1, with its pyramid.
#[derive(Debug, Clone)]
pub(super) struct NoisePicture {
    /// Each texel with its neighbours to the right, below, and to the right below: one load per look-up.
    levels: Vec<Vec<[f32; 4]>>,
}

impl NoisePicture {
    pub(super) fn new(seed: u64) -> Self {
        let mut finest = vec![0.0f32; SIDE * SIDE];
        // Octaves of 8 to 64 cells per side.
        for octave in 3..7 {
            add_octave(&mut finest, 1 << octave, &mut Random::keyed(seed, &[0x7E87, octave]));
        }
        let peak = finest.iter().fold(0.0f32, |peak, v| peak.max(v.abs()));
        finest.iter_mut().for_each(|v| *v /= peak);
        let mut levels = vec![finest];
        while let Some(coarser) = levels.last().and_then(|finer| halved(finer)) {
            levels.push(coarser);
        }
        Self { levels: levels.iter().map(|level| with_neighbours(level)).collect() }
    }

    /// The noise around `position` (in pictures), averaged over a square of this squared width.
    #[inline]
    pub(super) fn sample(&self, position: [f32; 2], width_squared: f32) -> f32 {
        let texels_squared = width_squared * (SIDE * SIDE) as f32;
        let level = (0.5 * coarse_log2(texels_squared.max(1.0))).min((LEVELS - 1) as f32);
        let lower = (level as usize).min(LEVELS - 2);
        let share = level - lower as f32;
        let fine = self.bilinear(lower, position);
        // Surfaces seen from close by need no second look-up.
        if share <= 0.0 {
            return fine;
        }
        fine + (self.bilinear(lower + 1, position) - fine) * share
    }

    #[inline]
    fn bilinear(&self, level: usize, position: [f32; 2]) -> f32 {
        let shift = LEVELS - 1 - level;
        let (side, mask) = ((1usize << shift) as f32, (1i32 << shift) - 1);
        // A texel's centre is at +0.5, on every level.
        let (x, y) = (position[0] * side - 0.5, position[1] * side - 0.5);
        let (x0, y0) = (floor(x), floor(y));
        let (fx, fy) = (x - x0, y - y0);
        let (x0, y0) = (x0 as i32, y0 as i32);
        let [left, right, below, right_below] =
            self.levels[level][(((y0 & mask) << shift) + (x0 & mask)) as usize];
        let (top, bottom) = (left + (right - left) * fx, below + (right_below - below) * fx);
        top + (bottom - top) * fy
    }
}

fn with_neighbours(level: &[f32]) -> Vec<[f32; 4]> {
    let side = level.len().isqrt();
    let texel = |x: usize, y: usize| level[(y % side) * side + x % side];
    let quad = |i: usize| {
        let (x, y) = (i % side, i / side);
        [texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)]
    };
    (0..level.len()).map(quad).collect()
}

fn add_octave(picture: &mut [f32], cells: usize, random: &mut Random) {
    let lattice: Vec<f32> = (0..cells * cells).map(|_| random.gaussian()).collect();
    let amplitude = 1.0 / (cells as f32).sqrt();
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    for (i, value) in picture.iter_mut().enumerate() {
        let at = [i % SIDE, i / SIDE].map(|p| p as f32 * cells as f32 / SIDE as f32);
        let [x, y] = at.map(|p| p as usize);
        let [fx, fy] = at.map(|p| smooth(p - p.floor()));
        let node = |x: usize, y: usize| lattice[(y % cells) * cells + x % cells];
        let top = node(x, y) * (1.0 - fx) + node(x + 1, y) * fx;
        let bottom = node(x, y + 1) * (1.0 - fx) + node(x + 1, y + 1) * fx;
        *value += amplitude * (top * (1.0 - fy) + bottom * fy);
    }
}

/// The next level of the pyramid; `None` after the single texel.
fn halved(finer: &[f32]) -> Option<Vec<f32>> {
    let side = finer.len().isqrt();
    if side < 2 {
        return None;
    }
    let half = side / 2;
    let average = |i: usize| {
        let corner = (i / half) * 2 * side + (i % half) * 2;
        0.25 * (finer[corner] + finer[corner + 1] + finer[corner + side] + finer[corner + side + 1])
    };
    Some((0..half * half).map(average).collect())
}

/// `f32::floor` without the library call that processors without SSE 4.1 need; for values that fit an `i32`.
#[inline]
pub(super) fn floor(value: f32) -> f32 {
    let cut = value as i32 as f32;
    if cut > value { cut - 1.0 } else { cut }
}

/// log2 of a positive number, exact at powers of two and linear between: enough to choose a level of a pyramid.
#[inline]
fn coarse_log2(value: f32) -> f32 {
    value.to_bits() as f32 / (1u32 << 23) as f32 - 127.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_fades_with_the_size_of_the_pixel() {
        let noise = NoisePicture::new(5);
        let spread = |width: f32| {
            (0..400)
                .map(|i| noise.sample([0.37 * i as f32, 0.11 * i as f32], width * width).abs())
                .fold(0.0f32, f32::max)
        };
        assert!(spread(0.001) > 0.3 && spread(0.5) < 0.1, "{} {}", spread(0.001), spread(0.5));
    }
}
