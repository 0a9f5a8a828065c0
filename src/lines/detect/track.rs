//! A straight edge followed column by column (or row by row): sub-pixel samples on it and its robust line fit.
use super::gradient::{BORDER_PX, COUNTS_PER_LEVEL, Gradient};
use super::trace::top_of_parabola;
use crate::geometry::PixelPoint;

/// Least cosine between the gradient at a sample and the edge's normal (22 degrees).
const MIN_COSINE: f32 = 0.927;
/// Least gradient of a sample along the normal, counts: little below the least gradient of a chain.
const MIN_PEAK: f32 = 0.8 * COUNTS_PER_LEVEL as f32;
/// Largest distance of a sample from the predicted line, px.
const REACH_PX: f64 = 1.0;
/// Scale of the robust weights, px: localisation of a single sample is mostly better than this.
const ROBUST_SCALE_PX: f64 = 0.3;

/// The line `v = offset + slope u` where u runs along the image axis that is closer to the edge's direction.
#[derive(Debug, Clone, Copy)]
pub struct Track {
    /// Whether u is x (and v is y).
    pub along_x: bool,
    /// v at u = 0, px.
    pub offset: f64,
    /// dv/du, between -1 and 1 or little more.
    pub slope: f64,
    /// +1 or -1: sign of u along the edge with the brighter side on the right hand.
    pub sense: f64,
}

/// One sub-pixel sample of an edge.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// Along, px.
    pub u: f64,
    /// Across, px.
    pub v: f64,
    /// Inverse variance before robust weighting, 1/px².
    pub weight: f64,
    /// How much the gradient falls within a pixel on both sides, as a share of the peak; 0.44 on a sharp edge.
    pub sharpness: f64,
}

impl Track {
    /// The track from one point to another, with the brighter side on the right hand.
    pub fn through(start: PixelPoint, end: PixelPoint) -> Self {
        let (dx, dy) = (end.x - start.x, end.y - start.y);
        let along_x = dx.abs() >= dy.abs();
        let (du, dv, u, v) = if along_x { (dx, dy, start.x, start.y) } else { (dy, dx, start.y, start.x) };
        let slope = if du == 0.0 { 0.0 } else { dv / du };
        Self { along_x, offset: v - slope * u, slope, sense: if du < 0.0 { -1.0 } else { 1.0 } }
    }

    /// v at u.
    pub fn at(&self, u: f64) -> f64 {
        self.offset + self.slope * u
    }

    /// Pixel position at u.
    pub fn pixel(&self, u: f64) -> PixelPoint {
        if self.along_x { PixelPoint { x: u, y: self.at(u) } } else { PixelPoint { x: self.at(u), y: u } }
    }

    /// Unit direction (x, y) along the edge.
    pub fn direction(&self) -> [f64; 2] {
        let scale = self.sense / self.stretch();
        if self.along_x { [scale, self.slope * scale] } else { [self.slope * scale, scale] }
    }

    /// Length along the edge of one pixel of u.
    pub fn stretch(&self) -> f64 {
        (1.0 + self.slope * self.slope).sqrt()
    }

    /// The robust least-squares line through samples, starting from this one and reweighted some times; `None` where
    /// they do not fix a line.
    pub fn fitted(&self, samples: &[Sample], rounds: usize) -> Option<Self> {
        let mut track = *self;
        for _ in 0..rounds {
            track = track.reweighted_fit(samples)?;
        }
        Some(track)
    }

    /// Weight of a sample in this line's fit: Geman-McClure on its distance.
    fn robust_weight(&self, sample: &Sample, inverse_scale2: f64) -> f64 {
        let distance_v = sample.v - self.at(sample.u);
        let penalty = 1.0 + distance_v * distance_v * inverse_scale2;
        sample.weight / (penalty * penalty)
    }

    fn reweighted_fit(&self, samples: &[Sample]) -> Option<Self> {
        let origin = samples.first()?.u;
        let [mut n, mut su, mut sv, mut suu, mut suv] = [0.0; 5];
        let inverse_scale2 = 1.0 / (ROBUST_SCALE_PX * self.stretch()).powi(2);
        for sample in samples {
            let weight = self.robust_weight(sample, inverse_scale2);
            let u = sample.u - origin;
            n += weight;
            su += weight * u;
            sv += weight * sample.v;
            suu += weight * u * u;
            suv += weight * u * sample.v;
        }
        let determinant = n * suu - su * su;
        // Below this all weight sits on one or two columns.
        if determinant.is_nan() || determinant <= 1e-6 * n * n {
            return None;
        }
        let slope = (n * suv - su * sv) / determinant;
        Some(Self { slope, offset: (sv - slope * su) / n - slope * origin, ..*self })
    }
}

/// A track laid over a gradient image, with all that is the same for every sample worked out once.
#[derive(Debug)]
pub struct Scan<'a> {
    gradient: &'a Gradient,
    track: Track,
    /// Smallest and largest u with a gradient.
    pub low: i64,
    /// See `low`.
    pub high: i64,
    /// Largest v that may be sampled, px.
    max_v: f64,
    /// Index steps along and across.
    steps: [usize; 2],
    /// Right-hand normal, towards the brighter side.
    normal: [f32; 2],
    /// Reach measured across the image axis, px.
    reach_v: f64,
}

/// Pixels next to the border of the gradient are not sampled: two more on each side are read.
const MARGIN: usize = BORDER_PX + 2;

impl<'a> Scan<'a> {
    /// Lays a track over a gradient.
    pub fn new(gradient: &'a Gradient, track: Track) -> Self {
        let (width, height) = (gradient.width, gradient.height);
        let (size_u, size_v, steps) =
            if track.along_x { (width, height, [1, width]) } else { (height, width, [width, 1]) };
        let [dx, dy] = track.direction();
        Self {
            gradient,
            track,
            low: BORDER_PX as i64,
            high: size_u as i64 - 1 - BORDER_PX as i64,
            max_v: size_v as f64 - 1.0 - MARGIN as f64,
            steps,
            normal: [-dy as f32, dx as f32],
            reach_v: REACH_PX * track.stretch(),
        }
    }

    /// Index of the pixel nearest to the line at u; `None` near the border.
    pub fn index(&self, u: i64) -> Option<usize> {
        let v = self.track.at(u as f64) + 0.5;
        let inside = u >= self.low && u <= self.high && v >= MARGIN as f64 && v <= self.max_v;
        // Truncation is rounding here: v is positive.
        inside.then(|| u as usize * self.steps[0] + v as usize * self.steps[1])
    }

    /// Index step to the next pixel across the track.
    pub fn across(&self) -> usize {
        self.steps[1]
    }

    /// Gradient along the normal.
    fn projected(&self, index: usize) -> f32 {
        let [x, y] = self.gradient.vector[index].map(f32::from);
        x * self.normal[0] + y * self.normal[1]
    }

    /// The edge at u: the ridge of the gradient along the normal within reach of the line, if it points the right way.
    pub fn sample(&self, u: i64) -> Option<Sample> {
        let middle = self.index(u)?;
        let across = self.steps[1];
        let [mut before, mut peak, mut after] =
            [middle - across, middle, middle + across].map(|index| self.projected(index));
        let mut top = middle;
        // Climb one pixel at most.
        if after > peak && after >= before {
            top = middle + across;
            [before, peak, after] = [peak, after, self.projected(top + across)];
        } else if before > peak {
            top = middle - across;
            [before, peak, after] = [self.projected(top - across), before, peak];
        }
        if peak < MIN_PEAK || before > peak || after > peak {
            return None;
        }
        let [x, y] = self.gradient.vector[top].map(f32::from);
        if peak * peak < MIN_COSINE * MIN_COSINE * (x * x + y * y) {
            return None;
        }
        let predicted = self.track.at(u as f64);
        let row = (predicted + 0.5) as usize + usize::from(top > middle) - usize::from(top < middle);
        let v = row as f64 + f64::from(top_of_parabola([before, peak, after]));
        if (v - predicted).abs() > self.reach_v {
            return None;
        }
        let sharpness = f64::from((2.0 * peak - before - after) / peak);
        Some(Sample { u: u as f64, v, weight: weight(f64::from(peak)), sharpness })
    }
}

/// Inverse variance of a sample: image noise over the gradient, and a floor of 0.1 px of texture and aliasing.
fn weight(peak: f64) -> f64 {
    let noise_px = 0.4 * COUNTS_PER_LEVEL / peak;
    1.0 / (0.01 + noise_px * noise_px)
}
