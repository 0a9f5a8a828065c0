//! From exact depth to what a stereo camera of the D435i class delivers: correlated disparity noise, quantisation, fattened
//! edges, the shadow of the second imager, holes.
//!
//! All of it happens in inverse depth, where stereo noise is uniform: disparity is `385 px * 0.050 m / z`.

use super::noise_field::{BlobField, SmoothField};
use super::random::Random;
use super::raycast::Raycaster;
use super::shade::Shaded;
use super::texture::Stereo;

/// Disparity of a point at 1 m, px (focal length of the infra-red imagers times their distance).
pub(super) const DISPARITY_AT_1M_PX: f32 = 385.0 * 0.050;
/// The matcher's smallest step, px.
const DISPARITY_STEP_PX: f32 = 1.0 / 32.0;
/// How far the second infra-red imager is to the right of the colour camera, m.
const SHADOW_BASELINE_M: f32 = 0.065;
/// Second difference of inverse depth that makes an edge, 1/m.
const EDGE_STEP_PER_M: f32 = 0.012;
/// Holes are drawn this close to edges, px.
const EDGE_ZONE_PX: isize = 3;
/// Range of the sensor, m, and how much its far end varies.
const RANGE_M: [f32; 2] = [0.25, 6.0];
const FAR_SCATTER_M: f32 = 0.6;

/// A value that a standard normal exceeds with the given probability.
mod quantile {
    /// 1 in 6.
    pub(super) const ONE_IN_SIX: f32 = 0.967;
    /// 0.3 %.
    pub(super) const THREE_IN_THOUSAND: f32 = 2.75;
}

/// The depth noise of one camera; owns all memory it takes.
#[derive(Debug)]
pub(super) struct DepthNoise {
    width: usize,
    sigma_px: f32,
    focal_px: f32,
    /// Correlated over 1.8 px, 14 px (the wide part), 7 px (fattening), 2 px (holes).
    fine: SmoothField,
    wide: BlobField,
    spread: BlobField,
    holes: BlobField,
    /// True inverse depth, 1/m, and that of the nearest surface that bleeds over it (0 where none does).
    inverse_per_m: Vec<f32>,
    bled_per_m: Vec<f32>,
    near_edge: Vec<bool>,
}

impl DepthNoise {
    pub(super) fn new((width, height): (usize, usize), sigma_px: f32, focal_px: f32) -> Self {
        let (size, pixels) = ((width, height), width * height);
        Self {
            width,
            sigma_px,
            focal_px,
            // Noise smoothed with sigma s is correlated over sqrt(2) s.
            fine: SmoothField::new(size, 1.27),
            wide: BlobField::new(size, 14),
            spread: BlobField::new(size, 7),
            holes: BlobField::new(size, 2),
            inverse_per_m: vec![0.0; pixels],
            bled_per_m: vec![0.0; pixels],
            near_edge: vec![false; pixels],
        }
    }

    /// Overwrites `depth` with counts of `unit_m`.
    pub(super) fn apply(
        &mut self,
        (rays, shaded): (&Raycaster, &Shaded),
        random: &mut Random,
        out: DepthOut<'_>,
    ) {
        self.fine.draw(random);
        self.wide.draw(random);
        self.spread.draw(random);
        self.holes.draw(random);
        self.inverse_per_m.iter_mut().zip(&rays.z_m).for_each(|(inverse, z_m)| *inverse = 1.0 / z_m);
        self.bleed();
        let mut strip_px = random.between(4.0, 20.0) as f32;
        for (y, row) in out.counts.chunks_exact_mut(self.width).enumerate() {
            strip_px = (strip_px + 2.0 * random.gaussian()).clamp(2.0, 24.0);
            let mut shadow = Shadow { edge_px: f32::MAX };
            for x in (0..row.len()).rev() {
                let i = y * row.len() + x;
                let is_shadowed = shadow.covers(x as f32, self.focal_px, self.inverse_per_m[i]);
                let reading = self.reading_per_m(i, shaded).filter(|_| {
                    x as f32 >= strip_px
                        && !(is_shadowed && self.bled_per_m[i] <= 0.0)
                        && !self.is_hole(i, shaded)
                });
                row[x] = reading.map_or(0, |inverse| counts(1.0 / inverse, out.unit_m));
            }
        }
    }

    /// Spreads the nearer depth 1 to 4 px over every discontinuity and marks the zone around it.
    fn bleed(&mut self) {
        self.bled_per_m.fill(0.0);
        self.near_edge.fill(false);
        let (width, height) = (self.width, self.inverse_per_m.len() / self.width);
        for y in 1..height.saturating_sub(1) {
            for x in 1..width - 1 {
                let i = y * width + x;
                let middle = self.inverse_per_m[i];
                let fall =
                    |step: usize| 2.0 * middle - self.inverse_per_m[i - step] - self.inverse_per_m[i + step];
                // Positive: this pixel is on the near side.
                if fall(1).max(fall(width)) > EDGE_STEP_PER_M {
                    self.spread_from((x as isize, y as isize), middle);
                }
            }
        }
    }

    fn spread_from(&mut self, (x, y): (isize, isize), inverse_per_m: f32) {
        let (width, height) = (self.width as isize, (self.inverse_per_m.len() / self.width) as isize);
        let radius = (2.4 + 0.8 * self.spread.values[(y * width + x) as usize]).clamp(1.0, 4.0);
        let reach = EDGE_ZONE_PX.max(radius as isize);
        for py in (y - reach).max(0)..(y + reach + 1).min(height) {
            for px in (x - reach).max(0)..(x + reach + 1).min(width) {
                let i = (py * width + px) as usize;
                let square = ((px - x) * (px - x) + (py - y) * (py - y)) as f32;
                self.near_edge[i] |= square <= (EDGE_ZONE_PX * EDGE_ZONE_PX) as f32;
                let is_behind = self.inverse_per_m[i] < inverse_per_m - 0.5 * EDGE_STEP_PER_M;
                if square <= radius * radius && is_behind {
                    self.bled_per_m[i] = self.bled_per_m[i].max(inverse_per_m);
                }
            }
        }
    }

    /// Inverse depth as measured; `None` when the noise takes it to infinity.
    fn reading_per_m(&self, i: usize, shaded: &Shaded) -> Option<f32> {
        let inverse = self.inverse_per_m[i].max(self.bled_per_m[i]);
        let bare = if shaded.stereo[i] == Stereo::Bare && inverse < 1.0 / 2.5 { 1.25 } else { 1.0 };
        // Rises to 1.6 as the cosine falls from 0.35 to 0.
        let grazing = 1.0 + 0.6 * (1.0 - shaded.cosine[i] / 0.35).max(0.0);
        let noise = 0.92 * self.fine.values[i] + 0.39 * self.wide.values[i];
        let disparity_px = inverse * DISPARITY_AT_1M_PX + self.sigma_px * bare * grazing * noise;
        // Rounds positive numbers; negative ones become 0.
        let steps = (disparity_px / DISPARITY_STEP_PX + 0.5) as u32;
        (steps > 0).then_some(steps as f32 * (DISPARITY_STEP_PX / DISPARITY_AT_1M_PX))
    }

    /// Whether the matcher gives up on this pixel.
    fn is_hole(&self, i: usize, shaded: &Shaded) -> bool {
        let z_m = 1.0 / self.inverse_per_m[i].max(self.bled_per_m[i]);
        let (blob, slow) = (self.holes.values[i], self.spread.values[i]);
        if z_m < RANGE_M[0] || z_m > RANGE_M[1] + FAR_SCATTER_M * slow {
            return true;
        }
        let at_edge = self.near_edge[i] && blob > quantile::ONE_IN_SIX;
        let stray = slow > quantile::THREE_IN_THOUSAND;
        let dim = z_m > 0.6 && shaded.echo[i] * (1.0 + 0.3 * blob).max(0.1) < 0.006 * z_m * z_m.sqrt().sqrt();
        let least_cosine = match shaded.stereo[i] {
            Stereo::Textured => 0.055,
            Stereo::Bare => 0.12 + 0.05 * blob,
            // What stands before it may still bleed over it.
            Stereo::Blind if self.bled_per_m[i] <= 0.0 => return true,
            Stereo::Blind => 0.0,
        };
        at_edge || stray || dim || shaded.cosine[i] < least_cosine
    }
}

/// Where the counts go.
#[derive(Debug)]
pub(super) struct DepthOut<'a> {
    pub(super) counts: &'a mut [u16],
    pub(super) unit_m: f64,
}

/// Depth in counts; 0 where it does not fit.
pub(super) fn counts(z_m: f32, unit_m: f64) -> u16 {
    // Rounds; a cast saturates and turns NaN into 0.
    let counts = (f64::from(z_m) / unit_m + 0.5) as u32;
    u16::try_from(counts).unwrap_or(0)
}

/// What hides a row from the second imager, scanned from right to left: the leftmost place that nearer surfaces cover.
struct Shadow {
    edge_px: f32,
}

impl Shadow {
    fn covers(&mut self, x: f32, focal_px: f32, inverse_per_m: f32) -> bool {
        let seen_at_px = x - focal_px * SHADOW_BASELINE_M * inverse_per_m;
        let is_hidden = seen_at_px > self.edge_px + 1.0;
        self.edge_px = self.edge_px.min(seen_at_px);
        is_hidden
    }
}
