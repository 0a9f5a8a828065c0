//! Counters and latency histograms that any thread may write at any time: atomics of fixed size, nothing to lock or allocate.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Buckets per factor of two: a quantile is at most 1/16 off.
const PER_OCTAVE: u64 = 8;
/// Up to 2^27 µs, about two minutes; longer ones count in the last bucket.
const OCTAVES: u64 = 27;
const N_BUCKETS: usize = ((OCTAVES + 1) * PER_OCTAVE) as usize;

/// A number that only grows. Relaxed throughout: nothing is handed over through a count.
#[derive(Debug, Default)]
pub struct Counter(AtomicU64);

impl Counter {
    /// Counts one.
    pub fn add_one(&self) {
        self.add(1);
    }

    /// Counts `n`.
    pub fn add(&self, n: u64) {
        self.0.fetch_add(n, Ordering::Relaxed);
    }

    /// Replaces the count: for one writer that counts on its own.
    pub fn set(&self, n: u64) {
        self.0.store(n, Ordering::Relaxed);
    }

    /// The count.
    pub fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}

/// Durations by size, in buckets that are linear within each factor of two of microseconds.
#[derive(Debug)]
pub struct Histogram {
    buckets: [Counter; N_BUCKETS],
    sum_us: Counter,
    // Relaxed, as the counters: a maximum hands nothing over.
    max_us: AtomicU64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self {
            buckets: std::array::from_fn(|_| Counter::default()),
            sum_us: Counter::default(),
            max_us: AtomicU64::new(0),
        }
    }
}

/// A histogram in five numbers, ms.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LatencySummary {
    /// Number of durations.
    pub count: u64,
    /// Mean.
    pub mean_ms: f64,
    /// Median, to 1/16.
    pub p50_ms: f64,
    /// 95 of 100 are not longer, to 1/16.
    pub p95_ms: f64,
    /// 99 of 100 are not longer, to 1/16.
    pub p99_ms: f64,
    /// Longest.
    pub max_ms: f64,
}

impl Histogram {
    /// Counts one duration.
    pub fn record(&self, duration: Duration) {
        let us = u64::try_from(duration.as_micros()).unwrap_or(u64::MAX);
        self.buckets[bucket_of(us)].add_one();
        self.sum_us.add(us);
        self.max_us.fetch_max(us, Ordering::Relaxed);
    }

    /// The numbers so far; all zero before the first duration.
    pub fn summary(&self) -> LatencySummary {
        let counts: Vec<u64> = self.buckets.iter().map(Counter::get).collect();
        let count: u64 = counts.iter().sum();
        if count == 0 {
            return LatencySummary::default();
        }
        let max_ms = self.max_us.load(Ordering::Relaxed) as f64 / 1e3;
        LatencySummary {
            count,
            mean_ms: self.sum_us.get() as f64 / count as f64 / 1e3,
            p50_ms: quantile_ms(&counts, count.div_ceil(2)).min(max_ms),
            p95_ms: quantile_ms(&counts, (count * 95).div_ceil(100)).min(max_ms),
            p99_ms: quantile_ms(&counts, (count * 99).div_ceil(100)).min(max_ms),
            max_ms,
        }
    }
}

/// Middle of the bucket that holds the `rank`-th smallest, ms.
fn quantile_ms(counts: &[u64], rank: u64) -> f64 {
    let mut below = 0;
    for (bucket, count) in counts.iter().enumerate() {
        below += count;
        if below >= rank {
            return middle_us(bucket) / 1e3;
        }
    }
    0.0
}

/// Durations below `PER_OCTAVE` µs have a bucket each; then `PER_OCTAVE` buckets per factor of two.
fn bucket_of(us: u64) -> usize {
    if us < PER_OCTAVE {
        return us as usize;
    }
    let shift = us.ilog2() - PER_OCTAVE.ilog2();
    let bucket = u64::from(shift) * PER_OCTAVE + (us >> shift);
    (bucket as usize).min(N_BUCKETS - 1)
}

fn middle_us(bucket: usize) -> f64 {
    let bucket = bucket as u64;
    if bucket < 2 * PER_OCTAVE {
        return bucket as f64;
    }
    let shift = bucket / PER_OCTAVE - 1;
    let low = (bucket - shift * PER_OCTAVE) << shift;
    low as f64 + 0.5 * (1u64 << shift) as f64
}

/// Everything the frame path counts.
#[derive(Debug, Default)]
pub struct Counters {
    pub(super) frames: Counter,
    pub(super) bad_frames: Counter,
    pub(super) dropped_frames: Counter,
    pub(super) unmatched_frames: Counter,
    pub(super) out_of_order: Counter,
    pub(super) clock_resets: Counter,
    pub(super) sets_formed: Counter,
    pub(super) refused_skew: Counter,
    pub(super) dropped_sets: Counter,
    pub(super) sets_done: Counter,
    pub(super) refused_gyro: Counter,
    pub(super) refused_image: Counter,
    pub(super) skipped_sets: Counter,
    pub(super) accepted_sets: Counter,
    pub(super) repeated_sets: Counter,
    pub(super) solves: Counter,
    pub(super) dropped_events: Counter,
}

/// The counts at one moment, since the pipeline's start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Good frames of all cameras.
    pub frames: u64,
    /// Frames that were unreadable or not of the promised size.
    pub bad_frames: u64,
    /// Frames that the sync thread did not fetch in time.
    pub dropped_frames: u64,
    /// Frames without a partner.
    pub unmatched_frames: u64,
    /// Frames older than what was already used, or doubled.
    pub out_of_order: u64,
    /// Clocks that were set back.
    pub clock_resets: u64,
    /// Frame sets formed.
    pub sets_formed: u64,
    /// Moments whose frames were further apart than the skew limit.
    pub refused_skew: u64,
    /// Frame sets that the line stage was too slow for.
    pub dropped_sets: u64,
    /// Frame sets that went through the line stage.
    pub sets_done: u64,
    /// Frame sets kept from the estimator because a gyro said that the rig turned fast.
    pub refused_gyro: u64,
    /// The same, because an image moved fast.
    pub refused_image: u64,
    /// Frame sets the estimator had no time for, because it was solving.
    pub skipped_sets: u64,
    /// Frame sets that brought the estimator new evidence.
    pub accepted_sets: u64,
    /// Frame sets that repeated what it had seen.
    pub repeated_sets: u64,
    /// Solutions computed.
    pub solves: u64,
    /// Events nobody read in time.
    pub dropped_events: u64,
}

impl Counters {
    /// The counts now.
    pub fn counts(&self) -> Counts {
        Counts {
            frames: self.frames.get(),
            bad_frames: self.bad_frames.get(),
            dropped_frames: self.dropped_frames.get(),
            unmatched_frames: self.unmatched_frames.get(),
            out_of_order: self.out_of_order.get(),
            clock_resets: self.clock_resets.get(),
            sets_formed: self.sets_formed.get(),
            refused_skew: self.refused_skew.get(),
            dropped_sets: self.dropped_sets.get(),
            sets_done: self.sets_done.get(),
            refused_gyro: self.refused_gyro.get(),
            refused_image: self.refused_image.get(),
            skipped_sets: self.skipped_sets.get(),
            accepted_sets: self.accepted_sets.get(),
            repeated_sets: self.repeated_sets.get(),
            solves: self.solves.get(),
            dropped_events: self.dropped_events.get(),
        }
    }
}

/// How long each stage takes.
#[derive(Debug, Default)]
pub struct Latencies {
    pub(super) frame_to_set: Histogram,
    pub(super) detect: Histogram,
    pub(super) lift: Histogram,
    pub(super) frame_to_progress: Histogram,
    pub(super) associate: Histogram,
    pub(super) solve: Histogram,
    pub(super) watch: Histogram,
}

/// Summaries of [`Latencies`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LatencySummaries {
    /// From the arrival of a set's newest frame to the formed set.
    pub frame_to_set: LatencySummary,
    /// Gray conversion and segment detection, per image.
    pub detect: LatencySummary,
    /// Lifting and surface samples, per image.
    pub lift: LatencySummary,
    /// From the arrival of a set's newest frame to its published progress.
    pub frame_to_progress: LatencySummary,
    /// One frame set into the evidence: lines to candidates.
    pub associate: LatencySummary,
    /// One solution of the estimator.
    pub solve: LatencySummary,
    /// One frame set compared with the converged result.
    pub watch: LatencySummary,
}

impl Latencies {
    /// The summaries now.
    pub fn summaries(&self) -> LatencySummaries {
        LatencySummaries {
            frame_to_set: self.frame_to_set.summary(),
            detect: self.detect.summary(),
            lift: self.lift.summary(),
            frame_to_progress: self.frame_to_progress.summary(),
            associate: self.associate.summary(),
            solve: self.solve.summary(),
            watch: self.watch.summary(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_right_to_a_sixteenth_over_five_decades() {
        for scale_us in [1u64, 30, 1000, 40_000, 900_000] {
            let histogram = Histogram::default();
            for i in 1..=1000 {
                histogram.record(Duration::from_micros(i * scale_us));
            }
            let summary = histogram.summary();
            for (found_ms, rank) in
                [(summary.p50_ms, 500.0), (summary.p95_ms, 950.0), (summary.p99_ms, 990.0)]
            {
                let true_ms = rank * scale_us as f64 / 1e3;
                assert!((found_ms / true_ms - 1.0).abs() < 1.0 / 15.0, "{found_ms} instead of {true_ms} ms");
            }
            assert_eq!((summary.count, summary.max_ms), (1000, scale_us as f64));
        }
    }

    #[test]
    fn every_duration_has_a_bucket_and_buckets_ascend() {
        let mut last = 0;
        for us in (0..5000).chain([1 << 26, (1 << 28) - 1, 1 << 40, u64::MAX]) {
            let bucket = bucket_of(us);
            assert!(bucket >= last && bucket < N_BUCKETS, "{us} µs: bucket {bucket} after {last}");
            last = bucket;
        }
    }

    #[test]
    fn an_empty_histogram_is_all_zero() {
        assert_eq!(Histogram::default().summary(), LatencySummary::default());
    }
}
