//! From a frame to its lines: gray, detect, lift, surface, and what a source of matches wants to know of them. One finder per thread, with its own scratch memory.

use std::ops::AddAssign;
use std::time::{Duration, Instant};

use crate::capture::RgbdFrame;
use crate::geometry::{Camera, Segment};
use crate::image::{GrayView, RgbView, gray_from_rgb};
use crate::lines::{Describer, Detector, Lifter, sample_surface};

use super::buffers::FoundLines;
use super::motion::flow::Thumbnail;
use super::options::PipelineOptions;

/// Finds the lines of a frame; another one can be put into the pipeline, in tests for example.
pub trait LineFinder: Send {
    /// Replaces `found` by what `frame` shows; reuses its memory. The same frame gives the same bits.
    fn find(&mut self, frame: &RgbdFrame, camera: &Camera, found: &mut FoundLines) -> FindTimes;
}

/// How long the parts of finding took.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FindTimes {
    /// Gray conversion.
    pub gray: Duration,
    /// Segment detection.
    pub detect: Duration,
    /// Lifting and surface samples.
    pub lift: Duration,
    /// Descriptors.
    pub describe: Duration,
}

impl AddAssign for FindTimes {
    fn add_assign(&mut self, other: Self) {
        self.gray += other.gray;
        self.detect += other.detect;
        self.lift += other.lift;
        self.describe += other.describe;
    }
}

/// The finder of this library: [`Detector`], then [`Lifter`].
#[derive(Debug)]
pub struct SegmentLineFinder {
    detector: Detector,
    lifter: Lifter,
    /// `None` where nobody asks for descriptors.
    describer: Option<Describer>,
    keeps_images: bool,
    gray: Vec<u8>,
    segments: Vec<Segment>,
}

impl SegmentLineFinder {
    /// A finder with the given options.
    pub fn new(options: &PipelineOptions) -> Self {
        Self {
            detector: Detector::new(options.detect),
            lifter: Lifter::new(options.lift),
            describer: options.associate.needs_looks().then(Describer::new),
            keeps_images: options.associate.needs_images(),
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
        found.looks.clear();
        found.gray.1 = (0, 0);
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
        let grayed = Instant::now();
        {
            let _span = tracing::trace_span!("detect").entered();
            found.thumbnail = Thumbnail::of(&gray);
            self.detector.detect_color(&gray, &rgb, &mut self.segments);
        }
        let detected = Instant::now();
        let _span = tracing::trace_span!("lift").entered();
        self.lifter.lift(&self.segments, &depth, camera, &mut found.view.lines);
        sample_surface(&depth, camera, &mut found.view.surface);
        let lifted = Instant::now();
        if let Some(describer) = &mut self.describer {
            describer.describe(&rgb, &found.view.lines, &mut found.looks);
        }
        if self.keeps_images {
            // The buffers change places: nothing is copied.
            std::mem::swap(&mut self.gray, &mut found.gray.0);
            found.gray.1 = size;
        }
        FindTimes {
            gray: grayed - start,
            detect: detected - grayed,
            lift: lifted - detected,
            describe: lifted.elapsed(),
        }
    }
}
