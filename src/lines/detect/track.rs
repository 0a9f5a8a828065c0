//! A straight edge followed column by column (or row by row): sub-pixel samples on it and its robust line fit.
use super::gradient::{BORDER_PX, COUNTS_PER_LEVEL, Gradient};
use super::trace::top_of_parabola;
use crate::geometry::PixelPoint;

/// Least cosine between the gradient at a sample and the edge's normal (22 degrees).
const MIN_COSINE: f32 = 0.927;
/// Least gradient of a sample along the normal, counts: one gray level per pixel.
const MIN_PEAK: f32 = 1.0 * COUNTS_PER_LEVEL as f32;
/// Largest distance of a sample from the predicted line, px.
const REACH_PX: f32 = 1.0;
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
        let scale = self.sense / self.slope.hypot(1.0);
        if self.along_x { [scale, self.slope * scale] } else { [self.slope * scale, scale] }
    }

    /// Length along the edge of one pixel of u.
    pub fn stretch(&self) -> f64 {
        self.slope.hypot(1.0)
    }

    /// Smallest and largest u with a gradient.
    pub fn range(&self, gradient: &Gradient) -> (i64, i64) {
        let size = if self.along_x { gradient.width } else { gradient.height };
        (BORDER_PX as i64, size as i64 - 1 - BORDER_PX as i64)
    }

    /// Index of the pixel nearest to the line at u and the index step across; `None` near the border.
    pub fn index(&self, gradient: &Gradient, u: i64) -> Option<(usize, usize)> {
        let (low, high) = self.range(gradient);
        let size_v = if self.along_x { gradient.height } else { gradient.width };
        let v = self.at(u as f64).round();
        // Two more pixels on each side are read.
        let margin = (BORDER_PX + 2) as f64;
        if u < low || u > high || !(v >= margin && v <= size_v as f64 - 1.0 - margin) {
            return None;
        }
        let (u, v) = (u as usize, v as usize);
        Some(if self.along_x {
            (v * gradient.width + u, gradient.width)
        } else {
            (u * gradient.width + v, 1)
        })
    }

    /// The edge at u: the ridge of the gradient along the normal within reach of the line, if it points the right way.
    pub fn sample(&self, gradient: &Gradient, u: i64) -> Option<Sample> {
        let (middle, across) = self.index(gradient, u)?;
        let [dx, dy] = self.direction();
        // Right-hand normal, towards the brighter side.
        let (nx, ny) = (-dy as f32, dx as f32);
        let first = middle - 2 * across;
        let profile: [f32; 5] = std::array::from_fn(|i| {
            let at = first + i * across;
            f32::from(gradient.x[at]) * nx + f32::from(gradient.y[at]) * ny
        });
        let mut top = 2;
        for i in [1, 3] {
            if profile[i] > profile[top] {
                top = i;
            }
        }
        let peak = profile[top];
        let [before, after] = [profile[top - 1], profile[top + 1]];
        if peak < MIN_PEAK || before > peak || after > peak {
            return None;
        }
        let at = first + top * across;
        let norm = f32::from(gradient.x[at]).hypot(f32::from(gradient.y[at]));
        let from_middle = top as f32 - 2.0 + top_of_parabola([before, peak, after]);
        let predicted = self.at(u as f64);
        let v = predicted.round() + f64::from(from_middle);
        let distance = (v - predicted).abs() as f32 / self.stretch() as f32;
        (peak >= MIN_COSINE * norm && distance <= REACH_PX).then(|| Sample {
            u: u as f64,
            v,
            weight: weight(f64::from(peak)),
        })
    }

    /// The robust least-squares line through samples, starting from this one; `None` where they do not fix a line.
    pub fn fitted(&self, samples: &[Sample]) -> Option<Self> {
        let mut track = *self;
        for _ in 0..4 {
            track = track.reweighted_fit(samples)?;
        }
        Some(track)
    }

    /// Weight of a sample in this line's fit: Geman-McClure on its distance.
    pub fn robust_weight(&self, sample: &Sample) -> f64 {
        let distance = (sample.v - self.at(sample.u)) / self.stretch();
        let ratio = distance / ROBUST_SCALE_PX;
        sample.weight / (1.0 + ratio * ratio).powi(2)
    }

    fn reweighted_fit(&self, samples: &[Sample]) -> Option<Self> {
        let origin = samples.first()?.u;
        let [mut n, mut su, mut sv, mut suu, mut suv] = [0.0; 5];
        for sample in samples {
            let weight = self.robust_weight(sample);
            let u = sample.u - origin;
            n += weight;
            su += weight * u;
            sv += weight * sample.v;
            suu += weight * u * u;
            suv += weight * u * sample.v;
        }
        let determinant = n * suu - su * su;
        // Below this all weight sits on one or two columns.
        if !(determinant > 1e-6 * n * n) {
            return None;
        }
        let slope = (n * suv - su * sv) / determinant;
        Some(Self { slope, offset: (sv - slope * su) / n - slope * origin, ..*self })
    }
}

/// Inverse variance of a sample: image noise over the gradient, and a floor of 0.1 px of texture and aliasing.
fn weight(peak: f64) -> f64 {
    let noise_px = 0.4 * COUNTS_PER_LEVEL / peak;
    1.0 / (0.01 + noise_px * noise_px)
}
