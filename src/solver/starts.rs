//! Where the poses of a pair are looked for: rotation modes, translation peaks of each, and the best of all by a quick score.
//!
//! Votes know nothing of appearance, so that whoever rivals a pose that looks right is found as surely as without it. Where such a pose
//! is known beforehand, only what could rival it is looked for: a rival aligns a good part of the directions that it aligns, and
//! brings a good part of its lines together.

use super::association::coarse_score;
use super::candidates::Candidate;
use super::rotation_vote::{RotationMode, rotation_modes, support};
use super::translation_vote::{Blur, COARSE, FINE, TranslationGrid, translation_lines};
use crate::geometry::motion::{Motion, rotation_gap_rad, translation_gap_m};

/// Rotations tried.
const MAX_MODES: usize = 100;
/// Translations tried per rotation, by the rotation's rank: where lines share a room's axes, the true rotation leads, and the
/// true translation may hide among many peaks of parallel bundles.
const PEAKS_BY_RANK: [(usize, usize, Blur); 3] = [(6, 800, FINE), (60, 60, COARSE), (MAX_MODES, 12, COARSE)];
/// The same for rivals of a known pose; the rotation nearest to its own comes first: lines that are shifted as a whole are the
/// likeliest rivals.
const PEAKS_OF_RIVALS: [(usize, usize, Blur); 2] = [(1, 800, FINE), (MAX_MODES, 60, COARSE)];
/// Poses refined.
const MAX_STARTS: usize = 160;
/// Starts closer than this settle on the same pose (1.1 degrees and 6 cm).
const SAME_START: (f64, f64) = (0.02, 0.06);
/// A rival has at least this share of the known pose's directions and of its quick score: less than half of its lines ...
const RIVAL_SHARE: f64 = 0.4;
/// ... but so many of the best are looked at whatever they have.
const MIN_STARTS: usize = 12;

/// How poses are looked for.
pub struct Search<'a> {
    /// A pose that is known to explain much; `None` looks everywhere.
    pub known: Option<&'a Motion>,
    /// Largest distance between the two cameras, m.
    pub max_baseline_m: f64,
    /// Asked often; once it says no, the search is given up.
    pub keep_going: &'a dyn Fn() -> bool,
}

/// Poses near which a true one may lie, the best by the quick score first.
pub fn starts(candidates: &[Candidate], search: &Search<'_>) -> Vec<Motion> {
    let mut modes = rotation_modes(candidates, MAX_MODES, search.keep_going);
    let (mut ranks, mut least) = (&PEAKS_BY_RANK[..], 0.0);
    if let Some(known) = search.known {
        least = RIVAL_SHARE * quick_score(candidates, known);
        modes = rivals(candidates, modes, known);
        ranks = &PEAKS_OF_RIVALS;
    }
    let mut poses: Vec<(Motion, f64)> = Vec::new();
    let mut first = 0;
    for &(end, max_peaks, blur) in ranks {
        let mut grid = TranslationGrid::new(search.max_baseline_m, blur.cell_m);
        for mode in modes.iter().take(end).skip(first).take_while(|_| (search.keep_going)()) {
            let lines = translation_lines(candidates, &mode.target_from_source);
            for translation_m in grid.peaks(candidates, &lines, max_peaks) {
                let score = coarse_score(candidates, &lines, (&translation_m, &blur));
                poses.push((Motion::from_parts(translation_m.into(), mode.target_from_source), score));
            }
        }
        first = end;
    }
    poses.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut kept: Vec<Motion> = Vec::new();
    for (pose, score) in poses {
        if kept.len() >= MAX_STARTS || (score < least && kept.len() >= MIN_STARTS) {
            break;
        }
        if kept.iter().all(|other| !is_same_start(other, &pose)) {
            kept.push(pose);
        }
    }
    kept
}

fn is_same_start(a: &Motion, b: &Motion) -> bool {
    rotation_gap_rad(a, b) <= SAME_START.0 && translation_gap_m(a, b) <= SAME_START.1
}

fn quick_score(candidates: &[Candidate], pose: &Motion) -> f64 {
    let lines = translation_lines(candidates, &pose.rotation);
    coarse_score(candidates, &lines, (&pose.translation.vector, &COARSE))
}

/// The rotations of what could rival a known pose, the one nearest to its own first.
fn rivals(candidates: &[Candidate], modes: Vec<RotationMode>, known: &Motion) -> Vec<RotationMode> {
    let own =
        RotationMode { target_from_source: known.rotation, support: support(candidates, &known.rotation) };
    let gap_rad = |mode: &RotationMode| mode.target_from_source.angle_to(&known.rotation);
    let nearest = modes.iter().copied().min_by(|a, b| gap_rad(a).total_cmp(&gap_rad(b)));
    let nearest = nearest.filter(|mode| gap_rad(mode) < SAME_START.0).unwrap_or(own);
    let others = modes.into_iter().filter(|mode| {
        mode.support >= RIVAL_SHARE * own.support && mode.target_from_source != nearest.target_from_source
    });
    std::iter::once(nearest).chain(others).collect()
}
