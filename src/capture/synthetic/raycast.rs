//! Which block each pixel sees: one ray per pixel centre against the blocks whose outline touches the pixel's tile.
//!
//! Rays are points of the plane z = 1, lens distortion included, so the parameter along a ray is the depth z itself.

use nalgebra::Point3;

use super::scene::Scene;
use crate::geometry::motion::Motion;
use crate::geometry::{Camera, PixelPoint};

/// Side of a tile, px.
const TILE: usize = 16;
/// Parts of blocks nearer than this are not looked at, m.
const NEAR_M: f32 = 1e-3;
/// Outlines are cut off here, m; nothing that is seen is nearer.
const OUTLINE_NEAR_M: f64 = 0.02;
/// Corners of a cut box: 8 corners and one point on each of 12 edges.
const OUTLINE_POINTS: usize = 20;

/// What a ray met: a block and one of its faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Hit {
    pub(super) block: u16,
    pub(super) face: u16,
}

/// A block as seen from the camera.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    /// Rows of the rotation block_from_camera.
    pub(super) rows: [[f32; 3]; 3],
    /// The camera in the block's frame, m.
    pub(super) origin_m: [f32; 3],
    pub(super) half_m: [f32; 3],
}

impl Placed {
    fn new(block_from_camera: &Motion, half_m: [f64; 3]) -> Self {
        let rotation = block_from_camera.rotation.to_rotation_matrix();
        let rows = std::array::from_fn(|r| std::array::from_fn(|c| rotation[(r, c)] as f32));
        let origin_m = std::array::from_fn(|k| block_from_camera.translation.vector[k] as f32);
        Self { rows, origin_m, half_m: half_m.map(|h| h as f32) }
    }

    /// Direction of a ray along one axis of the block.
    #[inline]
    pub(super) fn slope(&self, axis: usize, [x, y]: [f32; 2]) -> f32 {
        let row = &self.rows[axis];
        row[0] * x + row[1] * y + row[2]
    }

    /// Depth of the entry and the exit of a ray with their faces, m; it misses where the entry lies behind the exit.
    #[inline]
    pub(super) fn crossing(&self, ray: [f32; 2]) -> [(f32, u16); 2] {
        let mut near = (NEAR_M, 0);
        let mut far = (f32::MAX, 0);
        for axis in 0..3 {
            let slope = self.slope(axis, ray);
            let per_slope = 1.0 / slope;
            // A ray with rising coordinate comes in through the minus face.
            let entry_face = 2 * axis as u16 + u16::from(slope < 0.0);
            let side_m = if slope < 0.0 { self.half_m[axis] } else { -self.half_m[axis] };
            let entry = (side_m - self.origin_m[axis]) * per_slope;
            let exit = (-side_m - self.origin_m[axis]) * per_slope;
            if entry > near.0 {
                near = (entry, entry_face);
            }
            if exit < far.0 {
                far = (exit, entry_face ^ 1);
            }
        }
        [near, far]
    }
}

/// Blocks that may be seen in each tile.
#[derive(Debug)]
struct Tiles {
    columns: usize,
    rows: usize,
    /// Bounds of the rays of each tile: x from, x to, y from, y to.
    bounds: Vec<[f32; 4]>,
    counts: Vec<u16>,
    /// One stretch of `stretch` entries per tile.
    blocks: Vec<u16>,
    stretch: usize,
}

/// Casts the rays of one camera; owns all memory that takes.
#[derive(Debug)]
pub(super) struct Raycaster {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Ray of each pixel centre.
    pub(super) rays: Vec<[f32; 2]>,
    pub(super) placed: Vec<Placed>,
    pub(super) hits: Vec<Hit>,
    /// Depth at each pixel centre, m.
    pub(super) z_m: Vec<f32>,
    tiles: Tiles,
}

impl Raycaster {
    pub(super) fn new(camera: &Camera, blocks: usize) -> Self {
        let (width, height) = (camera.width_px() as usize, camera.height_px() as usize);
        let rays: Vec<[f32; 2]> = (0..width * height)
            .map(|i| {
                let pixel = PixelPoint { x: (i % width) as f64, y: (i / width) as f64 };
                let ray = camera.ray_from_pixel(pixel);
                [ray.x as f32, ray.y as f32]
            })
            .collect();
        let tiles = Tiles::new((width, height), &rays, blocks);
        Self {
            width,
            height,
            placed: Vec::with_capacity(blocks),
            hits: vec![Hit::default(); rays.len()],
            z_m: vec![0.0; rays.len()],
            rays,
            tiles,
        }
    }

    /// Looks at the scene from a pose: fills `hits`, `z_m` and `placed`.
    pub(super) fn cast(&mut self, scene: &Scene, world_from_camera: &Motion) {
        self.placed.clear();
        self.tiles.counts.fill(0);
        for (i, block) in scene.blocks.iter().enumerate() {
            let block_from_camera = block.world_from_block.inv_mul(world_from_camera);
            self.placed.push(Placed::new(&block_from_camera, block.half_m.into()));
            // The room itself is behind everything and needs no outline.
            if i > 0 {
                let corners = block.corners_m().map(|c| world_from_camera.inverse_transform_point(&c));
                self.tiles.enter(i as u16, &corners);
            }
        }
        for tile in 0..self.tiles.counts.len() {
            for row in 0..TILE {
                self.cast_row(tile, row);
            }
        }
    }

    /// One row of a tile.
    fn cast_row(&mut self, tile: usize, row: usize) {
        let (left, y) = (tile % self.tiles.columns * TILE, tile / self.tiles.columns * TILE + row);
        if y >= self.height {
            return;
        }
        let count = TILE.min(self.width - left);
        let start = y * self.width + left;
        let (mut xs, mut ys) = ([0.0f32; TILE], [0.0f32; TILE]);
        for (i, [x, y]) in self.rays[start..start + count].iter().enumerate() {
            (xs[i], ys[i]) = (*x, *y);
        }
        let mut nearest = Nearest { z_m: [f32::MAX; TILE], block: [0; TILE] };
        let from = tile * self.tiles.stretch;
        for &block in &self.tiles.blocks[from..from + self.tiles.counts[tile] as usize] {
            nearest.meet(&self.placed[block as usize], (&xs, &ys), u32::from(block));
        }
        for i in 0..count {
            let block = nearest.block[i] as u16;
            let [near, far] = self.placed[block as usize].crossing(self.rays[start + i]);
            let (z_m, face) = if block == 0 { far } else { near };
            self.hits[start + i] = Hit { block, face };
            self.z_m[start + i] = z_m;
        }
    }
}

/// The nearest block so far for a row of rays; block 0 is the room.
struct Nearest {
    z_m: [f32; TILE],
    block: [u32; TILE],
}

impl Nearest {
    /// Written without branches, so that the compiler tests several rays at once.
    #[inline]
    fn meet(&mut self, placed: &Placed, (xs, ys): (&[f32; TILE], &[f32; TILE]), block: u32) {
        for i in 0..TILE {
            let (mut near, mut far) = (NEAR_M, f32::MAX);
            for axis in 0..3 {
                let per_slope = 1.0 / placed.slope(axis, [xs[i], ys[i]]);
                let a = (-placed.half_m[axis] - placed.origin_m[axis]) * per_slope;
                let b = (placed.half_m[axis] - placed.origin_m[axis]) * per_slope;
                let (low, high) = (if a < b { a } else { b }, if a < b { b } else { a });
                near = if low > near { low } else { near };
                far = if high < far { high } else { far };
            }
            let is_hit = (near <= far) & (near < self.z_m[i]);
            self.z_m[i] = if is_hit { near } else { self.z_m[i] };
            self.block[i] = if is_hit { block } else { self.block[i] };
        }
    }
}

impl Tiles {
    fn new((width, height): (usize, usize), rays: &[[f32; 2]], stretch: usize) -> Self {
        let (columns, rows) = (width.div_ceil(TILE), height.div_ceil(TILE));
        let bounds = (0..columns * rows).map(|tile| {
            let (left, top) = (tile % columns * TILE, tile / columns * TILE);
            let inside = (top..height.min(top + TILE))
                .flat_map(|y| rays[y * width + left..y * width + width.min(left + TILE)].iter());
            // Pixels reach half a pixel beyond their centres; a pixel of margin is on the safe side.
            let margin = (rays[1][0] - rays[0][0]).abs();
            inside.fold([f32::MAX, f32::MIN, f32::MAX, f32::MIN], |b, [x, y]| {
                [b[0].min(x - margin), b[1].max(x + margin), b[2].min(y - margin), b[3].max(y + margin)]
            })
        });
        Self {
            columns,
            rows,
            bounds: bounds.collect(),
            counts: vec![0; columns * rows],
            blocks: vec![0; columns * rows * stretch],
            stretch,
        }
    }

    /// Adds a block to every tile that its outline touches.
    fn enter(&mut self, block: u16, corners_in_camera: &[Point3<f64>; 8]) {
        let mut points = [[0.0f32; 2]; OUTLINE_POINTS];
        let count = projected(corners_in_camera, &mut points);
        let mut hull = [[0.0f32; 2]; OUTLINE_POINTS + 1];
        let corners = convex_hull(&mut points[..count], &mut hull);
        for tile in 0..self.columns * self.rows {
            if touches(&hull[..corners], &self.bounds[tile]) {
                self.blocks[tile * self.stretch + self.counts[tile] as usize] = block;
                self.counts[tile] += 1;
            }
        }
    }
}

/// The corners of a box on the plane z = 1, cut off close to the camera; how many there are.
fn projected(corners: &[Point3<f64>; 8], points: &mut [[f32; 2]; OUTLINE_POINTS]) -> usize {
    let mut count = 0;
    let mut put = |p: Point3<f64>| {
        points[count] = [(p.x / p.z) as f32, (p.y / p.z) as f32];
        count += 1;
    };
    for (i, corner) in corners.iter().enumerate() {
        if corner.z >= OUTLINE_NEAR_M {
            put(*corner);
        }
        for bit in [1, 2, 4].into_iter().filter(|bit| i & bit == 0) {
            let other = corners[i | bit];
            if (corner.z < OUTLINE_NEAR_M) != (other.z < OUTLINE_NEAR_M) {
                put(corner + (other - corner) * ((OUTLINE_NEAR_M - corner.z) / (other.z - corner.z)));
            }
        }
    }
    count
}

/// Twice the signed area of a triangle.
fn turn(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Andrew's monotone chain; the hull has positive area, the number of its corners comes back.
fn convex_hull(points: &mut [[f32; 2]], hull: &mut [[f32; 2]; OUTLINE_POINTS + 1]) -> usize {
    points.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    let mut count = 0;
    for pass in 0..2 {
        let start = count;
        for i in 0..points.len() {
            let point = if pass == 0 { points[i] } else { points[points.len() - 1 - i] };
            while count >= start + 2 && turn(hull[count - 2], hull[count - 1], point) <= 0.0 {
                count -= 1;
            }
            hull[count] = point;
            count += 1;
        }
        // The last point of a chain is the first of the other.
        count = count.saturating_sub(1);
    }
    count
}

/// Whether a convex outline and a rectangle overlap, by separating axes; says yes rather than no.
fn touches(hull: &[[f32; 2]], &[x0, x1, y0, y1]: &[f32; 4]) -> bool {
    if hull.is_empty() {
        return false;
    }
    let beside = |axis: usize, low: f32, high: f32| {
        hull.iter().all(|p| p[axis] < low) || hull.iter().all(|p| p[axis] > high)
    };
    if beside(0, x0, x1) || beside(1, y0, y1) {
        return false;
    }
    let rectangle = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    !(0..hull.len()).any(|i| {
        let (a, b) = (hull[i], hull[(i + 1) % hull.len()]);
        hull.len() > 2 && rectangle.iter().all(|corner| turn(a, b, *corner) < 0.0)
    })
}
