//! From a frame to its lines: gray, detect, lift, surface. One finder per thread, with its own scratch memory.

use std::time::{Duration, Instant};

use crate::capture::RgbdFrame;
use crate::geometry::{Camera, Segment};
use crate::image::{GrayView, RgbView, gray_from_rgb};
use crate::lines::{DetectOptions, Detector, LiftOptions, Lifter, sample_surface};

use super::buffers::FoundLines;
use super::motion::Thumbnail;

/// Finds the lines of a frame; another one can be put into the pipeline, in tests for example.
pub trait LineFinder: Send {
    /// Replaces `found` by what `frame` shows; reuses its memory. The same frame gives the same bits.
    fn find(&mut self, frame: &RgbdFrame, camera: &Camera, found: &mut FoundLines) -> FindTimes;
}

/// How long the parts of finding took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FindTimes {
    /// Gray conversion and segment detection.
    pub detect: Duration,
    /// Lifting and surface samples.
    pub lift: Duration,
}

/// The finder of this library: [`Detector`], then [`Lifter`].
#[derive(Debug)]
pub struct SegmentLineFinder {
    detector: Detector,
    lifter: Lifter,
    gray: Vec<u8>,
    segments: Vec<Segment>,
}

impl SegmentLineFinder {
    /// A finder with the given options.
    pub fn new(detect: DetectOptions, lift: LiftOptions) -> Self {
        Self {
            detector: Detector::new(detect),
            lifter: Lifter::new(lift),
            gray: Vec::new(),
            segments: Vec::new(),
        }
    }
}

impl LineFinder for SegmentLineFinder {
    fn find(&mut self, frame: &RgbdFrame, camera: &Camera, found: &mut FoundLines) -> FindTimes {
        let start = Instant::now();
        found.view.lines.clear();
        found.view.surface.clear();
        found.thumbnail = Thumbnail::default();
        gray_from_rgb(&frame.rgb, &mut self.gray);
        let size = (frame.width, frame.height);
        let views = (
            GrayView::try_new(&self.gray, size, frame.width),
            RgbView::try_new(&frame.rgb, size, 3 * frame.width),
            frame.depth_view(),
        );
        let (Some(gray), Some(rgb), Some(depth)) = views else {
            return FindTimes::default();
        };
        {
            let _span = tracing::trace_span!("detect").entered();
            found.thumbnail = Thumbnail::of(&gray);
            self.detector.detect_color(&gray, &rgb, &mut self.segments);
        }
        let detected = Instant::now();
        let _span = tracing::trace_span!("lift").entered();
        self.lifter.lift(&self.segments, &depth, camera, &mut found.view.lines);
        sample_surface(&depth, camera, &mut found.view.surface);
        FindTimes { detect: detected - start, lift: detected.elapsed() }
    }
}
