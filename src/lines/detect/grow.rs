//! Whole edges from fragments: fit, extend both ways over small gaps, refit, until nothing is gained.
//!
//! The longest fragments go first and own their pixels, so that an edge is found once.
use super::fragment::Fragment;
use super::gradient::Gradient;
use super::samples::{LANES, Samples, Scan};
use super::track::Track;
use crate::geometry::{PixelPoint, Segment};

/// Rounds of extending and refitting.
const MAX_ROUNDS: usize = 5;
/// Growth below this share does not pay for another round.
const MIN_GAIN: f64 = 0.02;
/// A gap is bridged up to this share of the length so far ...
const GAP_SHARE: f64 = 0.25;
/// ... within these limits, px.
const GAP_LIMITS_PX: [f64; 2] = [5.0, 45.0];
/// An extent grows to a column when, of this many columns up to it ...
const RECENT: i64 = 8;
/// ... at least so many show the edge.
const MIN_RECENT: u32 = 6;
/// Least share of columns with a sample.
const MIN_SUPPORT: f64 = 0.6;
/// The same of a segment that is as short and sharp as noise makes them.
const MIN_SUPPORT_NOISY: f64 = 0.9;
/// Least mean sharpness: a soft shadow or a shaded curve falls off over many pixels and is no line of the scene (0.44 is
/// sharp, 0.15 blurred by another 2 px).
const MIN_SHARPNESS: f64 = 0.15;
/// Mean sharpness above which a segment may be a ridge of noise: these have 0.8 to 1.3, and the flanks of thin lines up to 0.9.
const NOISE_SHARPNESS: f64 = 0.85;
/// Ridges of noise are shorter than this, px.
const NOISE_LENGTH_PX: f64 = 32.0;
/// Least cosine between two segments that may be one edge (10 degrees).
const MIN_COSINE_SAME: f64 = 0.985;
/// Largest share of a segment's columns that another segment of its direction may own.
const MAX_OWNED: f64 = 0.4;
/// Systematic part of the uncertainty across, px: aliasing, lens blur, compression.
const SIGMA_FLOOR_PX: f64 = 0.13;
/// Samples closer than this are correlated by the filters, px.
const CORRELATION_PX: f64 = 3.0;
/// Block for the slow part of the residuals, samples.
const BLOCK: usize = 8;

/// Grows fragments; owns the map of pixels already given to a segment.
#[derive(Debug, Default)]
pub struct Grower {
    /// Index + 1 into `directions` of the segment that owns a pixel; 0 is free.
    owner: Vec<u16>,
    directions: Vec<[f64; 2]>,
    samples: Samples,
}

/// An extent along a track, inclusive, px.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Extent {
    low: i64,
    high: i64,
}

impl Extent {
    fn columns(self) -> f64 {
        (self.high - self.low + 1) as f64
    }
}

impl Grower {
    /// Forgets all segments and prepares for an image of this size.
    pub fn reset(&mut self, gradient: &Gradient, max_segments: usize) {
        self.owner.clear();
        self.owner.resize(gradient.magnitude.len(), 0);
        self.directions.clear();
        self.directions.reserve(max_segments);
        self.samples.reset(gradient.width.max(gradient.height));
    }

    /// The whole edge around a fragment; `None` when it is not straight, too short, or found already.
    pub fn grow(&mut self, gradient: &Gradient, fragment: &Fragment, min_length_px: f64) -> Option<Segment> {
        let pixel = |p: super::trace::EdgePoint| PixelPoint { x: f64::from(p.x), y: f64::from(p.y) };
        let (start, end) = (pixel(fragment.start), pixel(fragment.end));
        let mut track = Track::through(start, end);
        let [u0, u1] = if track.along_x { [start.x, end.x] } else { [start.y, end.y] };
        let mut extent = Extent { low: u0.min(u1).round() as i64, high: u0.max(u1).round() as i64 };
        if self.is_taken(&Scan::new(gradient, &track), &track, extent) {
            return None;
        }
        self.collect(&Scan::new(gradient, &track), extent);
        for _ in 0..MAX_ROUNDS {
            track = track.fitted(&self.samples, 2)?;
            let grown = self.extend(&Scan::new(gradient, &track), track.direction(), extent);
            let gained = grown.columns() - extent.columns();
            extent = grown;
            if gained < MIN_GAIN * extent.columns() {
                break;
            }
        }
        if extent.columns() * track.stretch() < min_length_px {
            return None;
        }
        self.collect(&Scan::new(gradient, &track), extent);
        track = track.fitted(&self.samples, 4)?;
        let extent = Extent { low: *self.samples.u.first()? as i64, high: *self.samples.u.last()? as i64 };
        let scan = Scan::new(gradient, &track);
        let supported = self.is_supported(extent.columns(), track.stretch());
        let long_enough = (extent.columns() - 1.0) * track.stretch() >= min_length_px;
        if !supported || !long_enough || self.is_taken(&scan, &track, extent) {
            return None;
        }
        self.own(&scan, &track, extent);
        Some(self.segment(&track, extent))
    }

    /// Whether the samples show an edge all along so many columns, and one that is no shading and no noise.
    fn is_supported(&self, columns: f64, stretch: f64) -> bool {
        // Across a slanted edge a step along the image axis is shorter than a pixel.
        let sharpness = self.samples.mean_sharpness() * stretch.powi(2);
        let support = self.samples.len() as f64 / columns;
        let is_short = columns * stretch < NOISE_LENGTH_PX;
        let is_noise = is_short && sharpness > NOISE_SHARPNESS && support < MIN_SUPPORT_NOISY;
        sharpness >= MIN_SHARPNESS && support >= MIN_SUPPORT && !is_noise
    }

    fn collect(&mut self, scan: &Scan<'_>, extent: Extent) {
        self.samples.truncate(0);
        for first in (extent.low..=extent.high).step_by(LANES) {
            let found = scan.sample(first);
            for lane in 0..LANES.min((extent.high - first) as usize + 1) {
                if found.is_found(lane) {
                    self.samples.push(&found, lane);
                }
            }
        }
    }

    /// Whether a like-directed segment owns much of this extent; every third column tells.
    fn is_taken(&self, scan: &Scan<'_>, track: &Track, extent: Extent) -> bool {
        let direction = track.direction();
        let columns = (extent.low..=extent.high).step_by(3);
        let n_owned = columns.filter(|&u| self.is_owned(scan, direction, u)).count();
        3.0 * n_owned as f64 > MAX_OWNED * extent.columns()
    }

    fn is_owned(&self, scan: &Scan<'_>, direction: [f64; 2], u: i64) -> bool {
        scan.index(u).is_some_and(|index| self.owns(index, direction))
    }

    /// Whether a segment of this direction owns a pixel.
    fn owns(&self, index: usize, [ax, ay]: [f64; 2]) -> bool {
        let Some(owner) = usize::from(self.owner[index]).checked_sub(1) else { return false };
        let [bx, by] = self.directions[owner];
        ax * bx + ay * by >= MIN_COSINE_SAME
    }

    /// Walks on from both ends of the extent; adds what it sees to the samples.
    fn extend(&mut self, scan: &Scan<'_>, direction: [f64; 2], extent: Extent) -> Extent {
        let max_gap = (GAP_SHARE * extent.columns()).clamp(GAP_LIMITS_PX[0], GAP_LIMITS_PX[1]) as i64;
        let reach = max_gap + RECENT;
        Extent {
            low: self.walk((scan, direction), (extent.low, -1), reach).unwrap_or(extent.low),
            high: self.walk((scan, direction), (extent.high, 1), reach).unwrap_or(extent.high),
        }
    }

    /// Goes on from an end while most of the last few columns show the edge, or a gap is within reach; the last column of the edge.
    fn walk(
        &mut self,
        (scan, direction): (&Scan<'_>, [f64; 2]),
        (end, step): (i64, i64),
        reach: i64,
    ) -> Option<i64> {
        let (mut accepted, mut n_samples) = (None, self.samples.len());
        let mut recent = u8::MAX;
        let mut n_since = 0;
        let mut next = end + step;
        'walk: while (scan.low..=scan.high).contains(&next) {
            let (first, last_lane) =
                if step > 0 { (next, 0) } else { (next - (LANES as i64 - 1), LANES - 1) };
            let found = scan.sample(first);
            for lane in (0..LANES).map(|lane| lane.abs_diff(last_lane)) {
                let is_seen = found.is_found(lane) && !self.owns(found.middle[lane], direction);
                if is_seen {
                    self.samples.push(&found, lane);
                }
                recent = (recent << 1) | u8::from(is_seen);
                n_since += 1;
                if is_seen && recent.count_ones() >= MIN_RECENT {
                    (accepted, n_samples, n_since) = (Some(first + lane as i64), self.samples.len(), 0);
                }
                if n_since > reach {
                    break 'walk;
                }
            }
            next += step * LANES as i64;
        }
        // What was seen beyond the last accepted column is of something else.
        self.samples.truncate(n_samples);
        accepted
    }

    /// Marks the pixels of a segment, three wide.
    fn own(&mut self, scan: &Scan<'_>, track: &Track, extent: Extent) {
        self.directions.push(track.direction());
        let id = u16::try_from(self.directions.len()).unwrap_or(u16::MAX);
        for index in (extent.low..=extent.high).filter_map(|u| scan.index(u)) {
            for index in [index - scan.across(), index, index + scan.across()] {
                self.owner[index] = id;
            }
        }
    }

    fn segment(&self, track: &Track, extent: Extent) -> Segment {
        let [low, high] = [extent.low, extent.high].map(|u| track.pixel(u as f64));
        let (start, end) = if track.sense > 0.0 { (low, high) } else { (high, low) };
        Segment { start, end, sigma_across_px: self.sigma_across_px(track) }
    }

    /// Standard deviation of each end across the line, from the residuals: the larger of what single samples and what
    /// blocks of them say (slow waves: a slight bend, a misplaced bridge), over a floor.
    fn sigma_across_px(&self, track: &Track) -> f64 {
        let samples = &self.samples;
        let distances = || {
            let across = |(&u, &v): (&f32, &f32)| (f64::from(v) - track.at(f64::from(u))) / track.stretch();
            samples.u.iter().zip(&samples.v).map(across)
        };
        let n = samples.len() as f64;
        let variance = distances().map(|distance| distance * distance).sum::<f64>() / (n - 2.0).max(1.0);
        // The end of a regression line over evenly spread samples has four times the variance of their mean.
        let from_samples = 4.0 * variance * CORRELATION_PX / n;
        let n_blocks = (samples.len() / BLOCK) as f64;
        let mut distances = distances();
        let block_sum: f64 = (0..samples.len() / BLOCK)
            .map(|_| (distances.by_ref().take(BLOCK).sum::<f64>() / BLOCK as f64).powi(2))
            .sum();
        let from_blocks = if n_blocks > 3.0 { 4.0 * block_sum / (n_blocks - 2.0) / n_blocks } else { 0.0 };
        (from_samples.max(from_blocks) + SIGMA_FLOOR_PX * SIGMA_FLOOR_PX).sqrt()
    }
}
