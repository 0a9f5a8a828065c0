//! Images of random numbers: mean 0, variance 1, correlated over a given number of pixels.

use super::random::Random;

/// Half width of the smoothing kernel, px.
const RADIUS: usize = 4;

/// Gaussian noise smoothed so that neighbours within about `2 * sigma_px` resemble each other (at most 2 px).
#[derive(Debug)]
pub(super) struct SmoothField {
    pub(super) values: Vec<f32>,
    width: usize,
    kernel: [f32; 2 * RADIUS + 1],
    row: Vec<f32>,
    /// The last rows after the pass along x; one slot per tap.
    ring: [Vec<f32>; 2 * RADIUS + 1],
}

impl SmoothField {
    pub(super) fn new((width, height): (usize, usize), sigma_px: f32) -> Self {
        let mut kernel: [f32; 2 * RADIUS + 1] = std::array::from_fn(|i| {
            let at = i as f32 - RADIUS as f32;
            (-0.5 * (at / sigma_px).powi(2)).exp()
        });
        // Unit variance after the pass along each axis.
        let norm = kernel.iter().map(|k| k * k).sum::<f32>().sqrt();
        kernel.iter_mut().for_each(|k| *k /= norm);
        Self {
            values: vec![0.0; width * height],
            width,
            kernel,
            row: vec![0.0; width + 2 * RADIUS],
            ring: std::array::from_fn(|_| vec![0.0; width]),
        }
    }

    /// Draws the whole image anew.
    pub(super) fn draw(&mut self, random: &mut Random) {
        let height = self.values.len() / self.width;
        for y in 0..height + 2 * RADIUS {
            self.row.iter_mut().for_each(|value| *value = random.gaussian());
            let slot = &mut self.ring[y % (2 * RADIUS + 1)];
            slot.fill(0.0);
            for (tap, weight) in self.kernel.iter().enumerate() {
                slot.iter_mut().zip(&self.row[tap..]).for_each(|(sum, value)| *sum += weight * value);
            }
            if y < 2 * RADIUS {
                continue;
            }
            let top = (y - 2 * RADIUS) * self.width;
            let out = &mut self.values[top..top + self.width];
            out.fill(0.0);
            for (tap, weight) in self.kernel.iter().enumerate() {
                let line = &self.ring[(y - 2 * RADIUS + tap) % (2 * RADIUS + 1)];
                out.iter_mut().zip(line).for_each(|(sum, value)| *sum += weight * value);
            }
        }
    }
}

/// Noise from random values on a coarse lattice: cheap blobs of about `step_px`.
#[derive(Debug)]
pub(super) struct BlobField {
    pub(super) values: Vec<f32>,
    width: usize,
    step_px: usize,
    lattice: [Vec<f32>; 2],
}

impl BlobField {
    pub(super) fn new((width, height): (usize, usize), step_px: usize) -> Self {
        let nodes = vec![0.0; width / step_px + 2];
        Self { values: vec![0.0; width * height], width, step_px, lattice: [nodes.clone(), nodes] }
    }

    /// Draws the whole image anew.
    pub(super) fn draw(&mut self, random: &mut Random) {
        let mut draw_row = |nodes: &mut Vec<f32>| nodes.iter_mut().for_each(|node| *node = random.gaussian());
        draw_row(&mut self.lattice[1]);
        let step = self.step_px as f32;
        for (y, out) in self.values.chunks_exact_mut(self.width).enumerate() {
            if y % self.step_px == 0 {
                self.lattice.swap(0, 1);
                draw_row(&mut self.lattice[1]);
            }
            let [above, below] = weights((y % self.step_px) as f32 / step);
            let nodes = self.lattice[0].iter().zip(&self.lattice[1]);
            let mut column = nodes.map(|(a, b)| above * a + below * b);
            let mut left = column.next().unwrap_or_default();
            for (stretch, right) in out.chunks_mut(self.step_px).zip(column) {
                for (i, value) in stretch.iter_mut().enumerate() {
                    let [before, after] = weights(i as f32 / step);
                    *value = before * left + after * right;
                }
                left = right;
            }
        }
    }
}

/// Weights of the two neighbours at a share of the way, scaled to keep the variance.
#[inline]
fn weights(share: f32) -> [f32; 2] {
    let after = share * share * (3.0 - 2.0 * share);
    let norm = (after * after + (1.0 - after) * (1.0 - after)).sqrt();
    [(1.0 - after) / norm, after / norm]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check_variance(values: &[f32]) {
        let variance = values.iter().map(|v| f64::from(v * v)).sum::<f64>() / values.len() as f64;
        assert!((variance - 1.0).abs() < 0.15, "variance {variance}");
    }

    #[test]
    fn fields_have_variance_one_everywhere() {
        let (mut smooth, mut blobs) = (SmoothField::new((200, 150), 1.27), BlobField::new((203, 151), 7));
        smooth.draw(&mut Random::keyed(1, &[]));
        blobs.draw(&mut Random::keyed(2, &[]));
        check_variance(&smooth.values);
        check_variance(&blobs.values);
        check_variance(&smooth.values[29_000..]);
    }
}
