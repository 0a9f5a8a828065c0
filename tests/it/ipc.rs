//! Daemon and client over both transports, each test under an instance name of its own.
#![allow(clippy::expect_used, reason = "clippy sees the helpers of an integration test as product code")]

mod leftovers;

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use pelical::geometry::motion::Motion;
use pelical::ipc::{
    Activity, Archived, CalibrationMessage, CameraHealth, CameraIdentity, CameraLines, CameraState, Client,
    ClientError, FrameClock, FrameSetCounts, HealthMessage, InstanceName, Outcome, ProgressMessage,
    Provenance, RefusalCode, Request, RequestKind, Response, Server, ServerError, Skew, Snapshot,
    StageLatency, Transport,
};
use pelical::solver::{CameraPose, Reason, ReasonCode, RigCalibration, State};

/// More than a loaded machine needs; only a broken exchange takes this long.
const PLENTY: Duration = Duration::from_secs(30);

fn unique_instance() -> InstanceName {
    static COUNTER: AtomicU32 = AtomicU32::new(0);
    // Relaxed: only the number has to be unique.
    let count = COUNTER.fetch_add(1, Ordering::Relaxed);
    format!("test-{}-{count}", std::process::id()).parse().expect("allowed characters")
}

fn calibration(sequence: u64) -> CalibrationMessage {
    let pose =
        |motion| Some(CameraPose { reference_from_camera: motion, covariance: nalgebra::Matrix6::zeros() });
    let turned = Motion::new(nalgebra::Vector3::new(0.3, -0.1, 0.02), nalgebra::Vector3::new(0.0, 1.2, 0.0));
    let identity =
        |name: &str| CameraIdentity { name: name.to_owned(), serial: "0123".to_owned(), firmware: None };
    CalibrationMessage {
        sequence,
        stamp_ns: 1_800_000_000_000_000_000,
        provenance: Provenance { id: Some(sequence), ..Provenance::default() },
        cameras: vec![identity("left"), identity("right")],
        calibration: RigCalibration {
            state: State::Converged,
            reason: None,
            reference: 0,
            cameras: vec![pose(Motion::identity()), pose(turned)],
            pairs: Vec::new(),
            frame_sets_used: 12,
        },
    }
}

fn progress(sequence: u64) -> ProgressMessage {
    ProgressMessage {
        sequence,
        newest_frame_ns: 33_000_000,
        published_ns: 5,
        latency_ns: 4,
        state: State::Collecting,
        is_moved: false,
        frame_sets: FrameSetCounts { seen: sequence, used: 1, ..FrameSetCounts::default() },
        cameras: vec![CameraLines { lines: 80, lifted: 50 }; 2],
        best_pair: None,
        skew: Skew { last_ns: 1_000, max_ns: 2_000 },
        turning: None,
    }
}

fn health(sequence: u64) -> HealthMessage {
    let camera = CameraHealth {
        name: "left".to_owned(),
        state: CameraState::Streaming,
        frames: 9,
        dropped: 0,
        last_frame_age_ns: Some(12),
        fps_hz: 30.0,
        lost: 0,
        bad: 0,
        valid_depth: Some(0.75),
        clock: Some(FrameClock::Source),
        gravity_off_deg: Some(0.5),
    };
    let stage = StageLatency {
        stage: "detect".to_owned(),
        p50_ns: 3_000_000,
        p99_ns: 6_000_000,
        total_ns: 90_000_000,
    };
    let (cameras, stages) = (vec![camera], vec![stage]);
    HealthMessage { sequence, uptime_ns: 1, watch: None, cameras, stages, pair_skews: Vec::new() }
}

fn snapshot() -> Snapshot {
    Snapshot {
        activity: Activity::Collecting,
        state: State::Collecting,
        reason: Some(Reason { code: ReasonCode::NotEnoughEvidence, sentence: "3 lines so far".to_owned() }),
        watch: None,
        calibration_sequence: 0,
        calibration_id: None,
        calibration_stamp_ns: None,
        store_fault: None,
        uptime_ns: 7,
        frame_sets: FrameSetCounts { used: 2, ..FrameSetCounts::default() },
        cameras: 2,
        cameras_streaming: 2,
    }
}

/// Status is accepted, recalibrate is busy, cancel is refused: all three kinds of answer.
fn answer(request: Request) -> Response {
    let outcome = match request.kind {
        RequestKind::Status => Outcome::Accepted,
        RequestKind::Recalibrate => Outcome::Busy,
        RequestKind::Rollback => Outcome::Refused {
            code: RefusalCode::UnknownCalibration,
            sentence: format!("no calibration {}", request.calibration),
        },
        RequestKind::Cancel => Outcome::Refused {
            code: RefusalCode::NothingToCancel,
            sentence: "no calibration runs: nothing to cancel".to_owned(),
        },
    };
    Response { outcome, snapshot: snapshot() }
}

/// A history of calibrations 1 to 40.
fn archived_below(below: u64) -> Archived {
    match below.min(41) {
        0 | 1 => Archived::NoOlder,
        below => Archived::Found(Box::new(calibration(below - 1))),
    }
}

type Job = Box<dyn FnOnce(&Server) + Send>;

/// A daemon's IPC thread: polls, and does the jobs of the test in between. Ends when dropped.
struct Daemon {
    jobs: Option<mpsc::Sender<Job>>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Daemon {
    fn start(over: &Transport, instance: &InstanceName) -> Self {
        let (jobs, todo) = mpsc::channel::<Job>();
        let (started, is_started) = mpsc::channel();
        let (over, instance) = (over.clone(), instance.clone());
        let thread = std::thread::spawn(move || {
            let server = Server::start_over(&over, &instance).expect("no other daemon of this name");
            started.send(()).expect("the test waits");
            loop {
                match todo.try_recv() {
                    Ok(job) => job(&server),
                    Err(mpsc::TryRecvError::Empty) => {
                        server.poll(Duration::from_millis(20), answer).expect("polling works");
                        server.poll_archive(archived_below).expect("polling works");
                    }
                    Err(mpsc::TryRecvError::Disconnected) => return,
                }
            }
        });
        is_started.recv().expect("the daemon starts");
        Self { jobs: Some(jobs), thread: Some(thread) }
    }

    fn run(&self, job: impl FnOnce(&Server) + Send + 'static) {
        self.jobs.as_ref().expect("not dropped").send(Box::new(job)).expect("the daemon's thread lives");
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        drop(self.jobs.take());
        if let Some(thread) = self.thread.take() {
            let ended = thread.join();
            assert!(std::thread::panicking() || ended.is_ok(), "the daemon's thread panicked");
        }
    }
}

/// Each of these with shared memory and with files.
macro_rules! over_both {
    ($($name:ident)*) => {
        mod shared_memory {
            $(#[test] fn $name() { super::$name(&super::Transport::SharedMemory) })*
        }
        mod files {
            $(#[test] fn $name() {
                let folder = tempfile::tempdir().expect("a temporary folder");
                super::$name(&super::Transport::files(folder.path()));
            })*
        }
    };
}

over_both! {
    a_client_that_joins_after_the_result_gets_it
    what_is_published_is_there_with_the_first_answer_of_a_busy_daemon
    each_kind_of_request_gets_its_typed_answer
    a_whole_history_comes_newest_first_to_several_clients_at_once
    progress_messages_come_in_order
    a_client_that_never_reads_does_not_hold_up_the_daemon
    a_second_daemon_of_the_same_name_is_refused
    a_client_without_a_daemon_is_told_so
    a_daemon_that_is_too_busy_gives_no_answer
    a_client_goes_on_with_the_next_daemon
    a_killed_daemon_leaves_nothing_in_the_way
}

fn a_client_that_joins_after_the_result_gets_it(over: &Transport) {
    let instance = unique_instance();
    let daemon = Daemon::start(over, &instance);
    let (done, is_done) = mpsc::channel();
    daemon.run(move |server| {
        server.publish_calibration(&calibration(1)).expect("published");
        server.publish_calibration(&calibration(2)).expect("published");
        server.publish_health(&health(1)).expect("published");
        done.send(()).expect("the test waits");
    });
    is_done.recv().expect("published");
    let mut client = Client::connect_over(over, &instance).expect("the daemon runs");
    let newest = client.wait_calibration(PLENTY).expect("the daemon runs");
    assert_eq!(newest, Some(calibration(2)));
    assert_eq!(
        client.latest_calibration().expect("readable"),
        Some(&calibration(2)),
        "reading does not use it up"
    );
    assert_eq!(client.latest_health().expect("readable"), Some(&health(1)));
    let again = client.wait_calibration(Duration::from_millis(1)).expect("the daemon runs");
    assert_eq!(again, None, "the same calibration was given twice");
    daemon.run(|server| server.publish_calibration(&calibration(3)).expect("published"));
    let next = client.wait_calibration(PLENTY).expect("the daemon runs").expect("woken by the news");
    assert_eq!(next.sequence, 3);
}

fn what_is_published_is_there_with_the_first_answer_of_a_busy_daemon(over: &Transport) {
    let instance = unique_instance();
    let server = Server::start_over(over, &instance).expect("no other daemon of this name");
    server.publish_calibration(&calibration(1)).expect("published");
    let (over, asked) = (over.clone(), instance.clone());
    let client = std::thread::spawn(move || {
        // Nobody greets it: the daemon does something else.
        let mut client = Client::connect_over(&over, &asked).expect("the daemon runs");
        client.status(PLENTY).expect("answered");
        client.latest_calibration().expect("readable").cloned()
    });
    // Longer than a client waits to be greeted, so that its question is there when the daemon looks for the first time.
    std::thread::sleep(Duration::from_millis(600));
    // Once: then it is busy again.
    while server.poll(Duration::from_millis(20), answer).expect("polling works") == 0 {}
    assert_eq!(client.join().expect("no panic"), Some(calibration(1)));
}

fn each_kind_of_request_gets_its_typed_answer(over: &Transport) {
    let instance = unique_instance();
    let _daemon = Daemon::start(over, &instance);
    let mut client = Client::connect_over(over, &instance).expect("the daemon runs");
    let status = client.status(PLENTY).expect("answered");
    assert_eq!((status.outcome, status.snapshot), (Outcome::Accepted, snapshot()));
    assert_eq!(client.recalibrate(PLENTY).expect("answered").outcome, Outcome::Busy);
    let refused = client.cancel(PLENTY).expect("answered").outcome;
    assert!(matches!(refused, Outcome::Refused { code: RefusalCode::NothingToCancel, .. }), "{refused:?}");
}

fn a_whole_history_comes_newest_first_to_several_clients_at_once(over: &Transport) {
    let instance = unique_instance();
    let _daemon = Daemon::start(over, &instance);
    let read = |mut client: Client| {
        let (mut found, mut below) = (Vec::new(), u64::MAX);
        while let Archived::Found(message) = client.archived_below(below, PLENTY).expect("answered") {
            below = message.provenance.id.expect("kept");
            found.push(below);
        }
        assert_eq!(found, (1..=40).rev().collect::<Vec<_>>());
    };
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| read(Client::connect_over(over, &instance).expect("the daemon runs")));
        }
    });
    let mut client = Client::connect_over(over, &instance).expect("the daemon runs");
    let refused = client.rollback(7, PLENTY).expect("answered").outcome;
    let code = RefusalCode::UnknownCalibration;
    assert_eq!(refused, Outcome::Refused { code, sentence: "no calibration 7".to_owned() });
}

fn progress_messages_come_in_order(over: &Transport) {
    let instance = unique_instance();
    let daemon = Daemon::start(over, &instance);
    let mut client = Client::connect_over(over, &instance).expect("the daemon runs");
    daemon.run(|server| (1..=5).for_each(|n| server.publish_progress(&progress(n)).expect("published")));
    for n in 1..=5 {
        assert_eq!(client.next_progress(PLENTY).expect("the daemon runs"), Some(progress(n)));
    }
}

fn a_client_that_never_reads_does_not_hold_up_the_daemon(over: &Transport) {
    let instance = unique_instance();
    let daemon = Daemon::start(over, &instance);
    let mut sleeper = Client::connect_over(over, &instance).expect("the daemon runs");
    let (done, is_done) = mpsc::channel();
    daemon.run(move |server| {
        (1..=2_000).for_each(|n| server.publish_progress(&progress(n)).expect("published"));
        done.send(()).expect("the test waits");
    });
    is_done.recv_timeout(PLENTY).expect("the daemon is held up");
    let first = sleeper.next_progress(PLENTY).expect("the daemon runs").expect("the newest are kept");
    assert!(first.sequence > 1_900, "kept {} instead of the newest", first.sequence);
}

fn a_second_daemon_of_the_same_name_is_refused(over: &Transport) {
    let instance = unique_instance();
    let _daemon = Daemon::start(over, &instance);
    let error = Server::start_over(over, &instance).expect_err("the name is taken");
    assert!(
        matches!(&error, ServerError::AlreadyRunning { instance: named } if *named == instance),
        "{error}"
    );
    assert!(error.to_string().contains(instance.as_str()), "{error}");
    let mut client = Client::connect_over(over, &instance).expect("the first daemon still runs");
    client.status(PLENTY).expect("and still answers");
}

fn a_client_without_a_daemon_is_told_so(over: &Transport) {
    let instance = unique_instance();
    let error = Client::connect_over(over, &instance).expect_err("nobody there");
    assert!(matches!(error, ClientError::NotRunning { .. }), "{error}");
}

fn a_daemon_that_is_too_busy_gives_no_answer(over: &Transport) {
    let instance = unique_instance();
    let daemon = Daemon::start(over, &instance);
    let mut client = Client::connect_over(over, &instance).expect("the daemon runs");
    let (release, released) = mpsc::channel::<()>();
    let (busy, is_busy) = mpsc::channel();
    daemon.run(move |_| {
        busy.send(()).expect("the test waits");
        let _ = released.recv();
    });
    is_busy.recv().expect("the daemon's thread lives");
    let error = client.status(Duration::from_millis(20)).expect_err("the daemon is busy");
    assert!(matches!(error, ClientError::NoAnswer { .. }), "{error}");
    drop(release);
    client.status(PLENTY).expect("answered again, and not with the answer to the first");
}

fn a_client_goes_on_with_the_next_daemon(over: &Transport) {
    let instance = unique_instance();
    let daemon = Daemon::start(over, &instance);
    let mut client = Client::connect_over(over, &instance).expect("the daemon runs");
    drop(daemon);
    let error = client.status(PLENTY).expect_err("the daemon ended");
    assert!(matches!(error, ClientError::NotRunning { .. }), "{error}");
    let error = client.wait_calibration(PLENTY).expect_err("the daemon ended");
    assert!(matches!(error, ClientError::NotRunning { .. }), "{error}");
    let daemon = Daemon::start(over, &instance);
    daemon.run(|server| server.publish_calibration(&calibration(7)).expect("published"));
    let next = client.wait_calibration(PLENTY).expect("the daemon runs").expect("published");
    assert_eq!(next.sequence, 7);
    client.status(PLENTY).expect("answered");
}

/// Set in a child process: the instance that it serves until it is killed.
const SERVE: &str = "PELICAL_TEST_SERVE";
/// With it: the folder of the files; without, shared memory.
const SERVE_BELOW: &str = "PELICAL_TEST_SERVE_BELOW";

/// Not a test by itself: the daemon of [`a_killed_daemon_leaves_nothing_in_the_way`], in a process of its own.
#[test]
fn serves_when_asked_to_by_its_environment() {
    let Ok(name) = std::env::var(SERVE) else { return };
    let over = std::env::var(SERVE_BELOW).map_or(Transport::SharedMemory, Transport::files);
    let instance = name.parse().expect("allowed characters");
    let server = Server::start_over(&over, &instance).expect("started");
    server.publish_calibration(&calibration(1)).expect("published");
    // The parent kills this process; if it died instead, this one must not stay for ever.
    let deadline = Instant::now() + 2 * PLENTY;
    while Instant::now() < deadline {
        server.poll(Duration::from_millis(50), answer).expect("polling works");
    }
}

struct Child(std::process::Child);

impl Child {
    fn serve(over: &Transport, instance: &InstanceName) -> Self {
        let this = std::env::current_exe().expect("this test's binary");
        let mut command = std::process::Command::new(this);
        command
            .args(["--exact", "ipc::serves_when_asked_to_by_its_environment"])
            .env(SERVE, instance.as_str());
        if let Transport::Files { directory } = over {
            command.env(SERVE_BELOW, directory);
        }
        command.stdout(std::process::Stdio::null());
        Self(command.spawn().expect("started"))
    }

    /// SIGKILL, as `kill -9`.
    fn kill(&mut self) {
        self.0.kill().expect("killed");
        self.0.wait().expect("ended");
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn connect_within_plenty(over: &Transport, instance: &InstanceName) -> Client {
    let deadline = Instant::now() + PLENTY;
    loop {
        match Client::connect_over(over, instance) {
            Ok(client) => return client,
            Err(error) => assert!(Instant::now() < deadline, "no daemon came up: {error}"),
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn a_killed_daemon_leaves_nothing_in_the_way(over: &Transport) {
    let instance = unique_instance();
    let mut child = Child::serve(over, &instance);
    let mut old_client = connect_within_plenty(over, &instance);
    old_client.wait_calibration(PLENTY).expect("the child runs").expect("its calibration");
    for round in 0..3 {
        child.kill();
        let error = old_client.status(PLENTY).expect_err("killed");
        assert!(matches!(error, ClientError::NotRunning { .. }), "{error}");
        let error = Client::connect_over(over, &instance).expect_err("killed");
        assert!(matches!(error, ClientError::NotRunning { .. }), "{error}");
        if round == 1 {
            let _in_this_process = Server::start_over(over, &instance).expect("the name is free");
        }
        child = Child::serve(over, &instance);
        let mut new_client = connect_within_plenty(over, &instance);
        new_client.status(PLENTY).expect("the new client is served");
        let found = new_client.wait_calibration(PLENTY).expect("the new child runs");
        assert_eq!(found, Some(calibration(1)), "round {round}: a client of the new daemon");
        old_client.status(PLENTY).expect("the old client is served again");
        let found = old_client.wait_calibration(PLENTY).expect("the new child runs");
        assert_eq!(found, Some(calibration(1)), "round {round}: the client that saw the kill");
    }
    child.kill();
    // Whoever comes next cleans up after the killed: nothing of this test stays.
    assert!(matches!(Client::connect_over(over, &instance), Err(ClientError::NotRunning { .. })));
}

#[test]
fn a_daemon_of_another_folder_is_not_found() {
    let instance = unique_instance();
    let (here, elsewhere) = (tempfile::tempdir().expect("a folder"), tempfile::tempdir().expect("a folder"));
    let _daemon = Daemon::start(&Transport::files(here.path()), &instance);
    for over in [Transport::files(elsewhere.path()), Transport::SharedMemory] {
        let error = Client::connect_over(&over, &instance).expect_err("nobody there");
        assert!(matches!(error, ClientError::NotRunning { .. }), "{over:?}: {error}");
    }
}
