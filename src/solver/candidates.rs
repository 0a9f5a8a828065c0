//! Candidate matches of a pair of cameras: every lifted source line with every lifted target line of the same frame set.
//!
//! All of them, whatever they look like: appearance only says which are likelier. Parallel bundles would vote n × m times for what is
//! one direction, so each candidate carries a weight that makes a bundle of n by m lines count like min(n, m) matches.

use nalgebra::Vector3;

use super::appearance::nats_of;
use super::evidence::{Evidence, EvidenceLine, EvidenceView};
use crate::geometry::ScoredMatch;

/// Lines within this angle belong to one bundle, rad (5 degrees: detection plus lifting noise of short lines).
const BUNDLE_ANGLE_RAD: f64 = 0.087;

/// One candidate: indices into the evidence, and what voting needs at hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate {
    /// Index of the frame set.
    pub set: u32,
    /// Index of the target line in its view.
    pub target: u16,
    /// Index of the source line in its view.
    pub source: u16,
    /// 1 / the larger of both bundles.
    pub weight: f64,
    /// Unit direction of the target line, in the target.
    pub target_direction: Vector3<f64>,
    /// Unit direction of the source line, in the source.
    pub source_direction: Vector3<f64>,
    /// Middle of the target line, in the target, m.
    pub target_middle_m: Vector3<f64>,
    /// Middle of the source line, in the source, m.
    pub source_middle_m: Vector3<f64>,
    /// Standard deviation of the angle between both directions, rad.
    pub sigma_angle_rad: f64,
    /// Standard deviation of the distance between both middles across the lines, m.
    pub sigma_position_m: f64,
    /// What appearance says for it, as far as that is believed, nats; 0 says nothing.
    pub nats: f64,
}

/// The two cameras of a pair and their lines.
#[derive(Debug, Clone, Copy)]
pub struct PairEvidence<'a> {
    /// Everything stored.
    pub evidence: &'a Evidence,
    /// Index of the target camera.
    pub target: usize,
    /// Index of the source camera.
    pub source: usize,
}

impl<'a> PairEvidence<'a> {
    /// Target and source views of one set; `None` when one of the cameras was missing.
    pub fn views(&self, set: usize) -> Option<(&'a EvidenceView, &'a EvidenceView)> {
        let views = &self.evidence.sets.get(set)?.views;
        Some((views.get(self.target)?.as_ref()?, views.get(self.source)?.as_ref()?))
    }

    /// Target and source lines of one set; `None` when one of the cameras was missing.
    pub fn lines(&self, set: usize) -> Option<(&'a [EvidenceLine], &'a [EvidenceLine])> {
        let (target, source) = self.views(set)?;
        Some((&target.lines, &source.lines))
    }

    /// The two lines of a candidate.
    pub fn pair(&self, candidate: &Candidate) -> Option<(&'a EvidenceLine, &'a EvidenceLine)> {
        let (targets, sources) = self.lines(candidate.set as usize)?;
        Some((targets.get(usize::from(candidate.target))?, sources.get(usize::from(candidate.source))?))
    }

    /// What appearance says of the lines of one set, sorted by source and target; empty where nobody compared.
    pub fn scores(&self, set: usize) -> &'a [ScoredMatch] {
        let sets = &self.evidence.sets;
        let mut of_set = sets.get(set).into_iter().flat_map(|set| &set.scores);
        of_set
            .find(|scores| (scores.target, scores.source) == (self.target, self.source))
            .map_or(&[], |scores| &scores.matches)
    }

    /// Every cross pair of every set whose directions are known better than `max_sigma_angle_rad`.
    pub fn candidates(&self, max_sigma_angle_rad: f64) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for set in 0..self.evidence.sets.len() {
            let Some((targets, sources)) = self.lines(set) else { continue };
            let target_bundles = bundle_sizes(targets);
            let source_bundles = bundle_sizes(sources);
            let scores = self.scores(set);
            for (source_idx, source) in sources.iter().enumerate() {
                for (target_idx, target) in targets.iter().enumerate() {
                    let sigma_angle_rad = target.sigma_direction_rad.hypot(source.sigma_direction_rad);
                    if sigma_angle_rad > max_sigma_angle_rad {
                        continue;
                    }
                    let bundle = target_bundles[target_idx].max(source_bundles[source_idx]);
                    candidates.push(Candidate {
                        set: set as u32,
                        target: target_idx as u16,
                        source: source_idx as u16,
                        weight: 1.0 / bundle as f64,
                        target_direction: target.direction.into_inner(),
                        source_direction: source.direction.into_inner(),
                        target_middle_m: target.middle_m().coords,
                        source_middle_m: source.middle_m().coords,
                        sigma_angle_rad,
                        sigma_position_m: target.sigma_position_m.hypot(source.sigma_position_m),
                        nats: nats_of(scores, (target_idx, source_idx)),
                    });
                }
            }
        }
        candidates
    }
}

/// For each line, how many lines of the view are (nearly) parallel to it, itself included.
fn bundle_sizes(lines: &[EvidenceLine]) -> Vec<usize> {
    let least_cosine = BUNDLE_ANGLE_RAD.cos();
    lines
        .iter()
        .map(|line| {
            lines.iter().filter(|other| line.direction.dot(&other.direction).abs() >= least_cosine).count()
        })
        .collect()
}
