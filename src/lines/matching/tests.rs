use super::*;
use crate::geometry::{DepthFit, EdgeSide, PixelPoint, RayPoint, Segment};
use crate::image::RgbView;
use crate::lines::describe::Describer;

const SIZE: (usize, usize) = (640, 480);
/// Patches along x and y; each has one upright edge in its middle.
const PATCHES: [usize; 2] = [8, 4];
const N_PATCHES: usize = PATCHES[0] * PATCHES[1];
const PATCH_PX: [usize; 2] = [80, 120];
/// The edges end this far from the border of their patch, px.
const MARGIN_PX: f64 = 8.0;

/// A number in 0..1 that depends on nothing but its key.
fn random(key: [usize; 4]) -> f64 {
    let mut state = 0x9E37_79B9_7F4A_7C15_u64;
    for part in key {
        state = (state ^ part as u64).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        state ^= state >> 29;
        state = state.wrapping_mul(0x94D0_49BB_1331_11EB);
        state ^= state >> 32;
    }
    (state >> 11) as f64 / (1_u64 << 53) as f64
}

/// How a picture of the patches is taken.
#[derive(Clone)]
struct Shot {
    /// Which edge of the world stands in each patch, and what is on its left and right.
    edges: Vec<[usize; 2]>,
    exposure: [f64; 3],
    noise_levels: f64,
}

impl Shot {
    fn plain() -> Self {
        Self { edges: (0..N_PATCHES).map(|edge| [edge; 2]).collect(), exposure: [1.0; 3], noise_levels: 0.0 }
    }

    /// The same edges at other places: edge `i` in patch `7 i + 3`.
    fn moved() -> Self {
        let mut shot = Self::plain();
        for edge in 0..N_PATCHES {
            shot.edges[patch_of(edge)] = [edge; 2];
        }
        shot
    }

    /// Light of a channel at a place of a patch, 0 to 1: a colour per side, with stains along the edge and a slope across it.
    fn light(&self, patch: usize, [x, y]: [usize; 2], channel: usize) -> f64 {
        let side = usize::from(x >= PATCH_PX[0] / 2);
        let surface = self.edges[patch][side];
        let colour = 0.03 + 0.25 * random([1, surface, side, channel]) + 0.3 * side as f64;
        let stain = 0.8 + 0.4 * random([2, surface, side, y / 15]);
        let slope = 0.02 * (random([3, surface, side, 0]) - 0.5);
        let across_px = (x as f64 - 39.5).abs();
        (colour * stain * (1.0 + slope * across_px) * self.exposure[channel]).clamp(0.0, 1.0)
    }

    fn pixels(&self) -> Vec<u8> {
        let mut pixels = Vec::with_capacity(3 * SIZE.0 * SIZE.1);
        for (i, channel) in (0..SIZE.0 * SIZE.1).flat_map(|i| [0, 1, 2].map(|channel| (i, channel))) {
            let (x, y) = (i % SIZE.0, i / SIZE.0);
            let patch = y / PATCH_PX[1] * PATCHES[0] + x / PATCH_PX[0];
            let linear = self.light(patch, [x % PATCH_PX[0], y % PATCH_PX[1]], channel);
            let encoded =
                if linear < 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 };
            let noise = self.noise_levels * (random([4, i, channel, self.edges[0][0]]) - 0.5) * 3.46;
            pixels.push((255.0 * encoded + noise).round().clamp(0.0, 255.0) as u8);
        }
        pixels
    }

    fn looks(&self, lines: &[LineObservation]) -> Vec<LineDescriptor> {
        let pixels = self.pixels();
        let image = RgbView::try_new(&pixels, SIZE, 3 * SIZE.0).expect("fits");
        let mut looks = Vec::new();
        Describer::new().describe(&image, lines, &mut looks);
        looks
    }
}

fn patch_of(edge: usize) -> usize {
    (7 * edge + 3) % N_PATCHES
}

/// The edge of each patch between two shares of its length; the right hand is the side of larger x.
fn lines_between(from: f64, to: f64) -> Vec<LineObservation> {
    let line = |patch: usize| {
        let x = (patch % PATCHES[0] * PATCH_PX[0]) as f64 + 39.5;
        let top = (patch / PATCHES[0] * PATCH_PX[1]) as f64 + MARGIN_PX;
        let length = PATCH_PX[1] as f64 - 2.0 * MARGIN_PX;
        // From the bottom up, so that the right hand is on the right.
        let [start, end] = [to, from].map(|share| PixelPoint { x, y: top + share * length });
        let segment = Segment { start, end, sigma_across_px: 0.1 };
        let ends =
            [start, end].map(|end| RayPoint { x: (end.x - 320.0) / 600.0, y: (end.y - 240.0) / 600.0 });
        LineObservation { segment, ends, sigma_across: 0.1 / 600.0, depth: None }
    };
    (0..N_PATCHES).map(line).collect()
}

/// Scores of the plain shot's edges against those of another, with lines cut differently in that one.
fn scores(source: &Shot, source_lines: &[LineObservation]) -> Vec<ScoredMatch> {
    let lines = lines_between(0.0, 1.0);
    let (target_looks, source_looks) = (Shot::plain().looks(&lines), source.looks(source_lines));
    let target = LooksOf { lines: &lines, looks: &target_looks };
    score_lines(target, LooksOf { lines: source_lines, looks: &source_looks })
}

fn best_of_target(scores: &[ScoredMatch], target: usize) -> Option<&ScoredMatch> {
    let of_line = scores.iter().filter(|found| found.target as usize == target);
    of_line.max_by(|a, b| a.nats.total_cmp(&b.nats))
}

/// How many edges have their counterpart as best candidate, with at least so many nats.
fn n_right(scores: &[ScoredMatch], min_nats: f64) -> usize {
    (0..N_PATCHES)
        .filter(|&edge| {
            best_of_target(scores, edge)
                .is_some_and(|best| best.source as usize == patch_of(edge) && best.nats >= min_nats)
        })
        .count()
}

fn owned_by_right() -> DepthFit {
    DepthFit {
        inverse_depth_per_m: [0.5; 2],
        covariance_per_m2: nalgebra::Matrix2::identity() * 1e-5,
        inlier_ratio: 1.0,
        n_inliers: 100,
        side: EdgeSide::Right,
    }
}

#[test]
fn edges_are_found_at_other_places_of_another_picture() {
    let scores = scores(&Shot::moved(), &lines_between(0.0, 1.0));
    assert_eq!(n_right(&scores, MATCH_NATS), N_PATCHES);
}

#[test]
fn exposure_and_white_balance_keep_the_matches() {
    for exposure in [[0.62, 0.60, 0.55], [1.3, 1.25, 1.4]] {
        let shot = Shot { exposure, ..Shot::moved() };
        let scores = scores(&shot, &lines_between(0.0, 1.0));
        assert!(n_right(&scores, MATCH_NATS) >= N_PATCHES - 1, "{}", n_right(&scores, MATCH_NATS));
    }
}

#[test]
fn noise_keeps_the_matches() {
    let shot = Shot { noise_levels: 6.0, ..Shot::moved() };
    assert!(n_right(&scores(&shot, &lines_between(0.0, 1.0)), MATCH_NATS) >= N_PATCHES - 1);
}

#[test]
fn another_background_on_one_side_keeps_the_match_of_the_other() {
    // As seen past the edge of a table: on every third edge the darker side shows something else.
    let mut shot = Shot::moved();
    let changed: Vec<usize> = (0..N_PATCHES).step_by(3).collect();
    for edge in &changed {
        shot.edges[patch_of(*edge)][0] = 1000 + edge;
    }
    let mut lines = lines_between(0.0, 1.0);
    lines.iter_mut().for_each(|line| line.depth = Some(owned_by_right()));
    let [target, source] = [Shot::plain(), shot].map(|shot| shot.looks(&lines));
    let [target, source] = [&target, &source].map(|looks| LooksOf { lines: &lines, looks });
    let scores = score_lines(target, source);
    let is_right = |edge: &&usize| {
        best_of_target(&scores, **edge).is_some_and(|best| best.source as usize == patch_of(**edge))
    };
    let kept = changed.iter().filter(is_right).count();
    assert!(4 * kept >= 3 * changed.len(), "{kept} of {} kept", changed.len());
}

#[test]
fn half_of_an_edge_matches_the_whole() {
    for (from, to) in [(0.0, 0.5), (0.5, 1.0), (0.25, 0.75)] {
        let scores = scores(&Shot::moved(), &lines_between(from, to));
        assert!(n_right(&scores, 3.0) >= N_PATCHES - 2, "{from} to {to}: {}", n_right(&scores, 3.0));
    }
}

#[test]
fn swapped_roles_give_the_same_bits() {
    let (whole, part) = (lines_between(0.0, 1.0), lines_between(0.1, 0.7));
    let shot = Shot { exposure: [0.7, 0.6, 0.65], noise_levels: 3.0, ..Shot::moved() };
    let looks = [Shot::plain().looks(&whole), shot.looks(&part)];
    let [a, b] = [LooksOf { lines: &whole, looks: &looks[0] }, LooksOf { lines: &part, looks: &looks[1] }];
    let there = score_lines(a, b);
    let mut back = score_lines(b, a);
    for found in &mut back {
        (found.target, found.source) = (found.source, found.target);
    }
    back.sort_by_key(|found| (found.target, found.source));
    assert!(there.len() > N_PATCHES && there == back);
}

#[test]
fn pictures_of_different_places_have_no_match() {
    let mut shot = Shot::plain();
    shot.edges = (0..N_PATCHES).map(|edge| [500 + edge; 2]).collect();
    let scores = scores(&shot, &lines_between(0.0, 1.0));
    let strongest = scores.iter().map(|found| found.nats).fold(0.0, f64::max);
    assert!(strongest < MATCH_NATS - 1.0, "{strongest}");
}

#[test]
fn a_repeated_edge_is_less_sure_than_a_unique_one() {
    let lines = lines_between(0.0, 1.0);
    let mut shot = Shot::moved();
    shot.edges[patch_of(1)] = shot.edges[patch_of(0)];
    let target_looks = Shot::plain().looks(&lines);
    let source_looks = shot.looks(&lines);
    let scores = score_lines(
        LooksOf { lines: &lines, looks: &target_looks },
        LooksOf { lines: &lines, looks: &source_looks },
    );
    let nats = |edge: usize| {
        let place = scores
            .iter()
            .find(|found| (found.target as usize, found.source as usize) == (edge, patch_of(edge)));
        place.map_or(0.0, |found| found.nats)
    };
    assert!(nats(0) > 1.0 && nats(0) < nats(2) - 1.0, "{} and {}", nats(0), nats(2));
}

#[test]
fn no_lines_and_lines_without_looks_give_nothing() {
    let lines = lines_between(0.0, 1.0);
    let looks = Shot::plain().looks(&lines);
    let all = LooksOf { lines: &lines, looks: &looks };
    let none = LooksOf { lines: &lines, looks: &[] };
    assert!(score_lines(all, none).is_empty() && score_lines(none, all).is_empty());
    let blank = vec![LineDescriptor::default(); lines.len()];
    assert!(score_lines(all, LooksOf { lines: &lines, looks: &blank }).is_empty());
}
