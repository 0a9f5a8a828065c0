//! What needs a process of its own: allocations and threads of the running pipeline.
#![allow(
    unsafe_code,
    reason = "a counting allocator is the only way to see allocations, and `GlobalAlloc` is unsafe"
)]
#![allow(clippy::expect_used, clippy::panic, reason = "clippy's leave for tests stops at #[test]")]

#[allow(dead_code, reason = "each program uses its part of the fake cameras")]
#[path = "it/pipeline/fake.rs"]
mod fake;

#[allow(dead_code, reason = "each program uses its part of the stand-ins")]
#[path = "it/pipeline/parts.rs"]
mod parts;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use parts::CountingEstimator;
use pelical::pipeline::{Estimator, Parts, Pipeline, PipelineEvent, PipelineOptions, SyncOptions};

/// Threads that are counted; later ones share the last place.
const MAX_THREADS: usize = 64;
/// Longest wait for anything, far beyond what a loaded machine needs.
const PATIENCE: Duration = Duration::from_secs(30);

static ALLOCATIONS: [AtomicU64; MAX_THREADS] = [const { AtomicU64::new(0) }; MAX_THREADS];
static THREAD_IDS: [AtomicI32; MAX_THREADS] = [const { AtomicI32::new(0) }; MAX_THREADS];
static NEXT_PLACE: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    /// This thread's place in the tables.
    static PLACE: Cell<Option<usize>> = const { Cell::new(None) };
}

struct CountingAllocator;

fn count() {
    // Without a place a thread that is ending would not be counted; its last allocations are not on the frame path.
    let place = PLACE.try_with(|place| {
        place.get().unwrap_or_else(|| {
            let new = NEXT_PLACE.fetch_add(1, Ordering::SeqCst).min(MAX_THREADS - 1);
            THREAD_IDS[new].store(rustix::thread::gettid().as_raw_nonzero().get(), Ordering::SeqCst);
            place.set(Some(new));
            new
        })
    });
    if let Ok(place) = place {
        ALLOCATIONS[place].fetch_add(1, Ordering::SeqCst);
    }
}

// SAFETY: every call goes to the system's allocator unchanged; counting allocates nothing.
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is passed on.
        unsafe { System.realloc(pointer, layout, new_size) }
    }
}

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator;

/// Thread ids by the name the system shows.
fn threads() -> BTreeMap<String, i32> {
    let tasks = fs::read_dir("/proc/self/task").expect("proc");
    tasks
        .filter_map(|task| {
            let task = task.ok()?;
            // A thread may end while it is listed.
            let name = fs::read_to_string(task.path().join("comm")).ok()?;
            Some((name.trim_end().to_owned(), task.file_name().to_str()?.parse().ok()?))
        })
        .collect()
}

fn allocations_of(thread_id: i32) -> u64 {
    let place = THREAD_IDS.iter().position(|id| id.load(Ordering::SeqCst) == thread_id);
    place.map_or(0, |place| ALLOCATIONS[place].load(Ordering::SeqCst))
}

fn start() -> (Pipeline, crossbeam_channel::Receiver<PipelineEvent>) {
    let (cameras, _) = fake::rig(&["a", "b"]);
    let sync = SyncOptions { max_skew: Duration::from_micros(2_400), ..SyncOptions::default() };
    let options = PipelineOptions { sync, n_line_threads: 2, ..PipelineOptions::default() };
    let (sender, events) = crossbeam_channel::bounded(64);
    // A real solution could be under way at the stop.
    let estimator = Box::new(|_| Box::new(CountingEstimator::converging_at(u64::MAX)) as Box<dyn Estimator>);
    let parts = Parts { estimator, ..Parts::new(&options) };
    (Pipeline::start_with(parts, cameras, &options, sender).expect("it starts"), events)
}

#[track_caller]
fn wait_for_sets(pipeline: &Pipeline, n_sets: u64) {
    let goal = pipeline.snapshot().counts.sets_done + n_sets;
    let deadline = Instant::now() + PATIENCE;
    while pipeline.snapshot().counts.sets_done < goal {
        assert!(Instant::now() < deadline, "never: {n_sets} more frame sets");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// One test, because both parts look at all threads of the process.
#[test]
fn the_frame_path_has_named_threads_that_allocate_nothing_and_end() {
    let (pipeline, events) = start();
    let reader = std::thread::spawn(move || events.iter().count());
    wait_for_sets(&pipeline, 60);
    let before = threads();
    for name in ["cap-a", "cap-b", "sync", "lines-0", "lines-1", "publish", "estimate"] {
        assert!(before.contains_key(name), "no thread \"{name}\" in {before:?}");
    }
    let counted: Vec<_> = before.iter().filter(|(name, _)| is_on_frame_path(name)).collect();
    assert_eq!(counted.len(), 6, "{counted:?}");
    let count = || counted.iter().map(|(name, id)| (*name, allocations_of(**id))).collect::<Vec<_>>();
    let allocated = count();
    assert!(allocated.iter().any(|(_, n)| *n > 0), "the allocator counts nothing: {allocated:?}");
    wait_for_sets(&pipeline, 120);
    assert_eq!(count(), allocated, "allocations per thread after and before 120 frame sets");

    assert_eq!(pipeline.stop().abandoned, [""; 0]);
    assert!(reader.join().expect("reader") > 100, "the events were read");
    let left: Vec<String> = threads().into_keys().filter(|name| is_of_pipeline(name)).collect();
    assert_eq!(left, [""; 0], "threads that outlive the stop");
}

fn is_on_frame_path(name: &str) -> bool {
    name.starts_with("cap-") || name.starts_with("lines-") || name == "sync" || name == "publish"
}

fn is_of_pipeline(name: &str) -> bool {
    is_on_frame_path(name) || name == "estimate"
}
