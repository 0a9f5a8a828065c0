//! The live pipeline with cameras in memory.

mod fake;
mod offline;
mod parts;
mod resets;

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use crossbeam_channel::Receiver;
use pelical::pipeline::{
    Answer, CameraSlot, CameraState, Command, Counts, Estimator, Parts, Phase, Pipeline, PipelineEvent,
    PipelineOptions, Progress, StartError, SyncOptions,
};

use fake::{FIRST_STAMP_NS, Mode, PERIOD, SKEW};
use parts::{BlockingEstimator, CountingEstimator, SlowFinder};

/// Longest wait for anything, far beyond what a loaded machine needs.
const PATIENCE: Duration = Duration::from_secs(30);

fn quick() -> PipelineOptions {
    let sync = SyncOptions {
        max_skew: Duration::from_micros(2_400),
        wait: Duration::from_millis(50),
        stalled_after: Duration::from_millis(250),
        reopen_after: Duration::from_secs(60),
    };
    PipelineOptions { sync, ..PipelineOptions::default() }
}

/// A running pipeline and what it says.
struct Bench {
    pipeline: Pipeline,
    events: Receiver<PipelineEvent>,
}

impl Bench {
    fn start(cameras: Vec<CameraSlot>, parts: Parts) -> Self {
        Self::start_with(cameras, parts, &quick())
    }

    fn start_with(cameras: Vec<CameraSlot>, parts: Parts, options: &PipelineOptions) -> Self {
        let (sender, events) = crossbeam_channel::bounded(64);
        let pipeline = Pipeline::start_with(parts, cameras, options, sender).expect("it starts");
        Self { pipeline, events }
    }

    /// The first event that `pick` takes.
    #[track_caller]
    fn wait_for<T>(&self, what: &str, mut pick: impl FnMut(PipelineEvent) -> Option<T>) -> T {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            let event = self.events.recv_timeout(left).unwrap_or_else(|_| panic!("never: {what}"));
            if let Some(picked) = pick(event) {
                return picked;
            }
        }
    }

    #[track_caller]
    fn wait_for_progress(&self, what: &str, mut is_it: impl FnMut(&Progress) -> bool) -> Progress {
        self.wait_for(what, |event| match event {
            PipelineEvent::Progress(progress) if is_it(&progress) => Some(progress),
            _ => None,
        })
    }

    #[track_caller]
    fn wait_for_camera(&self, camera: usize, state: CameraState) {
        self.wait_for(&format!("camera {camera} {}", state.name()), |event| {
            matches!(event, PipelineEvent::Camera { camera: c, state: s, .. } if (c, s) == (camera, state))
                .then_some(())
        });
    }

    fn counts(&self) -> Counts {
        self.pipeline.snapshot().counts
    }

    #[track_caller]
    fn wait_for_counts(&self, what: &str, is_it: impl Fn(&Counts) -> bool) -> Counts {
        poll(what, || Some(self.counts()).filter(&is_it))
    }
}

/// Asks again and again until there is an answer.
#[track_caller]
fn poll<T>(what: &str, ask: impl Fn() -> Option<T>) -> T {
    let deadline = Instant::now() + PATIENCE;
    loop {
        if let Some(answer) = ask() {
            return answer;
        }
        assert!(Instant::now() < deadline, "never: {what}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// The real line stage, and an estimator that takes no time and never converges.
fn quick_parts() -> Parts {
    let estimator = Box::new(|_| Box::new(CountingEstimator::converging_at(u64::MAX)) as Box<dyn Estimator>);
    Parts { estimator, ..Parts::new(&quick()) }
}

fn present(progress: &Progress) -> [bool; 3] {
    [0, 1, 2].map(|camera| progress.cameras[camera].is_present)
}

#[test]
fn frame_sets_arrive_in_order_with_their_stamps_and_lines() {
    let (cameras, _) = fake::rig(&["in-order-a", "in-order-b"]);
    let bench = Bench::start(cameras, quick_parts());
    let mut last: Option<Progress> = None;
    for _ in 0..50 {
        let progress = bench.wait_for_progress("a frame set", |_| true);
        let since_first_ns = progress.newest_stamp.0 - FIRST_STAMP_NS - SKEW.as_nanos() as i64;
        assert_eq!(since_first_ns % PERIOD.as_nanos() as i64, 0, "{progress:?}");
        assert_eq!(progress.skew, SKEW);
        assert_eq!(present(&progress), [true, true, false]);
        assert!(progress.latency >= Duration::ZERO && progress.newest_arrival <= Instant::now());
        if let Some(last) = last {
            assert!(progress.set > last.set && progress.newest_stamp > last.newest_stamp);
            assert!(progress.newest_arrival >= last.newest_arrival);
        }
        last = Some(progress);
    }
    let snapshot = bench.pipeline.snapshot();
    assert!(snapshot.counts.frames >= 100 && snapshot.counts.bad_frames == 0, "{:?}", snapshot.counts);
    assert!(snapshot.latencies.detect.count >= 100 && snapshot.latencies.frame_to_progress.count >= 50);
    assert_eq!(bench.pipeline.stop().abandoned, [""; 0]);
}

#[test]
fn an_unplugged_camera_is_missed_until_it_is_back() {
    let (cameras, controls) = fake::rig(&["plug-a", "plug-b", "plug-c"]);
    let bench = Bench::start(cameras, quick_parts());
    bench.wait_for_progress("all three", |progress| present(progress) == [true; 3]);
    controls[2].set(Mode::Unplugged);
    bench.wait_for_camera(2, CameraState::Unplugged);
    bench.wait_for_progress("the other two", |progress| present(progress) == [true, true, false]);
    controls[2].set(Mode::Run);
    bench.wait_for_camera(2, CameraState::Streaming);
    bench.wait_for_progress("all three again", |progress| present(progress) == [true; 3]);
    assert_eq!(bench.pipeline.stop().abandoned, [""; 0]);
}

#[test]
fn a_camera_that_is_not_there_at_the_start_joins_later() {
    let (cameras, controls) = fake::rig(&["late-a", "late-b", "late-c"]);
    controls[0].set(Mode::Unplugged);
    let bench = Bench::start(cameras, quick_parts());
    bench.wait_for_progress("the other two", |progress| present(progress) == [false, true, true]);
    assert_eq!(bench.pipeline.snapshot().cameras[0].state, CameraState::Waiting);
    controls[0].set(Mode::Run);
    bench.wait_for_progress("all three", |progress| present(progress) == [true; 3]);
}

#[test]
fn a_stalled_camera_is_reported_and_the_others_go_on() {
    let (cameras, controls) = fake::rig(&["stall-a", "stall-b", "stall-c"]);
    let bench = Bench::start(cameras, quick_parts());
    bench.wait_for_progress("all three", |progress| present(progress) == [true; 3]);
    controls[1].set(Mode::Stall);
    bench.wait_for_camera(1, CameraState::Stalled);
    bench.wait_for_progress("the other two", |progress| present(progress) == [true, false, true]);
    controls[1].set(Mode::Run);
    bench.wait_for_camera(1, CameraState::Streaming);
    bench.wait_for_progress("all three again", |progress| present(progress) == [true; 3]);
}

#[test]
fn a_camera_that_stays_stalled_is_opened_again() {
    let (cameras, controls) = fake::rig(&["reopen-a", "reopen-b"]);
    let mut options = quick();
    options.sync.reopen_after = Duration::from_millis(300);
    let bench = Bench::start_with(cameras, quick_parts(), &options);
    bench.wait_for_camera(0, CameraState::Streaming);
    controls[0].set(Mode::Stall);
    bench.wait_for_camera(0, CameraState::Stalled);
    bench.wait_for_camera(0, CameraState::Opened);
    bench.wait_for_camera(0, CameraState::Stalled);
    controls[0].set(Mode::Run);
    bench.wait_for_camera(0, CameraState::Streaming);
}

#[test]
fn an_open_camera_is_not_said_to_deliver_frames_before_it_does() {
    let (cameras, controls) = fake::rig(&["silent-a", "silent-b"]);
    controls[1].set(Mode::Stall);
    let bench = Bench::start(cameras, quick_parts());
    let mut states = Vec::new();
    bench.wait_for("the first frame's state", |event| {
        if let PipelineEvent::Camera { camera: 1, state, .. } = event {
            states.push(state);
            if state == CameraState::Stalled {
                controls[1].set(Mode::Run);
            }
        }
        (states.last() == Some(&CameraState::Streaming)).then_some(())
    });
    assert_eq!(states, [CameraState::Opened, CameraState::Stalled, CameraState::Streaming]);
}

#[test]
fn the_thread_of_a_camera_that_is_away_shows_signs_of_life_all_the_time() {
    let (cameras, controls) = fake::rig(&["away-a", "away-b"]);
    controls[0].set(Mode::Unplugged);
    let bench = Bench::start(cameras, quick_parts());
    let (start, mut before) = (Instant::now(), bench.pipeline.vitals());
    // The pauses between two attempts have grown beyond a second by then.
    while start.elapsed() < Duration::from_millis(3500) {
        std::thread::sleep(Duration::from_millis(600));
        let now = bench.pipeline.vitals();
        assert!(!now.hanging_since(&before).contains(&"cap-away-a".to_owned()), "{now:?}");
        before = now;
    }
}

#[test]
fn the_end_of_a_recording_is_a_state_and_not_the_end_of_the_pipeline() {
    let (cameras, controls) = fake::rig(&["end-a", "end-b", "end-c"]);
    let bench = Bench::start(cameras, quick_parts());
    controls[2].set(Mode::End);
    bench.wait_for_camera(2, CameraState::Ended);
    bench.wait_for_progress("the other two", |progress| present(progress) == [true, true, false]);
}

#[test]
fn frames_of_another_size_than_promised_are_counted_and_not_used() {
    let (cameras, controls) = fake::rig(&["size-a", "size-b"]);
    controls[1].set(Mode::WrongSize);
    let bench = Bench::start(cameras, quick_parts());
    let counts = bench.wait_for_counts("bad frames", |counts| counts.bad_frames > 5);
    assert_eq!(counts.sets_formed, 0);
    bench.wait_for_camera(1, CameraState::Failed);
    controls[1].set(Mode::Run);
    bench.wait_for_progress("both cameras", |progress| present(progress) == [true, true, false]);
}

#[test]
fn a_camera_that_stamps_by_its_own_clock_meets_no_other_however_near_its_stamps_are() {
    let (cameras, controls) = fake::rig(&["clock-a", "clock-b"]);
    controls[1].set(Mode::OwnClock);
    let bench = Bench::start(cameras, quick_parts());
    let counts = bench.wait_for_counts("refused sets", |counts| counts.refused_skew > 20);
    assert_eq!(counts.sets_formed, 0);
    assert_eq!(bench.pipeline.snapshot().pair_skews[0].own_clock, Some(1));
    controls[1].set(Mode::Run);
    bench.wait_for_progress("both cameras", |progress| present(progress) == [true, true, false]);
    poll("its clock is known", || {
        let own_clock = bench.pipeline.snapshot().pair_skews[0].own_clock;
        own_clock.is_none().then_some(())
    });
}

#[test]
fn a_source_that_hangs_is_left_behind_and_named() {
    let (cameras, controls) = fake::rig(&["hang-a", "hang-b"]);
    let bench = Bench::start(cameras, quick_parts());
    bench.wait_for_progress("a frame set", |_| true);
    controls[0].set(Mode::Hang);
    bench.wait_for_camera(0, CameraState::Stalled);
    assert_eq!(bench.pipeline.stop().abandoned, ["cap-hang-a"]);
    controls[0].set(Mode::Run);
}

#[test]
fn sets_that_the_line_stage_is_too_slow_for_are_counted() {
    let (cameras, _) = fake::rig(&["slow-a", "slow-b"]);
    let mut parts = quick_parts();
    parts.line_finder = Box::new(|| Box::new(SlowFinder(Duration::from_millis(25))));
    let bench = Bench::start(cameras, parts);
    let counts = bench.wait_for_counts("drops", |counts| counts.dropped_sets > 20 && counts.sets_done > 5);
    assert!(counts.dropped_frames * 4 < counts.frames, "sync must not wait for the line stage: {counts:?}");
    // Four in flight and one pending; the counts are not read at one moment, so it may take several looks.
    bench.wait_for_counts("every set is accounted for", |counts| {
        counts.sets_formed.abs_diff(counts.sets_done + counts.dropped_sets) <= 5
    });
}

#[test]
fn every_set_is_in_order_even_with_more_threads_than_frames() {
    let (cameras, _) = fake::rig(&["many-a", "many-b"]);
    let mut parts = quick_parts();
    parts.line_finder = Box::new(|| Box::new(SlowFinder(Duration::from_millis(3))));
    let bench = Bench::start_with(cameras, parts, &PipelineOptions { n_line_threads: 6, ..quick() });
    let mut next = 0;
    bench.wait_for_progress("50 sets", |progress| {
        assert!(progress.set >= next, "{} after {next}", progress.set);
        next = progress.set + 1;
        next > 50
    });
}

#[test]
fn a_recalibration_is_refused_while_one_is_going_on() {
    let (cameras, _) = fake::rig(&["busy-a", "busy-b"]);
    let Bench { pipeline, .. } = Bench::start(cameras, quick_parts());
    assert_eq!(pipeline.command(Command::Recalibrate), Answer::Busy);
    assert_eq!(pipeline.command(Command::Cancel), Answer::Accepted);
    assert_eq!(pipeline.snapshot().phase, Phase::Idle);
    assert_eq!(pipeline.command(Command::Cancel), Answer::NotCollecting);
    assert_eq!(pipeline.command(Command::Recalibrate), Answer::Accepted);
    assert_eq!(pipeline.command(Command::Recalibrate), Answer::Busy);
}

#[test]
fn after_convergence_it_goes_on_watching_and_recalibrates_from_nothing() {
    let (cameras, _) = fake::rig(&["watch-a", "watch-b"]);
    let mut parts = quick_parts();
    parts.estimator = Box::new(|_| Box::new(CountingEstimator::converging_at(6)));
    let bench = Bench::start(cameras, parts);
    let mut solved_sets = Vec::new();
    let mut wait_for_convergence = || {
        bench.wait_for("convergence", |event| {
            let PipelineEvent::Calibration(solved) = event else { return None };
            solved_sets.push((solved.round, solved.calibration.frame_sets_used));
            (solved.calibration.state == pelical::solver::State::Converged).then_some(())
        });
    };
    wait_for_convergence();
    assert_eq!(bench.pipeline.snapshot().phase, Phase::Watching);
    bench.wait_for_progress("watching", |progress| progress.phase == Phase::Watching);
    assert_eq!(bench.pipeline.command(Command::Recalibrate), Answer::Accepted);
    wait_for_convergence();
    // Each round begins with its first three sets: nothing of the round before is in it.
    let of_three: Vec<u64> =
        solved_sets.iter().filter(|(_, sets)| *sets == 3).map(|(round, _)| *round).collect();
    assert_eq!(of_three, [1, 2], "{solved_sets:?}");
}

#[test]
fn a_given_result_is_watched_from_the_start_and_nothing_is_collected_until_asked_for() {
    let (cameras, _) = fake::rig(&["given-a", "given-b"]);
    let mut parts = quick_parts();
    parts.estimator = Box::new(|_| Box::new(CountingEstimator::converging_at(6)));
    let bench = Bench::start(cameras, parts);
    bench.pipeline.watch(parts::calibration(pelical::solver::State::Converged, 6));
    let round = bench.pipeline.round();
    let watched = |round: u64| {
        bench.wait_for("a look at the given result", |event| {
            assert!(!matches!(&event, PipelineEvent::Calibration(solved) if solved.round == round));
            let PipelineEvent::Watched(watched) = event else { return None };
            (watched.round == round).then_some(())
        });
    };
    watched(round);
    assert_eq!(bench.pipeline.snapshot().phase, Phase::Watching);
    assert_eq!(bench.pipeline.command(Command::Recalibrate), Answer::Accepted);
    bench.wait_for("convergence", |event| {
        let PipelineEvent::Calibration(solved) = event else { return None };
        (solved.calibration.state == pelical::solver::State::Converged).then_some(())
    });
    // Another one can be given at any time.
    bench.pipeline.watch(parts::calibration(pelical::solver::State::Converged, 6));
    watched(round + 2);
}

#[test]
fn nothing_waits_for_a_solution_and_a_cancelled_one_is_not_published() {
    let (cameras, _) = fake::rig(&["solve-a", "solve-b"]);
    let gate = Arc::new(parts::Gate::default());
    let of_estimator = Arc::clone(&gate);
    let mut parts = quick_parts();
    parts.estimator = Box::new(move |_| Box::new(BlockingEstimator(Arc::clone(&of_estimator))));
    let bench = Bench::start(cameras, parts);
    poll("a solution begins", || gate.is_solving.load(Ordering::SeqCst).then_some(()));
    let before = bench.counts();
    bench.wait_for_counts("progress during the solution", |counts| {
        counts.sets_done > before.sets_done + 20 && counts.skipped_sets > 0
    });
    assert_eq!(bench.pipeline.command(Command::Cancel), Answer::Accepted);
    gate.is_open.store(true, Ordering::SeqCst);
    bench.wait_for_counts("the end of the solution", |counts| counts.solves == 1);
    let done = bench.counts().sets_done;
    bench.wait_for_counts("it goes on", |counts| counts.sets_done > done + 10);
    assert!(!bench.events.try_iter().any(|event| matches!(event, PipelineEvent::Calibration(_))));
}

#[test]
fn sets_taken_in_fast_motion_are_kept_from_the_estimator() {
    let (cameras, controls) = fake::rig(&["fast-a", "fast-b"]);
    controls[1].shift_px.store(1, Ordering::SeqCst);
    let mut options = quick();
    options.motion.max_turn_rad_per_s = 0.7;
    let bench = Bench::start_with(cameras, quick_parts(), &options);
    let counts = bench.wait_for_counts("refused sets", |counts| counts.refused_image > 20);
    // The first set, and one after a pause of the machine, has nothing to compare with.
    let offered = counts.accepted_sets + counts.repeated_sets + counts.skipped_sets;
    assert!(offered < counts.refused_image, "{counts:?}");
}

#[test]
fn a_panic_in_a_thread_is_an_event() {
    let (cameras, _) = fake::rig(&["bug-a", "bug-b"]);
    let mut parts = quick_parts();
    parts.line_finder = Box::new(|| Box::new(parts::BrokenFinder));
    let bench = Bench::start(cameras, parts);
    let thread = bench.wait_for("the bug", |event| match event {
        PipelineEvent::Bug { thread } => Some(thread),
        _ => None,
    });
    assert!(thread.starts_with("lines-"), "{thread}");
    assert_eq!(bench.pipeline.stop().abandoned, [""; 0]);
}

#[test]
fn events_that_nobody_reads_are_dropped_and_counted() {
    let (cameras, _) = fake::rig(&["deaf-a", "deaf-b"]);
    let bench = Bench::start(cameras, quick_parts());
    bench.wait_for_counts("dropped events", |counts| counts.dropped_events > 10);
    assert_eq!(bench.events.len(), 64);
}

#[test]
fn a_rig_without_cameras_or_with_too_many_does_not_start() {
    let start = |n: usize| {
        let names = vec!["x"; n];
        let (sender, _events) = crossbeam_channel::bounded(1);
        Pipeline::start(fake::rig(&names).0, &quick(), sender).map(drop)
    };
    assert!(matches!(start(0), Err(StartError::NoCameras)));
    assert!(matches!(start(9), Err(StartError::TooManyCameras(9))));
}
