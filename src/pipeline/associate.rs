//! Where candidate matches get their scores from: sources behind one trait, chosen by `estimate.association`.
//!
//! A source says how alike lines of two cameras look; whoever says nothing leaves all to geometry. Sources run in the estimator's
//! thread, and only for frame sets that brought evidence: they may take their time.

use crate::geometry::{CameraView, LineObservation, PairScores};

use super::buffers::FoundLines;

/// Which sources score candidate matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Association {
    /// Descriptors always, the learned matcher where there is one.
    #[default]
    Auto,
    /// None: lines are told apart by geometry alone.
    Geometric,
    /// Descriptors.
    Descriptor,
    /// The learned matcher.
    Onnx,
}

/// What a camera of a frame set shows to a source.
#[derive(Debug, Clone, Copy)]
pub struct SeenLines<'a> {
    /// Its lines; scores name them by their indices here.
    pub lines: &'a [LineObservation],
}

impl<'a> SeenLines<'a> {
    /// Of a view and what was found beside it.
    pub fn new(view: &'a CameraView, _found: &'a FoundLines) -> Self {
        Self { lines: &view.lines }
    }
}

/// Scores candidate matches of the lines of a frame set by how alike they look.
pub trait MatchSource: Send {
    /// The scores of each pair of cameras, a missing camera being `None`; incomplete once `keep_going` says no.
    fn score(&mut self, seen: &[Option<SeenLines<'_>>], keep_going: &dyn Fn() -> bool) -> Vec<PairScores>;
}

/// Says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Geometric;

impl MatchSource for Geometric {
    fn score(&mut self, _: &[Option<SeenLines<'_>>], _: &dyn Fn() -> bool) -> Vec<PairScores> {
        Vec::new()
    }
}

/// The source of an association.
pub fn source(association: Association) -> Box<dyn MatchSource> {
    match association {
        Association::Auto | Association::Geometric | Association::Descriptor | Association::Onnx => {
            Box::new(Geometric)
        }
    }
}
