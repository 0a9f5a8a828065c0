//! How fast the image of a camera moves, from the change of a coarse gray image. Pure.
//!
//! Of the whole image, not of its segments: a fast turn blurs the very edges that lie across it, so that segments are gone when their
//! flow would be asked for.
//!
//! The normal flow of a thumbnail, `Σ |ΔI - mean ΔI| / Σ |∇I|`, is the part of the motion across the edges: exposure drops out, and
//! so does the contrast of the scene. With edges in all directions it is 2/π of the motion. Beyond one thumbnail pixel per frame it
//! falls behind, and it ends at about three: 55 px of an image of 640, which at 15 frames per second is still beyond the default limit.

use crate::capture::StampNs;
use crate::image::GrayView;

/// Thumbnail size, cells; a cell of a 640 x 480 image is 20 x 20 px, so sensor noise averages out.
const COLUMNS: usize = 32;
const ROWS: usize = 24;

/// Below this mean gradient (gray levels per cell) the scene is too plain to tell motion from noise.
const MIN_MEAN_GRADIENT: f64 = 1.0;

/// Frames further apart tell nothing about the speed at either one, ns.
const MAX_GAP_NS: i64 = 150_000_000;

/// A coarse gray image: mean gray level per cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thumbnail {
    cells: [f32; COLUMNS * ROWS],
    cell_px: f64,
}

impl Default for Thumbnail {
    fn default() -> Self {
        Self { cells: [0.0; COLUMNS * ROWS], cell_px: 0.0 }
    }
}

impl Thumbnail {
    /// The thumbnail of an image; every cell is 0 for images smaller than the thumbnail.
    pub fn of(image: &GrayView<'_>) -> Self {
        let (cell_width, cell_height) = (image.width() / COLUMNS, image.height() / ROWS);
        if cell_width == 0 || cell_height == 0 {
            return Self::default();
        }
        // Every other row is enough: half the cost, and edges are no thinner than that.
        let row_step = if cell_height >= 4 { 2 } else { 1 };
        let mut sums = [0u32; COLUMNS * ROWS];
        for (cell_y, row_sums) in sums.chunks_exact_mut(COLUMNS).enumerate() {
            for y in (cell_y * cell_height..(cell_y + 1) * cell_height).step_by(row_step) {
                for (sum, pixels) in row_sums.iter_mut().zip(image.row(y).chunks_exact(cell_width)) {
                    *sum += pixels.iter().map(|&level| u32::from(level)).sum::<u32>();
                }
            }
        }
        let n_pixels = (cell_width * cell_height.div_ceil(row_step)) as f32;
        let cells = sums.map(|sum| sum as f32 / n_pixels);
        Self { cells, cell_px: 0.5 * (cell_width + cell_height) as f64 }
    }

    /// Mean length of the gradient, gray levels per cell.
    fn mean_gradient(&self) -> f64 {
        let mut sum = 0.0;
        for y in 1..ROWS - 1 {
            for x in 1..COLUMNS - 1 {
                let at = y * COLUMNS + x;
                let dx = f64::from(self.cells[at + 1] - self.cells[at - 1]);
                let dy = f64::from(self.cells[at + COLUMNS] - self.cells[at - COLUMNS]);
                sum += 0.5 * dx.hypot(dy);
            }
        }
        sum / ((ROWS - 2) * (COLUMNS - 2)) as f64
    }
}

/// A thumbnail and when its image was taken.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Glimpse {
    /// When.
    pub stamp: StampNs,
    /// What.
    pub thumbnail: Thumbnail,
}

/// Mean share of a motion that lies across edges of all directions: that of `|cos|` over a circle.
const SHARE_ACROSS: f64 = std::f64::consts::FRAC_2_PI;

/// Speed of the image between two frames of one camera, px/s; `None` when they are too far apart or too plain to tell.
pub fn image_speed_px_per_s(before: &Glimpse, after: &Glimpse) -> Option<f64> {
    let gap_ns = after.stamp.0.saturating_sub(before.stamp.0);
    let same_size = before.thumbnail.cell_px == after.thumbnail.cell_px;
    if !(1..=MAX_GAP_NS).contains(&gap_ns) || !same_size {
        return None;
    }
    let gradient = 0.5 * (before.thumbnail.mean_gradient() + after.thumbnail.mean_gradient());
    if gradient < MIN_MEAN_GRADIENT {
        return None;
    }
    let shift_cells = mean_change(&before.thumbnail, &after.thumbnail) / gradient;
    Some(shift_cells / SHARE_ACROSS * after.thumbnail.cell_px * 1e9 / gap_ns as f64)
}

/// Mean absolute change per cell after the change of the mean is taken out, gray levels.
fn mean_change(before: &Thumbnail, after: &Thumbnail) -> f64 {
    let n_cells = (COLUMNS * ROWS) as f64;
    let changes = || before.cells.iter().zip(&after.cells).map(|(b, a)| f64::from(a - b));
    let mean = changes().sum::<f64>() / n_cells;
    changes().map(|change| (change - mean).abs()).sum::<f64>() / n_cells
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 640;
    const HEIGHT: usize = 480;

    /// A smooth scene, `shift_px` to the left and `gain` brighter.
    fn glimpse(stamp_ms: i64, shift_px: f64, brighter: f64) -> Glimpse {
        let level = |i: usize| {
            let (x, y) = ((i % WIDTH) as f64 + shift_px, (i / WIDTH) as f64);
            let value = 100.0 + 50.0 * (x / 40.0).sin() + 30.0 * (y / 55.0 + x / 90.0).cos();
            (value + brighter).round() as u8
        };
        let pixels: Vec<u8> = (0..WIDTH * HEIGHT).map(level).collect();
        let view = GrayView::try_new(&pixels, (WIDTH, HEIGHT), WIDTH).expect("whole image");
        Glimpse { stamp: StampNs(stamp_ms * 1_000_000), thumbnail: Thumbnail::of(&view) }
    }

    #[track_caller]
    fn check_speed(shift_px: f64, brighter: f64, range_px_per_s: (f64, f64)) {
        let speed = image_speed_px_per_s(&glimpse(0, 0.0, 0.0), &glimpse(33, shift_px, brighter));
        let speed = speed.expect("a textured scene");
        assert!(speed >= range_px_per_s.0 && speed <= range_px_per_s.1, "{speed} px/s");
    }

    #[test]
    fn a_still_image_has_no_speed() {
        check_speed(0.0, 0.0, (0.0, 0.0));
    }

    #[test]
    fn a_brighter_exposure_is_not_motion() {
        check_speed(0.0, 20.0, (0.0, 5.0));
    }

    #[test]
    fn three_pixels_in_33_ms_are_about_90_px_per_s() {
        check_speed(3.0, 0.0, (75.0, 150.0));
    }

    #[test]
    fn twenty_pixels_in_33_ms_are_told_as_fast() {
        check_speed(20.0, 0.0, (500.0, 1000.0));
    }

    #[test]
    fn frames_far_apart_and_plain_walls_tell_nothing() {
        assert_eq!(image_speed_px_per_s(&glimpse(0, 0.0, 0.0), &glimpse(500, 9.0, 0.0)), None);
        assert_eq!(image_speed_px_per_s(&glimpse(33, 0.0, 0.0), &glimpse(33, 9.0, 0.0)), None);
        let wall = |stamp_ms: i64| Glimpse { stamp: StampNs(stamp_ms * 1_000_000), ..Glimpse::default() };
        assert_eq!(image_speed_px_per_s(&wall(0), &wall(33)), None);
    }
}
