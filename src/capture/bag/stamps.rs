//! One clock for all images: counters that wrap, depth beside its colour, and cameras whose own clocks know nothing of each other.

use super::device::{Device, Stamped};
use super::file::Place;
use crate::capture::frame::TurnRate;

/// ns; hardware counts microseconds in 32 bits.
const WRAP_NS: i64 = (1 << 32) * 1_000;
/// ns; depth that is further from its colour belongs to another frame: half the time between frames at 30 Hz.
const MAX_DEPTH_GAP_NS: i64 = 17_000_000;
/// ns; frames of two cameras that are further apart do not even begin to be one set. What is too far is up to the sync limit.
const MAX_SET_GAP_NS: i64 = 50_000_000;
/// ns; how long before the first frame the gyro counts.
const FIRST_INTERVAL_NS: i64 = 33_333_333;

/// One frame of a camera: colour with the depth that is nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BagFrame {
    pub(super) stamp_ns: i64,
    pub(super) color: Place,
    pub(super) depth: Place,
    pub(super) turn_rate: Option<TurnRate>,
}

/// Makes the stamps of a device go on where its counter begins again.
pub(super) fn unwrap(device: &mut Device) {
    let Device { color, depth, gyro, .. } = device;
    let images = color.images.iter_mut().chain(&mut depth.images);
    let images = images.map(|image| (image.place, &mut image.stamp_ns));
    let samples = gyro.iter_mut().map(|(place, sample)| (*place, &mut sample.stamp_ns));
    let mut stamps: Vec<(Place, &mut i64)> = images.chain(samples).collect();
    // Time since 1970 is far beyond the counter.
    if stamps.iter().any(|(_, stamp)| **stamp >= WRAP_NS) {
        return;
    }
    stamps.sort_unstable_by_key(|(place, _)| *place);
    let (mut wraps, mut last_ns) = (0, stamps.first().map_or(0, |(_, stamp)| **stamp));
    for (_, stamp) in stamps {
        let counted_ns = *stamp;
        if counted_ns < last_ns - WRAP_NS / 2 {
            wraps += 1;
        } else if wraps > 0 && counted_ns > last_ns + WRAP_NS / 2 {
            // From before the wrap, and late.
            wraps -= 1;
        }
        last_ns = counted_ns;
        *stamp += wraps * WRAP_NS;
    }
}

/// The frames of a device in increasing order: every colour image that has a depth image near it, each used once.
pub(super) fn frames(device: &Device) -> Vec<BagFrame> {
    let (color, depth) = (increasing(&device.color.images), increasing(&device.depth.images));
    let stamps = |images: &[Stamped]| images.iter().map(|image| image.stamp_ns).collect::<Vec<_>>();
    let partners = nearest_partners(&stamps(&color), &stamps(&depth), MAX_DEPTH_GAP_NS);
    let mut rates = TurnRates::new(device);
    let frame = |(image, partner): (&Stamped, Option<usize>)| {
        // Asked for every image: its interval ends here, with or without depth.
        let turn_rate = rates.until(image.stamp_ns);
        let depth = depth.get(partner?)?.place;
        Some(BagFrame { stamp_ns: image.stamp_ns, color: image.place, depth, turn_rate })
    };
    color.iter().zip(partners).filter_map(frame).collect()
}

/// ns to add to stamps of the device's own clock so that they count since 1970: the least delay of all its images. `None` where
/// its stamps do so already, or its bag does not tell when images arrived.
pub(super) fn host_offset_ns(device: &Device) -> Option<i64> {
    let color = &device.color;
    let delays = color.images.iter().filter_map(|image| image.arrival_ns?.checked_sub(image.stamp_ns));
    delays.min().filter(|_| color.is_hardware_clock)
}

/// Frame sets: the frames of the first camera for which every other one has a frame near it.
pub(super) fn frame_sets(cameras: &[Vec<i64>]) -> Vec<Vec<i64>> {
    let Some((first, others)) = cameras.split_first() else { return Vec::new() };
    let partners: Vec<Vec<Option<usize>>> =
        others.iter().map(|other| nearest_partners(first, other, MAX_SET_GAP_NS)).collect();
    let set = |(idx, stamp): (usize, &i64)| {
        let other = |(partners, stamps): (&Vec<Option<usize>>, &Vec<i64>)| {
            stamps.get((*partners.get(idx)?)?).copied()
        };
        let others: Option<Vec<i64>> = partners.iter().zip(others).map(other).collect();
        Some([vec![*stamp], others?].concat())
    };
    first.iter().enumerate().filter_map(set).collect()
}

/// Without what is not later than all before it.
fn increasing(images: &[Stamped]) -> Vec<Stamped> {
    let mut last_ns = -1;
    let mut kept = images.to_vec();
    kept.retain(|image| {
        let is_later = image.stamp_ns > last_ns;
        last_ns = last_ns.max(image.stamp_ns);
        is_later
    });
    kept
}

/// For each stamp the nearest of the others, within a gap, unless that one is nearer to a neighbour. Both increase, and so do the
/// partners.
fn nearest_partners(stamps: &[i64], others: &[i64], max_gap_ns: i64) -> Vec<Option<usize>> {
    let nearest = |stamps: &[i64], to_ns: i64| {
        let behind = stamps.partition_point(|&stamp| stamp < to_ns);
        let around = [behind.checked_sub(1), Some(behind)].into_iter().flatten();
        let gap_ns = |idx: usize| stamps.get(idx).map(|stamp| stamp.abs_diff(to_ns));
        around.filter_map(|idx| Some((gap_ns(idx)?, idx))).min().map(|(_, idx)| idx)
    };
    let partner = |(idx, &stamp): (usize, &i64)| {
        let other_idx = nearest(others, stamp)?;
        let other = *others.get(other_idx)?;
        let is_mutual = nearest(stamps, other) == Some(idx);
        (is_mutual && other.abs_diff(stamp) <= max_gap_ns.unsigned_abs()).then_some(other_idx)
    };
    stamps.iter().enumerate().map(partner).collect()
}

/// The gyro's samples in order, and how far they have been told.
struct TurnRates {
    /// ns and rad/s.
    samples: Vec<(i64, f64)>,
    next: usize,
    until_ns: Option<i64>,
}

impl TurnRates {
    fn new(device: &Device) -> Self {
        let samples = device.gyro.iter().map(|(_, sample)| (sample.stamp_ns, sample.rad_per_s));
        let mut samples: Vec<(i64, f64)> = samples.collect();
        samples.sort_unstable_by_key(|(stamp_ns, _)| *stamp_ns);
        Self { samples, next: 0, until_ns: None }
    }

    /// What the gyro said since the last question.
    fn until(&mut self, stamp_ns: i64) -> Option<TurnRate> {
        let since_ns = self.until_ns.replace(stamp_ns).unwrap_or(stamp_ns - FIRST_INTERVAL_NS);
        let behind = |ns: i64| self.samples.partition_point(|(sample_ns, _)| *sample_ns <= ns);
        let (from, to) = (behind(since_ns).max(self.next), behind(stamp_ns));
        self.next = to;
        let rates = self.samples.get(from..to)?.iter().map(|(_, rad_per_s)| *rad_per_s);
        rates.reduce(f64::max).map(|max_rad_per_s| TurnRate { max_rad_per_s })
    }
}
