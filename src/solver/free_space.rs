//! Free space: what one camera saw through, another cannot have seen as solid.
//!
//! A pose that carries surfaces of one camera in front of what the other measured in the same direction is impossible, whatever
//! lines agree with it. Poses without common view say nothing here.

use crate::geometry::motion::Motion;
use crate::geometry::{Camera, PixelPoint, SurfaceSample};

use super::candidates::PairEvidence;

/// A surface counts as in front when its inverse depth exceeds what was seen there by more than this, 1/m: ten times the
/// noise of one reading.
const CLEARLY_IN_FRONT_PER_M: f64 = 0.05;
/// ... and by this share, for sensors whose depth is off by a scale.
const CLEARLY_IN_FRONT_RATIO: f64 = 0.12;
/// Edge of the cells in which the nearest surface is looked up, px: about the spacing of the samples.
const CELL_PX: f64 = 16.0;

/// Fewer samples than this are no proof.
const MIN_COMPARED: usize = 40;

/// Counts over all frame sets, both ways.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FreeSpace {
    /// Surface samples that fall beside a sample of the other camera.
    pub compared: usize,
    /// Of these, in front of what the other camera saw.
    pub violated: usize,
}

impl FreeSpace {
    /// Share of the compared samples that contradict the pose.
    pub fn violated_share(&self) -> f64 {
        if self.compared == 0 { 0.0 } else { self.violated as f64 / self.compared as f64 }
    }

    /// Whether enough samples were compared and more than the given share of them contradicts.
    pub fn is_violated(&self, max_share: f64) -> bool {
        self.compared >= MIN_COMPARED && self.violated_share() > max_share
    }
}

/// Looks for contradictions between the surfaces of both cameras under a pose.
pub fn free_space(pair: &PairEvidence<'_>, cameras: &[Camera], target_from_source: &Motion) -> FreeSpace {
    let mut total = FreeSpace::default();
    let (Some(target_camera), Some(source_camera)) = (cameras.get(pair.target), cameras.get(pair.source))
    else {
        return total;
    };
    let source_from_target = target_from_source.inverse();
    for set in &pair.evidence.sets {
        let view = |camera: usize| set.views.get(camera).and_then(Option::as_ref);
        let (Some(target), Some(source)) = (view(pair.target), view(pair.source)) else { continue };
        let there =
            look(&source.surface, (target_from_source, source_camera), (&target.surface, target_camera));
        let back =
            look(&target.surface, (&source_from_target, target_camera), (&source.surface, source_camera));
        total.compared += there.compared + back.compared;
        total.violated += there.violated + back.violated;
    }
    total
}

/// The nearest surface per cell of an image, inverse depth in 1/m; 0 where there is no sample.
pub struct NearestSurface {
    columns: usize,
    rows: usize,
    inverse_depths_per_m: Vec<f64>,
}

impl NearestSurface {
    /// Puts samples into cells.
    pub fn new(camera: &Camera, samples: &[SurfaceSample]) -> Self {
        let columns = (f64::from(camera.width_px()) / CELL_PX).ceil() as usize + 1;
        let rows = (f64::from(camera.height_px()) / CELL_PX).ceil() as usize + 1;
        let mut nearest = Self { columns, rows, inverse_depths_per_m: vec![0.0; columns * rows] };
        for sample in samples {
            let (column, row) = nearest.cell(sample.pixel);
            let cell = &mut nearest.inverse_depths_per_m[row * columns + column];
            *cell = cell.max(sample.inverse_depth_per_m);
        }
        nearest
    }

    fn cell(&self, pixel: PixelPoint) -> (usize, usize) {
        let place = |position_px: f64, n: usize| ((position_px / CELL_PX).max(0.0) as usize).min(n - 1);
        (place(pixel.x, self.columns), place(pixel.y, self.rows))
    }

    /// The nearest surface in and around a pixel's cell: a step of depth beside the pixel is no contradiction.
    pub fn around(&self, pixel: PixelPoint) -> Option<f64> {
        let (column, row) = self.cell(pixel);
        let mut nearest_per_m = 0.0_f64;
        for y in row.saturating_sub(1)..=(row + 1).min(self.rows - 1) {
            for x in column.saturating_sub(1)..=(column + 1).min(self.columns - 1) {
                nearest_per_m = nearest_per_m.max(self.inverse_depths_per_m[y * self.columns + x]);
            }
        }
        (nearest_per_m > 0.0).then_some(nearest_per_m)
    }
}

/// Carries samples of one camera into another and compares.
fn look(
    from: &[SurfaceSample],
    (to_from_from, from_camera): (&Motion, &Camera),
    (to, to_camera): (&[SurfaceSample], &Camera),
) -> FreeSpace {
    let mut counts = FreeSpace::default();
    let seen = NearestSurface::new(to_camera, to);
    for sample in from {
        let point_in_to = to_from_from
            * from_camera.ray_from_pixel(sample.pixel).at_inverse_depth(sample.inverse_depth_per_m);
        let Some(pixel) = to_camera.project(&point_in_to) else { continue };
        if !to_camera.contains(pixel, 0.0) {
            continue;
        }
        let Some(seen_per_m) = seen.around(pixel) else { continue };
        counts.compared += 1;
        let limit_per_m = seen_per_m * (1.0 + CLEARLY_IN_FRONT_RATIO) + CLEARLY_IN_FRONT_PER_M;
        counts.violated += usize::from(1.0 / point_in_to.z > limit_per_m);
    }
    counts
}
