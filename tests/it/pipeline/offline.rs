//! The offline run over frame sets in memory.

use std::path::PathBuf;
use std::time::Duration;

use pelical::capture::{CaptureError, RgbdFrame, StampNs};
use pelical::geometry::camera::Pinhole;
use pelical::geometry::{Camera, Distortion};
use pelical::pipeline::offline::{
    FrameSetReader, OfflineProgress, OfflineRun, RefusedSets, SetCounts, run_offline,
};
use pelical::pipeline::{PipelineOptions, SyncOptions};
use pelical::solver::RigCamera;

const SIZE: (usize, usize) = (160, 120);

fn rig() -> [RigCamera; 3] {
    ["a", "b", "c"].map(|name| RigCamera { name: name.to_owned(), camera: camera() })
}

fn camera() -> Camera {
    let pinhole = Pinhole { fx_px: 150.0, fy_px: 150.0, cx_px: 79.5, cy_px: 59.5 };
    Camera::try_new((SIZE.0 as u32, SIZE.1 as u32), pinhole, Distortion::None).expect("valid intrinsics")
}

/// Frame sets by their stamps in ms; `None` is a missing camera.
struct Sets {
    stamps_ms: Vec<Vec<Option<i64>>>,
    next: usize,
    broken_at: Option<usize>,
}

impl Sets {
    fn new(stamps_ms: &[&[Option<i64>]]) -> Self {
        Self { stamps_ms: stamps_ms.iter().map(|set| set.to_vec()).collect(), next: 0, broken_at: None }
    }
}

impl FrameSetReader for Sets {
    fn next_set(&mut self, frames: &mut [RgbdFrame]) -> Result<bool, CaptureError> {
        if self.broken_at == Some(self.next) {
            return Err(CaptureError::BadData { path: PathBuf::from("7.png"), what: "truncated".to_owned() });
        }
        let Some(stamps_ms) = self.stamps_ms.get(self.next) else { return Ok(false) };
        for (camera, (frame, stamp_ms)) in frames.iter_mut().zip(stamps_ms).enumerate() {
            match stamp_ms {
                Some(stamp_ms) => draw(frame, *stamp_ms, 7 * self.next + 31 * camera),
                None => frame.width = 0,
            }
        }
        self.next += 1;
        Ok(true)
    }
}

/// A bright board, at a place of its own, before a darker wall that is further away.
fn draw(frame: &mut RgbdFrame, stamp_ms: i64, place_px: usize) {
    let (width, height) = SIZE;
    frame.stamp = StampNs(stamp_ms * 1_000_000);
    (frame.width, frame.height, frame.depth_unit_m) = (width, height, 0.001);
    let left = 10 + place_px % 60;
    let on_board = |i: usize| (left..left + 70).contains(&(i % width)) && (20..95).contains(&(i / width));
    frame.depth.clear();
    frame.depth.extend((0..width * height).map(|i| if on_board(i) { 900 } else { 1500 }));
    frame.rgb.clear();
    frame.rgb.extend((0..width * height).flat_map(|i| [if on_board(i) { 200 } else { 70 }; 3]));
}

fn run(sets: &mut Sets, n_line_threads: usize) -> Result<OfflineRun, CaptureError> {
    let sync = SyncOptions { max_skew: Duration::from_millis(8), ..SyncOptions::default() };
    let options = PipelineOptions { sync, n_line_threads, ..PipelineOptions::default() };
    run_offline(sets, &rig(), &options, &mut |_| {})
}

fn three_sets() -> Sets {
    let set = |start_ms| [Some(start_ms), Some(start_ms + 1), Some(start_ms)];
    Sets::new(&[&set(0), &set(2000), &set(4000)])
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let with = |n_threads| {
        let run = run(&mut three_sets(), n_threads).expect("good sets");
        // Debug prints every float so that it can be read back exactly.
        (format!("{:?}", run.calibration), run.lines, run.frame_sets)
    };
    let one = with(1);
    assert!(one.1.iter().all(|&lines| lines >= 3 * 2), "lines per camera: {:?}", one.1);
    assert_eq!(one.2, SetCounts { seen: 3, used: 3, refused: RefusedSets::default() });
    for n_threads in [2, 3, 5] {
        assert_eq!(with(n_threads), one, "{n_threads} threads");
    }
}

#[test]
fn sets_with_too_much_skew_or_too_few_frames_are_refused_and_counted() {
    let mut sets = Sets::new(&[
        &[Some(0), Some(20), Some(0)],
        &[Some(1000), None, None],
        &[Some(2000), None, Some(2003)],
        &[None, None, None],
    ]);
    let run = run(&mut sets, 2).expect("readable sets");
    let refused = RefusedSets { incomplete: 2, skew: 1, ..RefusedSets::default() };
    assert_eq!(run.frame_sets, SetCounts { seen: 4, used: 1, refused });
    let [a_b, a_c, b_c] = run.pair_skews[..] else { panic!("{:?}", run.pair_skews) };
    assert_eq!((a_b.within.count, a_b.beyond, a_b.last_beyond_ms), (0, 1, 20.0));
    assert_eq!((a_c.within.count, a_c.within.max_ms, a_c.beyond), (2, 3.0, 0));
    assert_eq!((b_c.first, b_c.second, b_c.beyond), (1, 2, 1));
    assert_eq!(run.lines[1], 0);
}

#[test]
fn a_set_that_cannot_be_read_ends_the_run_with_its_file() {
    let mut sets = three_sets();
    sets.broken_at = Some(2);
    let error = run(&mut sets, 1).expect_err("the third set is broken");
    assert_eq!(error.to_string(), "7.png: truncated");
}

#[test]
fn no_sets_at_all_is_a_result_without_cameras() {
    let run = run(&mut Sets::new(&[]), 1).expect("nothing to fail");
    assert_eq!(run.frame_sets, SetCounts::default());
    assert!(run.calibration.reason.is_some());
}

#[test]
fn progress_counts_the_sets_and_then_solves() {
    let mut told = Vec::new();
    let options = PipelineOptions::default();
    run_offline(&mut three_sets(), &rig(), &options, &mut |progress| told.push(progress)).expect("good sets");
    let counts = |seen| OfflineProgress::Set(SetCounts { seen, used: seen, refused: RefusedSets::default() });
    assert_eq!(told, [counts(1), counts(2), counts(3), OfflineProgress::Solving]);
}
