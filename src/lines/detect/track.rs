//! The straight line along an edge, and its robust fit to sub-pixel samples.
use super::samples::{LANES, Samples};
use crate::geometry::PixelPoint;

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
    pub fn fitted(&self, samples: &Samples, rounds: usize) -> Option<Self> {
        let mut track = *self;
        for _ in 0..rounds {
            track = track.reweighted_fit(samples)?;
        }
        Some(track)
    }

    /// Weighted least squares on what is left over from this line, in the middle of the samples: small numbers keep single
    /// precision exact enough.
    fn reweighted_fit(&self, samples: &Samples) -> Option<Self> {
        let (first, last) = (*samples.u.first()?, *samples.u.last()?);
        let (low, high) = (first.min(last), first.max(last));
        // Samples that were found while walking down come in the other order; the middle need not be exact.
        let middle = (0.5 * (low + high)).round();
        let half = (0.5 * (high - low)).max(1.0);
        let line = LineInLanes {
            middle,
            at_middle: self.at(f64::from(middle)) as f32,
            slope: self.slope as f32,
            inverse_half: 1.0 / half,
            inverse_scale2: (1.0 / (ROBUST_SCALE_PX * self.stretch()).powi(2)) as f32,
        };
        let [n, st, sr, stt, str] = line.moments(samples);
        let determinant = n * stt - st * st;
        // Below this all weight sits on one or two columns.
        if determinant.is_nan() || determinant * f64::from(half * half) <= 1e-2 * n * n {
            return None;
        }
        let steps = (n * str - st * sr) / determinant;
        let slope = self.slope + steps / f64::from(half);
        let at_middle = self.at(f64::from(middle)) + (sr - steps * st) / n;
        Some(Self { slope, offset: at_middle - slope * f64::from(middle), ..*self })
    }
}

/// What a fit needs of the line it starts from.
struct LineInLanes {
    middle: f32,
    at_middle: f32,
    slope: f32,
    inverse_half: f32,
    inverse_scale2: f32,
}

impl LineInLanes {
    /// Sums of `w, w t, w r, w t², w t r` over the samples: t from -1 to 1 along, r what is left across, w Geman-McClure on it.
    fn moments(&self, samples: &Samples) -> [f64; 5] {
        let mut sums = [[0.0_f32; LANES]; 5];
        for [u, v, weight] in samples.lanes() {
            for lane in 0..LANES {
                let ahead = u[lane] - self.middle;
                let left_over = (v[lane] - self.at_middle) - self.slope * ahead;
                let penalty = 1.0 + left_over * left_over * self.inverse_scale2;
                let w = weight[lane] / (penalty * penalty);
                let t = ahead * self.inverse_half;
                let (wt, wr) = (w * t, w * left_over);
                sums[0][lane] += w;
                sums[1][lane] += wt;
                sums[2][lane] += wr;
                sums[3][lane] += wt * t;
                sums[4][lane] += wt * left_over;
            }
        }
        sums.map(|lanes| lanes.iter().map(|&sum| f64::from(sum)).sum())
    }
}
