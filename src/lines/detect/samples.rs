//! Sub-pixel samples of an edge, column by column, eight columns at a time: the inner loop of the detector.
//!
//! Vectors of eight lanes on every machine (crate `wide`), without a branch. Every operation is one of IEEE 754, so one column at a
//! time gives the same bits: the scalar twin in the tests.
use wide::{f32x8, i32x8};

use super::gradient::{BORDER_PX, COUNTS_PER_LEVEL, Gradient};
use super::track::Track;

/// Columns that are sampled together.
pub const LANES: usize = 8;

/// Least cosine between the gradient at a sample and the edge's normal (22 degrees).
const MIN_COSINE: f32 = 0.927;
/// Least gradient of a sample along the normal, counts: little below the least gradient of a chain.
const MIN_PEAK: f32 = 0.8 * COUNTS_PER_LEVEL as f32;
/// Largest distance of a sample from the predicted line, px.
const REACH_PX: f32 = 1.0;
/// Part of a parabola's error at `offset` that goes with `offset (1/4 - offset²)`.
const PARABOLA_BIAS: f32 = 0.5;
/// Pixels next to the border of the gradient are not sampled: two more on each side are read.
const MARGIN: usize = BORDER_PX + 2;

/// The samples of one edge in the order they were found, one array per quantity.
#[derive(Debug, Default)]
pub struct Samples {
    /// Along, px; whole numbers.
    pub u: Vec<f32>,
    /// Across, px.
    pub v: Vec<f32>,
    /// Inverse variance before robust weighting, 1/px².
    weight: Vec<f32>,
    /// How much the gradient falls within a pixel on both sides, as a share of the peak; 0.44 on a sharp edge.
    sharpness: Vec<f32>,
}

impl Samples {
    /// Forgets all samples; room for `n`.
    pub fn reset(&mut self, n: usize) {
        self.truncate(0);
        for column in self.columns() {
            column.reserve(n);
        }
    }

    /// Forgets all samples but the first `n`.
    pub fn truncate(&mut self, n: usize) {
        for column in self.columns() {
            column.truncate(n);
        }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.u.len()
    }

    /// Mean of the sharpness; not a number without samples.
    pub fn mean_sharpness(&self) -> f64 {
        self.sharpness.iter().map(|&sharpness| f64::from(sharpness)).sum::<f64>() / self.len() as f64
    }

    /// Adds one lane.
    pub fn push(&mut self, found: &Sampled, lane: usize) {
        self.u.push(found.u[lane]);
        self.v.push(found.v[lane]);
        self.weight.push(found.weight[lane]);
        self.sharpness.push(found.sharpness[lane]);
    }

    /// `u`, `v` and weight in lanes; the last ones are filled up with samples of no weight.
    pub fn lanes(&self) -> impl Iterator<Item = [[f32; LANES]; 3]> + '_ {
        let columns = [&self.u, &self.v, &self.weight].map(|column| column.as_chunks::<LANES>());
        let n_whole = columns[0].0.len();
        let mut rest = [[0.0; LANES]; 3];
        for (rest, column) in rest.iter_mut().zip(columns) {
            rest[..column.1.len()].copy_from_slice(column.1);
        }
        let has_rest = !columns[0].1.is_empty();
        let whole = (0..n_whole).map(move |i| columns.map(|column| column.0[i]));
        whole.chain(has_rest.then_some(rest))
    }

    fn columns(&mut self) -> [&mut Vec<f32>; 4] {
        [&mut self.u, &mut self.v, &mut self.weight, &mut self.sharpness]
    }
}

/// What eight columns show.
#[derive(Debug, Clone, Copy)]
pub struct Sampled {
    /// Along, px.
    pub u: [f32; LANES],
    /// Across, px.
    pub v: [f32; LANES],
    weight: [f32; LANES],
    sharpness: [f32; LANES],
    /// One bit per column, from the lowest: whether it shows the edge.
    is_found: u8,
    /// Index of the pixel nearest to the predicted line.
    pub middle: [usize; LANES],
}

impl Sampled {
    /// Whether a column shows the edge.
    pub fn is_found(&self, lane: usize) -> bool {
        self.is_found >> lane & 1 == 1
    }

    /// All of a column that shows the edge, bit by bit.
    #[cfg(test)]
    pub fn bits(&self, lane: usize) -> Option<[u32; 4]> {
        let all = [&self.u, &self.v, &self.weight, &self.sharpness];
        self.is_found(lane).then(|| all.map(|column| column[lane].to_bits()))
    }
}

/// A track laid over a gradient image, with all that is the same for every sample worked out once.
#[derive(Debug)]
pub struct Scan<'a> {
    gradient: &'a Gradient,
    /// Smallest and largest u with a gradient.
    pub low: i64,
    /// See `low`.
    pub high: i64,
    offset: f32,
    slope: f32,
    /// Smallest and largest v that may be sampled, px.
    v_limits: [f32; 2],
    /// Index steps along and across.
    steps: [usize; 2],
    /// Right-hand normal, towards the brighter side.
    normal: [f32; 2],
    /// Reach measured across the image axis, px.
    reach_v: f32,
}

impl<'a> Scan<'a> {
    /// Lays a track over a gradient.
    pub fn new(gradient: &'a Gradient, track: &Track) -> Self {
        let (width, height) = (gradient.width, gradient.height);
        let (size_u, size_v, steps) =
            if track.along_x { (width, height, [1, width]) } else { (height, width, [width, 1]) };
        let [dx, dy] = track.direction();
        Self {
            gradient,
            low: BORDER_PX as i64,
            high: size_u as i64 - 1 - BORDER_PX as i64,
            offset: track.offset as f32,
            slope: track.slope as f32,
            v_limits: [MARGIN as f32, size_v as f32 - 1.0 - MARGIN as f32],
            steps,
            normal: [-dy as f32, dx as f32],
            reach_v: REACH_PX * track.stretch() as f32,
        }
    }

    /// Index of the pixel nearest to the line at u; `None` near the border.
    pub fn index(&self, u: i64) -> Option<usize> {
        let v = self.offset + self.slope * u as f32 + 0.5;
        let inside = u >= self.low && u <= self.high && v >= self.v_limits[0] && v <= self.v_limits[1];
        // Truncation is rounding here: v is positive.
        inside.then(|| u as usize * self.steps[0] + v as usize * self.steps[1])
    }

    /// Index step to the next pixel across the track.
    pub fn across(&self) -> usize {
        self.steps[1]
    }

    /// The edge at eight columns from u: the ridge of the gradient along the normal within reach of the line, where it points the
    /// right way.
    pub fn sample(&self, first_u: i64) -> Sampled {
        let u = f32x8::splat(first_u as f32) + f32x8::new([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let [low, high] = [self.low, self.high].map(|limit| f32x8::splat(limit as f32));
        let [low_v, high_v] = self.v_limits.map(f32x8::splat);
        let predicted = f32x8::splat(self.offset) + f32x8::splat(self.slope) * u;
        let rounded = predicted + f32x8::splat(0.5);
        let is_inside = u.simd_ge(low) & u.simd_le(high) & rounded.simd_ge(low_v) & rounded.simd_le(high_v);
        // Truncation is rounding here: v is positive. What is outside reads from the nearest place inside, for nothing.
        let row = rounded.fast_max(low_v).fast_min(high_v).fast_trunc_int();
        let columns = u.fast_max(low).fast_min(high).fast_trunc_int().to_array();
        let rows = row.to_array();
        let middle: [usize; LANES] = std::array::from_fn(|lane| {
            columns[lane] as usize * self.steps[0] + rows[lane] as usize * self.steps[1]
        });
        let ridge = self.ridge(&middle);
        let v = row.round_float() + ridge.offset;
        let is_near = (v - predicted).abs().simd_le(f32x8::splat(self.reach_v));
        let is_found = is_inside & ridge.is_there & is_near;
        Sampled {
            u: u.to_array(),
            v: v.to_array(),
            weight: ridge.weight.to_array(),
            sharpness: ridge.sharpness.to_array(),
            is_found: is_found.to_bitmask() as u8,
            middle,
        }
    }

    /// The ridge around eight pixels.
    #[inline(always)]
    fn ridge(&self, middle: &[usize; LANES]) -> Ridge {
        // Five pixels across, from two before the middle to two behind.
        let across = self.steps[1];
        let [mut x, mut y] = [[f32x8::ZERO; 5]; 2];
        for k in 0..5 {
            let mut pairs = [0; LANES];
            for lane in 0..LANES {
                let [x, y] = self.gradient.vector[middle[lane] - 2 * across + k * across];
                // One load; the halves are taken apart for all lanes at once.
                pairs[lane] = i32::from(y) << 16 | i32::from(x.cast_unsigned());
            }
            let pairs = i32x8::new(pairs);
            let (high, low): (i32x8, i32x8) = (pairs >> 16_i32, pairs << 16_i32);
            let low: i32x8 = low >> 16_i32;
            (x[k], y[k]) = (low.round_float(), high.round_float());
        }
        let [normal_x, normal_y] = self.normal.map(f32x8::splat);
        let p: [f32x8; 5] = std::array::from_fn(|k| x[k] * normal_x + y[k] * normal_y);
        // Climbs one pixel at most.
        let up = p[3].simd_gt(p[2]) & p[3].simd_ge(p[1]);
        let down = p[1].simd_gt(p[2]) & !up;
        let choose =
            |middle: f32x8, above: f32x8, below: f32x8| up.bitselect(above, down.bitselect(below, middle));
        let before = choose(p[1], p[2], p[0]);
        let peak = choose(p[2], p[3], p[1]);
        let after = choose(p[3], p[4], p[2]);
        let (gx, gy) = (choose(x[2], x[3], x[1]), choose(y[2], y[3], y[1]));
        let is_ridge = peak.simd_ge(f32x8::splat(MIN_PEAK)) & before.simd_le(peak) & after.simd_le(peak);
        let points_right = (peak * peak).simd_ge(f32x8::splat(MIN_COSINE * MIN_COSINE) * (gx * gx + gy * gy));
        let one = f32x8::splat(1.0);
        let curvature = before - (peak + peak) + after;
        let is_top = curvature.simd_lt(f32x8::ZERO);
        let offset = f32x8::splat(0.5) * (before - after) / is_top.bitselect(curvature, -one);
        let offset = unbiased(is_top.bitselect(offset, f32x8::ZERO));
        let safe_peak = peak.fast_max(one);
        Ridge {
            is_there: is_ridge & points_right,
            offset: choose(f32x8::ZERO, one, -one) + offset,
            sharpness: -curvature / safe_peak,
            weight: weight(safe_peak),
        }
    }
}

/// The ridge that eight columns show.
struct Ridge {
    is_there: f32x8,
    /// From the middle pixel, px.
    offset: f32x8,
    sharpness: f32x8,
    weight: f32x8,
}

/// Inverse variance of a sample: image noise over the gradient, and a floor of 0.1 px of texture and aliasing.
fn weight(peak: f32x8) -> f32x8 {
    const NOISE: f32 = 0.4 * COUNTS_PER_LEVEL as f32;
    let peak2 = peak * peak;
    peak2 / (f32x8::splat(0.01) * peak2 + f32x8::splat(NOISE * NOISE))
}

/// The top of a ridge from that of the parabola through its three highest samples, both from the middle one, px.
///
/// The ridge of a step seen through the filters is nearly a Gaussian of 1.4 px, on which a parabola pulls the top towards
/// the middle by up to 0.024 px; that is undone.
fn unbiased(offset: f32x8) -> f32x8 {
    let pulled = f32x8::splat(0.25) - offset * offset;
    offset + f32x8::splat(PARABOLA_BIAS) * offset * pulled.fast_max(f32x8::ZERO)
}

/// Where the ridge has its top, from the highest of three samples in a row, px: for the chains, where a hundredth of a pixel does not
/// count; 0 where there is none.
pub fn top_of_parabola([before, here, after]: [f32; 3]) -> f32 {
    let curvature = before - 2.0 * here + after;
    if curvature < 0.0 { (0.5 * (before - after) / curvature).clamp(-1.0, 1.0) } else { 0.0 }
}
