//! The document of `pelical bench`, and its text.

use std::fmt::Write as _;
use std::time::Duration;

use serde::Serialize;

use super::text::table;
use crate::capture::CameraInfo;
use crate::capture::recording::Recording;
use crate::geometry::LineObservation;
use crate::pipeline::{LatencySummary, Snapshot};

/// `pelical.bench/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BenchDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// The recording's folder.
    pub recording: String,
    /// Width and height of each camera's images, px.
    pub images_px: Vec<[u32; 2]>,
    /// Cores of this machine that the program may use.
    pub cores: usize,
    /// The stages on one core, with nothing else of this program running.
    pub one_core: OneCoreEntry,
    /// The live pipeline with all its threads.
    pub pipeline: PipelineEntry,
}

/// The stages on one core.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OneCoreEntry {
    /// How long it ran.
    pub seconds: f64,
    /// Images per second.
    pub images_per_s: f64,
    /// Lines found.
    pub lines: LineCounts,
    /// Time of each stage per image, of `match` per frame set (0 ms where no appearance is asked); percentiles are exact.
    pub stages: Vec<StageEntry>,
}

/// The live pipeline.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PipelineEntry {
    /// How long it ran.
    pub seconds: f64,
    /// Frame sets through the line stage, per second.
    pub sets_per_s: f64,
    /// Lines found, as far as they were told in time.
    pub lines: LineCounts,
    /// Time of each stage, waiting for a core included; percentiles to 1/16. `detect` has the gray conversion in it, `lift` the
    /// descriptors, `associate` the scores.
    pub stages: Vec<StageEntry>,
    /// Frame sets by what became of them.
    pub sets: SetsEntry,
    /// What was dropped.
    pub drops: DropsEntry,
}

/// Frame sets by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct SetsEntry {
    /// Formed of frames of one moment.
    pub formed: u64,
    /// Through the line stage.
    pub done: u64,
    /// Taken by the estimator as new evidence.
    pub accepted: u64,
    /// Taken by the estimator, but seen before.
    pub repeated: u64,
}

/// What was dropped, and where.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct DropsEntry {
    /// Frames that no set was formed with in time.
    pub frames: u64,
    /// Frames without a partner.
    pub unmatched_frames: u64,
    /// Frame sets that the line stage was too slow for.
    pub sets: u64,
    /// Frame sets that came while the estimator was solving: no fault, the next ones are as good.
    pub skipped_by_estimator: u64,
}

/// How many lines.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct LineCounts {
    /// Images looked at.
    pub images: u64,
    /// Segments per image, mean.
    pub per_image: f64,
    /// Of these, with depth, mean.
    pub lifted_per_image: f64,
}

/// The time of one stage, ms.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageEntry {
    /// Which.
    pub stage: &'static str,
    /// How often it ran.
    pub count: u64,
    /// Mean.
    pub mean_ms: f64,
    /// Median.
    pub p50_ms: f64,
    /// 95 of 100 are not longer.
    pub p95_ms: f64,
    /// 99 of 100 are not longer.
    pub p99_ms: f64,
    /// Longest.
    pub max_ms: f64,
}

impl LineCounts {
    /// Counts one image by its lines.
    pub fn count(&mut self, lines: &[LineObservation]) {
        self.add(lines.len(), lines.iter().filter(|line| line.depth.is_some()).count());
    }

    /// Counts one image.
    pub fn add(&mut self, lines: usize, lifted: usize) {
        self.images += 1;
        let share = 1.0 / self.images as f64;
        self.per_image += share * (lines as f64 - self.per_image);
        self.lifted_per_image += share * (lifted as f64 - self.lifted_per_image);
    }
}

impl StageEntry {
    /// Of all durations; all zero without any.
    pub fn exact(stage: &'static str, mut durations: Vec<Duration>) -> Self {
        durations.sort_unstable();
        let ms = |duration: &Duration| duration.as_secs_f64() * 1e3;
        let count = durations.len();
        // The smallest that so many of 100 do not exceed.
        let percentile =
            |percent: usize| durations.get((count * percent).div_ceil(100).saturating_sub(1)).map_or(0.0, ms);
        Self {
            stage,
            count: count as u64,
            mean_ms: durations.iter().map(ms).sum::<f64>() / count.max(1) as f64,
            p50_ms: percentile(50),
            p95_ms: percentile(95),
            p99_ms: percentile(99),
            max_ms: percentile(100),
        }
    }

    fn summed_up(stage: &'static str, summary: &LatencySummary) -> Self {
        let LatencySummary { count, mean_ms, p50_ms, p95_ms, p99_ms, max_ms } = *summary;
        Self { stage, count, mean_ms, p50_ms, p95_ms, p99_ms, max_ms }
    }
}

impl OneCoreEntry {
    /// What was measured.
    pub fn new(elapsed: Duration, lines: LineCounts, stages: Vec<StageEntry>) -> Self {
        let seconds = elapsed.as_secs_f64();
        Self { seconds, images_per_s: lines.images as f64 / seconds, lines, stages }
    }
}

impl PipelineEntry {
    /// What was measured.
    pub fn new(elapsed: Duration, lines: LineCounts, snapshot: &Snapshot) -> Self {
        let (counts, latencies) = (&snapshot.counts, &snapshot.latencies);
        let stages = [
            ("detect", &latencies.detect),
            ("lift", &latencies.lift),
            ("frame to set", &latencies.frame_to_set),
            ("frame to progress", &latencies.frame_to_progress),
            ("associate", &latencies.associate),
            ("estimate", &latencies.solve),
        ];
        let seconds = elapsed.as_secs_f64();
        Self {
            seconds,
            sets_per_s: counts.sets_done as f64 / seconds,
            lines,
            stages: stages.map(|(stage, summary)| StageEntry::summed_up(stage, summary)).to_vec(),
            sets: SetsEntry {
                formed: counts.sets_formed,
                done: counts.sets_done,
                accepted: counts.accepted_sets,
                repeated: counts.repeated_sets,
            },
            drops: DropsEntry {
                frames: counts.dropped_frames,
                unmatched_frames: counts.unmatched_frames,
                sets: counts.dropped_sets,
                skipped_by_estimator: counts.skipped_sets,
            },
        }
    }
}

impl BenchDocument {
    /// Both parts.
    pub fn new(recording: &Recording, one_core: OneCoreEntry, pipeline: PipelineEntry) -> Self {
        let size = |info: &CameraInfo| [info.camera.width_px(), info.camera.height_px()];
        Self {
            schema: "pelical.bench/1",
            recording: recording.path().display().to_string(),
            images_px: recording.cameras().iter().map(size).collect(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            one_core,
            pipeline,
        }
    }
}

/// The document as text, ending with a line break.
pub fn text(document: &BenchDocument) -> String {
    let BenchDocument { one_core, pipeline, cores, .. } = document;
    let mut text =
        format!("one core: {:.1} images per s, {}\n\n", one_core.images_per_s, words(&one_core.lines));
    text += &stages(&one_core.stages);
    let _ = writeln!(
        text,
        "\npipeline on {cores} cores: {:.1} frame sets per s, {}\n",
        pipeline.sets_per_s,
        words(&pipeline.lines)
    );
    text += &stages(&pipeline.stages);
    let SetsEntry { formed, done, accepted, repeated } = pipeline.sets;
    let DropsEntry { frames, unmatched_frames, sets, skipped_by_estimator } = pipeline.drops;
    let _ = writeln!(
        text,
        "\nsets     {formed} formed, {done} done, {accepted} new to the estimator, {repeated} repeated"
    );
    let _ = writeln!(
        text,
        "dropped  {frames} frames, {unmatched_frames} frames without a partner, {sets} sets; {skipped_by_estimator} sets came while \
         the estimator was busy"
    );
    text
}

fn words(lines: &LineCounts) -> String {
    format!("{:.1} lines per image, {:.1} of them with depth", lines.per_image, lines.lifted_per_image)
}

fn stages(stages: &[StageEntry]) -> String {
    let row = |stage: &StageEntry| {
        let times = [stage.mean_ms, stage.p50_ms, stage.p95_ms, stage.p99_ms, stage.max_ms];
        let times = times.map(|time| format!("{time:.2}"));
        [vec![stage.stage.to_owned(), stage.count.to_string()], times.to_vec()].concat()
    };
    let header = ["stage", "n", "mean ms", "p50", "p95", "p99", "max"];
    table(&header, &stages.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_those_of_the_sorted_durations() {
        let stage = StageEntry::exact("x", (1..=200).rev().map(Duration::from_millis).collect());
        assert_eq!((stage.count, stage.mean_ms), (200, 100.5));
        assert_eq!([stage.p50_ms, stage.p95_ms, stage.p99_ms, stage.max_ms], [100.0, 190.0, 198.0, 200.0]);
        let one = StageEntry::exact("x", vec![Duration::from_millis(7)]);
        assert_eq!([one.p50_ms, one.p95_ms, one.p99_ms, one.max_ms], [7.0; 4]);
        assert_eq!(StageEntry::exact("x", Vec::new()).max_ms, 0.0);
    }

    #[test]
    fn lines_are_averaged_over_images() {
        let mut lines = LineCounts::default();
        [(10, 8), (20, 4), (30, 0)].iter().for_each(|&(all, lifted)| lines.add(all, lifted));
        assert_eq!(lines.images, 3);
        assert!(
            (lines.per_image - 20.0).abs() < 1e-9 && (lines.lifted_per_image - 4.0).abs() < 1e-9,
            "{lines:?}"
        );
    }
}
