//! Straight segments of a gray image: edges are drawn along the gradient's ridge, cut into straight fragments, and the
//! longest fragments grown into whole edges over small gaps.
//!
//! Long edges matter most: an edge interrupted by clutter comes out as one segment.
mod colour;
mod doubles;
mod fragment;
mod gradient;
mod grow;
mod samples;
mod trace;
mod track;

use crate::geometry::Segment;
use crate::image::{GrayView, RgbView};
use colour::Colour;
use doubles::{Kept, drop_doubles};
use fragment::Fragment;
use gradient::{COUNTS_PER_LEVEL, Gradient};
use grow::Grower;
use trace::{TraceLimits, Tracer};

/// Smallest image side worth looking at, px.
const MIN_SIDE_PX: usize = 16;
/// Most fragments kept of one image.
const MAX_FRAGMENTS: usize = 8192;
/// Shortest fragment that is grown, px.
const MIN_FRAGMENT_PX: f32 = 9.0;

/// What counts as a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectOptions {
    /// Shortest segment kept, px.
    pub min_length_px: f64,
    /// Least gradient along an edge, gray levels per px.
    pub min_gradient_levels_per_px: f64,
    /// Most segments of one image; the longest are kept.
    pub max_segments: usize,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self { min_length_px: 18.0, min_gradient_levels_per_px: 1.2, max_segments: 500 }
    }
}

/// Finds straight segments; owns its scratch memory, so that a stream allocates once.
#[derive(Debug)]
pub struct Detector {
    options: DetectOptions,
    gradient: Gradient,
    colour: Colour,
    tracer: Tracer,
    fragments: Vec<Fragment>,
    grower: Grower,
    grown: Vec<Segment>,
    kept: Vec<Kept>,
}

impl Detector {
    /// A detector with the given options.
    pub fn new(options: DetectOptions) -> Self {
        Self {
            options,
            gradient: Gradient::default(),
            colour: Colour::default(),
            tracer: Tracer::default(),
            fragments: Vec::new(),
            grower: Grower::default(),
            grown: Vec::new(),
            kept: Vec::new(),
        }
    }

    /// Replaces `segments` by those of a gray image, longest first; the same image gives the same segments, bit for bit.
    pub fn detect(&mut self, gray: &GrayView<'_>, segments: &mut Vec<Segment>) {
        self.detect_in(gray, None, segments);
    }

    /// The same for a colour image: also finds edges between colours that are equally bright, which its gray form `gray` does not
    /// show. There the redder side stands for the brighter one, or the bluer side.
    pub fn detect_color(&mut self, gray: &GrayView<'_>, rgb: &RgbView<'_>, segments: &mut Vec<Segment>) {
        let is_same_size = (gray.width(), gray.height()) == (rgb.width(), rgb.height());
        self.detect_in(gray, is_same_size.then_some(rgb), segments);
    }

    fn detect_in(&mut self, gray: &GrayView<'_>, rgb: Option<&RgbView<'_>>, segments: &mut Vec<Segment>) {
        segments.clear();
        if gray.width() < MIN_SIDE_PX || gray.height() < MIN_SIDE_PX {
            return;
        }
        self.gradient.compute(gray);
        if let Some(rgb) = rgb {
            self.colour.add(rgb, &mut self.gradient);
        }
        self.find_fragments();
        self.grower.reset(&self.gradient, MAX_FRAGMENTS);
        let grown = &mut self.grown;
        grown.clear();
        grown.reserve(MAX_FRAGMENTS);
        for fragment in &self.fragments {
            grown.extend(self.grower.grow(&self.gradient, fragment, self.options.min_length_px));
        }
        // The unstable sort allocates nothing; ties are broken by position, so that it stays deterministic.
        grown.sort_unstable_by(|a, b| {
            b.length_px()
                .total_cmp(&a.length_px())
                .then(a.start.y.total_cmp(&b.start.y))
                .then(a.start.x.total_cmp(&b.start.x))
        });
        self.kept.reserve(MAX_FRAGMENTS);
        drop_doubles(grown, &mut self.kept);
        segments.reserve(self.options.max_segments);
        segments.extend(grown.iter().take(self.options.max_segments));
    }

    /// Straight fragments, longest first.
    fn find_fragments(&mut self) {
        self.fragments.clear();
        self.fragments.reserve(MAX_FRAGMENTS);
        let least = (self.options.min_gradient_levels_per_px * COUNTS_PER_LEVEL).clamp(1.0, 16_000.0);
        let limits = TraceLimits { anchor: (1.2 * least) as i16, follow: least as i16 };
        let fragments = &mut self.fragments;
        self.tracer.trace(&self.gradient, limits, |chain| fragment::split(chain, fragments));
        fragments.retain(|fragment| fragment.length_px2() >= MIN_FRAGMENT_PX * MIN_FRAGMENT_PX);
        fragments.sort_unstable_by(|a, b| {
            b.length_px2()
                .total_cmp(&a.length_px2())
                .then(a.start.y.total_cmp(&b.start.y))
                .then(a.start.x.total_cmp(&b.start.x))
        });
    }
}

#[cfg(test)]
mod tests;
