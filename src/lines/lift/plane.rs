//! Robust planes beside an edge. The inverse depth of a plane is affine in the image, so beside the edge it is
//! `(1 - along) start + along end + slope across`, whatever the plane's tilt; at the edge itself `across` is 0.
use super::band::{Reading, ZONES};

/// Hypotheses tried per side.
const HYPOTHESES: usize = 40;
/// Share of the highest possible score that ends the search: nearly every cell agrees, and least squares does the rest.
const GOOD_SCORE: f64 = 0.8;
/// Trust in a cell by zone: near the edge the surface is that of the edge, far away it may be another.
const ZONE_WEIGHT: [f64; ZONES] = [1.0, 1.0, 0.8, 0.6];
/// Steepest surface beside an edge, 1/m per px: a plane seen edge-on at 0.2 m by a lens of 500 px has 0.01.
const MAX_SLOPE_PER_M_PX: f64 = 0.02;

/// Inverse depth of one plane beside an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plane {
    /// At the edge's start and end, 1/m.
    pub ends_per_m: [f64; 2],
    /// Across the edge, to the right, 1/m per px.
    pub slope_per_m_px: f64,
}

impl Plane {
    /// Measured minus modelled inverse depth, 1/m.
    pub fn residual(&self, reading: &Reading) -> f64 {
        let [start, end] = self.ends_per_m;
        let model = start + (end - start) * reading.along + self.slope_per_m_px * reading.across_px;
        reading.inverse_depth_per_m - model
    }

    /// At the middle of the edge, 1/m.
    pub fn mean_per_m(&self) -> f64 {
        0.5 * (self.ends_per_m[0] + self.ends_per_m[1])
    }

    /// The plane through two readings that is level across the edge: all that a strip of a pixel or two can say.
    fn level_through([a, b]: [&Reading; 2]) -> Option<Self> {
        let along = b.along - a.along;
        let rise = (b.inverse_depth_per_m - a.inverse_depth_per_m) / along;
        let start = a.inverse_depth_per_m - rise * a.along;
        (along.abs() >= 0.1).then_some(Self { ends_per_m: [start, start + rise], slope_per_m_px: 0.0 })
    }

    /// The plane through three readings; `None` where they do not even fix a level one or it is too steep to be a surface.
    fn through([a, b, c]: [&Reading; 3]) -> Option<Self> {
        let (s1, t1) = (b.along - a.along, b.across_px - a.across_px);
        let (s2, t2) = (c.along - a.along, c.across_px - a.across_px);
        let (z1, z2) =
            (b.inverse_depth_per_m - a.inverse_depth_per_m, c.inverse_depth_per_m - a.inverse_depth_per_m);
        let determinant = s1 * t2 - s2 * t1;
        // A tenth of the segment by one pixel: smaller triangles amplify the noise.
        if determinant.abs() < 0.1 {
            return Self::level_through([a, b]);
        }
        let rise = (z1 * t2 - z2 * t1) / determinant;
        let slope_per_m_px = (s1 * z2 - s2 * z1) / determinant;
        let start = a.inverse_depth_per_m - rise * a.along - slope_per_m_px * a.across_px;
        (slope_per_m_px.abs() <= MAX_SLOPE_PER_M_PX)
            .then_some(Self { ends_per_m: [start, start + rise], slope_per_m_px })
    }
}

/// The plane that most cells of one side agree with, within `tolerance_per_m`; `None` with too few cells.
pub fn consensus(cells: &[Reading], tolerance_per_m: f64) -> Option<Plane> {
    let mut best: Option<(f64, Plane)> = None;
    let enough = GOOD_SCORE * cells.iter().map(|cell| ZONE_WEIGHT[cell.zone()]).sum::<f64>();
    let mut random = 0x9E37_79B9_7F4A_7C15_u64;
    for _ in 0..HYPOTHESES {
        let mut pick = || {
            // A fixed linear congruential sequence: the same cells give the same plane.
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            cells.get((random >> 33) as usize % cells.len().max(1))
        };
        let Some(plane) = Plane::through([pick()?, pick()?, pick()?]) else { continue };
        let score = score(&plane, cells, tolerance_per_m);
        if best.is_none_or(|(best, _)| score > best) {
            best = Some((score, plane));
            if score >= enough {
                break;
            }
        }
    }
    best.map(|(_, plane)| plane)
}

fn score(plane: &Plane, cells: &[Reading], tolerance_per_m: f64) -> f64 {
    let gain = |cell: &Reading| {
        let ratio = plane.residual(cell) / tolerance_per_m;
        ZONE_WEIGHT[cell.zone()] * (1.0 - ratio * ratio).max(0.0)
    };
    cells.iter().map(gain).sum()
}
