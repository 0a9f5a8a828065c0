//! Depth beside a segment from an imager with a geometry of its own.
//!
//! A colour pixel of unknown depth lies somewhere on a short curve in the depth image. The other way round nothing is unknown: the
//! depth pixels over which the segment sweeps from near to far are carried into the colour image, and those that fall beside the
//! segment are kept, unless something nearer hides them there.
use crate::geometry::{Camera, DepthCamera, PixelPoint, RayPoint, Segment};
use crate::image::DepthView;

/// Depth sensors see nothing nearer than this, 1/m.
const NEAREST_PER_M: f64 = 5.0;
/// Stands for infinity, 1/m.
const FARTHEST_PER_M: f64 = 0.01;
/// Points that outline the swept area: three along the segment, near and far.
const OUTLINE: usize = 6;
/// What rounding and a distorting lens add to the area's border, px.
const BORDER_PX: f64 = 3.0;
/// Farther than this share of what is nearest in a cell of the colour image, a reading is hidden there.
const SAME_SURFACE: f64 = 0.9;
/// Side of such a cell, in pixels of the depth image.
const CELL_DEPTH_PX: f64 = 1.5;
/// Room for the readings of a segment.
const READINGS_RESERVED: usize = 8192;

/// A depth reading in the colour image.
#[derive(Debug, Clone, Copy)]
pub struct Carried {
    /// Where, px.
    pub pixel: PixelPoint,
    /// Inverse depth in the colour camera's frame, 1/m.
    pub inverse_depth_per_m: f64,
    cell: usize,
}

/// Scratch memory of the look-up.
#[derive(Debug, Default)]
pub struct Sweep {
    carried: Vec<Carried>,
    /// Nearest reading of each cell of the colour image around the segment, 1/m.
    nearest_per_m: Vec<f64>,
}

/// Cells of the colour image around a segment.
struct Cells {
    left_px: f64,
    top_px: f64,
    side_px: f64,
    columns: usize,
    rows: usize,
}

impl Sweep {
    /// The readings within `reach_px` of the segment's box in the colour image that nothing hides there; every second pixel,
    /// and of those every `step`th.
    pub fn read(
        &mut self,
        (segment, reach_px, step): (&Segment, f64, usize),
        depth: &DepthView<'_>,
        (color, imager): (&Camera, &DepthCamera),
    ) -> impl Iterator<Item = &Carried> {
        let px_per_depth_px = color.mean_focal_px() / imager.camera.mean_focal_px();
        let cells = Cells::around(segment, reach_px, px_per_depth_px * CELL_DEPTH_PX);
        self.carried.clear();
        self.carried.reserve(READINGS_RESERVED);
        self.nearest_per_m.clear();
        self.nearest_per_m.resize(cells.columns * cells.rows, 0.0);
        let outline = outline(segment, color, imager);
        let margin_px = reach_px / px_per_depth_px + BORDER_PX;
        for y in rows(&outline, margin_px, depth.height()) {
            let Some((first, last)) = columns(&outline, y as f64, margin_px) else { continue };
            for x in first.max(0)..=last.min(depth.width() as i64 - 1) {
                let is_read = (x + y) % 2 == 0 && (x + y) / 2 % step as i64 == 0;
                let Some(depth_m) = depth.depth_m(x, y).filter(|_| is_read) else { continue };
                let pixel = PixelPoint { x: x as f64, y: y as f64 };
                let point = imager.point_in_color(pixel, depth_m);
                let Some(pixel) = color.project(&point) else { continue };
                let Some(cell) = cells.find(pixel) else { continue };
                let inverse_depth_per_m = 1.0 / point.z;
                let nearest_per_m = &mut self.nearest_per_m[cell];
                *nearest_per_m = nearest_per_m.max(inverse_depth_per_m);
                self.carried.push(Carried { pixel, inverse_depth_per_m, cell });
            }
        }
        let nearest_per_m = &self.nearest_per_m;
        self.carried
            .iter()
            .filter(|carried| carried.inverse_depth_per_m >= SAME_SURFACE * nearest_per_m[carried.cell])
    }
}

impl Cells {
    fn around(segment: &Segment, reach_px: f64, side_px: f64) -> Self {
        let (start, end) = (segment.start, segment.end);
        let (left_px, top_px) = (start.x.min(end.x) - reach_px, start.y.min(end.y) - reach_px);
        let count = |a: f64, b: f64| (((a - b).abs() + 2.0 * reach_px) / side_px) as usize + 1;
        Self { left_px, top_px, side_px, columns: count(start.x, end.x), rows: count(start.y, end.y) }
    }

    fn find(&self, pixel: PixelPoint) -> Option<usize> {
        let (x, y) = ((pixel.x - self.left_px) / self.side_px, (pixel.y - self.top_px) / self.side_px);
        let is_in = x >= 0.0 && y >= 0.0 && x < self.columns as f64 && y < self.rows as f64;
        is_in.then_some(y as usize * self.columns + x as usize)
    }
}

/// Where the segment may appear in the depth image; points behind the imager are left out.
fn outline(segment: &Segment, color: &Camera, imager: &DepthCamera) -> [Option<PixelPoint>; OUTLINE] {
    let (start, end) = (segment.start, segment.end);
    let middle = PixelPoint { x: 0.5 * (start.x + end.x), y: 0.5 * (start.y + end.y) };
    let depth_from_color = imager.color_from_depth.inverse();
    let seen = |pixel: PixelPoint, inverse_depth_per_m: f64| {
        let ray: RayPoint = color.ray_from_pixel(pixel);
        imager.camera.project(&(depth_from_color * ray.at_inverse_depth(inverse_depth_per_m)))
    };
    std::array::from_fn(|i| {
        let inverse_depth_per_m = if i < OUTLINE / 2 { NEAREST_PER_M } else { FARTHEST_PER_M };
        seen([start, middle, end][i % 3], inverse_depth_per_m)
    })
}

/// Rows of the depth image within `margin_px` of the outline.
fn rows(outline: &[Option<PixelPoint>], margin_px: f64, height: usize) -> std::ops::Range<i64> {
    let bounds = outline.iter().flatten().fold((f64::INFINITY, f64::NEG_INFINITY), |(top, bottom), point| {
        (point.y.min(top), point.y.max(bottom))
    });
    // Casts saturate: no point at all gives an empty range.
    let (top, bottom) = ((bounds.0 - margin_px).floor() as i64, (bounds.1 + margin_px).ceil() as i64);
    top.max(0)..bottom.saturating_add(1).min(height as i64)
}

/// First and last column of the outline's convex hull near a row, and the margin beside it.
fn columns(outline: &[Option<PixelPoint>], y: f64, margin_px: f64) -> Option<(i64, i64)> {
    let (top, bottom) = (y - margin_px, y + margin_px);
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    for (i, a) in outline.iter().enumerate() {
        for (a, b) in outline[i..].iter().filter_map(|b| a.as_ref().zip(b.as_ref())) {
            if a.y.max(b.y) < top || a.y.min(b.y) > bottom {
                continue;
            }
            let at = |y: f64| {
                let share = if a.y == b.y { 0.0 } else { ((y - a.y) / (b.y - a.y)).clamp(0.0, 1.0) };
                a.x + share * (b.x - a.x)
            };
            let (one, other) = if a.y == b.y { (a.x, b.x) } else { (at(top), at(bottom)) };
            (first, last) = (first.min(one.min(other)), last.max(one.max(other)));
        }
    }
    (first <= last).then(|| ((first - margin_px).floor() as i64, (last + margin_px).ceil() as i64))
}
