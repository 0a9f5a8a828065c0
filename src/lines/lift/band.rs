//! Depth readings in a band on both sides of a segment, and robust averages of them in cells.
use super::sweep::Sweep;
use crate::geometry::{Camera, RayPoint, Segment};
use crate::image::DepthView;

/// Readings closer to the edge than this are of neither side, px.
const INNER_PX: f64 = 0.75;
/// Width of a zone across the edge, px.
const ZONE_PX: f64 = 2.0;
/// Zones per side.
pub const ZONES: usize = 4;
/// Half-width of the band, px: well beyond the 1 to 4 px over which stereo depth bleeds.
const OUTER_PX: f64 = INNER_PX + ZONE_PX * ZONES as f64;
/// Most cells along the edge.
pub const MAX_BINS: usize = 12;
/// Segments longer than this are read every other column, than twice this every third, px.
const LONG_PX: f64 = 200.0;
/// Length of a cell, px, where the segment is short enough for it.
const BIN_PX: f64 = 10.0;
/// Readings a cell keeps for its median.
const CELL_READINGS: usize = 12;
/// More than one side of any segment gives: 200 columns of half 17 px, or as many of a longer segment's.
pub const MAX_READINGS: usize = 2048;
/// A cell with fewer readings has no value.
const MIN_CELL_READINGS: usize = 3;

/// One depth reading near a segment.
#[derive(Debug, Clone, Copy)]
pub struct Reading {
    /// Position along the segment, 0 to 1, linear on the undistorted ray.
    pub along: f64,
    /// Position across, px; positive on the right hand.
    pub across_px: f64,
    /// Inverse depth, 1/m.
    pub inverse_depth_per_m: f64,
    /// Cell: zone (0 beside the edge) times [`MAX_BINS`] plus bin along the edge.
    pub cell: u16,
}

impl Reading {
    /// Zone across the edge, 0 beside it.
    pub fn zone(&self) -> usize {
        usize::from(self.cell) / MAX_BINS
    }

    /// Bin along the edge.
    pub fn bin(&self) -> usize {
        usize::from(self.cell) % MAX_BINS
    }
}

/// Fixed-size collection of a cell's readings.
#[derive(Debug, Clone, Copy, Default)]
struct CellBuilder {
    inverse_depths: [f64; CELL_READINGS],
    n: usize,
    along: f64,
    across_px: f64,
}

/// Everything read on one side of a segment; reused from segment to segment.
#[derive(Debug, Default)]
pub struct Band {
    /// All readings.
    pub readings: Vec<Reading>,
    /// Robust averages: mean position and median inverse depth of each cell with enough readings.
    pub cells: Vec<Reading>,
    /// Number of bins along the segment.
    pub n_bins: usize,
    builders: Vec<CellBuilder>,
}

/// The segment's frame in the image: from pixels to (along, across).
struct Frame {
    start: [f64; 2],
    direction: [f64; 2],
    length_px: f64,
    /// Direction over length: share of the way per px.
    share_per_px: [f64; 2],
    /// Bend of `along` by lens distortion: `along = s + bend s (1 - s)` with `s` linear in the image.
    bend: f64,
}

impl Frame {
    fn new(segment: &Segment, camera: &Camera) -> Self {
        let (start, end) = (segment.start, segment.end);
        let length_px = segment.length_px();
        let direction = [(end.x - start.x) / length_px, (end.y - start.y) / length_px];
        let middle = crate::geometry::PixelPoint { x: 0.5 * (start.x + end.x), y: 0.5 * (start.y + end.y) };
        let [from, half, to] = [start, middle, end].map(|pixel| camera.ray_from_pixel(pixel));
        let bend = 4.0 * (share_along(from, to, half) - 0.5);
        let share_per_px = direction.map(|component| component / length_px);
        Self { start: [start.x, start.y], direction, length_px, share_per_px, bend }
    }

    /// Share of the way along and px across (right hand positive) of a pixel.
    fn locate(&self, x: f64, y: f64) -> (f64, f64) {
        let (dx, dy) = (x - self.start[0], y - self.start[1]);
        let s = dx * self.share_per_px[0] + dy * self.share_per_px[1];
        (s, dy * self.direction[0] - dx * self.direction[1])
    }

    /// Adds a reading at a pixel to the band it lies in, if any.
    fn sort_in(&self, bands: &mut [Band; 2], (x, y): (f64, f64), inverse_depth_per_m: f64) {
        let (s, across_px) = self.locate(x, y);
        if (0.0..=1.0).contains(&s) && (INNER_PX..OUTER_PX).contains(&across_px.abs()) {
            let along = s + self.bend * s * (1.0 - s);
            bands[usize::from(across_px > 0.0)].add((along, across_px), inverse_depth_per_m);
        }
    }
}

/// Where the foot of `point` lies between two rays, as a share.
fn share_along(from: RayPoint, to: RayPoint, point: RayPoint) -> f64 {
    let (dx, dy) = (to.x - from.x, to.y - from.y);
    ((point.x - from.x) * dx + (point.y - from.y) * dy) / (dx * dx + dy * dy)
}

/// Pixels that each reading stands for.
pub fn pixels_per_reading(length_px: f64) -> f64 {
    2.0 * column_step(length_px) as f64
}

/// Every how many columns a segment of this length is read: neighbours are correlated, so that long segments lose little.
fn column_step(length_px: f64) -> usize {
    1 + (length_px / LONG_PX) as usize
}

/// Replaces the bands on the left and on the right of `segment`, whose length is positive.
pub fn read(
    (bands, sweep): (&mut [Band; 2], &mut Sweep),
    segment: &Segment,
    depth: &DepthView<'_>,
    camera: &Camera,
) {
    let frame = Frame::new(segment, camera);
    let n_bins = ((frame.length_px / BIN_PX) as usize).clamp(4, MAX_BINS);
    bands.iter_mut().for_each(|band| band.reset(n_bins));
    match depth.imager() {
        None => read_registered(bands, &frame, depth),
        Some(imager) => {
            let area = (segment, OUTER_PX + 1.0, column_step(frame.length_px));
            for carried in sweep.read(area, depth, (camera, imager)) {
                let pixel = carried.pixel;
                frame.sort_in(bands, (pixel.x, pixel.y), carried.inverse_depth_per_m);
            }
        }
    }
    bands.iter_mut().for_each(Band::find_medians);
}

/// Reads the pixels beside the segment.
fn read_registered(bands: &mut [Band; 2], frame: &Frame, depth: &DepthView<'_>) {
    let along_x = frame.direction[0].abs() >= frame.direction[1].abs();
    let [major, minor] = if along_x { [0, 1] } else { [1, 0] };
    let slope = frame.direction[minor] / frame.direction[major];
    let first = frame.start[major];
    let last = first + frame.direction[major] * frame.length_px;
    let reach = (OUTER_PX / frame.direction[major].abs()).ceil() as i64;
    let columns = first.min(last).ceil() as i64..=first.max(last).floor() as i64;
    for u in columns.step_by(column_step(frame.length_px)) {
        let middle = (frame.start[minor] + slope * (u as f64 - first) + 0.5).floor() as i64;
        // A chess board of pixels: direct neighbours say nearly the same.
        let first_v = middle - reach + (u + middle - reach).rem_euclid(2);
        for v in (first_v..=middle + reach).step_by(2) {
            let (x, y) = if along_x { (u, v) } else { (v, u) };
            if let Some(depth_m) = depth.depth_m(x, y) {
                frame.sort_in(bands, (x as f64, y as f64), 1.0 / depth_m);
            }
        }
    }
}

impl Band {
    fn reset(&mut self, n_bins: usize) {
        self.n_bins = n_bins;
        self.readings.clear();
        self.readings.reserve(MAX_READINGS);
        self.cells.clear();
        self.cells.reserve(ZONES * MAX_BINS);
        self.builders.clear();
        self.builders.resize(ZONES * MAX_BINS, CellBuilder::default());
    }

    fn add(&mut self, (along, across_px): (f64, f64), inverse_depth_per_m: f64) {
        let bin = ((along * self.n_bins as f64) as usize).min(self.n_bins - 1);
        let zone = (((across_px.abs() - INNER_PX) / ZONE_PX) as usize).min(ZONES - 1);
        let cell = zone * MAX_BINS + bin;
        self.readings.push(Reading { along, across_px, inverse_depth_per_m, cell: cell as u16 });
        let builder = &mut self.builders[cell];
        if builder.n < CELL_READINGS {
            builder.inverse_depths[builder.n] = inverse_depth_per_m;
            builder.n += 1;
            builder.along += along;
            builder.across_px += across_px;
        }
    }

    fn find_medians(&mut self) {
        for (cell, builder) in self.builders.iter_mut().enumerate() {
            if builder.n < MIN_CELL_READINGS {
                continue;
            }
            let n = builder.n as f64;
            let values = &mut builder.inverse_depths[..builder.n];
            let (_, &mut inverse_depth_per_m, _) =
                values.select_nth_unstable_by(builder.n / 2, f64::total_cmp);
            let (along, across_px) = (builder.along / n, builder.across_px / n);
            self.cells.push(Reading { along, across_px, inverse_depth_per_m, cell: cell as u16 });
        }
    }
}
