//! The colour of each pixel: texture times light, averaged over the pixel where it sees more than one face.
//!
//! A pixel inside a face takes one filtered texture look-up; a pixel at an edge counts sub-rays per face, so that an
//! edge lies within a few hundredths of a pixel of where geometry puts it.

use super::raycast::{Hit, Placed, Raycaster};
use super::scene::{LAMPS, Scene};
use super::texture::{Rgb, Spot, Stereo};

/// Sub-rays of a pixel at an edge, a power of two.
const SAMPLES: usize = 32;
/// Faces that one pixel may show; more are left out.
const FACES: usize = 8;
/// Light from everywhere.
const AMBIENT: f32 = 0.34;

/// A rendered view without noise; images are row-major.
#[derive(Debug)]
pub(super) struct Shaded {
    /// Linear red, green and blue planes.
    pub(super) planes: [Vec<f32>; 3],
    /// Brightness under frontal light (reflectance times cosine).
    pub(super) echo: Vec<f32>,
    /// Cosine between the viewing ray and the surface normal.
    pub(super) cosine: Vec<f32>,
    /// What stereo finds there.
    pub(super) stereo: Vec<Stereo>,
    /// The same for each material.
    stereo_of_material: Vec<Stereo>,
    /// Lamps in the frame of each block.
    lamps: Vec<[[f32; 3]; LAMPS]>,
    /// The world's up in the frame of each block.
    ups: Vec<[f32; 3]>,
}

/// One look at a face.
struct Look {
    color: Rgb,
    reflectance: f32,
    cosine: f32,
}

/// A ray and its change per pixel to the right and down.
#[derive(Debug, Clone, Copy)]
struct PixelRay {
    at: [f32; 2],
    right: [f32; 2],
    down: [f32; 2],
}

impl PixelRay {
    fn of(rays: &Raycaster, x: usize, y: usize) -> Self {
        let ray = |x: usize, y: usize| rays.rays[y * rays.width + x];
        // One-sided differences; at the right and lower border to the other side.
        let (left, top) = (x.min(rays.width - 2), y.min(rays.height - 2));
        let minus = |a: [f32; 2], b: [f32; 2]| [a[0] - b[0], a[1] - b[1]];
        let right = minus(ray(left + 1, y), ray(left, y));
        Self { at: ray(x, y), right, down: minus(ray(x, top + 1), ray(x, top)) }
    }

    /// The ray at an offset from the pixel's centre, px.
    fn shifted(&self, [dx, dy]: [f32; 2]) -> [f32; 2] {
        let moved = |k: usize| self.at[k] + dx * self.right[k] + dy * self.down[k];
        [moved(0), moved(1)]
    }
}

impl Shaded {
    pub(super) fn new(pixels: usize, scene: &Scene) -> Self {
        let plane = || vec![0.0f32; pixels];
        let in_block = |p: nalgebra::Vector3<f64>| std::array::from_fn(|k| p[k] as f32);
        let lamps = scene.blocks.iter().map(|block| {
            scene
                .lamps
                .map(|lamp| in_block(block.world_from_block.inverse_transform_point(&lamp.at_m).coords))
        });
        let ups = scene
            .blocks
            .iter()
            .map(|block| in_block(block.world_from_block.inverse_transform_vector(&nalgebra::Vector3::z())));
        Self {
            planes: [plane(), plane(), plane()],
            echo: plane(),
            cosine: plane(),
            stereo: vec![Stereo::default(); pixels],
            stereo_of_material: scene.materials.iter().map(|material| material.stereo()).collect(),
            lamps: lamps.collect(),
            ups: ups.collect(),
        }
    }

    /// Colours every pixel of what the rays met.
    pub(super) fn shade(&mut self, scene: &Scene, rays: &Raycaster) {
        for y in 0..rays.height {
            for x in 0..rays.width {
                let i = y * rays.width + x;
                let (hit, ray) = (rays.hits[i], PixelRay::of(rays, x, y));
                let look = self.look(scene, (hit, &rays.placed[hit.block as usize]), &ray);
                let material = scene.blocks[hit.block as usize].faces[hit.face as usize];
                self.echo[i] = look.reflectance * look.cosine;
                self.cosine[i] = look.cosine;
                self.stereo[i] = self.stereo_of_material[material as usize];
                let color = match is_at_edge(rays, x, y) {
                    true => self.average(scene, (rays, &ray), &Neighbours::around(rays, x, y)),
                    false => look.color,
                };
                for (plane, value) in self.planes.iter_mut().zip(color) {
                    plane[i] = value;
                }
            }
        }
    }

    /// Colour of a pixel at an edge.
    fn average(&self, scene: &Scene, (rays, ray): (&Raycaster, &PixelRay), near: &Neighbours) -> Rgb {
        let mut seen: [(Hit, f32, [f32; 2]); FACES] = [(Hit::default(), 0.0, [0.0; 2]); FACES];
        let mut faces = 0;
        for offset in (0..SAMPLES).map(sample_offset) {
            let hit = near.first_hit(rays, ray.shifted(offset));
            let known = seen[..faces].iter().position(|(other, ..)| *other == hit);
            if known.is_none() && faces == FACES {
                continue;
            }
            let slot = known.unwrap_or(faces);
            faces = faces.max(slot + 1);
            let (_, count, sum) = seen[slot];
            seen[slot] = (hit, count + 1.0, [sum[0] + offset[0], sum[1] + offset[1]]);
        }
        let total: f32 = seen[..faces].iter().map(|(_, count, _)| count).sum();
        let mut color = [0.0; 3];
        for (hit, count, sum) in &seen[..faces] {
            let middle = PixelRay { at: ray.shifted([sum[0] / count, sum[1] / count]), ..*ray };
            let look = self.look(scene, (*hit, &rays.placed[hit.block as usize]), &middle);
            for (channel, value) in color.iter_mut().zip(look.color) {
                *channel += value * count / total;
            }
        }
        color
    }

    /// Texture and light of one face along a ray.
    fn look(&self, scene: &Scene, (hit, placed): (Hit, &Placed), ray: &PixelRay) -> Look {
        let (axis, is_plus) = ((hit.face / 2) as usize, hit.face % 2 == 1);
        let side_m = if is_plus { placed.half_m[axis] } else { -placed.half_m[axis] };
        let slope = placed.slope(axis, ray.at);
        let z_m = (side_m - placed.origin_m[axis]) / slope;
        let (spot, at_m) = spot(placed, (axis, side_m, z_m), ray);
        let block = &scene.blocks[hit.block as usize];
        let reflectance = scene.materials[block.faces[hit.face as usize] as usize].color(&spot, &scene.noise);
        // The room is seen from inside: its faces look the other way.
        let sign = if is_plus == (hit.block > 0) { 1.0 } else { -1.0 };
        let light = self.light(scene, hit.block as usize, (axis, sign, at_m));
        let length = (ray.at[0] * ray.at[0] + ray.at[1] * ray.at[1] + 1.0).sqrt();
        Look {
            color: [reflectance[0] * light, reflectance[1] * light, reflectance[2] * light],
            reflectance: (reflectance[0] + reflectance[1] + reflectance[2]) / 3.0,
            cosine: slope.abs() / length,
        }
    }

    /// Light that falls on a point of a block, its normal along an axis.
    fn light(&self, scene: &Scene, block: usize, (axis, sign, at_m): (usize, f32, [f32; 3])) -> f32 {
        let upward = sign * self.ups[block][axis];
        let mut sum = AMBIENT * (1.0 + 0.25 * upward);
        for (lamp, at) in scene.lamps.iter().zip(&self.lamps[block]) {
            let to = [at[0] - at_m[0], at[1] - at_m[1], at[2] - at_m[2]];
            let square = to[0] * to[0] + to[1] * to[1] + to[2] * to[2];
            let facing = (sign * to[axis]).max(0.0);
            // Inverse square, softened close to the lamp (0.3 m²: it has a size).
            sum += lamp.strength * facing / (square.sqrt() * (square + 0.3));
        }
        sum
    }
}

/// Where a ray meets a face, as the texture and as the light need it.
#[inline]
fn spot(placed: &Placed, (axis, side_m, z_m): (usize, f32, f32), ray: &PixelRay) -> (Spot, [f32; 3]) {
    let [first, second] = [[1, 2], [0, 2], [0, 1]][axis];
    let slope = placed.slope(axis, ray.at);
    // d(at)/d(ray) = z (row_k - slope_k / slope_axis * row_axis), from z = (side - origin_axis) / slope_axis.
    let per_px = |k: usize| {
        let ratio = placed.slope(k, ray.at) / slope;
        let gradient = |c: usize| z_m * (placed.rows[k][c] - ratio * placed.rows[axis][c]);
        let along = |step: [f32; 2]| gradient(0) * step[0] + gradient(1) * step[1];
        [along(ray.right), along(ray.down)]
    };
    let place = |k: usize| placed.origin_m[k] + z_m * placed.slope(k, ray.at);
    let mut at_m = [place(0), place(1), place(2)];
    at_m[axis] = side_m;
    let spot = Spot {
        at_m: [at_m[first], at_m[second]],
        first_per_px: per_px(first),
        second_per_px: per_px(second),
        half_m: [placed.half_m[first], placed.half_m[second]],
    };
    (spot, at_m)
}

/// Offset of a sub-ray from the pixel's centre, px: the Hammersley points. All differ in x and in y, so that level and
/// upright edges are resolved to 1/32 px; for the others the error is 0.025 px rms in one row.
#[inline]
fn sample_offset(i: usize) -> [f32; 2] {
    let reversed = (i as u32).reverse_bits() >> (u32::BITS - SAMPLES.trailing_zeros());
    [(i as f32 + 0.5) / SAMPLES as f32 - 0.5, (reversed as f32 + 0.5) / SAMPLES as f32 - 0.5]
}

/// Whether one of the four pixels around shows another face; where none does, no straight edge touches the pixel.
#[inline]
fn is_at_edge(rays: &Raycaster, x: usize, y: usize) -> bool {
    let line = |row: usize| &rays.hits[row * rays.width..(row + 1) * rays.width];
    let (row, center) = (line(y), line(y)[x]);
    let (above, below) = (line(y.saturating_sub(1)), line((y + 1).min(rays.height - 1)));
    let (left, right) = (row[x.saturating_sub(1)], row[(x + 1).min(rays.width - 1)]);
    left != center || right != center || above[x] != center || below[x] != center
}

/// The blocks seen in a pixel and the eight around it, without the room: that is behind everything.
struct Neighbours {
    blocks: [u16; 9],
    count: usize,
}

impl Neighbours {
    fn around(rays: &Raycaster, x: usize, y: usize) -> Self {
        let mut near = Self { blocks: [0; 9], count: 0 };
        for row in y.saturating_sub(1)..(y + 2).min(rays.height) {
            let start = row * rays.width;
            for hit in &rays.hits[start + x.saturating_sub(1)..start + (x + 2).min(rays.width)] {
                if hit.block > 0 && !near.blocks[..near.count].contains(&hit.block) {
                    near.blocks[near.count] = hit.block;
                    near.count += 1;
                }
            }
        }
        near
    }

    fn first_hit(&self, rays: &Raycaster, ray: [f32; 2]) -> Hit {
        let [_, (mut z_m, face)] = rays.placed[0].crossing(ray);
        let mut hit = Hit { block: 0, face };
        for &block in &self.blocks[..self.count] {
            let [near, far] = rays.placed[block as usize].crossing(ray);
            if near.0 <= far.0 && near.0 < z_m {
                z_m = near.0;
                hit = Hit { block, face: near.1 };
            }
        }
        hit
    }
}
