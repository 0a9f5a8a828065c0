//! What the service manager is told of the running daemon, and when: that it is ready, how it is in one line, and that it lives. Signs
//! of life go out only while every thread of the pipeline moves; a hang anywhere ends in a restart by the manager.

use std::fmt::Display;
use std::time::{Duration, Instant};

use super::config::ReadyWhen;
use super::manager::{Notice, ServiceManager};
use crate::ipc::{Activity, Snapshot};
use crate::pipeline::{CameraSnapshot, CameraState, ThreadVitals, Vitals};
use crate::solver::State;

/// How often the pipeline is looked at where no watchdog asks for more.
const LOOK: Duration = Duration::from_millis(500);
/// By how much a start is extended that waits for cameras or a result, as long as everything moves.
const STARTING_FOR: Duration = Duration::from_secs(20);

/// The daemon's link with its service manager.
#[derive(Debug)]
pub struct Supervisor {
    manager: ServiceManager,
    ready_when: ReadyWhen,
    is_ready: bool,
    looked: Option<Instant>,
    /// The last time that everything had moved, and what was counted then.
    moved: Option<(Instant, Vitals)>,
    is_hang_told: bool,
    /// Why the config file as it is now was not taken.
    refused_config: Option<String>,
    status: String,
}

/// The daemon at one moment, as its supervisor sees it.
#[derive(Debug, Clone, Copy)]
pub struct Standing<'a> {
    /// What clients are told.
    pub daemon: &'a Snapshot,
    /// Every camera.
    pub cameras: &'a [CameraSnapshot],
}

/// What the daemon does before there is a pipeline.
#[derive(Debug, Clone, Copy)]
pub enum Opening<'a> {
    /// It reads what it needs. No driver is in that which could hang, and it ends.
    Loading,
    /// It looks for cameras.
    Looking {
        /// How often the thread that looks has turned.
        turns: u64,
        /// What is missing, in words; `None` before the first look is over.
        missing: Option<&'a str>,
    },
}

impl Supervisor {
    /// Nothing is told yet.
    pub fn new(manager: ServiceManager, ready_when: ReadyWhen) -> Self {
        Self {
            manager,
            ready_when,
            is_ready: false,
            looked: None,
            moved: None,
            is_hang_told: false,
            refused_config: None,
            status: String::new(),
        }
    }

    /// Changes when the service counts as ready.
    pub fn set_ready_when(&mut self, ready_when: ReadyWhen) {
        self.ready_when = ready_when;
    }

    /// Whether it is time for the next look.
    pub fn is_due(&self) -> bool {
        let watchdog = self.manager.watchdog();
        let interval = watchdog.map_or(LOOK, |watchdog| LOOK.min(watchdog / 8));
        self.looked.is_none_or(|looked| looked.elapsed() >= interval)
    }

    /// Looks whether everything moves, and tells what is new.
    pub fn look(&mut self, vitals: Vitals, standing: &Standing<'_>) {
        let daemon = standing.daemon;
        let is_met = match self.ready_when {
            ReadyWhen::Started => true,
            ReadyWhen::Cameras => daemon.cameras_streaming == daemon.cameras,
            ReadyWhen::Calibrated => daemon.state == State::Converged,
        };
        let hang = self.attend(vitals, is_met);
        let words = hang.unwrap_or_else(|| status(standing, (!self.is_ready).then_some(self.ready_when)));
        self.say(&words);
    }

    /// The same before there is a pipeline. A daemon that waits for cameras has started: it answers its clients.
    pub fn look_at_opening(&mut self, opening: &Opening<'_>) {
        let Opening::Looking { turns, missing } = *opening else {
            self.looked = Some(Instant::now());
            return self.live(false);
        };
        let thread = ThreadVitals { name: "open".to_owned(), turns, has_ended: false };
        let vitals = Vitals { threads: vec![thread], ..Vitals::default() };
        let hang = self.attend(vitals, self.ready_when == ReadyWhen::Started && missing.is_some());
        let words = || match missing {
            Some(missing) => format!("waiting for cameras: {missing}"),
            None => "looking for cameras".to_owned(),
        };
        self.say(&hang.unwrap_or_else(words));
    }

    /// Tells of life where everything has moved since the last look; `is_met` says whether the service is then ready. What hangs, in
    /// words, where something has done so for long.
    fn attend(&mut self, vitals: Vitals, is_met: bool) -> Option<String> {
        let now = Instant::now();
        self.looked = Some(now);
        let hanging = self.moved.as_ref().map_or(Vec::new(), |(_, before)| vitals.hanging_since(before));
        if hanging.is_empty() {
            self.moved = Some((now, vitals));
            self.is_hang_told = false;
            self.live(is_met);
        } else {
            self.worry(&hanging.join(", "));
        }
        self.is_hang_told.then(|| format!("hangs: {} does not move", hanging.join(", ")))
    }

    /// Everything moves.
    fn live(&mut self, is_met: bool) {
        if is_met && !self.is_ready {
            self.is_ready = true;
            self.manager.tell(Notice::Ready);
        }
        // Until it is ready, the manager's patience with the start is what has to be fed.
        self.manager.tell(if self.is_ready { Notice::Watchdog } else { Notice::StartingFor(STARTING_FOR) });
    }

    /// Something does not move. Most of the time it does at the next look; what takes half of the manager's patience is told.
    fn worry(&mut self, who: &str) {
        let patience = self.manager.watchdog().unwrap_or(STARTING_FOR) / 2;
        let since = self.moved.as_ref().map_or(Duration::ZERO, |(moved, _)| moved.elapsed());
        if since >= patience && !self.is_hang_told {
            self.is_hang_told = true;
            let is_watched = self.manager.watchdog().is_some();
            let end = if is_watched {
                "the service manager will start the daemon again"
            } else {
                "stop it and start again"
            };
            tracing::error!(who, ms = since.as_millis() as u64, "hangs: {end}");
        }
    }

    /// One line for `systemctl status`; nothing when it is not new.
    pub fn say(&mut self, words: &str) {
        // `systemctl reload` has no way to tell that it was refused.
        let refused = self.refused_config.as_ref();
        let line =
            refused.map_or(words.to_owned(), |why| format!("{words}; the config file is not taken: {why}"));
        if self.status != line {
            self.manager.tell(Notice::Status(&line));
            self.status = line;
        }
    }

    /// A reload begins, and its end is told when `reload` is done. Before the service is ready nothing is told: the end of a
    /// reload would be taken for the end of the start. Why it was refused stays in the status until one is taken.
    pub fn during_reload<T, E: Display>(&mut self, reload: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let tell = |notice| self.is_ready.then(|| self.manager.tell(notice));
        tell(Notice::Reloading);
        let done = reload();
        tell(Notice::Ready);
        self.refused_config = done.as_ref().err().map(E::to_string);
        done
    }

    /// The end has begun.
    pub fn stopping(&mut self, words: &str) {
        self.manager.tell(Notice::Stopping);
        self.say(words);
    }
}

/// The daemon in one line.
fn status(standing: &Standing<'_>, waits_for: Option<ReadyWhen>) -> String {
    let Standing { daemon, cameras } = standing;
    let mut line = match daemon.activity {
        Activity::Watching if daemon.state == State::Stored => {
            format!("serves a stored calibration (result {}), not verified yet", daemon.calibration_sequence)
        }
        Activity::Watching => format!("calibrated (result {})", daemon.calibration_sequence),
        activity => activity.name().to_owned(),
    };
    if daemon.watch.as_ref().is_some_and(|watch| !watch.moved.is_empty()) {
        line += ", but a camera was moved";
    }
    line += &format!("; {} of {} cameras deliver frames", daemon.cameras_streaming, daemon.cameras);
    let silent = cameras.iter().filter(|camera| camera.state != CameraState::Streaming);
    let silent: Vec<String> =
        silent.map(|camera| format!("{} is {}", camera.name, camera.state.name())).collect();
    if !silent.is_empty() {
        line += &format!(" ({})", silent.join(", "));
    }
    if let Some(reason) = &daemon.reason {
        line += &match daemon.activity {
            Activity::Collecting => format!("; no result yet: {}", reason.sentence),
            Activity::Watching => format!("; cannot be verified: {}", reason.sentence),
            _ => String::new(),
        };
    }
    match waits_for {
        Some(ReadyWhen::Cameras) => line + "; ready when every camera delivers frames",
        Some(ReadyWhen::Calibrated) => line + "; ready when there is a converged result",
        Some(ReadyWhen::Started) | None => line,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ipc::FrameSetCounts;
    use crate::pipeline::{FrameHealth, ThreadVitals};
    use crate::solver::{Reason, ReasonCode};

    fn vitals(turns: [u64; 2]) -> Vitals {
        let thread =
            |(name, turns): (&str, u64)| ThreadVitals { name: name.to_owned(), turns, has_ended: false };
        Vitals {
            threads: ["cap-left", "sync"].into_iter().zip(turns).map(thread).collect(),
            ..Vitals::default()
        }
    }

    fn daemon(streaming: u32) -> Snapshot {
        Snapshot {
            activity: Activity::Collecting,
            state: State::Collecting,
            reason: None,
            watch: None,
            calibration_sequence: 0,
            calibration_id: None,
            calibration_stamp_ns: None,
            store_fault: None,
            uptime_ns: 0,
            frame_sets: FrameSetCounts::default(),
            cameras: 2,
            cameras_streaming: streaming,
        }
    }

    fn cameras(states: [CameraState; 2]) -> Vec<CameraSnapshot> {
        let camera = |(name, state): (&str, CameraState)| CameraSnapshot {
            name: name.to_owned(),
            state,
            frames: 0,
            dropped: 0,
            last_frame_age: None,
            frame_health: FrameHealth::default(),
            firmware: None,
        };
        ["left", "right"].into_iter().zip(states).map(camera).collect()
    }

    fn supervisor(ready_when: ReadyWhen) -> Supervisor {
        Supervisor::new(ServiceManager::default(), ready_when)
    }

    #[test]
    fn the_status_says_what_is_missing_and_why() {
        let cameras = cameras([CameraState::Streaming, CameraState::Unplugged]);
        let reason = Reason { code: ReasonCode::NotEnoughEvidence, sentence: "3 lines so far".to_owned() };
        let daemon = Snapshot { reason: Some(reason), ..daemon(1) };
        let standing = Standing { daemon: &daemon, cameras: &cameras };
        assert_eq!(
            status(&standing, None),
            "collecting; 1 of 2 cameras deliver frames (right is unplugged); no result yet: 3 lines so far"
        );
        assert!(
            status(&standing, Some(ReadyWhen::Cameras)).ends_with("ready when every camera delivers frames")
        );
        let daemon = Snapshot { activity: Activity::Watching, calibration_sequence: 3, ..daemon };
        let standing = Standing { daemon: &daemon, cameras: &[] };
        assert!(status(&standing, None).ends_with("; cannot be verified: 3 lines so far"));
        let daemon = Snapshot { reason: None, ..daemon };
        let standing = Standing { daemon: &daemon, cameras: &[] };
        assert_eq!(status(&standing, None), "calibrated (result 3); 1 of 2 cameras deliver frames");
    }

    #[test]
    fn it_is_ready_when_the_policy_is_met_and_stays_so() {
        let converged = Snapshot { state: State::Converged, ..daemon(2) };
        for (ready_when, expected) in [
            (ReadyWhen::Started, [true, true, true]),
            (ReadyWhen::Cameras, [false, true, true]),
            (ReadyWhen::Calibrated, [false, false, true]),
        ] {
            let mut supervisor = supervisor(ready_when);
            let mut turns = 0;
            let mut ready_after = |daemon: &Snapshot| {
                turns += 1;
                supervisor.look(vitals([turns, turns]), &Standing { daemon, cameras: &[] });
                supervisor.is_ready
            };
            assert_eq!(
                [&daemon(1), &daemon(2), &converged].map(&mut ready_after),
                expected,
                "{ready_when:?}"
            );
            assert_eq!(ready_after(&daemon(0)), expected[2], "once ready, always ready");
        }
    }

    #[test]
    fn a_daemon_that_waits_for_cameras_is_ready_by_the_policy_started_alone() {
        for (ready_when, expected) in
            [(ReadyWhen::Started, true), (ReadyWhen::Cameras, false), (ReadyWhen::Calibrated, false)]
        {
            let mut supervisor = supervisor(ready_when);
            supervisor.look_at_opening(&Opening::Loading);
            supervisor.look_at_opening(&Opening::Looking { turns: 1, missing: None });
            assert!(!supervisor.is_ready, "nobody knows yet what is there");
            supervisor.look_at_opening(&Opening::Looking { turns: 2, missing: Some("two cameras") });
            assert_eq!(supervisor.is_ready, expected, "{ready_when:?}");
            assert_eq!(supervisor.status, "waiting for cameras: two cameras");
        }
    }

    #[test]
    fn a_search_for_cameras_that_stands_is_no_sign_of_life() {
        let mut supervisor = supervisor(ReadyWhen::Started);
        let looking = |turns| Opening::Looking { turns, missing: Some("two cameras") };
        let mark = |supervisor: &Supervisor| supervisor.moved.clone().expect("looked").0;
        supervisor.look_at_opening(&looking(5));
        let moved = mark(&supervisor);
        supervisor.look_at_opening(&looking(5));
        assert_eq!(mark(&supervisor), moved);
        supervisor.look_at_opening(&looking(6));
        assert!(mark(&supervisor) > moved);
    }

    #[test]
    fn while_one_thread_stands_the_mark_stays_where_everything_moved_last() {
        let mut supervisor = supervisor(ReadyWhen::Started);
        let daemon = daemon(2);
        let standing = Standing { daemon: &daemon, cameras: &[] };
        supervisor.look(vitals([1, 1]), &standing);
        let mark = |supervisor: &Supervisor| supervisor.moved.clone().expect("looked").1;
        supervisor.look(vitals([1, 2]), &standing);
        supervisor.look(vitals([1, 3]), &standing);
        assert_eq!(mark(&supervisor), vitals([1, 1]));
        supervisor.look(vitals([2, 3]), &standing);
        assert_eq!(mark(&supervisor), vitals([2, 3]));
    }
}
