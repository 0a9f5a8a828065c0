//! The matches prepared for drawing and scoring, in an order of their own: what a caller's order is must not matter.

use std::cmp::Ordering;

use nalgebra::Vector3;

use super::draw::Generator;
use crate::solver::evidence::EvidenceLine;
use crate::solver::line_pair::LinePair;

/// What scoring needs of a match.
#[derive(Debug, Clone, Copy)]
pub struct Sight {
    /// Ends of the source line in the source camera, m.
    pub source_ends_m: [Vector3<f64>; 2],
    /// Rays of the target segment's ends, z = 1.
    pub target_rays: [Vector3<f64>; 2],
    /// Inverse depths there, 1/m; `None` for a PnL match.
    pub inverse_depth_per_m: Option<[f64; 2]>,
}

/// What drawing needs of a line.
#[derive(Debug, Clone, Copy)]
pub struct PlacedLine {
    /// Middle of the observed part, m.
    pub middle_m: Vector3<f64>,
    /// Unit direction; its sign carries no meaning.
    pub direction: Vector3<f64>,
    /// Standard deviation of the direction, rad.
    pub sigma_direction_rad: f64,
    /// Standard deviation of the middle across the line, m.
    pub sigma_position_m: f64,
}

/// A match lifted on both sides.
#[derive(Debug, Clone, Copy)]
pub struct PlacedPair {
    /// In the target camera.
    pub target: PlacedLine,
    /// In the source camera.
    pub source: PlacedLine,
}

/// All matches, prepared; every list but `placed` is in the same order.
pub struct Sights<'a> {
    /// The matches.
    pub pairs: Vec<&'a LinePair>,
    /// Where each stood in the caller's list.
    pub order: Vec<usize>,
    /// For scoring.
    pub sights: Vec<Sight>,
    /// The full ones, for drawing.
    pub placed: Vec<PlacedPair>,
}

impl<'a> Sights<'a> {
    /// Sorts by what was measured, then shuffles with a fixed seed, so that any stretch of the list is a fair sample.
    pub fn new(pairs: &'a [LinePair]) -> Self {
        let mut order: Vec<usize> = (0..pairs.len()).collect();
        order.sort_by(|&a, &b| by_measurement(&pairs[a], &pairs[b]));
        let mut generator = Generator::new();
        for at in (1..order.len()).rev() {
            order.swap(at, generator.below(at + 1));
        }
        Self::of(order.iter().map(|&index| (index, &pairs[index])).collect())
    }

    /// Those of the matches that are not at these positions (ascending), in the same order.
    pub fn without(&self, positions: &[usize]) -> Self {
        let left = (0..self.pairs.len()).filter(|at| positions.binary_search(at).is_err());
        Self::of(left.map(|at| (self.order[at], self.pairs[at])).collect())
    }

    fn of(listed: Vec<(usize, &'a LinePair)>) -> Self {
        let (order, pairs): (Vec<usize>, Vec<&LinePair>) = listed.into_iter().unzip();
        let sights = pairs.iter().map(|pair| Sight::new(pair)).collect();
        let placed = pairs.iter().filter_map(|pair| {
            Some(PlacedPair {
                target: PlacedLine::new(pair.full_target()?),
                source: PlacedLine::new(&pair.source),
            })
        });
        let placed = placed.collect();
        Self { pairs, order, sights, placed }
    }

    /// What a pose that explains all of them perfectly would score.
    pub fn highest_score(&self) -> f64 {
        let n_full = self.placed.len();
        n_full as f64 + 0.5 * (self.pairs.len() - n_full) as f64
    }
}

impl Sight {
    fn new(pair: &LinePair) -> Self {
        let target = pair.target_observation();
        Self {
            source_ends_m: pair.source.ends_m.map(|end_m| end_m.coords),
            target_rays: target.ends.map(|ray| Vector3::new(ray.x, ray.y, 1.0)),
            inverse_depth_per_m: pair
                .full_target()
                .and_then(|line| line.observation.depth)
                .map(|depth| depth.inverse_depth_per_m),
        }
    }
}

impl PlacedLine {
    fn new(line: &EvidenceLine) -> Self {
        Self {
            middle_m: line.middle_m().coords,
            direction: line.direction.into_inner(),
            sigma_direction_rad: line.sigma_direction_rad,
            sigma_position_m: line.sigma_position_m,
        }
    }
}

/// Where a match is in both images, px: source start and end, target start and end.
pub fn places_px(pair: &LinePair) -> [f64; 8] {
    let [s, t] = [pair.source.observation.segment, pair.target_observation().segment];
    [s.start.x, s.start.y, s.end.x, s.end.y, t.start.x, t.start.y, t.end.x, t.end.y]
}

fn by_measurement(a: &LinePair, b: &LinePair) -> Ordering {
    let pairs_of_numbers = |a: &[f64], b: &[f64]| {
        a.iter().zip(b).map(|(a, b)| a.total_cmp(b)).find(|order| order.is_ne()).unwrap_or(Ordering::Equal)
    };
    let depths = |pair: &LinePair| {
        let target = pair.full_target().map_or([0.0; 2], |line| line.ends_m.map(|end_m| end_m.z));
        let source = pair.source.ends_m.map(|end_m| end_m.z);
        [source[0], source[1], target[0], target[1]]
    };
    pairs_of_numbers(&places_px(a), &places_px(b))
        .then_with(|| pairs_of_numbers(&depths(a), &depths(b)))
        .then(a.set.cmp(&b.set))
}
