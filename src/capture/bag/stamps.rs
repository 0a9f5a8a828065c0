//! One clock for all images: counters that wrap, depth beside its colour, and cameras whose own clocks know nothing of each other.

use nalgebra::Vector3;

use super::device::{Device, ImageStream, Stamped};
use super::file::Place;
use crate::capture::frame::{SpecificForce, TurnRate};
use crate::capture::realsense::clock::{WRAP_NS, WrappingClock};
use crate::capture::realsense::pairing::{self, MaxGap};

/// Of a stream that does not say it and is too short to tell.
const USUAL_RATE_HZ: f64 = 30.0;
/// ns; frames of two cameras that are further apart do not even begin to be one set. What is too far is up to the sync limit.
const MAX_SET_GAP_NS: i64 = 50_000_000;
/// ns; how long before the first frame gyro and accelerometer count.
const FIRST_INTERVAL_NS: i64 = 33_333_333;

/// One frame of a camera: colour with the depth that is nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BagFrame {
    pub(super) stamp_ns: i64,
    pub(super) color: Place,
    pub(super) depth: Place,
    pub(super) turn_rate: Option<TurnRate>,
    pub(super) specific_force: Option<SpecificForce>,
}

/// Makes the stamps of a device go on where its counter begins again.
pub(super) fn unwrap(device: &mut Device) {
    let Device { color, depth, gyro, accel, .. } = device;
    let images = color.images.iter_mut().chain(&mut depth.images);
    let images = images.map(|image| (image.place, &mut image.stamp_ns));
    let turns = gyro.iter_mut().map(|(place, sample)| (*place, &mut sample.stamp_ns));
    let forces = accel.iter_mut().map(|(place, sample)| (*place, &mut sample.stamp_ns));
    let mut stamps: Vec<(Place, &mut i64)> = images.chain(turns).chain(forces).collect();
    // Time since 1970 is far beyond the counter.
    if stamps.iter().any(|(_, stamp)| **stamp >= WRAP_NS) {
        return;
    }
    stamps.sort_unstable_by_key(|(place, _)| *place);
    let mut clock = WrappingClock::default();
    for (_, stamp) in stamps {
        *stamp = clock.unwrapped(*stamp);
    }
}

/// The frames of a device in increasing order: colour and depth of one moment, each used once.
pub(super) fn frames(device: &Device) -> Vec<BagFrame> {
    let (color, depth) = (increasing(&device.color.images), increasing(&device.depth.images));
    let max_gap = MaxGap::for_rate(rate_hz(&device.color, &color));
    let (mut colors, mut depths) = (color.iter().peekable(), depth.iter().peekable());
    let color_from_accel = device.color_from_accel();
    let (mut frames, mut rates, mut forces) = (Vec::new(), turn_rates(device), specific_forces(device));
    while let (Some(color), Some(depth)) = (colors.peek(), depths.peek()) {
        let too_old = max_gap.too_old(color.stamp_ns, depth.stamp_ns);
        if too_old.is_none() {
            let rates = rates.until(color.stamp_ns).iter().map(|(_, rad_per_s)| *rad_per_s);
            let turn_rate = rates.reduce(f64::max).map(|max_rad_per_s| TurnRate { max_rad_per_s });
            let forces = forces.until(color.stamp_ns).iter().map(|(_, m_per_s2)| *m_per_s2);
            let specific_force = color_from_accel.and_then(|turned| SpecificForce::mean(forces, &turned));
            frames.push(BagFrame {
                stamp_ns: color.stamp_ns,
                color: color.place,
                depth: depth.place,
                turn_rate,
                specific_force,
            });
        }
        if too_old != Some(pairing::Stream::Depth) {
            colors.next();
        }
        if too_old != Some(pairing::Stream::Color) {
            depths.next();
        }
    }
    frames
}

/// As the bag says, else by the median of the time between images.
fn rate_hz(stream: &ImageStream, images: &[Stamped]) -> f64 {
    if let Some(rate_hz) = stream.rate_hz.filter(|rate_hz| *rate_hz > 0) {
        return f64::from(rate_hz);
    }
    let gap_ns = |pair: &[Stamped]| match pair {
        [a, b] => b.stamp_ns.saturating_sub(a.stamp_ns),
        _ => 0,
    };
    let mut gaps_ns: Vec<i64> = images.windows(2).map(gap_ns).collect();
    gaps_ns.sort_unstable();
    gaps_ns.get(gaps_ns.len() / 2).map_or(USUAL_RATE_HZ, |gap_ns| 1e9 / (*gap_ns).max(1) as f64)
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

/// Norms of the gyro's samples, rad/s.
fn turn_rates(device: &Device) -> Samples<f64> {
    Samples::new(device.gyro.iter().map(|(_, sample)| (sample.stamp_ns, sample.rad_per_s)).collect())
}

/// The accelerometer's samples, m/s², in its own axes.
fn specific_forces(device: &Device) -> Samples<Vector3<f64>> {
    let samples = device.accel.iter().map(|(_, sample)| (sample.stamp_ns, sample.m_per_s2.map(f64::from)));
    Samples::new(samples.map(|(stamp_ns, m_per_s2)| (stamp_ns, Vector3::from(m_per_s2))).collect())
}

/// A motion sensor's samples in order, and how far they have been told.
struct Samples<T> {
    /// With stamps, ns.
    samples: Vec<(i64, T)>,
    next: usize,
    until_ns: Option<i64>,
}

impl<T> Samples<T> {
    fn new(mut samples: Vec<(i64, T)>) -> Self {
        samples.sort_by_key(|(stamp_ns, _)| *stamp_ns);
        Self { samples, next: 0, until_ns: None }
    }

    /// What the sensor said since the last question.
    fn until(&mut self, stamp_ns: i64) -> &[(i64, T)] {
        let since_ns = self.until_ns.replace(stamp_ns).unwrap_or(stamp_ns - FIRST_INTERVAL_NS);
        let behind = |ns: i64| self.samples.partition_point(|(sample_ns, _)| *sample_ns <= ns);
        let (from, to) = (behind(since_ns).max(self.next), behind(stamp_ns));
        self.next = to;
        self.samples.get(from..to).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(ms: i64) -> Stamped {
        Stamped { place: Place::default(), stamp_ns: 1_000_000 * ms, arrival_ns: None }
    }

    #[test]
    fn depth_belongs_to_colour_within_half_a_frame_of_the_declared_or_else_the_usual_interval() {
        let device = |rate_hz, interval_ms: i64, late_ms: i64| {
            let mut device = Device::default();
            device.color.rate_hz = rate_hz;
            device.color.images = (1..10).map(|number| image(number * interval_ms)).collect();
            device.depth.images = (1..10).map(|number| image(number * interval_ms + late_ms)).collect();
            device
        };
        for (rate_hz, interval_ms, late_ms, n_frames) in [
            (Some(15), 66, 25, 9),
            (Some(15), 66, -25, 9),
            (None, 66, 25, 9),
            (Some(0), 66, 25, 9),
            (Some(30), 66, 25, 0),
            (Some(30), 33, 16, 9),
            (Some(90), 11, 5, 9),
        ] {
            let case = format!("{rate_hz:?} Hz, {interval_ms} ms, {late_ms} ms");
            assert_eq!(frames(&device(rate_hz, interval_ms, late_ms)).len(), n_frames, "{case}");
        }
    }

    #[test]
    fn partners_are_the_nearest_of_both_sides_and_none_is_used_twice() {
        let partners = |stamps: &[i64], others: &[i64]| nearest_partners(stamps, others, 10);
        assert_eq!(partners(&[0, 33, 66], &[1, 30, 70]), [Some(0), Some(1), Some(2)]);
        // A frame was lost on either side.
        assert_eq!(partners(&[0, 33, 66], &[1, 70]), [Some(0), None, Some(1)]);
        assert_eq!(partners(&[0, 66], &[1, 30, 70]), [Some(0), Some(2)]);
        // Two for one: the nearer one has it.
        assert_eq!(partners(&[0, 6], &[4]), [None, Some(0)]);
        assert_eq!(partners(&[0], &[11]), [None]);
        assert_eq!(partners(&[5], &[]), [None]);
    }

    #[test]
    fn a_set_needs_every_camera() {
        let ms = |stamps: &[i64]| stamps.iter().map(|ms| 1_000_000 * ms).collect::<Vec<_>>();
        let sets = frame_sets(&[ms(&[0, 33, 66, 99]), ms(&[2, 35, 101]), ms(&[1, 34, 67, 100])]);
        assert_eq!(sets, [ms(&[0, 2, 1]), ms(&[33, 35, 34]), ms(&[99, 101, 100])]);
        assert!(frame_sets(&[ms(&[0, 33]), ms(&[5000])]).is_empty());
        assert_eq!(frame_sets(&[ms(&[7])]), [ms(&[7])]);
    }
}
