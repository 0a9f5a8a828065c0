//! Which readings agree with a plane, and least squares over them: one side alone, or both under the shapes two sides can have.
use nalgebra::{Matrix3, Matrix3x4, Matrix4, Vector3, Vector4};

use super::band::{Band, MAX_BINS, Reading, ZONES};
use super::plane::Plane;

/// Readings farther from the edge do not enter the inlier ratio, px: most of that surface may be another's.
const RATIO_BAND_PX: f64 = 4.75;

/// Least share of the readings at the edge, and of its bins, for a surface that reaches it.
const MIN_AT_EDGE: f64 = 0.5;

/// How surely a surface is level across the edge before anything is measured: like readings that give the slope to 0.004 1/m per
/// px. It holds a strip of a pixel or two, and is less than 1 % of what a whole band says.
const LEVEL_PX2: f64 = 20.0;

/// How the inverse depths of the two sides are tied.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Shape {
    /// One plane under all readings: a marking.
    Plane,
    /// Two planes that meet at the edge.
    Crease,
    /// Two parallel planes, one before the other.
    Terrace,
}

/// How far from a plane depth may lie to agree with it, 1/m.
#[derive(Debug, Clone, Copy)]
pub struct Gate {
    /// A single reading.
    pub reading_per_m: f64,
    /// The median of a cell: less noisy, so it tells surfaces apart whose readings overlap.
    pub cell_per_m: f64,
}

/// Sums over the agreeing readings of a cell.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    n: f64,
    along: f64,
    across_px: f64,
    inverse_depth_per_m: f64,
}

/// The readings of one side that agree with its plane.
#[derive(Debug, Clone, Copy)]
pub struct Agreement {
    sums: [Sums; ZONES * MAX_BINS],
    /// Sum of squared residuals, 1/m².
    pub sum_per_m2: f64,
    /// Number of readings that agree.
    pub n: f64,
    /// Readings beside the edge, and those of them that agree.
    pub n_near: [f64; 2],
    /// Bins with agreeing readings beside the edge, one bit each.
    pub covered: u16,
    /// Readings in the zone at the edge, and those of them that agree.
    n_at_edge: [f64; 2],
    /// Bins with agreeing readings in the zone at the edge.
    at_edge: u16,
}

/// Whether a surface reaches the edge it was found beside.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// It is what the depth at the edge shows.
    Edge,
    /// There is too little depth at the edge to say.
    Unknown,
    /// Depth at the edge shows something else.
    Short,
}

impl Agreement {
    /// The readings within the gate of `plane`, in cells whose median is.
    pub fn with(plane: &Plane, band: &Band, gate: Gate) -> Self {
        let sums = [Sums::default(); ZONES * MAX_BINS];
        let mut found = Self {
            sums,
            sum_per_m2: 0.0,
            n: 0.0,
            n_near: [0.0; 2],
            covered: 0,
            n_at_edge: [0.0; 2],
            at_edge: 0,
        };
        let is_open = open_cells(plane, band, gate.cell_per_m);
        for reading in &band.readings {
            let is_near = reading.across_px.abs() <= RATIO_BAND_PX;
            found.n_near[0] += f64::from(u8::from(is_near));
            let is_at_edge = reading.zone() == 0;
            found.n_at_edge[0] += f64::from(u8::from(is_at_edge));
            let residual_per_m = plane.residual(reading);
            if is_open[usize::from(reading.cell)] && residual_per_m.abs() <= gate.reading_per_m {
                found.add(reading, residual_per_m);
                if is_near {
                    found.n_near[1] += 1.0;
                    found.covered |= 1 << reading.bin();
                }
                if is_at_edge {
                    found.n_at_edge[1] += 1.0;
                    found.at_edge |= 1 << reading.bin();
                }
            }
        }
        found
    }

    fn add(&mut self, reading: &Reading, residual_per_m: f64) {
        let sums = &mut self.sums[usize::from(reading.cell)];
        sums.n += 1.0;
        sums.along += reading.along;
        sums.across_px += reading.across_px;
        sums.inverse_depth_per_m += reading.inverse_depth_per_m;
        self.sum_per_m2 += residual_per_m * residual_per_m;
        self.n += 1.0;
    }

    /// Whether the surface reaches the edge, which has so many bins.
    pub fn reach(&self, n_bins: usize) -> Reach {
        let [all, agreeing] = self.n_at_edge;
        if agreeing < MIN_AT_EDGE * all {
            Reach::Short
        } else if f64::from(self.at_edge.count_ones()) < MIN_AT_EDGE * n_bins as f64 {
            Reach::Unknown
        } else {
            Reach::Edge
        }
    }

    /// Number of agreeing readings and mean residual of each bin along the edge, 1/m.
    pub fn bin_residuals(&self, plane: &Plane) -> impl Iterator<Item = (f64, f64)> {
        let [start, end] = plane.ends_per_m;
        (0..MAX_BINS).map(move |bin| {
            let (mut n, mut sum_per_m) = (0.0, 0.0);
            for sums in (0..ZONES).map(|zone| &self.sums[zone * MAX_BINS + bin]) {
                n += sums.n;
                let model =
                    start * sums.n + (end - start) * sums.along + plane.slope_per_m_px * sums.across_px;
                sum_per_m += sums.inverse_depth_per_m - model;
            }
            (n, sum_per_m / n.max(1.0))
        })
    }

    /// The sums of least squares.
    pub fn moments(&self) -> Moments {
        let mut moments = Moments::default();
        for sums in self.sums.iter().filter(|sums| sums.n > 0.0) {
            let (along, across_px) = (sums.along / sums.n, sums.across_px / sums.n);
            let row = Vector3::new(1.0 - along, along, across_px);
            moments.information.ger(sums.n, &row, &row, 1.0);
            moments.right_hand.axpy(sums.inverse_depth_per_m, &row, 1.0);
            moments.square_per_m2 += sums.inverse_depth_per_m * sums.inverse_depth_per_m / sums.n;
        }
        moments
    }
}

/// Which cells have their median within `tolerance_per_m` of a plane.
pub fn open_cells(plane: &Plane, band: &Band, tolerance_per_m: f64) -> [bool; ZONES * MAX_BINS] {
    let mut is_open = [false; ZONES * MAX_BINS];
    for cell in &band.cells {
        is_open[usize::from(cell.cell)] = plane.residual(cell).abs() <= tolerance_per_m;
    }
    is_open
}

/// Sums of least squares of one side, for the unknowns `[at the start, at the end, slope across]`.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    information: Matrix3<f64>,
    right_hand: Vector3<f64>,
    square_per_m2: f64,
}

/// A least-squares surface. Its first two numbers are the inverse depths at the edge's start and end.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceFit {
    /// Start, end (1/m), slope across (1/m per px); then the right side's own slope, or how much it is nearer.
    pub surface: Vector4<f64>,
    /// Its covariance for independent readings of unit variance.
    pub unit_covariance: Matrix4<f64>,
    /// Sum of squared residuals of the cells' means, 1/m².
    pub sum_per_m2: f64,
}

impl SurfaceFit {
    /// The surface of the left side, or of both.
    pub fn plane(&self) -> Plane {
        Plane { ends_per_m: [self.surface[0], self.surface[1]], slope_per_m_px: self.surface[2] }
    }
}

/// Least squares over the left and the right side; `None` where the readings do not fix the surface.
pub fn least_squares([left, right]: [&Moments; 2], shape: Shape) -> Option<SurfaceFit> {
    let own = Matrix3x4::<f64>::identity();
    let mut of_right = own;
    match shape {
        Shape::Plane => {}
        Shape::Crease => of_right.swap_columns(2, 3),
        Shape::Terrace => (of_right[(0, 3)], of_right[(1, 3)]) = (1.0, 1.0),
    }
    let mut information = Matrix4::<f64>::zeros();
    let mut right_hand = Vector4::<f64>::zeros();
    for (moments, unknowns) in [(left, &own), (right, &of_right)] {
        information += unknowns.transpose() * moments.information * unknowns;
        right_hand += unknowns.transpose() * moments.right_hand;
    }
    // What nothing measures stays at zero.
    information[(2, 2)] += LEVEL_PX2;
    information[(3, 3)] += if shape == Shape::Crease { LEVEL_PX2 } else { 1e-6 };
    let unit_covariance = information.cholesky()?.inverse();
    let surface = unit_covariance * right_hand;
    let square_per_m2 = left.square_per_m2 + right.square_per_m2;
    let sum_per_m2 = (square_per_m2 - right_hand.dot(&surface)).max(0.0);
    let is_finite = surface.iter().all(|value| value.is_finite());
    is_finite.then_some(SurfaceFit { surface, unit_covariance, sum_per_m2 })
}
