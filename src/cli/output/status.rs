//! What the daemon is doing: documents and text of `status`, `watch`, and of answers to requests.

use std::fmt::Write as _;

use serde::Serialize;

use super::document::ReasonEntry;
use super::intake::{PairSkewEntry, RefusedFor, SkewEntry, TurnEntry, skew_table};
use super::moved::{self, MovedEntry};
use super::text::table;
use super::time::{age_in_words, age_s, now_ns};
use crate::ipc::{
    CameraHealth, FrameClock, HealthMessage, InstanceName, Outcome, PairSkew, ProgressMessage, Snapshot,
    StageLatency,
};
use crate::solver::State;

/// `pelical.status/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StatusDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// Name of the daemon.
    pub instance: String,
    /// What it does: starting, collecting, watching, idle or stopping.
    pub activity: &'static str,
    /// The newest verdict; `stored` when that is a kept one which live lines have not confirmed yet; `moved` when a camera was moved
    /// since the published result was made.
    pub state: &'static str,
    /// Why that is not converged.
    pub reason: Option<ReasonEntry>,
    /// What was moved, and how far; empty while nothing shows that anything was.
    pub moved: Vec<MovedEntry>,
    /// Frame sets since the published result was last seen to hold; null while there is none, or it is `stored`, so that it never was.
    pub sets_since_confirmed: Option<u64>,
    /// Frame sets in which a `stored` result was looked for since anything last spoke for it; null for any other.
    pub sets_unconfirmed: Option<u64>,
    /// Number of the newest calibration; 0 before the first.
    pub calibration_sequence: u64,
    /// Its number in the history; null where it is not kept.
    pub calibration_id: Option<u64>,
    /// Since it was made; null before the first, or when the clock stands before that.
    pub calibration_age_s: Option<f64>,
    /// Why calibrations cannot be kept at present; null while they can, or need not be.
    pub store_fault: Option<String>,
    /// Since the daemon started.
    pub uptime_s: f64,
    /// What became of the frame sets since collecting began.
    pub frame_sets: FrameSetStatus,
    /// How fast the rig turns; null where nothing tells.
    pub turn: Option<TurnEntry>,
    /// How far apart the frames of each two cameras are, since the daemon started; empty before its first word about them.
    pub pair_skews: Vec<PairSkewEntry>,
    /// How the cameras are; empty before the daemon's first word about them.
    pub cameras: Vec<CameraStatus>,
    /// How long the stages take.
    pub stages: Vec<StageStatus>,
}

/// What became of frame sets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FrameSetStatus {
    /// Complete sets.
    pub seen: u64,
    /// Taken as evidence.
    pub used: u64,
    /// Not taken.
    pub refused: u64,
    /// Why.
    pub refused_for: RefusedFor,
    /// Lost because a stage was busy.
    pub dropped: u64,
}

/// What a daemon has said about itself.
#[derive(Debug, Clone, Copy)]
pub struct Words<'a> {
    /// Its answer.
    pub snapshot: &'a Snapshot,
    /// Its newest word about health; none in its first moments.
    pub health: Option<&'a HealthMessage>,
    /// Its newest word about collecting; none before the first frame set.
    pub progress: Option<&'a ProgressMessage>,
}

/// How one camera is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CameraStatus {
    /// Name in the rig.
    pub name: String,
    /// waiting, streaming, stalled, unplugged, failed or ended.
    pub state: &'static str,
    /// Frames it delivered.
    pub frames: u64,
    /// Frames that were dropped.
    pub dropped: u64,
    /// Since its last frame; null before the first.
    pub last_frame_age_ms: Option<f64>,
    /// Frames per second.
    pub fps_hz: f64,
    /// Frames that the camera numbered and that never came.
    pub lost: u64,
    /// Damaged frames.
    pub bad: u64,
    /// Share of the newest depth image that has a reading, 0 to 1; null before the first frame.
    pub valid_depth: Option<f64>,
    /// Whose clock stamps the frames: source (a recording's), device, translated or host; null before the first.
    pub clock: Option<&'static str>,
    /// Between where this camera feels up and where the reference camera does, by the published result; 0 for the reference camera, null
    /// where an accelerometer or a place is missing.
    pub gravity_off_deg: Option<f64>,
}

/// How long one stage takes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StageStatus {
    /// Name.
    pub stage: String,
    /// Median.
    pub p50_ms: f64,
    /// 99 of 100 are not longer.
    pub p99_ms: f64,
    /// All runs together.
    pub total_ms: f64,
}

/// `pelical.answer/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct AnswerDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// accepted, busy or refused.
    pub answer: &'static str,
    /// Why it is not accepted, or why no result came.
    pub reason: Option<ReasonEntry>,
}

impl StatusDocument {
    /// The document of what a daemon has said.
    pub fn new(instance: &InstanceName, words: &Words<'_>) -> Self {
        let Words { snapshot, health, progress } = *words;
        let name = |camera| moved::camera_name(health, camera);
        let pair_skew = |pair: &PairSkew| PairSkewEntry {
            cameras: [pair.cameras.0, pair.cameras.1].map(name),
            skew: SkewEntry::from(pair),
        };
        let watch = snapshot.watch.as_ref();
        let is_stored = snapshot.state == State::Stored;
        let sets_since = watch.map(|watch| watch.sets_since_confirmed);
        let entries = watch.iter().flat_map(|watch| &watch.moved).map(|moved| MovedEntry::new(moved, &name));
        let moved: Vec<MovedEntry> = entries.collect();
        let sets = snapshot.frame_sets;
        Self {
            schema: "pelical.status/1",
            instance: instance.to_string(),
            activity: snapshot.activity.name(),
            state: if moved.is_empty() { snapshot.state.name() } else { moved::STATE },
            reason: moved::reason(&moved).or_else(|| snapshot.reason.as_ref().map(ReasonEntry::from)),
            moved,
            sets_since_confirmed: sets_since.filter(|_| !is_stored),
            sets_unconfirmed: sets_since.filter(|_| is_stored),
            calibration_sequence: snapshot.calibration_sequence,
            calibration_id: snapshot.calibration_id,
            calibration_age_s: snapshot.calibration_stamp_ns.and_then(|made_ns| age_s(made_ns, now_ns())),
            store_fault: snapshot.store_fault.clone(),
            uptime_s: snapshot.uptime_ns as f64 * 1e-9,
            frame_sets: FrameSetStatus {
                seen: sets.seen,
                used: sets.used,
                refused: sets.refused.total(),
                refused_for: sets.refused.into(),
                dropped: sets.dropped,
            },
            turn: progress.and_then(|progress| progress.turning).map(TurnEntry::from),
            pair_skews: health.iter().flat_map(|health| &health.pair_skews).map(pair_skew).collect(),
            cameras: health.iter().flat_map(|health| &health.cameras).map(CameraStatus::from).collect(),
            stages: health.iter().flat_map(|health| &health.stages).map(StageStatus::from).collect(),
        }
    }
}

impl From<&CameraHealth> for CameraStatus {
    fn from(camera: &CameraHealth) -> Self {
        Self {
            name: camera.name.clone(),
            state: camera.state.name(),
            frames: camera.frames,
            dropped: camera.dropped,
            last_frame_age_ms: camera.last_frame_age_ns.map(|age_ns| age_ns as f64 * 1e-6),
            fps_hz: camera.fps_hz,
            lost: camera.lost,
            bad: camera.bad,
            valid_depth: camera.valid_depth,
            clock: camera.clock.map(FrameClock::name),
            gravity_off_deg: camera.gravity_off_deg,
        }
    }
}

impl From<&StageLatency> for StageStatus {
    fn from(stage: &StageLatency) -> Self {
        let ms = |ns: u64| ns as f64 * 1e-6;
        Self {
            stage: stage.stage.clone(),
            p50_ms: ms(stage.p50_ns),
            p99_ms: ms(stage.p99_ns),
            total_ms: ms(stage.total_ns),
        }
    }
}

impl AnswerDocument {
    /// The request was accepted, and then no result came.
    pub fn without_result(sentence: &str) -> Self {
        let reason = ReasonEntry { code: "no_result", sentence: sentence.to_owned() };
        Self { schema: "pelical.answer/1", answer: "accepted", reason: Some(reason) }
    }
}

impl From<&Outcome> for AnswerDocument {
    fn from(outcome: &Outcome) -> Self {
        let (answer, reason) = match outcome {
            Outcome::Accepted => ("accepted", None),
            Outcome::Busy => {
                let sentence =
                    "a calibration runs already: cancel it first, or wait for its result".to_owned();
                ("busy", Some(ReasonEntry { code: "busy", sentence }))
            }
            Outcome::Refused { code, sentence } => {
                ("refused", Some(ReasonEntry { code: code.name(), sentence: sentence.clone() }))
            }
        };
        Self { schema: "pelical.answer/1", answer, reason }
    }
}

/// A status as text, ending with a line break.
pub fn text(status: &StatusDocument) -> String {
    let mut text = format!(
        "instance    {}\nactivity    {}\nstate       {}\n",
        status.instance, status.activity, status.state
    );
    if let Some(reason) = &status.reason {
        let _ = writeln!(text, "reason      {} ({})", reason.sentence, reason.code);
    }
    let FrameSetStatus { seen, used, refused, dropped, refused_for } = status.frame_sets;
    let _ = writeln!(text, "frame sets  {seen} seen, {used} used, {refused} refused, {dropped} dropped");
    if refused > 0 {
        let _ = writeln!(text, "refused     {}", refused_for.text());
    }
    if let Some(turn) = &status.turn {
        let _ = writeln!(text, "turning     {:.0} deg/s ({})", turn.deg_per_s, turn.by);
    }
    let _ = writeln!(text, "results     {}", status.calibration_sequence);
    if status.calibration_sequence > 0 {
        let id = status.calibration_id.map_or_else(String::new, |id| format!("calibration {id}, "));
        let _ = writeln!(text, "published   {id}made {}", age_in_words(status.calibration_age_s));
    }
    if let Some(fault) = &status.store_fault {
        let _ = writeln!(text, "not kept    {fault}");
    }
    if let Some(sets) = status.sets_since_confirmed {
        let _ = writeln!(text, "confirmed   {sets} compared frame sets ago");
    }
    match status.sets_unconfirmed {
        Some(0) => text += "confirmed   not yet\n",
        Some(sets) => {
            let _ =
                writeln!(text, "confirmed   not yet: nothing in {sets} compared frame sets speaks for it");
        }
        None => {}
    }
    let _ = writeln!(text, "up for      {:.0} s", status.uptime_s);
    if !status.cameras.is_empty() {
        text += &format!("\n{}", camera_table(&status.cameras));
    }
    if !status.pair_skews.is_empty() {
        text += &format!("\n{}", skew_table(&status.pair_skews));
    }
    if !status.stages.is_empty() {
        let rows = status.stages.iter().map(|stage| {
            vec![stage.stage.clone(), format!("{:.2}", stage.p50_ms), format!("{:.2}", stage.p99_ms)]
        });
        text += &format!("\n{}", table(&["stage", "median ms", "p99 ms"], &rows.collect::<Vec<_>>()));
    }
    text
}

const CAMERA_COLUMNS: [&str; 10] = [
    "camera",
    "state",
    "frames/s",
    "frames",
    "dropped",
    "lost",
    "bad",
    "depth %",
    "clock",
    "last frame ms ago",
];

fn camera_table(cameras: &[CameraStatus]) -> String {
    let or_dash =
        |number: Option<f64>| number.map_or_else(|| "-".to_owned(), |number| format!("{number:.0}"));
    let has_gravity = cameras.iter().any(|camera| camera.gravity_off_deg.is_some());
    let rows = cameras.iter().map(|camera| {
        let mut row = vec![camera.name.clone(), camera.state.to_owned(), format!("{:.1}", camera.fps_hz)];
        let counts = [camera.frames, camera.dropped, camera.lost, camera.bad];
        row.extend(counts.map(|count| count.to_string()));
        let clock = camera.clock.unwrap_or("-").to_owned();
        row.extend([
            or_dash(camera.valid_depth.map(|share| 100.0 * share)),
            clock,
            or_dash(camera.last_frame_age_ms),
        ]);
        let off_deg =
            camera.gravity_off_deg.map_or_else(|| "-".to_owned(), |off_deg| format!("{off_deg:.1}"));
        row.extend(has_gravity.then_some(off_deg));
        row
    });
    let columns = CAMERA_COLUMNS.into_iter().chain(has_gravity.then_some("gravity off deg"));
    table(&columns.collect::<Vec<_>>(), &rows.collect::<Vec<_>>())
}

/// How collecting goes, in one line.
pub fn progress_line(progress: &ProgressMessage) -> String {
    let sets = progress.frame_sets;
    let lines: Vec<String> = progress.cameras.iter().map(|camera| camera.lines.to_string()).collect();
    let best = progress.best_pair.map_or_else(String::new, |pair| format!(", {} matches", pair.matches));
    format!(
        "{}: {} frame sets, {} used, lines {}{best}",
        if progress.is_moved { moved::STATE } else { progress.state.name() },
        sets.seen,
        sets.used,
        lines.join("/")
    )
}
