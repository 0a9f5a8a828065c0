//! What surfaces look like: procedural patterns in metres on the face of a block.
//!
//! Every pattern is filtered with the footprint of the pixel (edges by box coverage, grain by a pyramid), so an edge in a
//! texture lies where geometry says, to a few hundredths of a pixel, and nothing makes moiré.

use super::noise_picture::{NoisePicture, floor};
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
    /// One colour, no depth (window panes, screens).
    Glass,
    /// Parallel stripes across the direction (cos, sin); `duty` of each period has the other colour.
    Stripes { direction: [f32; 2], period_m: f32, duty: f32, other: Rgb },
    /// Tiles or boards of `size_m`, turned by the direction, with joints of the other colour; each differs in brightness.
    Tiles { direction: [f32; 2], size_m: [f32; 2], joint_m: f32, other: Rgb },
    /// A row of things of one width along the first axis (books): each has its own colour.
    Row { period_m: f32, seed: u64 },
    /// A frame line of the other colour, `inset_m` from the face's border (door panel, rug border).
    Border { inset_m: f32, width_m: f32, other: Rgb },
    /// A checkerboard in the middle of the face: squares of this colour and the other in turn.
    Checkers { squares: [u32; 2], square_m: f32, other: Rgb },
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

/// What a stereo matcher finds on a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Stereo {
    /// Enough to match everywhere.
    #[default]
    Textured,
    /// Little: noisier from afar, lost at grazing angles.
    Bare,
    /// Nothing that belongs to the surface.
    Blind,
}

/// What one face is made of.
#[derive(Debug, Clone)]
pub(super) struct Material {
    pub(super) base: Rgb,
    pub(super) pattern: Pattern,
    pub(super) grain: Grain,
}

impl Material {
    /// What stereo finds on it.
    pub(super) fn stereo(&self) -> Stereo {
        match self.pattern {
            Pattern::Glass => Stereo::Blind,
            Pattern::Plain | Pattern::Border { .. } if self.grain.contrast <= 0.1 => Stereo::Bare,
            _ => Stereo::Textured,
        }
    }

    /// Reflectance averaged over the pixel.
    pub(super) fn color(&self, spot: &Spot, noise: &NoisePicture) -> Rgb {
        let [r, g, b] = self.drawn(spot);
        let [per_first_m, per_second_m] = self.grain.per_m;
        let square = |[right, down]: [f32; 2], per_m: f32| (right * right + down * down) * per_m * per_m;
        let width_squared =
            square(spot.first_per_px, per_first_m).max(square(spot.second_per_px, per_second_m));
        let position = [spot.at_m[0] * per_first_m, spot.at_m[1] * per_second_m];
        let factor = 1.0 + self.grain.contrast * noise.sample(position, width_squared);
        [r * factor, g * factor, b * factor]
    }

    fn drawn(&self, spot: &Spot) -> Rgb {
        match &self.pattern {
            Pattern::Plain | Pattern::Glass => self.base,
            Pattern::Stripes { direction, period_m, duty, other } => {
                mix(self.base, *other, pulses(spot.along(*direction), *period_m, *duty))
            }
            Pattern::Tiles { direction: [cos, sin], size_m, joint_m, other } => {
                let axes = [spot.along([*cos, *sin]), spot.along([-sin, *cos])];
                let joint = |k: usize| pulses(axes[k], size_m[k], joint_m / size_m[k]);
                let shade = 1.0 + 0.25 * tile_shade(axes, *size_m, *joint_m);
                let [r, g, b] = self.base;
                mix([r * shade, g * shade, b * shade], *other, 1.0 - (1.0 - joint(0)) * (1.0 - joint(1)))
            }
            Pattern::Row { period_m, seed } => row_color(spot.along([1.0, 0.0]), *period_m, *seed),
            Pattern::Border { inset_m, width_m, other } => {
                mix(self.base, *other, border(spot, *inset_m, *width_m))
            }
            Pattern::Checkers { squares, square_m, other } => {
                mix(self.base, *other, checkers(spot, *squares, *square_m))
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
    let channel = |c: usize| a[c] + (b[c] - a[c]) * share;
    [channel(0), channel(1), channel(2)]
}

/// Share of a pixel of this width beyond an edge at signed distance `beyond_m` before its centre.
fn coverage(beyond_m: f32, width_m: f32) -> f32 {
    (0.5 + beyond_m / width_m).clamp(0.0, 1.0)
}

/// Share of the pixel in the first `duty` of each period: the exact box filter of a pulse train.
fn pulses(along: Along, period_m: f32, duty: f32) -> f32 {
    let integral = |s: f32| floor(s) * duty + (s - floor(s)).min(duty);
    let (at, width) = (along.at_m / period_m, along.width_m / period_m);
    // Most pixels lie within a stretch of one colour.
    let (low, high) = (at - 0.5 * width, at + 0.5 * width);
    let first = floor(low);
    if high < first + 1.0 && (low > first + duty || high < first + duty) {
        return if high < first + duty { 1.0 } else { 0.0 };
    }
    // Beyond a few periods the mean is right to a percent and free of rounding.
    if width > 8.0 {
        return duty;
    }
    (integral(high) - integral(low)) / width
}

/// The cell under the low end of the pixel, and the share of the pixel in the next one.
fn cells(along: Along, period_m: f32) -> (i64, f32) {
    let low = (along.at_m - 0.5 * along.width_m) / period_m;
    let width = (along.width_m / period_m).min(1.0);
    let first = floor(low);
    (first as i64, ((low + width - first - 1.0) / width).clamp(0.0, 1.0))
}

/// Brightness of a tile, -1 to 1, blended where the pixel sees two; fades out where tiles become small.
fn tile_shade(axes: [Along; 2], size_m: [f32; 2], joint_m: f32) -> f32 {
    // The brightness changes in the middle of the joint.
    let cell = |k: usize| cells(Along { at_m: axes[k].at_m - 0.5 * joint_m, ..axes[k] }, size_m[k]);
    let fade = |k: usize| (1.5 - 2.0 * axes[k].width_m / size_m[k]).clamp(0.0, 1.0);
    let ((x, x_share), (y, y_share)) = (cell(0), cell(1));
    let shade = |x: i64, y: i64| {
        let tile = x.wrapping_mul(0x5851_F42D_4C95).wrapping_add(y.wrapping_mul(0x1405_7B7E_F767));
        let draw = Random::keyed(tile.cast_unsigned(), &[]).next_u64();
        (draw >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    // Most pixels lie in one tile.
    let row = |y: i64| match x_share > 0.0 {
        true => shade(x, y) + (shade(x + 1, y) - shade(x, y)) * x_share,
        false => shade(x, y),
    };
    let mean = if y_share > 0.0 { row(y) + (row(y + 1) - row(y)) * y_share } else { row(y) };
    fade(0) * fade(1) * mean
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

/// Share of the pixel in the dark squares. Exact but at corners, where the pixel is taken for a rectangle along the squares.
fn checkers(spot: &Spot, squares: [u32; 2], square_m: f32) -> f32 {
    let axes = [spot.along([1.0, 0.0]), spot.along([0.0, 1.0])];
    let half_m = |k: usize| 0.5 * squares[k] as f32 * square_m;
    let odd = |k: usize| {
        let from_end = Along { at_m: axes[k].at_m + half_m(k), ..axes[k] };
        pulses(from_end, 2.0 * square_m, 0.5)
    };
    let inside = |k: usize| coverage(half_m(k) - axes[k].at_m.abs(), axes[k].width_m);
    let (first, second) = (odd(0), odd(1));
    inside(0) * inside(1) * (first + second - 2.0 * first * second)
}

/// Share of the pixel in the ring `inset_m..inset_m + width_m` from the border of the face.
fn border(spot: &Spot, inset_m: f32, width_m: f32) -> f32 {
    let axes = [spot.along([1.0, 0.0]), spot.along([0.0, 1.0])];
    let inside =
        |margin_m: f32, k: usize| coverage(spot.half_m[k] - margin_m - axes[k].at_m.abs(), axes[k].width_m);
    let within = |margin_m: f32| inside(margin_m, 0) * inside(margin_m, 1);
    within(inset_m) - within(inset_m + width_m)
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
}
