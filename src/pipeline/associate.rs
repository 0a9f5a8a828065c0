//! Where candidate matches get their scores from: sources behind one trait, chosen by `estimate.association`.
//!
//! A source says how alike lines of two cameras look; whoever says nothing leaves all to geometry. Sources run in the estimator's
//! thread, and only for frame sets that brought evidence: they may take their time.

mod auto;
mod descriptor;
mod learned;
#[cfg(test)]
mod tests;

use crate::geometry::{CameraView, LineObservation, PairScores};
use crate::image::GrayView;
use crate::learned::LearnedOptions;
use crate::lines::LineDescriptor;

use super::buffers::FoundLines;
use auto::Auto;
use descriptor::Descriptors;
use learned::Learned;

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

/// Which sources, and what the learned one is made of.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct AssociateOptions {
    /// Which.
    pub association: Association,
    /// The learned matcher; without models there is none.
    pub learned: LearnedOptions,
}

impl AssociateOptions {
    /// Whether lines are to be described.
    pub(super) fn needs_looks(&self) -> bool {
        matches!(self.association, Association::Auto | Association::Descriptor)
    }

    /// Whether the images are to be kept beside their lines.
    pub(super) fn needs_images(&self) -> bool {
        matches!(self.association, Association::Auto | Association::Onnx) && !self.learned.models.is_empty()
    }
}

/// What a camera of a frame set shows to a source.
#[derive(Debug, Clone, Copy)]
pub struct SeenLines<'a> {
    /// Its lines; scores name them by their indices here.
    pub lines: &'a [LineObservation],
    /// One descriptor per line; none where nobody asked for them.
    pub looks: &'a [LineDescriptor],
    /// The image; `None` where nobody asked for it.
    pub image: Option<GrayView<'a>>,
}

impl<'a> SeenLines<'a> {
    /// Of a view, and what was found beside it.
    pub fn new(view: &'a CameraView, found: &'a FoundLines) -> Self {
        Self { lines: &view.lines, looks: &found.looks, image: found.image() }
    }
}

/// Scores candidate matches of the lines of a frame set by how alike they look.
pub trait MatchSource: Send {
    /// The scores of each pair of cameras, a missing camera being `None`; incomplete once `keep_going` says no.
    fn score(&mut self, seen: &[Option<SeenLines<'_>>], keep_going: &dyn Fn() -> bool) -> Vec<PairScores>;

    /// The least score, nats, by which this source would call two lines one edge, however few lines there are.
    fn least_nats(&self) -> f64 {
        0.0
    }

    /// A sentence for the user about what has to be done without, once.
    fn complaint(&mut self) -> Option<String> {
        None
    }
}

/// Says nothing.
#[derive(Debug, Clone, Copy, Default)]
pub struct Geometric;

impl MatchSource for Geometric {
    fn score(&mut self, _: &[Option<SeenLines<'_>>], _: &dyn Fn() -> bool) -> Vec<PairScores> {
        Vec::new()
    }
}

/// The source that is asked for. May take long, for models are loaded; what cannot be loaded is complained of and done without.
pub fn source(options: &AssociateOptions) -> Box<dyn MatchSource> {
    match options.association {
        Association::Geometric => Box::new(Geometric),
        Association::Descriptor => Box::new(Descriptors),
        Association::Onnx => {
            Box::new(Learned::load(&options.learned, "lines are told apart by geometry alone"))
        }
        Association::Auto if options.learned.models.is_empty() => Box::new(Descriptors),
        Association::Auto => {
            let learned = Learned::load(&options.learned, "lines are compared by their descriptors alone");
            Box::new(Auto::new(Box::new(learned), Box::new(Descriptors)))
        }
    }
}

/// Every pair of cameras that are both there, the smaller first.
fn pairs<T>(cameras: &[Option<T>]) -> impl Iterator<Item = ((usize, &T), (usize, &T))> {
    let there = || cameras.iter().enumerate().filter_map(|(camera, seen)| Some((camera, seen.as_ref()?)));
    there().flat_map(move |target| {
        there().filter(move |source| source.0 > target.0).map(move |source| (target, source))
    })
}
