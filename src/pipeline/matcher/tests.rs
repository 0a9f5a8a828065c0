use super::*;

const MS: i64 = 1_000_000;

/// A matcher over frames that are named by their stamp in ms, fed and read like the sync thread does it.
struct Bench {
    matcher: Matcher<i64>,
    expected: Vec<bool>,
    recycled: Vec<(usize, i64)>,
    now: Duration,
}

impl Bench {
    fn new(n_cameras: usize) -> Self {
        let options = MatchOptions { max_skew_ns: 8_000_000, wait: Duration::from_millis(100), capacity: 4 };
        let matcher = Matcher::new(n_cameras, options);
        Self { matcher, expected: vec![true; n_cameras], recycled: Vec::new(), now: Duration::ZERO }
    }

    fn push(&mut self, camera: usize, stamp_ms: i64) {
        let frame = Stamped { stamp: StampNs(stamp_ms * MS), arrival: self.now, item: stamp_ms };
        self.matcher.push(camera, frame, &mut |camera, item| self.recycled.push((camera, item)));
    }

    /// Every set there is now, as stamps in ms by camera.
    fn sets(&mut self) -> Vec<Vec<Option<i64>>> {
        let mut sets = Vec::new();
        let n_cameras = self.expected.len();
        while let Some(set) = self
            .matcher
            .next_set(self.now, &self.expected, &mut |camera, item| self.recycled.push((camera, item)))
        {
            sets.push(
                set.frames[..n_cameras].iter().map(|frame| frame.as_ref().map(|frame| frame.item)).collect(),
            );
        }
        sets
    }
}

#[test]
fn frames_of_one_moment_become_a_set_whatever_the_order_of_cameras() {
    let mut bench = Bench::new(2);
    for (camera, stamp_ms) in [(1, 2), (0, 0), (0, 33), (1, 35)] {
        bench.push(camera, stamp_ms);
    }
    assert_eq!(bench.sets(), [[Some(0), Some(2)], [Some(33), Some(35)]]);
    assert_eq!(bench.matcher.counters(), MatchCounters::default());
}

#[test]
fn the_skew_of_a_set_is_measured() {
    let mut bench = Bench::new(3);
    for (camera, stamp_ms) in [(0, 100), (1, 103), (2, 107)] {
        bench.push(camera, stamp_ms);
    }
    let set = bench.matcher.next_set(Duration::ZERO, &[true; 3], &mut |_, _| {}).expect("within 8 ms");
    assert_eq!(set.skew_ns, 7_000_000);
}

#[test]
fn cameras_out_of_phase_are_refused_once_per_moment() {
    let mut bench = Bench::new(2);
    for round in 0..10 {
        bench.push(0, 33 * round);
        bench.push(1, 33 * round + 16);
        assert!(bench.sets().is_empty());
    }
    let counters = bench.matcher.counters();
    assert!((9..=10).contains(&counters.refused_sets), "{counters:?}");
    let gaps: Vec<u64> = bench.matcher.drain_beyond().map(|beyond| beyond.gap_ns).collect();
    assert!(gaps.len() > 15 && gaps.iter().all(|gap| [16_000_000, 17_000_000].contains(gap)), "{gaps:?}");
}

#[test]
fn a_faster_camera_gives_its_nearest_frame_and_nothing_is_refused() {
    let mut bench = Bench::new(2);
    let mut sets = Vec::new();
    for step in 0..12 {
        bench.push(0, 11 * step);
        if step % 3 == 0 {
            bench.push(1, 11 * step + 1);
        }
        sets.extend(bench.sets());
    }
    let expected: Vec<_> = (0..4).map(|i| vec![Some(33 * i), Some(33 * i + 1)]).collect();
    assert_eq!(sets, expected);
    assert_eq!(bench.matcher.counters().refused_sets, 0);
}

#[test]
fn of_two_frames_in_reach_the_nearer_one_is_taken() {
    let mut bench = Bench::new(2);
    for (camera, stamp_ms) in [(0, 0), (0, 5), (1, 6)] {
        bench.push(camera, stamp_ms);
    }
    assert_eq!(bench.sets(), [[Some(5), Some(6)]]);
    assert_eq!(bench.recycled, [(0, 0)]);
}

#[test]
fn frames_out_of_order_are_sorted_and_those_too_late_are_counted() {
    let mut bench = Bench::new(2);
    for (camera, stamp_ms) in [(0, 33), (0, 0), (1, 0), (1, 33)] {
        bench.push(camera, stamp_ms);
    }
    assert_eq!(bench.sets(), [[Some(0), Some(0)], [Some(33), Some(33)]]);
    bench.push(0, 20);
    bench.push(0, 33);
    assert_eq!(bench.matcher.counters().out_of_order, 2);
    assert_eq!(bench.recycled, [(0, 20), (0, 33)]);
}

#[test]
fn clocks_that_are_set_back_go_on_forming_sets() {
    let mut bench = Bench::new(2);
    for stamp_ms in [100_000, 100_033] {
        bench.push(0, stamp_ms);
        bench.push(1, stamp_ms);
    }
    assert_eq!(bench.sets().len(), 2);
    bench.push(0, 100_066);
    for stamp_ms in [0, 33] {
        bench.push(0, stamp_ms);
        bench.push(1, stamp_ms);
    }
    assert_eq!(bench.sets(), [[Some(0), Some(0)], [Some(33), Some(33)]]);
    assert_eq!(bench.matcher.counters().clock_resets, 2);
    assert_eq!(bench.recycled, [(0, 100_066)]);
}

#[test]
fn a_living_camera_is_waited_for_but_not_for_ever() {
    let mut bench = Bench::new(3);
    bench.push(0, 0);
    bench.push(1, 1);
    assert!(bench.sets().is_empty(), "the third camera may still deliver");
    bench.now = Duration::from_millis(101);
    assert_eq!(bench.sets(), [[Some(0), Some(1), None]]);
}

#[test]
fn a_dead_camera_does_not_hold_up_the_others() {
    let mut bench = Bench::new(3);
    bench.expected[2] = false;
    bench.push(0, 0);
    bench.push(1, 1);
    assert_eq!(bench.sets(), [[Some(0), Some(1), None]]);
}

#[test]
fn the_last_living_camera_of_a_rig_forms_no_set() {
    let mut bench = Bench::new(2);
    bench.expected[1] = false;
    bench.push(0, 0);
    assert!(bench.sets().is_empty());
    assert_eq!(bench.recycled, [(0, 0)]);
    assert_eq!(bench.matcher.counters().unmatched_frames, 1);
}

#[test]
fn a_rig_of_one_camera_has_sets_of_one() {
    let mut bench = Bench::new(1);
    bench.push(0, 7);
    assert_eq!(bench.sets(), [[Some(7)]]);
}

#[test]
fn every_frame_comes_out_exactly_once_for_random_stamps() {
    let mut bench = Bench::new(3);
    let mut state = 7u64;
    let mut random = move |n: u64| {
        // splitmix64
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)) % n
    };
    let (mut pushed, mut in_sets) = (0, 0);
    for step in 0..3000i64 {
        bench.now += Duration::from_millis(random(30));
        let base = if random(400) == 0 { 0 } else { step * 10 };
        bench.push(random(3) as usize, base + random(25) as i64);
        pushed += 1;
        for set in bench.sets() {
            let stamps: Vec<_> = set.into_iter().flatten().collect();
            in_sets += stamps.len();
            let (low, high) = (stamps.iter().min().unwrap(), stamps.iter().max().unwrap());
            assert!(stamps.len() >= 2 && high - low <= 8, "{stamps:?}");
        }
    }
    let waiting: usize = bench.matcher.queues.iter().map(VecDeque::len).sum();
    assert_eq!(in_sets + bench.recycled.len() + waiting, pushed);
    assert!(in_sets > 300, "only {in_sets} frames in sets");
}

#[test]
fn frames_without_a_partner_are_told_with_the_nearest_camera_and_its_distance() {
    let mut bench = Bench::new(3);
    // Cameras 0 and 1 in step, 2 half a period behind them.
    for start_ms in [0, 33, 66] {
        for (camera, offset_ms) in [(0, 0), (1, 3), (2, 15)] {
            bench.push(camera, start_ms + offset_ms);
        }
    }
    assert_eq!(bench.sets().len(), 3);
    let told: Vec<BeyondLimit> = bench.matcher.drain_beyond().collect();
    assert_eq!(told, [BeyondLimit { cameras: (2, 1), gap_ns: 12 * MS as u64 }], "the second in a row");
    assert_eq!(bench.matcher.drain_beyond().count(), 0, "told once");
}

#[test]
fn a_lost_frame_of_another_camera_is_no_skew() {
    let mut bench = Bench::new(2);
    for start_ms in [0, 33, 66, 99] {
        bench.push(0, start_ms);
        if start_ms != 33 {
            bench.push(1, start_ms + 2);
        }
    }
    assert_eq!(bench.sets().len(), 3);
    assert_eq!(bench.matcher.drain_beyond().count(), 0);
}

/// Frames of a rig, ten rounds of them, each at its time, and the sync thread looking every 5 ms.
fn play(bench: &mut Bench, period_ms: i64, offsets_ms: &[i64]) -> usize {
    let mut n_sets = 0;
    for now_ms in 0..10 * period_ms {
        bench.now = Duration::from_millis(now_ms as u64);
        for (camera, offset_ms) in offsets_ms.iter().enumerate() {
            if now_ms % period_ms == *offset_ms {
                bench.push(camera, now_ms);
            }
        }
        if now_ms % 5 == 0 {
            n_sets += bench.sets().len();
        }
    }
    n_sets
}

#[test]
fn slow_cameras_out_of_step_are_refused_and_told_like_fast_ones() {
    for (period_ms, offset_ms) in
        [(33, 12), (100, 20), (167, 20), (250, 20), (250, 30), (250, 130), (1000, 500)]
    {
        let mut bench = Bench::new(2);
        assert_eq!(play(&mut bench, period_ms, &[0, offset_ms]), 0);
        let counters = bench.matcher.counters();
        assert!((8..=10).contains(&counters.refused_sets), "{period_ms} ms, {offset_ms} ms: {counters:?}");
        let told: Vec<BeyondLimit> = bench.matcher.drain_beyond().collect();
        let nearest_ns = (offset_ms.min(period_ms - offset_ms) * MS) as u64;
        assert!(told.len() >= 14, "{period_ms} ms, {offset_ms} ms: {told:?}");
        assert!(told.iter().any(|beyond| beyond.gap_ns == nearest_ns), "{period_ms} ms: {told:?}");
    }
}

#[test]
fn at_six_frames_per_second_one_camera_out_of_step_is_told_and_the_others_form_sets() {
    let mut bench = Bench::new(3);
    assert_eq!(play(&mut bench, 167, &[0, 3, 20]), 10);
    let told: Vec<BeyondLimit> = bench.matcher.drain_beyond().collect();
    assert!(told.len() >= 8, "{told:?}");
    assert!(told.iter().all(|beyond| *beyond == BeyondLimit { cameras: (2, 1), gap_ns: 17 * MS as u64 }));
}

#[test]
fn a_camera_that_falls_silent_is_no_skew() {
    let mut bench = Bench::new(2);
    for (camera, stamp_ms) in [(0, 0), (1, 2)] {
        bench.push(camera, stamp_ms);
    }
    assert_eq!(bench.sets().len(), 1);
    for (number, is_noticed) in (1..30).map(|number| (number, number > 15)) {
        bench.expected[1] = !is_noticed;
        bench.now = Duration::from_millis(33 * number);
        bench.push(0, 33 * number as i64);
        assert!(bench.sets().is_empty());
    }
    assert_eq!((bench.matcher.counters().refused_sets, bench.matcher.drain_beyond().count()), (0, 0));
}

#[test]
fn clocks_that_are_an_hour_apart_refuse_a_set_per_moment() {
    let mut bench = Bench::new(2);
    for start_ms in (0..30).map(|number| 33 * number) {
        bench.push(0, start_ms);
        bench.push(1, 3_600_000 + start_ms);
        assert!(bench.sets().is_empty());
    }
    let refused = bench.matcher.counters().refused_sets;
    assert!((25..=30).contains(&refused), "{refused}");
    assert!(bench.matcher.drain_beyond().all(|beyond| beyond.gap_ns > 3_500_000 * MS as u64));
}

#[test]
fn a_camera_with_a_clock_of_its_own_is_not_waited_for_and_refuses_no_set_of_the_others() {
    let mut bench = Bench::new(3);
    let mut n_sets = 0;
    for start_ms in (0..10).map(|number| 33 * number) {
        bench.matcher.pass_over(2);
        bench.push(0, start_ms);
        bench.push(1, start_ms + 1);
        n_sets += bench.sets().len();
    }
    assert_eq!((n_sets, bench.matcher.counters().refused_sets), (10, 0));
    assert_eq!((bench.matcher.strangers(), bench.matcher.counters().unmatched_frames), (0b100, 10));
}

#[test]
fn without_a_second_camera_on_the_same_clock_every_moment_is_a_refused_set() {
    for is_first_a_stranger in [false, true] {
        let mut bench = Bench::new(2);
        assert!(bench.sets().is_empty());
        for stamp_ms in (0..10).map(|number| 33 * number) {
            bench.matcher.pass_over(1);
            if is_first_a_stranger {
                bench.matcher.pass_over(0)
            } else {
                bench.push(0, stamp_ms)
            };
            assert!(bench.sets().is_empty());
        }
        assert_eq!(bench.matcher.counters().refused_sets, 10);
    }
}
