//! What the surroundings of a line look like, on each side of it alone: colour and its spread in bands along the edge, piece by piece.
//!
//! Everything is a logarithm of light, so that exposure and white balance add a constant, which the matcher takes out. The
//! bands have a width in metres where depth is known, so that both cameras look at the same neighbourhood, and the pieces
//! keep apart what lies where along the edge, since two cameras cut an edge differently.
mod sample;

use crate::geometry::LineObservation;
use crate::image::RgbView;
use sample::{LogLight, Sums};

/// Bands of one side, narrow ones next to the edge.
pub const BANDS: usize = 6;
/// Neighbouring bands taken together for what varies less: colour and spread.
pub const ZONES: usize = 3;
/// Most pieces of one line.
pub const MAX_PIECES: usize = 8;
/// Rows of samples in a band.
const ROWS_PER_BAND: usize = 2;
/// How far the bands reach from the edge, m ...
const REACH_M: f64 = 0.10;
/// ... but at least and at most so many pixels.
const REACH_PX: [f64; 2] = [10.0, 40.0];
/// Depth assumed where no line of the image has any, 1/m.
const USUAL_INVERSE_DEPTH_PER_M: f64 = 0.5;
/// The innermost row keeps clear of the edge's own blur, px.
const CLEARANCE_PX: f64 = 1.5;
/// Shortest piece, px.
const MIN_PIECE_PX: f64 = 12.0;

/// One side of a piece of a line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SideLook {
    /// Mean logarithm of light per band, from the edge outwards.
    pub light: [f32; BANDS],
    /// Mean of log red - log green per zone.
    pub red_green: [f32; ZONES],
    /// Mean of log blue - log green per zone.
    pub blue_green: [f32; ZONES],
    /// Standard deviation of the logarithm of light along the edge, per zone.
    pub spread: [f32; ZONES],
    /// Share of the samples that lie in the image, 0 to 1.
    pub seen: f32,
}

/// What a line looks like; left is the darker side.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LineDescriptor {
    /// Left and right over the whole length.
    pub whole: [SideLook; 2],
    /// The same piece by piece, from start to end; `n_pieces` of them are filled.
    pub pieces: [[SideLook; 2]; MAX_PIECES],
    /// Number of pieces, 1 to [`MAX_PIECES`]; 0 where the line is too short to be described.
    pub n_pieces: u8,
    /// Length of one piece, m (guessed from other lines' depth where the line has none).
    pub piece_m: f32,
}

impl Default for LineDescriptor {
    fn default() -> Self {
        let (side, n_pieces, piece_m) = (SideLook::default(), 0, 0.0);
        Self { whole: [side; 2], pieces: [[side; 2]; MAX_PIECES], n_pieces, piece_m }
    }
}

/// Describes lines; owns its tables and scratch memory.
#[derive(Debug, Default)]
pub struct Describer {
    log_light: LogLight,
    inverse_depths_per_m: Vec<f64>,
}

impl Describer {
    /// A describer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Replaces `looks` by one descriptor per line, in the same order. After the first image of a stream nothing is allocated
    /// as long as there are not more lines than before.
    pub fn describe(
        &mut self,
        image: &RgbView<'_>,
        lines: &[LineObservation],
        looks: &mut Vec<LineDescriptor>,
    ) {
        let typical_per_m = self.typical_inverse_depth(lines);
        looks.clear();
        looks.extend(lines.iter().map(|line| match Course::of(line, typical_per_m) {
            Some(course) => self.look(image, &course),
            None => LineDescriptor::default(),
        }));
    }

    /// The median over the lines that have depth.
    fn typical_inverse_depth(&mut self, lines: &[LineObservation]) -> f64 {
        let known = &mut self.inverse_depths_per_m;
        known.clear();
        let depths = lines.iter().filter_map(|line| line.depth);
        known.extend(depths.map(|depth| 0.5 * depth.inverse_depth_per_m.iter().sum::<f64>()));
        let middle = known.len() / 2;
        match known.is_empty() {
            true => USUAL_INVERSE_DEPTH_PER_M,
            false => *known.select_nth_unstable_by(middle, f64::total_cmp).1,
        }
    }

    fn look(&self, image: &RgbView<'_>, course: &Course) -> LineDescriptor {
        let mut look = LineDescriptor {
            n_pieces: course.n_pieces as u8,
            piece_m: (course.length_m / course.n_pieces as f64) as f32,
            ..LineDescriptor::default()
        };
        let mut whole = [[Sums::default(); BANDS]; 2];
        for (idx, piece) in look.pieces[..course.n_pieces].iter_mut().enumerate() {
            let [from, to] = [idx, idx + 1].map(|i| course.at(i as f64 / course.n_pieces as f64));
            for (side, look) in piece.iter_mut().enumerate() {
                let bands = self.bands(image, course, (from, to, side));
                for (sum, band) in whole[side].iter_mut().zip(&bands) {
                    sum.add(band);
                }
                *look = side_look(&bands);
            }
        }
        look.whole = whole.map(|bands| side_look(&bands));
        look
    }

    /// Sums over the bands of one side between two positions on the segment (0 start, 1 end).
    fn bands(
        &self,
        image: &RgbView<'_>,
        course: &Course,
        (from, to, side): (f64, f64, usize),
    ) -> [Sums; BANDS] {
        let mut bands = [Sums::default(); BANDS];
        let reach_px = course.reach_px(0.5 * (from + to));
        let sign = if side == 0 { -1.0 } else { 1.0 };
        for row in 0..BANDS * ROWS_PER_BAND {
            let share = (row as f64 + 0.5) / (BANDS * ROWS_PER_BAND) as f64;
            let across_px = sign * (CLEARANCE_PX + (reach_px - CLEARANCE_PX) * share * share.sqrt());
            let row_ends = [from, to].map(|at| course.pixel(at, across_px));
            bands[row / ROWS_PER_BAND].add(&self.log_light.sums(image, row_ends));
        }
        bands
    }
}

fn side_look(bands: &[Sums; BANDS]) -> SideLook {
    const PER_ZONE: usize = BANDS / ZONES;
    let zones: [Sums; ZONES] = std::array::from_fn(|zone| {
        let mut sums = Sums::default();
        bands[zone * PER_ZONE..][..PER_ZONE].iter().for_each(|band| sums.add(band));
        sums
    });
    let (n, n_possible) =
        bands.iter().fold((0.0, 0.0), |(n, possible), band| (n + band.n, possible + band.n_possible));
    SideLook {
        light: bands.map(|band| band.mean(band.light)),
        red_green: zones.map(|zone| zone.mean(zone.red_green)),
        blue_green: zones.map(|zone| zone.mean(zone.blue_green)),
        spread: zones.map(|zone| zone.deviation()),
        seen: n / f32::max(n_possible, 1.0),
    }
}

/// Where a line runs in the image and how large a metre is along it.
#[derive(Debug, Clone, Copy)]
struct Course {
    start: [f64; 2],
    end: [f64; 2],
    /// Unit vector to the right hand.
    right: [f64; 2],
    inverse_depth_per_m: [f64; 2],
    focal_px: f64,
    length_m: f64,
    n_pieces: usize,
}

impl Course {
    /// `None` for segments without length or with ends that are not numbers.
    fn of(line: &LineObservation, typical_per_m: f64) -> Option<Self> {
        let length_px = line.segment.length_px();
        let [a, b] = line.ends;
        let length_on_plane = (b.x - a.x).hypot(b.y - a.y);
        if !((1.0..1e5).contains(&length_px) && (1e-6..1e6).contains(&length_on_plane)) {
            return None;
        }
        let inverse_depth_per_m = line.depth.map_or([typical_per_m; 2], |depth| depth.inverse_depth_per_m);
        let [from_m, to_m] = [0, 1].map(|end| line.ends[end].at_inverse_depth(inverse_depth_per_m[end]));
        let start = [line.segment.start.x, line.segment.start.y];
        let end = [line.segment.end.x, line.segment.end.y];
        let right = [-(end[1] - start[1]) / length_px, (end[0] - start[0]) / length_px];
        let n_pieces = (length_px / MIN_PIECE_PX).clamp(1.0, MAX_PIECES as f64) as usize;
        let (focal_px, length_m) = (length_px / length_on_plane, (to_m - from_m).norm());
        Some(Self { start, end, right, inverse_depth_per_m, focal_px, length_m, n_pieces })
    }

    /// Position on the segment (0 to 1) of the point that lies this share of the way along the line in space.
    fn at(&self, share_in_space: f64) -> f64 {
        let [start, end] = self.inverse_depth_per_m;
        share_in_space * start / (end + (start - end) * share_in_space)
    }

    fn reach_px(&self, at: f64) -> f64 {
        let [start, end] = self.inverse_depth_per_m;
        let inverse_depth_per_m = start + (end - start) * at;
        (self.focal_px * REACH_M * inverse_depth_per_m).clamp(REACH_PX[0], REACH_PX[1])
    }

    fn pixel(&self, at: f64, across_px: f64) -> [f64; 2] {
        std::array::from_fn(|i| {
            self.start[i] + (self.end[i] - self.start[i]) * at + self.right[i] * across_px
        })
    }
}
