//! How far apart the frames of each two cameras are, over a whole run: one thread writes, any reads at any time, in fixed memory.
//!
//! Frames that stand in one set and frames that found no partner near enough are told apart: the ones say how well the cameras are in
//! step, the others how far they are out of it. Cameras whose frames stand in sets by turns, never in the same, are out of step too.

use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use super::stats::{Counter, Histogram, LatencySummary};
use crate::capture::StampNs;

/// So many turns in a row are no lost frames any more, also of a camera with half the rate of the other.
const MIN_TURNS: u64 = 4;

/// Two cameras, and how far apart their frames are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairSkew {
    /// Index of the first camera.
    pub first: usize,
    /// Index of the second camera, behind the first.
    pub second: usize,
    /// Frames of one moment, within the limit.
    pub within: LatencySummary,
    /// How often the nearest frames were further apart than the limit.
    pub beyond: u64,
    /// Of these, since frames of both stood in one set.
    pub in_a_row: u64,
    /// How far apart they were the last time, ms; 0 before the first.
    pub last_beyond_ms: f64,
    /// How far apart the nearest of those in a row were, ms; 0 without any.
    pub nearest_beyond_ms: f64,
    /// A camera of the two whose stamps are of a clock of its own: no set can have both.
    pub own_clock: Option<usize>,
}

/// The skews of all pairs of a rig.
#[derive(Debug)]
pub struct SkewBook {
    n_cameras: usize,
    /// Cameras whose stamps are of a clock of their own, as bits.
    own_clocks: Counter,
    /// Sets so far.
    sets: Counter,
    cameras: Vec<LastSeen>,
    /// Each pair once, the first camera's pairs first.
    pairs: Vec<PairBook>,
}

/// When a camera stood in a set last. Relaxed: only the thread that writes reads it.
#[derive(Debug, Default)]
struct LastSeen {
    /// Counting from 1; 0 for never.
    set: Counter,
    stamp_ns: AtomicI64,
}

#[derive(Debug, Default)]
struct PairBook {
    /// How often in a row one stood in a set without the other, and then the other without the one.
    turns: Counter,
    within: Histogram,
    beyond: Counter,
    in_a_row: Counter,
    last_beyond_ns: Counter,
    nearest_beyond_ns: Counter,
}

impl SkewBook {
    /// An empty book; allocates all it will ever need.
    pub fn new(n_cameras: usize) -> Self {
        let n_pairs = n_cameras * n_cameras.saturating_sub(1) / 2;
        let pairs = (0..n_pairs).map(|_| PairBook::default()).collect();
        let cameras = (0..n_cameras).map(|_| LastSeen::default()).collect();
        Self { n_cameras, own_clocks: Counter::default(), sets: Counter::default(), cameras, pairs }
    }

    /// Takes note of the cameras, as bits, whose stamps are of a clock of their own.
    pub fn note_own_clocks(&self, cameras: u32) {
        self.own_clocks.set(u64::from(cameras));
    }

    /// Takes note of frames of one moment, in the order of their cameras.
    pub fn note_set(&self, stamps: impl Iterator<Item = Option<StampNs>> + Clone, max_skew: Duration) {
        let present = stamps.enumerate().filter_map(|(camera, stamp)| stamp.map(|stamp| (camera, stamp)));
        self.sets.add_one();
        let members = present.clone().fold(0, |mask, (camera, _)| mask | 1 << camera);
        for (camera, stamp) in present.clone() {
            self.note_turns(camera, stamp, members);
        }
        for (first, first_stamp) in present.clone() {
            for (second, second_stamp) in present.clone().filter(|(second, _)| *second > first) {
                let gap = Duration::from_nanos(first_stamp.0.abs_diff(second_stamp.0));
                if gap > max_skew {
                    self.note_beyond((first, second), gap);
                } else if let Some(book) = self.book(first, second) {
                    book.within.record(gap);
                    book.turns.set(0);
                    book.in_a_row.set(0);
                    book.nearest_beyond_ns.set(0);
                }
            }
        }
    }

    /// Where another camera stood in sets since this one did, but not with it, it is their turn once more.
    fn note_turns(&self, camera: usize, stamp: StampNs, members: u32) {
        let Some(before) = self.cameras.get(camera) else { return };
        let (set, stamp_before) = (before.set.get(), before.stamp_ns.load(Ordering::Relaxed));
        for (other, seen) in self.cameras.iter().enumerate() {
            let is_member = members & 1 << other != 0;
            if is_member || set == 0 || seen.set.get() <= set {
                continue;
            }
            let Some(book) = self.book(camera.min(other), camera.max(other)) else { continue };
            book.turns.add_one();
            if book.turns.get() >= MIN_TURNS {
                let between = seen.stamp_ns.load(Ordering::Relaxed);
                let gap_ns = stamp.0.abs_diff(between).min(stamp_before.abs_diff(between));
                self.note_beyond((camera, other), Duration::from_nanos(gap_ns));
            }
        }
        before.set.set(self.sets.get());
        before.stamp_ns.store(stamp.0, Ordering::Relaxed);
    }

    /// Takes note of frames that are too far apart for one set.
    pub fn note_beyond(&self, (a, b): (usize, usize), gap: Duration) {
        if let Some(book) = self.book(a.min(b), a.max(b)) {
            let gap_ns = u64::try_from(gap.as_nanos()).unwrap_or(u64::MAX);
            let is_first = book.in_a_row.get() == 0;
            let nearest_ns = if is_first { gap_ns } else { gap_ns.min(book.nearest_beyond_ns.get()) };
            book.nearest_beyond_ns.set(nearest_ns);
            book.beyond.add_one();
            book.in_a_row.add_one();
            book.last_beyond_ns.set(gap_ns);
        }
    }

    /// Each pair once, as it is now.
    pub fn pairs(&self) -> Vec<PairSkew> {
        let indices = (0..self.n_cameras)
            .flat_map(|first| (first + 1..self.n_cameras).map(move |second| (first, second)));
        let own_clocks = self.own_clocks.get();
        let has_own = |camera: &usize| own_clocks & (1 << camera) != 0;
        let summary = |((first, second), book): ((usize, usize), &PairBook)| PairSkew {
            own_clock: [first, second].into_iter().find(has_own),
            ..book.summary(first, second)
        };
        indices.zip(&self.pairs).map(summary).collect()
    }

    fn book(&self, first: usize, second: usize) -> Option<&PairBook> {
        let before: usize = (0..first).map(|camera| self.n_cameras - 1 - camera).sum();
        self.pairs.get(before + second.checked_sub(first + 1)?)
    }
}

impl PairBook {
    fn summary(&self, first: usize, second: usize) -> PairSkew {
        PairSkew {
            first,
            second,
            within: self.within.summary(),
            beyond: self.beyond.get(),
            in_a_row: self.in_a_row.get(),
            own_clock: None,
            last_beyond_ms: self.last_beyond_ns.get() as f64 * 1e-6,
            nearest_beyond_ms: self.nearest_beyond_ns.get() as f64 * 1e-6,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_millis(8);

    fn note(book: &SkewBook, stamps_ms: &[Option<i64>]) {
        book.note_set(stamps_ms.iter().map(|stamp| stamp.map(|ms| StampNs(ms * 1_000_000))), LIMIT);
    }

    #[test]
    fn each_pair_has_its_own_skew() {
        let book = SkewBook::new(4);
        for start_ms in 0..100 {
            note(&book, &[Some(start_ms), Some(start_ms + 1), None, Some(start_ms - 4)]);
        }
        let pairs = book.pairs();
        let indices: Vec<_> = pairs.iter().map(|pair| (pair.first, pair.second)).collect();
        assert_eq!(indices, [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]);
        let median_ms: Vec<_> = pairs.iter().map(|pair| (pair.within.count, pair.within.max_ms)).collect();
        assert_eq!(median_ms, [(100, 1.0), (0, 0.0), (100, 4.0), (0, 0.0), (100, 5.0), (0, 0.0)]);
        assert!((pairs[4].within.p50_ms - 5.0).abs() < 0.4 && (pairs[4].within.p99_ms - 5.0).abs() < 0.4);
    }

    #[test]
    fn what_is_beyond_the_limit_is_counted_apart() {
        let book = SkewBook::new(2);
        note(&book, &[Some(0), Some(8)]);
        note(&book, &[Some(40), Some(29)]);
        book.note_beyond((1, 0), Duration::from_millis(15));
        let pair = book.pairs()[0];
        assert_eq!((pair.within.count, pair.within.max_ms), (1, 8.0));
        assert_eq!((pair.beyond, pair.in_a_row), (2, 2));
        assert_eq!((pair.last_beyond_ms, pair.nearest_beyond_ms), (15.0, 11.0));
        note(&book, &[Some(80), Some(81)]);
        assert_eq!((book.pairs()[0].beyond, book.pairs()[0].in_a_row), (2, 0));
    }

    #[test]
    fn cameras_that_stand_in_sets_by_turns_are_out_of_step() {
        let book = SkewBook::new(4);
        for moment in 0..10 {
            let ms = 33 * moment;
            note(&book, &[Some(ms), Some(ms + 1), None, None]);
            note(&book, &[None, None, Some(ms + 12), Some(ms + 13)]);
        }
        for pair in book.pairs() {
            let is_in_step = matches!((pair.first, pair.second), (0, 1) | (2, 3));
            assert_eq!(
                (pair.within.count, pair.beyond),
                if is_in_step { (10, 0) } else { (0, 15) },
                "{pair:?}"
            );
        }
        let of = |book: &SkewBook, first, second| {
            let pair = book.pairs().into_iter().find(|pair| (pair.first, pair.second) == (first, second));
            pair.expect("the pair").nearest_beyond_ms
        };
        assert_eq!((of(&book, 0, 3), of(&book, 1, 2)), (13.0, 11.0));
        note(&book, &[Some(400), Some(400), Some(400), Some(400)]);
        assert!(book.pairs().iter().all(|pair| pair.in_a_row == 0), "back in step");
    }

    #[test]
    fn lost_frames_and_slow_cameras_are_not_out_of_step() {
        let book = SkewBook::new(3);
        for moment in 0..30 {
            let is_there = |lost: bool| (!lost).then_some(33 * moment);
            // The first loses every seventh, the second the one behind it, the third comes every other time.
            note(&book, &[is_there(moment % 7 == 3), is_there(moment % 7 == 4), is_there(moment % 2 == 1)]);
        }
        assert!(book.pairs().iter().all(|pair| pair.beyond == 0), "{:?}", book.pairs());
    }

    #[test]
    fn one_camera_has_no_pair() {
        let book = SkewBook::new(1);
        note(&book, &[Some(0)]);
        book.note_beyond((0, 1), LIMIT);
        assert_eq!(book.pairs(), []);
    }
}
