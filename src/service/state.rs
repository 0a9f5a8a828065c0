//! What the daemon is at, as its clients see it, and what it answers to them. Knows no clock, no thread, no shared memory.

use crate::ipc::{Activity, Outcome, RefusalCode, RequestKind};
use crate::pipeline::{Answer, CameraState, Command, Phase, Snapshot, Solved};
use crate::solver::{Reason, State, WatchReport};

/// Fewer cameras cannot be calibrated against each other.
const MIN_CAMERAS: usize = 2;

/// The verdict so far, and whether the end has begun.
#[derive(Debug, Clone)]
pub struct Life {
    state: State,
    reason: Option<Reason>,
    /// Why frames of some cameras never meet; none while they do.
    apart: Option<Reason>,
    /// How the published result stands; none without a converged one.
    watch: Option<WatchReport>,
    has_started: bool,
    is_stopping: bool,
}

impl Life {
    /// Before the first frame.
    pub fn new() -> Self {
        Self {
            state: State::Collecting,
            reason: None,
            apart: None,
            watch: None,
            has_started: false,
            is_stopping: false,
        }
    }

    /// The verdict of the newest solution, or `Collecting` before the first one.
    pub fn state(&self) -> State {
        self.state
    }

    /// Why it is not converged. The estimator cannot know of frames that it was not given.
    pub fn reason(&self) -> Option<&Reason> {
        let apart = self.apart.as_ref().filter(|_| self.state != State::Converged);
        apart.or(self.reason.as_ref())
    }

    /// Why frames of some cameras meet no others, or that they do now.
    pub fn on_apart(&mut self, reason: Option<Reason>) {
        self.has_started |= reason.is_some();
        self.apart = reason;
    }

    /// How the published result stands; `None` without a converged one.
    pub fn watch(&self) -> Option<&WatchReport> {
        self.watch.as_ref()
    }

    /// Whether a camera was moved since the published result was made.
    pub fn is_moved(&self) -> bool {
        self.watch.as_ref().is_some_and(|watch| !watch.moved.is_empty())
    }

    /// The first frame set came.
    pub fn on_frames(&mut self) {
        self.has_started = true;
    }

    /// A solution came.
    pub fn on_solved(&mut self, solved: &Solved) {
        self.state = solved.calibration.state;
        self.reason = solved.calibration.reason.clone();
        if self.state == State::Converged {
            self.watch = Some(WatchReport::default());
        }
    }

    /// The published result was compared with what the cameras see; whether other cameras than before are said to be moved.
    pub fn on_watched(&mut self, report: WatchReport) -> bool {
        let before = self.watch.replace(report);
        let (before, now) = (before.unwrap_or_default(), self.watch.iter().flat_map(WatchReport::who));
        now.ne(before.who())
    }

    /// A result of an earlier run is served.
    pub fn on_stored(&mut self) {
        (self.state, self.reason) = (State::Stored, None);
        self.watch = Some(WatchReport::default());
    }

    /// Whether live lines have just confirmed a result of an earlier run, which from now on is as good as one of this run.
    pub fn on_verified(&mut self) -> bool {
        let is_verified =
            self.watch.as_ref().is_some_and(|watch| watch.is_verified && watch.moved.is_empty());
        let is_news = is_verified && self.state == State::Stored;
        if is_news {
            self.state = State::Converged;
        }
        is_news
    }

    /// Collecting begins anew because a camera was moved: that stays true of the published result until there is another one.
    pub fn on_moved_restart(&mut self) {
        (self.state, self.reason) = (State::Collecting, None);
    }

    /// Collecting begins anew.
    pub fn on_restart(&mut self) {
        self.on_moved_restart();
        self.watch = None;
    }

    /// Whether the end has begun.
    pub fn is_stopping(&self) -> bool {
        self.is_stopping
    }

    /// The end has begun.
    pub fn on_stop(&mut self) {
        self.is_stopping = true;
    }

    /// What clients are told that the daemon does.
    pub fn activity(&self, phase: Phase) -> Activity {
        match phase {
            _ if self.is_stopping => Activity::Stopping,
            _ if !self.has_started => Activity::Starting,
            Phase::Collecting => Activity::Collecting,
            Phase::Watching => Activity::Watching,
            Phase::Idle => Activity::Idle,
        }
    }

    /// The answer to a request; `command` is called when the pipeline has to do something about it.
    pub fn answer(
        &mut self,
        kind: RequestKind,
        pipeline: &Snapshot,
        command: impl FnOnce(Command) -> Answer,
    ) -> Outcome {
        let refused = |code, sentence: String| Outcome::Refused { code, sentence };
        match kind {
            RequestKind::Status => Outcome::Accepted,
            _ if self.is_stopping => refused(
                RefusalCode::Stopping,
                "the daemon is about to end: start it again and ask then".into(),
            ),
            RequestKind::Recalibrate => {
                // One that was opened a moment ago is about to deliver.
                let there = streaming(pipeline) + count(pipeline, CameraState::Opened);
                if there < MIN_CAMERAS {
                    let sentence =
                        format!("{there} cameras deliver frames, {MIN_CAMERAS} are needed: see the status");
                    return refused(RefusalCode::NoCameras, sentence);
                }
                match command(Command::Recalibrate) {
                    Answer::Accepted => {
                        self.on_restart();
                        Outcome::Accepted
                    }
                    Answer::Busy | Answer::NotCollecting => Outcome::Busy,
                }
            }
            // What else speaks against it the history knows.
            RequestKind::Rollback => Outcome::Accepted,
            RequestKind::Cancel => match command(Command::Cancel) {
                Answer::Accepted => Outcome::Accepted,
                Answer::Busy | Answer::NotCollecting => refused(
                    RefusalCode::NothingToCancel,
                    "no calibration runs: there is nothing to cancel".into(),
                ),
            },
        }
    }
}

/// How many cameras deliver frames.
pub fn streaming(pipeline: &Snapshot) -> usize {
    count(pipeline, CameraState::Streaming)
}

fn count(pipeline: &Snapshot, state: CameraState) -> usize {
    pipeline.cameras.iter().filter(|camera| camera.state == state).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::{CameraSnapshot, Counts, FrameHealth, LatencySummaries};
    use crate::solver::{Moved, Who};

    fn with_cameras(states: &[CameraState]) -> Snapshot {
        let camera = |&state: &CameraState| CameraSnapshot {
            name: "c".into(),
            state,
            frames: 1,
            dropped: 0,
            last_frame_age: None,
            frame_health: FrameHealth::default(),
            firmware: None,
        };
        Snapshot {
            cameras: states.iter().map(camera).collect(),
            phase: Phase::Collecting,
            counts: Counts::default(),
            latencies: LatencySummaries::default(),
            pair_skews: Vec::new(),
        }
    }

    const TWO: [CameraState; 2] = [CameraState::Streaming, CameraState::Streaming];

    #[track_caller]
    fn check_refused(outcome: Outcome, expected: RefusalCode) {
        match outcome {
            Outcome::Refused { code, sentence } => {
                assert!(code == expected && !sentence.is_empty(), "{code:?}")
            }
            other => panic!("{other:?} instead of {expected:?}"),
        }
    }

    #[test]
    fn activities_follow_the_pipeline_once_frames_come_and_end_with_stopping() {
        let mut life = Life::new();
        assert_eq!(life.activity(Phase::Collecting), Activity::Starting);
        life.on_frames();
        assert_eq!(life.activity(Phase::Collecting), Activity::Collecting);
        assert_eq!(life.activity(Phase::Watching), Activity::Watching);
        assert_eq!(life.activity(Phase::Idle), Activity::Idle);
        life.on_stop();
        assert_eq!(life.activity(Phase::Watching), Activity::Stopping);
    }

    #[test]
    fn recalibrating_is_busy_accepted_or_refused_for_a_reason() {
        let mut life = Life::new();
        let ask = |life: &mut Life, states: &[CameraState], answer| {
            life.answer(RequestKind::Recalibrate, &with_cameras(states), |_| answer)
        };
        assert_eq!(ask(&mut life, &TWO, Answer::Accepted), Outcome::Accepted);
        assert_eq!(ask(&mut life, &TWO, Answer::Busy), Outcome::Busy);
        let one = [CameraState::Streaming, CameraState::Unplugged];
        check_refused(ask(&mut life, &one, Answer::Accepted), RefusalCode::NoCameras);
        life.on_stop();
        check_refused(ask(&mut life, &TWO, Answer::Accepted), RefusalCode::Stopping);
    }

    #[test]
    fn frames_that_never_meet_are_why_there_is_no_result_but_speak_not_against_one() {
        let mut life = Life::new();
        let apart =
            Reason { code: crate::solver::ReasonCode::NotEnoughEvidence, sentence: "apart".to_owned() };
        life.on_apart(Some(apart.clone()));
        assert_eq!((life.activity(Phase::Collecting), life.reason()), (Activity::Collecting, Some(&apart)));
        life.on_stored();
        assert_eq!(life.reason(), Some(&apart), "it cannot be verified");
        life.on_watched(WatchReport { is_verified: true, ..WatchReport::default() });
        assert!(life.on_verified() && life.reason().is_none());
        life.on_restart();
        life.on_apart(None);
        assert_eq!(life.reason(), None);
    }

    fn moved(camera: usize) -> WatchReport {
        let moved = Moved {
            who: Who::Camera(camera),
            rotation_rad: 0.05,
            sigma_rotation_rad: 0.001,
            translation_m: 0.02,
            sigma_translation_m: 0.001,
        };
        WatchReport { moved: vec![moved], sets_since_confirmed: 9, is_verified: false }
    }

    #[test]
    fn only_other_moved_cameras_than_before_are_news() {
        let mut life = Life::new();
        assert!(!life.on_watched(WatchReport { sets_since_confirmed: 4, ..WatchReport::default() }));
        assert!(!life.is_moved());
        assert!(life.on_watched(moved(1)) && life.is_moved());
        assert!(!life.on_watched(moved(1)), "said before");
        assert!(life.on_watched(moved(2)), "another camera");
        assert!(life.on_watched(WatchReport::default()) && !life.is_moved());
    }

    #[test]
    fn a_moved_camera_is_forgotten_when_asked_to_calibrate_but_not_when_that_begins_by_itself() {
        let mut life = Life::new();
        life.on_watched(moved(1));
        life.on_moved_restart();
        assert!(life.is_moved() && life.state() == State::Collecting);
        life.on_restart();
        assert!(!life.is_moved() && life.watch().is_none());
    }

    #[test]
    fn a_stored_result_is_verified_once_and_only_where_no_camera_was_moved() {
        let mut life = Life::new();
        let verified = WatchReport { is_verified: true, ..WatchReport::default() };
        life.on_watched(verified.clone());
        assert!(!life.on_verified(), "collecting has nothing to verify");
        life.on_stored();
        assert!(!life.on_verified() && life.state() == State::Stored, "not without being seen");
        life.on_watched(WatchReport { is_verified: true, ..moved(1) });
        assert!(!life.on_verified() && life.is_moved());
        life.on_watched(verified);
        assert!(life.on_verified() && life.state() == State::Converged);
        assert!(!life.on_verified(), "no news");
    }

    #[test]
    fn a_refused_request_never_reaches_the_pipeline() {
        let mut life = Life::new();
        let outcome = life.answer(RequestKind::Recalibrate, &with_cameras(&[]), |_| panic!("not asked"));
        check_refused(outcome, RefusalCode::NoCameras);
    }

    #[test]
    fn cancelling_needs_something_to_cancel() {
        let mut life = Life::new();
        let pipeline = with_cameras(&TWO);
        assert_eq!(life.answer(RequestKind::Cancel, &pipeline, |_| Answer::Accepted), Outcome::Accepted);
        let outcome = life.answer(RequestKind::Cancel, &pipeline, |_| Answer::NotCollecting);
        check_refused(outcome, RefusalCode::NothingToCancel);
    }
}
