//! The buffers that travel through the pipeline and come back: frames, lines of a frame, lines of a set.

use std::time::{Duration, Instant};

use crate::capture::{RgbdFrame, StampNs, TurnRate};
use crate::geometry::{Camera, CameraView};
use crate::image::GrayView;
use crate::lines::LineDescriptor;

use super::MAX_CAMERAS;
use super::motion::flow::Thumbnail;

/// Room for lines and surface samples that a busy 640 x 480 image needs; more would allocate once.
const LINES_RESERVED: usize = 1024;
const SURFACE_RESERVED: usize = 4096;

/// What is common to the frames of a set.
#[derive(Debug, Clone, Copy)]
pub(super) struct SetHeader {
    /// Number of the set among those sent to the line stage; no gaps.
    pub(super) id: u64,
    pub(super) n_members: usize,
    pub(super) newest_stamp: StampNs,
    pub(super) newest_arrival: Instant,
    pub(super) skew: Duration,
}

impl SetHeader {
    fn empty(now: Instant) -> Self {
        let newest_stamp = StampNs::default();
        Self { id: 0, n_members: 0, newest_stamp, newest_arrival: now, skew: Duration::ZERO }
    }
}

/// A frame, whose it is, and the set it belongs to once sync has found one.
#[derive(Debug)]
pub(super) struct FrameSlot {
    pub(super) frame: RgbdFrame,
    pub(super) camera: usize,
    /// `None` only before the slot's first frame.
    pub(super) intrinsics: Option<Camera>,
    pub(super) arrival: Instant,
    pub(super) set: SetHeader,
}

impl FrameSlot {
    pub(super) fn new(camera: usize, now: Instant) -> Self {
        let frame = RgbdFrame::default();
        Self { frame, camera, intrinsics: None, arrival: now, set: SetHeader::empty(now) }
    }
}

/// What a line finder makes of a frame.
#[derive(Debug, Clone, Default)]
pub struct FoundLines {
    /// The lines and surface samples.
    pub view: CameraView,
    /// What the lines look like, in their order; none where nobody asked.
    pub looks: Vec<LineDescriptor>,
    /// The coarse image, for the motion test.
    pub thumbnail: Thumbnail,
    /// The gray image without gaps between its rows, and its width and height, px; empty where nobody asked.
    pub(super) gray: (Vec<u8>, (usize, usize)),
}

impl FoundLines {
    /// The image, where it was kept.
    pub fn image(&self) -> Option<GrayView<'_>> {
        let (pixels, size) = &self.gray;
        GrayView::try_new(pixels, *size, size.0)
    }
}

/// The lines of one frame.
#[derive(Debug)]
pub(super) struct LineSlot {
    pub(super) found: FoundLines,
    pub(super) camera: usize,
    pub(super) intrinsics: Option<Camera>,
    pub(super) stamp: StampNs,
    pub(super) turn_rate: Option<TurnRate>,
    pub(super) set: SetHeader,
}

impl LineSlot {
    pub(super) fn new(now: Instant) -> Self {
        let view = CameraView {
            lines: Vec::with_capacity(LINES_RESERVED),
            surface: Vec::with_capacity(SURFACE_RESERVED),
        };
        let looks = Vec::with_capacity(LINES_RESERVED);
        let found = FoundLines { view, looks, ..FoundLines::default() };
        let stamp = StampNs::default();
        Self { found, camera: 0, intrinsics: None, stamp, turn_rate: None, set: SetHeader::empty(now) }
    }
}

/// The lines of one frame set.
#[derive(Debug)]
pub(super) struct LineSet {
    pub(super) header: SetHeader,
    pub(super) slots: [Option<Box<LineSlot>>; MAX_CAMERAS],
}

impl LineSet {
    pub(super) fn new(now: Instant) -> Self {
        Self { header: SetHeader::empty(now), slots: std::array::from_fn(|_| None) }
    }
}
