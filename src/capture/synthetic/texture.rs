//! What surfaces look like: procedural patterns in metres on the face of a block.
//!
//! Every pattern is filtered with the footprint of the pixel (edges by box coverage, grain by a pyramid), so an edge in a
//! texture lies where geometry says, to a few hundredths of a pixel, and nothing makes moiré.

use super::random::Random;

/// Linear RGB reflectance, 0 to 1.
pub(super) type Rgb = [f32; 3];

/// Where a pixel looks on a face, and how that place moves from pixel to pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spot {
    /// Position on the face from its centre, m.
    pub(super) at_m: [f32; 2],
    /// Change of `at_m[0]` per pixel to the right and down, m.
    pub(super) first_per_px: [f32; 2],
    /// Change of `at_m[1]` per pixel to the right and down, m.
    pub(super) second_per_px: [f32; 2],
    /// Half size of the face, m.
    pub(super) half_m: [f32; 2],
}

/// A coordinate on the face and the width of a pixel along it, m.
#[derive(Debug, Clone, Copy)]
struct Along {
    at_m: f32,
    width_m: f32,
}

impl Spot {
    /// The coordinate `cos * first + sin * second`.
    fn along(&self, [cos, sin]: [f32; 2]) -> Along {
        let x = cos * self.first_per_px[0] + sin * self.second_per_px[0];
        let y = cos * self.first_per_px[1] + sin * self.second_per_px[1];
        Along {
            at_m: cos * self.at_m[0] + sin * self.at_m[1],
            // Never zero, so that it may divide.
            width_m: (x * x + y * y).sqrt() + 1e-6,
        }
    }
}

/// A straight bar of a picture: `|normal · p - offset| < half_width`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bar {
    pub(super) normal: [f32; 2],
    pub(super) offset_m: f32,
    pub(super) half_width_m: f32,
    pub(super) color: Rgb,
}

/// The drawing on a face.
#[derive(Debug, Clone)]
pub(super) enum Pattern {
    /// One colour.
    Plain,
    /// Parallel stripes across the direction (cos, sin); `duty` of each period has the other colour.
    Stripes { direction: [f32; 2], period_m: f32, duty: f32, other: Rgb },
    /// Tiles or boards of `size_m`, turned by the direction, with joints of the other colour; each differs in brightness.
    Tiles { direction: [f32; 2], size_m: [f32; 2], joint_m: f32, other: Rgb },
    /// A row of things of one width along the first axis (books): each has its own colour.
    Row { period_m: f32, seed: u64 },
    /// A frame line of the other colour, `inset_m` from the face's border (door panel, rug border).
    Border { inset_m: f32, width_m: f32, other: Rgb },
    /// A picture of straight bars.
    Picture { bars: Vec<Bar> },
}

/// Fine irregular brightness on top of the drawing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grain {
    /// Peak share of the brightness.
    pub(super) contrast: f32,
    /// Repetitions of the noise picture per metre along both axes of the face.
    pub(super) per_m: [f32; 2],
}

/// What one face is made of.
#[derive(Debug, Clone)]
pub(super) struct Material {
    pub(super) base: Rgb,
    pub(super) pattern: Pattern,
    pub(super) grain: Grain,
}

impl Material {
    /// Whether stereo finds something to match on it.
    pub(super) fn is_textured(&self) -> bool {
        self.grain.contrast > 0.1 || !matches!(self.pattern, Pattern::Plain | Pattern::Border { .. })
    }

    /// Reflectance averaged over the pixel.
    pub(super) fn color(&self, spot: &Spot, noise: &NoisePicture) -> Rgb {
        let drawn = self.drawn(spot);
        let position = [spot.at_m[0] * self.grain.per_m[0], spot.at_m[1] * self.grain.per_m[1]];
        let first = spot.along([1.0, 0.0]).width_m * self.grain.per_m[0];
        let second = spot.along([0.0, 1.0]).width_m * self.grain.per_m[1];
        let factor = 1.0 + self.grain.contrast * noise.sample(position, first.max(second));
        drawn.map(|channel| channel * factor)
    }

    fn drawn(&self, spot: &Spot) -> Rgb {
        match &self.pattern {
            Pattern::Plain => self.base,
            Pattern::Stripes { direction, period_m, duty, other } => {
                mix(self.base, *other, pulses(spot.along(*direction), *period_m, *duty))
            }
            Pattern::Tiles { direction: [cos, sin], size_m, joint_m, other } => {
                let axes = [spot.along([*cos, *sin]), spot.along([-sin, *cos])];
                let joint = [0, 1].map(|k| pulses(axes[k], size_m[k], joint_m / size_m[k]));
                let shade = 1.0 + 0.25 * tile_shade(axes, *size_m, *joint_m);
                mix(self.base.map(|c| c * shade), *other, 1.0 - (1.0 - joint[0]) * (1.0 - joint[1]))
            }
            Pattern::Row { period_m, seed } => row_color(spot.along([1.0, 0.0]), *period_m, *seed),
            Pattern::Border { inset_m, width_m, other } => {
                mix(self.base, *other, border(spot, *inset_m, *width_m))
            }
            Pattern::Picture { bars } => bars.iter().fold(self.base, |under, bar| {
                let across = spot.along(bar.normal);
                let low = coverage(across.at_m - bar.offset_m + bar.half_width_m, across.width_m);
                let high = coverage(across.at_m - bar.offset_m - bar.half_width_m, across.width_m);
                mix(under, bar.color, low - high)
            }),
        }
    }
}

fn mix(a: Rgb, b: Rgb, share: f32) -> Rgb {
    [0, 1, 2].map(|c| a[c] + (b[c] - a[c]) * share)
}

/// Share of a pixel of this width beyond an edge at signed distance `beyond_m` before its centre.
fn coverage(beyond_m: f32, width_m: f32) -> f32 {
    (0.5 + beyond_m / width_m).clamp(0.0, 1.0)
}

/// Share of the pixel in the first `duty` of each period: the exact box filter of a pulse train.
fn pulses(along: Along, period_m: f32, duty: f32) -> f32 {
    let integral = |s: f32| s.floor() * duty + (s - s.floor()).min(duty);
    let (at, width) = (along.at_m / period_m, along.width_m / period_m);
    // Beyond a few periods the mean is right to a percent and free of rounding.
    if width > 8.0 {
        return duty;
    }
    (integral(at + 0.5 * width) - integral(at - 0.5 * width)) / width
}

/// The cell under the low end of the pixel, and the share of the pixel in the next one.
fn cells(along: Along, period_m: f32) -> (i64, f32) {
    let low = (along.at_m - 0.5 * along.width_m) / period_m;
    let width = (along.width_m / period_m).min(1.0);
    let first = low.floor();
    (first as i64, ((low + width - first - 1.0) / width).clamp(0.0, 1.0))
}

/// Brightness of a tile, -1 to 1, blended where the pixel sees two; fades out where tiles become small.
fn tile_shade(axes: [Along; 2], size_m: [f32; 2], joint_m: f32) -> f32 {
    // The brightness changes in the middle of the joint.
    let [(x, x_share), (y, y_share)] = [0, 1].map(|k| {
        let along = Along { at_m: axes[k].at_m - 0.5 * joint_m, ..axes[k] };
        cells(along, size_m[k])
    });
    let fade = [0, 1].map(|k| (1.5 - 2.0 * axes[k].width_m / size_m[k]).clamp(0.0, 1.0));
    let shade = |x: i64, y: i64| {
        let draw = Random::keyed(7, &[x.cast_unsigned(), y.cast_unsigned()]).next_u64();
        (draw >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    // Most pixels lie in one tile.
    let row = |y: i64| match x_share > 0.0 {
        true => shade(x, y) + (shade(x + 1, y) - shade(x, y)) * x_share,
        false => shade(x, y),
    };
    let mean = if y_share > 0.0 { row(y) + (row(y + 1) - row(y)) * y_share } else { row(y) };
    fade[0] * fade[1] * mean
}

/// Colours of a row of books, blended over the pixel where two meet.
fn row_color(along: Along, period_m: f32, seed: u64) -> Rgb {
    let (first, next_share) = cells(along, period_m);
    let color = |cell: i64| {
        let bits = Random::keyed(seed, &[cell.cast_unsigned()]).next_u64();
        let dark = 0.15 + 0.6 * (bits >> 56) as f32 / 255.0;
        [0, 8, 16].map(|shift| dark * (0.4 + 0.6 * (bits >> shift & 0xFF) as f32 / 255.0))
    };
    mix(color(first), color(first + 1), next_share)
}

/// Share of the pixel in the ring `inset_m..inset_m + width_m` from the border of the face.
fn border(spot: &Spot, inset_m: f32, width_m: f32) -> f32 {
    let inside = |margin_m: f32| {
        [0usize, 1].map(|k| {
            let along = spot.along([1.0 - k as f32, k as f32]);
            coverage(spot.half_m[k] - margin_m - along.at_m.abs(), along.width_m)
        })
    };
    let (outer, inner) = (inside(inset_m), inside(inset_m + width_m));
    outer[0] * outer[1] - inner[0] * inner[1]
}

const NOISE_LEVELS: usize = 9;
const NOISE_SIDE: usize = 1 << (NOISE_LEVELS - 1);

/// A tileable picture of fractal noise, -1 to 1, with its pyramid.
#[derive(Debug, Clone)]
pub(super) struct NoisePicture {
    levels: Vec<Vec<f32>>,
}

impl NoisePicture {
    pub(super) fn new(seed: u64) -> Self {
        let mut finest = vec![0.0f32; NOISE_SIDE * NOISE_SIDE];
        // Octaves of 8 to 128 cells per side.
        for octave in 3..8 {
            add_octave(&mut finest, 1 << octave, &mut Random::keyed(seed, &[0x7E87, octave]));
        }
        let peak = finest.iter().fold(0.0f32, |peak, v| peak.max(v.abs()));
        finest.iter_mut().for_each(|v| *v /= peak);
        let mut levels = vec![finest];
        while let Some(coarser) = levels.last().and_then(|finer| halved(finer)) {
            levels.push(coarser);
        }
        Self { levels }
    }

    /// The noise around `position` (in pictures), averaged over `width` pictures.
    fn sample(&self, position: [f32; 2], width: f32) -> f32 {
        let level = (width * NOISE_SIDE as f32).max(1.0).log2().min((NOISE_LEVELS - 1) as f32);
        let lower = (level as usize).min(NOISE_LEVELS - 2);
        let share = level - lower as f32;
        let fine = self.bilinear(lower, position);
        fine + (self.bilinear(lower + 1, position) - fine) * share
    }

    fn bilinear(&self, level: usize, position: [f32; 2]) -> f32 {
        let shift = NOISE_LEVELS - 1 - level;
        let (side, mask) = ((1usize << shift) as f32, (1i32 << shift) - 1);
        // A texel's centre is at +0.5, on every level.
        let [x, y] = position.map(|p| p * side - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let (x0, y0) = (x0 as i32, y0 as i32);
        let texels = &self.levels[level];
        let texel = |x: i32, y: i32| texels[(((y & mask) << shift) + (x & mask)) as usize];
        let top = texel(x0, y0) + (texel(x0 + 1, y0) - texel(x0, y0)) * fx;
        let bottom = texel(x0, y0 + 1) + (texel(x0 + 1, y0 + 1) - texel(x0, y0 + 1)) * fx;
        top + (bottom - top) * fy
    }
}

fn add_octave(picture: &mut [f32], cells: usize, random: &mut Random) {
    let lattice: Vec<f32> = (0..cells * cells).map(|_| random.gaussian()).collect();
    let amplitude = 1.0 / (cells as f32).sqrt();
    let smooth = |t: f32| t * t * (3.0 - 2.0 * t);
    for (i, value) in picture.iter_mut().enumerate() {
        let at = [i % NOISE_SIDE, i / NOISE_SIDE].map(|p| p as f32 * cells as f32 / NOISE_SIDE as f32);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn spot(at_m: f32, px_m: f32) -> Spot {
        Spot { at_m: [at_m, 0.0], first_per_px: [px_m, 0.0], second_per_px: [0.0, px_m], half_m: [1.0, 1.0] }
    }

    #[test]
    fn a_stripe_edge_covers_half_the_pixel_it_halves() {
        let share = |at_m| pulses(spot(at_m, 0.002).along([1.0, 0.0]), 0.1, 0.5);
        assert!((share(0.1) - 0.5).abs() < 1e-3);
        assert!((share(0.1005) - 0.75).abs() < 1e-3);
        assert!((share(0.12) - 1.0).abs() < 1e-3 && share(0.18).abs() < 1e-3);
    }

    #[test]
    fn stripes_smaller_than_a_pixel_become_their_mean() {
        for step in 0..20 {
            let share = pulses(spot(0.013 * step as f32, 0.05).along([1.0, 0.0]), 0.01, 0.3);
            assert!((share - 0.3).abs() < 0.05, "share {share}");
        }
    }

    #[test]
    fn noise_fades_with_the_size_of_the_pixel() {
        let noise = NoisePicture::new(5);
        let spread = |width: f32| {
            (0..400)
                .map(|i| noise.sample([0.37 * i as f32, 0.11 * i as f32], width).abs())
                .fold(0.0f32, f32::max)
        };
        assert!(spread(0.001) > 0.3 && spread(0.5) < 0.1, "{} {}", spread(0.001), spread(0.5));
    }
}
