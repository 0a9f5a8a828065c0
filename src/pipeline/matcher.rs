//! Which frames belong to one moment. Pure: stamps and times come in, sets go out; no thread, no clock.
//!
//! Stamps of all cameras must come from clocks that agree, but need not be wall clock. A set holds at most one frame per camera, all
//! within `max_skew` of each other. A camera that is late is waited for, up to a bound; one that is dead is not.

use std::collections::VecDeque;
use std::time::Duration;

use crate::capture::StampNs;

use super::MAX_CAMERAS;

/// A stamp this much older than the newest of its camera is a clock that was set back, not a frame out of order, ns.
const CLOCK_RESET_NS: i64 = 1_000_000_000;

/// Limits of a frame set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MatchOptions {
    /// Largest distance between the stamps of one set, ns.
    pub max_skew_ns: u64,
    /// How long a frame waits for the other cameras.
    pub wait: Duration,
    /// Frames kept per camera; the oldest goes first.
    pub capacity: usize,
}

/// A frame as the matcher sees it.
#[derive(Debug)]
pub struct Stamped<T> {
    /// When the image was taken, by the cameras' clock.
    pub stamp: StampNs,
    /// When it arrived, on the caller's clock.
    pub arrival: Duration,
    /// The frame.
    pub item: T,
}

/// Frames of one moment, by camera.
#[derive(Debug)]
pub struct Matched<T> {
    /// One per camera, `None` where it is missing.
    pub frames: [Option<Stamped<T>>; MAX_CAMERAS],
    /// Distance between the oldest and the newest stamp, ns.
    pub skew_ns: u64,
}

/// What was not used, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MatchCounters {
    /// Frames without a partner, or replaced by one nearer in time.
    pub unmatched_frames: u64,
    /// Moments at which every expected camera had a frame, but none near enough to another.
    pub refused_sets: u64,
    /// Frames older than what was already used, or doubled.
    pub out_of_order: u64,
    /// Clocks that were set back.
    pub clock_resets: u64,
}

/// A frame without a partner near enough.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BeyondLimit {
    /// Its camera, and the one with the frame nearest to it.
    pub cameras: (usize, usize),
    /// How far apart the two frames are, ns.
    pub gap_ns: u64,
}

/// Frames without a partner that are remembered until they are asked for.
const MAX_BEYOND: usize = 64;

/// Collects frames per camera and forms sets.
#[derive(Debug)]
pub struct Matcher<T> {
    options: MatchOptions,
    queues: Vec<VecDeque<Stamped<T>>>,
    /// Stamp of the last frame that left the queue, and the newest seen, per camera.
    last_taken: Vec<Option<StampNs>>,
    newest_seen: Vec<Option<StampNs>>,
    /// Cameras that lost a frame to the skew limit since the last set or refusal.
    lonely: u32,
    /// Cameras that were alive when [`Matcher::next_set`] was called last.
    expected: u32,
    /// Cameras whose newest frame was passed over.
    strangers: u32,
    /// Frames without a partner in a row, per camera.
    lost_in_a_row: Vec<u32>,
    /// Frames that found no partner since [`Matcher::drain_beyond`] was called last; what has no room is not told.
    beyond: Vec<BeyondLimit>,
    counters: MatchCounters,
}

impl<T> Matcher<T> {
    /// An empty matcher for `n_cameras`; allocates all it will ever need.
    pub fn new(n_cameras: usize, options: MatchOptions) -> Self {
        let n_cameras = n_cameras.min(MAX_CAMERAS);
        let queues = (0..n_cameras).map(|_| VecDeque::with_capacity(options.capacity + 1)).collect();
        Self {
            options,
            queues,
            last_taken: vec![None; n_cameras],
            newest_seen: vec![None; n_cameras],
            lonely: 0,
            expected: 0,
            strangers: 0,
            lost_in_a_row: vec![0; n_cameras],
            beyond: Vec::with_capacity(MAX_BEYOND),
            counters: MatchCounters::default(),
        }
    }

    /// What was not used so far.
    pub fn counters(&self) -> MatchCounters {
        self.counters
    }

    /// The frames that found no partner since this was called last.
    pub fn drain_beyond(&mut self) -> impl Iterator<Item = BeyondLimit> {
        self.beyond.drain(..)
    }

    /// Cameras whose newest frame was passed over, as bits.
    pub fn strangers(&self) -> u32 {
        self.strangers
    }

    /// Counts a frame that the caller keeps, because its stamp is of a clock that tells nothing of the other cameras'.
    pub fn pass_over(&mut self, camera: usize) {
        self.counters.unmatched_frames += 1;
        self.strangers |= 1 << camera;
        self.note_lonely(camera);
    }

    /// Takes a frame; those that will not be used go to `recycle`.
    pub fn push(&mut self, camera: usize, frame: Stamped<T>, recycle: &mut impl FnMut(usize, T)) {
        self.strangers &= !(1 << camera);
        self.notice_clock_reset(camera, frame.stamp, recycle);
        let queue = &mut self.queues[camera];
        let at = queue.iter().rposition(|other| other.stamp <= frame.stamp).map_or(0, |before| before + 1);
        let doubled = at > 0 && queue[at - 1].stamp == frame.stamp;
        if doubled || self.last_taken[camera].is_some_and(|taken| frame.stamp <= taken) {
            self.counters.out_of_order += 1;
            recycle(camera, frame.item);
            return;
        }
        self.newest_seen[camera] = self.newest_seen[camera].max(Some(frame.stamp));
        queue.insert(at, frame);
        if queue.len() > self.options.capacity {
            self.note_lonely(camera);
            self.discard(camera, recycle);
        }
    }

    /// The next complete set, oldest first; `None` until more frames or time have come. `expected` says which cameras are alive.
    pub fn next_set(
        &mut self,
        now: Duration,
        expected: &[bool],
        recycle: &mut impl FnMut(usize, T),
    ) -> Option<Matched<T>> {
        self.expected = mask(expected);
        loop {
            let oldest = self.oldest_head()?;
            if self.worth_waiting(oldest, now) {
                return None;
            }
            let limit = self.head(oldest)?.0.saturating_add_unsigned(self.options.max_skew_ns);
            let members = self.count_heads(|stamp| stamp.0 <= limit);
            if members >= self.queues.len().min(2) {
                return Some(self.take(StampNs(limit), recycle));
            }
            self.refuse(oldest);
            self.discard(oldest, recycle);
        }
    }

    fn head(&self, camera: usize) -> Option<StampNs> {
        self.queues[camera].front().map(|frame| frame.stamp)
    }

    fn oldest_head(&self) -> Option<usize> {
        (0..self.queues.len())
            .filter_map(|camera| self.head(camera).map(|stamp| (stamp, camera)))
            .min()
            .map(|(_, camera)| camera)
    }

    fn count_heads(&self, belongs: impl Fn(StampNs) -> bool) -> usize {
        (0..self.queues.len()).filter(|&camera| self.head(camera).is_some_and(&belongs)).count()
    }

    /// Whether a living camera may still deliver a frame for the set of the oldest head.
    fn worth_waiting(&self, oldest: usize, now: Duration) -> bool {
        let awaited = self.expected & !self.strangers;
        let missing = (0..self.queues.len())
            .any(|camera| awaited & (1 << camera) != 0 && self.queues[camera].is_empty());
        let waited =
            self.queues[oldest].front().map_or(Duration::ZERO, |head| now.saturating_sub(head.arrival));
        missing && waited < self.options.wait
    }

    /// Takes the heads up to `limit`; a camera with several takes the one nearest to the newest member.
    fn take(&mut self, limit: StampNs, recycle: &mut impl FnMut(usize, T)) -> Matched<T> {
        let newest = (0..self.queues.len())
            .filter_map(|camera| self.head(camera))
            .filter(|stamp| *stamp <= limit)
            .max()
            .unwrap_or(limit);
        let n_cameras = self.queues.len();
        let frames: [Option<Stamped<T>>; MAX_CAMERAS] = std::array::from_fn(|camera| {
            if camera < n_cameras { self.take_nearest(camera, newest, recycle) } else { None }
        });
        self.lonely = 0;
        let oldest = frames.iter().flatten().map(|frame| frame.stamp).min().unwrap_or(newest);
        Matched { frames, skew_ns: newest.0.abs_diff(oldest.0) }
    }

    /// The last frame of a camera up to `newest`; those before it are discarded.
    fn take_nearest(
        &mut self,
        camera: usize,
        newest: StampNs,
        recycle: &mut impl FnMut(usize, T),
    ) -> Option<Stamped<T>> {
        while self.queues[camera].get(1).is_some_and(|second| second.stamp <= newest) {
            self.discard(camera, recycle);
        }
        self.head(camera).filter(|stamp| *stamp <= newest)?;
        let frame = self.queues[camera].pop_front()?;
        self.last_taken[camera] = Some(frame.stamp);
        self.lost_in_a_row[camera] = 0;
        Some(frame)
    }

    /// Notes that the head of `camera` has no partner near enough.
    fn refuse(&mut self, camera: usize) {
        let Some(stamp) = self.head(camera) else { return };
        let nearest = self.nearest(camera, stamp);
        if let Some(beyond) = nearest {
            self.note_beyond(beyond);
        }
        // Where no other camera gave a frame meanwhile, it is the others that are missing, not the partner.
        if nearest.is_some() || self.strangers != 0 {
            self.note_lonely(camera);
        }
    }

    /// The frame of another camera that is nearest: one that waits, or one that has left since the last of this camera did. At low
    /// rates none waits any more when this one is given up.
    fn nearest(&self, camera: usize, stamp: StampNs) -> Option<BeyondLimit> {
        let others = (0..self.queues.len()).filter(|&other| other != camera);
        let near = others.flat_map(|other| {
            let left = self.last_taken[other].filter(|left| Some(*left) > self.last_taken[camera]);
            let around = [self.head(other), left];
            around.into_iter().flatten().map(move |near| (near.0.abs_diff(stamp.0), other))
        });
        near.min().map(|(gap_ns, other)| BeyondLimit { cameras: (camera, other), gap_ns })
    }

    /// Tells a frame without a partner, unless it is the first in a row: another camera's lost frame leaves one, and a faster camera
    /// has them between its matched ones.
    fn note_beyond(&mut self, beyond: BeyondLimit) {
        let in_a_row = &mut self.lost_in_a_row[beyond.cameras.0];
        *in_a_row += 1;
        if *in_a_row >= 2 && self.beyond.len() < MAX_BEYOND {
            self.beyond.push(beyond);
        }
    }

    /// Notes that a camera lost a frame for want of a partner; when all have, one set was refused.
    fn note_lonely(&mut self, camera: usize) {
        self.lonely |= 1 << camera;
        if self.expected.count_ones() >= 2 && self.lonely & self.expected == self.expected {
            self.counters.refused_sets += 1;
            self.lonely = 0;
        }
    }

    fn discard(&mut self, camera: usize, recycle: &mut impl FnMut(usize, T)) {
        if let Some(frame) = self.queues[camera].pop_front() {
            self.counters.unmatched_frames += 1;
            self.last_taken[camera] = Some(frame.stamp);
            recycle(camera, frame.item);
        }
    }

    fn notice_clock_reset(&mut self, camera: usize, stamp: StampNs, recycle: &mut impl FnMut(usize, T)) {
        let is_reset =
            self.newest_seen[camera].is_some_and(|newest| newest.0.saturating_sub(stamp.0) >= CLOCK_RESET_NS);
        if is_reset {
            while !self.queues[camera].is_empty() {
                self.discard(camera, recycle);
            }
            self.counters.clock_resets += 1;
            self.last_taken[camera] = None;
            self.newest_seen[camera] = None;
        }
    }
}

fn mask(flags: &[bool]) -> u32 {
    flags.iter().enumerate().fold(0, |mask, (i, &flag)| mask | (u32::from(flag) << i))
}

#[cfg(test)]
mod tests;
