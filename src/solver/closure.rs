//! Do the poses of the pairs close around every loop of cameras? If not, which pair or camera is to be suspected.
//!
//! A loop is judged by its own covariance and by absolute bounds. A single wrong pair lies in every loop that misses and in none
//! that closes; a wrong camera likewise. Where that does not single one out, nobody is accused, and no pair of a loop that misses
//! is trusted.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::{Matrix3, Matrix6, Vector6};

use crate::geometry::motion::{Motion, d_inverse_step_d_step, hat};

/// A loop may miss by this much (squared, in standard deviations; 99.9 % for six degrees of freedom is 22.5).
const MAX_DISTANCE2: f64 = 30.0;
/// Below this for each pair of the loop it closes whatever the covariance says: what lenses and depth sensors are off alike in all
/// lines is not in it, rad (0.1 degrees) ...
const NEGLIGIBLE_RAD: f64 = 0.0017;
/// ... and m.
const NEGLIGIBLE_M: f64 = 0.003;
/// Above this for each pair of the loop it misses whatever the covariance says: the bound of a good rig, rad (0.3 degrees) ...
const MAX_RAD: f64 = 0.0052;
/// ... and m.
const MAX_M: f64 = 0.010;

/// A motion and the covariance of a step of it (x y z rx ry rz).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UncertainMotion {
    /// The motion.
    pub motion: Motion,
    /// Its covariance, m and rad.
    pub covariance: Matrix6<f64>,
}

impl UncertainMotion {
    fn identity() -> Self {
        Self { motion: Motion::identity(), covariance: Matrix6::zeros() }
    }

    /// The way back.
    pub fn inverse(&self) -> Self {
        let d_step = d_inverse_step_d_step(&self.motion);
        Self { motion: self.motion.inverse(), covariance: d_step * self.covariance * d_step.transpose() }
    }

    /// `self * next`, their errors independent.
    pub fn then(&self, next: &Self) -> Self {
        let turn = self.motion.rotation.to_rotation_matrix().into_inner();
        // t = t1 + R1 t2, so that dt = dt1 + dr1 x R1 t2 + R1 dt2, and dr = dr1 + R1 dr2.
        let carried_m = turn * next.motion.translation.vector;
        let d_first = blocks(&Matrix3::identity(), &-hat(&carried_m));
        let d_next = blocks(&turn, &Matrix3::zeros());
        Self {
            motion: self.motion * next.motion,
            covariance: d_first * self.covariance * d_first.transpose()
                + d_next * next.covariance * d_next.transpose(),
        }
    }

    /// Squared distance from standing still, in standard deviations; `None` when the covariance is singular.
    pub fn distance2(&self) -> Option<f64> {
        let (t, r) = (self.motion.translation.vector, self.motion.rotation.scaled_axis());
        let gap = Vector6::new(t.x, t.y, t.z, r.x, r.y, r.z);
        Some(gap.dot(&self.covariance.cholesky()?.solve(&gap)))
    }
}

/// `[[diagonal, corner], [0, diagonal]]`.
fn blocks(diagonal: &Matrix3<f64>, corner: &Matrix3<f64>) -> Matrix6<f64> {
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(diagonal);
    matrix.fixed_view_mut::<3, 3>(3, 3).copy_from(diagonal);
    matrix.fixed_view_mut::<3, 3>(0, 3).copy_from(corner);
    matrix
}

/// The pose of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairPose {
    /// Index of the target camera, then of the source.
    pub cameras: [usize; 2],
    /// `target_from_source`.
    pub pose: UncertainMotion,
    /// Independent matches behind it.
    pub matches: usize,
}

/// A way through the pairs back to its first camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Loop {
    /// The cameras in turn, each once.
    pub cameras: Vec<usize>,
    /// The pairs walked (indices), ascending.
    pairs: Vec<usize>,
    /// By how much it misses, rad.
    pub gap_rad: f64,
    /// By how much it misses, m.
    pub gap_m: f64,
    /// The same, squared, in standard deviations.
    pub distance2: f64,
}

impl Loop {
    fn closes(&self) -> bool {
        let n = self.pairs.len() as f64;
        let is_within = |rad: f64, m: f64| self.gap_rad <= n * rad && self.gap_m <= n * m;
        is_within(NEGLIGIBLE_RAD, NEGLIGIBLE_M)
            || (self.distance2 <= MAX_DISTANCE2 && is_within(MAX_RAD, MAX_M))
    }
}

/// Who makes loops miss.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Suspect {
    /// The only pair that is in every loop that misses and in none that closes (index).
    Pair(usize),
    /// The only such camera.
    Camera(usize),
    /// It cannot be told; of the pairs in question this one (index) has the fewest matches.
    Unknown(usize),
}

/// Loops that do not close.
#[derive(Debug, Clone, PartialEq)]
pub struct Miss {
    /// The one that misses by most of what is allowed.
    pub worst: Loop,
    /// How many do not close.
    pub n_open: usize,
    /// Who it was.
    pub suspect: Suspect,
    /// The pairs (indices) that are not to be trusted.
    pub untrusted: Vec<usize>,
}

/// Walks the loops of the pairs; `None` when all close, or there is none.
pub fn find_miss(pairs: &[PairPose]) -> Option<Miss> {
    let (closed, open): (Vec<Loop>, Vec<Loop>) = loops(pairs).into_iter().partition(Loop::closes);
    let worst = open.iter().max_by(|a, b| a.distance2.total_cmp(&b.distance2))?.clone();
    let miss = |suspect, untrusted| Miss { worst, n_open: open.len(), suspect, untrusted };
    let is_bad = |is_part: &dyn Fn(&Loop) -> bool| open.iter().all(is_part) && !closed.iter().any(is_part);
    let by_pair = (0..pairs.len()).filter(|pair| is_bad(&|walk: &Loop| walk.pairs.contains(pair)));
    let cameras: BTreeSet<usize> = open.iter().flat_map(|walk| walk.cameras.iter().copied()).collect();
    // One open loop may as well be one wrong pair of it.
    let by_camera = cameras
        .into_iter()
        .filter(|camera| open.len() > 1 && is_bad(&|walk: &Loop| walk.cameras.contains(camera)));
    let suspect = only(by_pair).map(Suspect::Pair).or_else(|| only(by_camera).map(Suspect::Camera));
    let all_open: BTreeSet<usize> = open.iter().flat_map(|walk| walk.pairs.iter().copied()).collect();
    if let Some(suspect) = suspect {
        let is_of_suspect = |idx: usize| match suspect {
            Suspect::Camera(camera) => pairs[idx].cameras.contains(&camera),
            Suspect::Pair(pair) | Suspect::Unknown(pair) => idx == pair,
        };
        // Without the suspect the rest must close; what then lies in no loop and was in one that missed, nothing vouches for.
        let rest: Vec<usize> = (0..pairs.len()).filter(|&idx| !is_of_suspect(idx)).collect();
        let rest_loops = loops(&rest.iter().map(|&idx| pairs[idx]).collect::<Vec<_>>());
        if rest_loops.iter().all(Loop::closes) {
            let vouched: BTreeSet<usize> =
                rest_loops.iter().flat_map(|walk| walk.pairs.iter().map(|&idx| rest[idx])).collect();
            let is_untrusted =
                |idx: &usize| is_of_suspect(*idx) || (all_open.contains(idx) && !vouched.contains(idx));
            return Some(miss(suspect, (0..pairs.len()).filter(is_untrusted).collect()));
        }
    }
    let is_vouched = |idx: &usize| closed.iter().any(|walk| walk.pairs.contains(idx));
    let unvouched = || all_open.iter().copied().filter(|idx| !is_vouched(idx));
    let untrusted: Vec<usize> =
        if unvouched().next().is_some() { unvouched().collect() } else { all_open.iter().copied().collect() };
    let weakest = untrusted.iter().copied().min_by_key(|idx| pairs[*idx].matches)?;
    Some(miss(Suspect::Unknown(weakest), untrusted))
}

/// The only one; `None` of none or several.
fn only(mut of: impl Iterator<Item = usize>) -> Option<usize> {
    of.next().filter(|_| of.next().is_none())
}

/// Every triangle, and for every pair the shortest way back.
fn loops(pairs: &[PairPose]) -> Vec<Loop> {
    let mut found: BTreeMap<Vec<usize>, Loop> = BTreeMap::new();
    for (idx, pair) in pairs.iter().enumerate() {
        let [target, source] = pair.cameras;
        let others = pairs.iter().flat_map(|other| other.cameras).collect::<BTreeSet<_>>();
        let triangles = others
            .into_iter()
            .filter(|&other| {
                pair_of(pairs, target, other).is_some() && pair_of(pairs, other, source).is_some()
            })
            .map(|other| vec![target, other, source]);
        for cameras in triangles.chain(way_round(pairs, idx)) {
            if let Some(walk) = walked(pairs, cameras) {
                found.entry(walk.pairs.clone()).or_insert(walk);
            }
        }
    }
    found.into_values().collect()
}

fn pair_of(pairs: &[PairPose], a: usize, b: usize) -> Option<usize> {
    pairs.iter().position(|pair| pair.cameras == [a, b] || pair.cameras == [b, a])
}

/// The fewest cameras from a pair's target to its source by other pairs.
fn way_round(pairs: &[PairPose], avoided: usize) -> Option<Vec<usize>> {
    let [target, source] = pairs[avoided].cameras;
    let mut ways = VecDeque::from([vec![target]]);
    let mut seen = BTreeSet::from([target]);
    while let Some(way) = ways.pop_front() {
        let here = *way.last()?;
        if here == source {
            return Some(way);
        }
        for (idx, pair) in pairs.iter().enumerate() {
            let [a, b] = pair.cameras;
            let next = if a == here { b } else { a };
            if idx != avoided && (a == here || b == here) && seen.insert(next) {
                ways.push_back([&way[..], &[next]].concat());
            }
        }
    }
    None
}

/// Walks around a loop; `None` where two of its cameras are no pair or a covariance is singular.
fn walked(pairs: &[PairPose], cameras: Vec<usize>) -> Option<Loop> {
    let mut round = UncertainMotion::identity();
    let mut walked = Vec::new();
    for (place, &here) in cameras.iter().enumerate() {
        let next = cameras[(place + 1) % cameras.len()];
        let idx = pair_of(pairs, here, next)?;
        let PairPose { cameras: [target, _], pose, .. } = pairs[idx];
        round = round.then(&if target == here { pose } else { pose.inverse() });
        walked.push(idx);
    }
    walked.sort_unstable();
    let (gap_m, gap_rad) = (round.motion.translation.vector.norm(), round.motion.rotation.angle());
    Some(Loop { cameras, pairs: walked, gap_rad, gap_m, distance2: round.distance2()? })
}
