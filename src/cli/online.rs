//! `pelical status, recalibrate, cancel`: one question to a running daemon, one answer.

use std::time::{Duration, Instant};

use super::address::Address;
use super::args::{Output, RecalibrateArgs};
use super::error::CliError;
use super::exit::Exit;
use super::interrupt::Interrupt;
use super::output::document::{CalibrationDocument, Findings, FrameSets, TimingMs};
use super::output::history::ProvenanceEntry;
use super::output::status::{AnswerDocument, StatusDocument, Words};
use super::output::time::now_ns;
use super::talk::say;
use super::{output, progress};
use crate::geometry::motion::Motion;
use crate::ipc::{Activity, CalibrationMessage, Client, HealthMessage, Outcome, ProgressMessage, Response};
use crate::solver::State;

/// A daemon answers within milliseconds; one that is swapping or stopped gets this long.
pub const ANSWER_WITHIN: Duration = Duration::from_secs(5);
/// How often a waiting client looks at signals and the daemon's state.
pub const GLANCE: Duration = Duration::from_millis(250);

/// Prints what the daemon is doing; any answer is a success.
///
/// # Errors
/// When there is no daemon, or it does not answer.
pub fn status(daemon: &Address, output: Output) -> Result<Exit, CliError> {
    let mut client = daemon.connect()?;
    let response = client.status(ANSWER_WITHIN)?;
    let health = client.latest_health()?.cloned();
    let progress = newest_progress(&mut client)?;
    let words = Words { snapshot: &response.snapshot, health: health.as_ref(), progress: progress.as_ref() };
    let document = StatusDocument::new(&daemon.instance, &words);
    if output.json {
        output::print_json(&document)?;
    } else {
        output::print_text(&output::status::text(&document))?;
    }
    Ok(Exit::Done)
}

/// Asks the daemon to stop collecting.
///
/// # Errors
/// As [`status`].
pub fn cancel(daemon: &Address, output: Output) -> Result<Exit, CliError> {
    let response = daemon.connect()?.cancel(ANSWER_WITHIN)?;
    print_answer(&response, output)
}

/// Asks the daemon to calibrate again; waits for the verdict if told to.
///
/// # Errors
/// As [`status`].
pub fn recalibrate(daemon: &Address, args: &RecalibrateArgs) -> Result<Exit, CliError> {
    let mut client = daemon.connect()?;
    let response = client.recalibrate(ANSWER_WITHIN)?;
    if !args.wait || response.outcome != Outcome::Accepted {
        return print_answer(&response, args.output);
    }
    let wanted = Wanted { after_sequence: response.snapshot.calibration_sequence, within: args.timeout };
    let verdict = await_verdict(&mut client, &wanted)?;
    verdict.print(None, args.output)
}

/// Accepted is done; busy and refused are failures with a sentence.
pub fn print_answer(response: &Response, output: Output) -> Result<Exit, CliError> {
    let document = AnswerDocument::from(&response.outcome);
    if output.json {
        output::print_json(&document)?;
    }
    if response.outcome == Outcome::Accepted {
        if !output.json {
            output::print_text("accepted\n")?;
        }
        return Ok(Exit::Done);
    }
    let sentence = document.reason.map_or(String::new(), |reason| reason.sentence);
    say(format_args!("pelical: {}: {sentence}", document.answer));
    Ok(Exit::Failed)
}

/// Which result is waited for.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// Results up to this one are old.
    pub after_sequence: u64,
    /// How long at most.
    pub within: Duration,
}

/// What the daemon had found when the wait ended.
#[derive(Debug)]
pub struct Verdict {
    newest: Option<CalibrationMessage>,
    progress: Option<ProgressMessage>,
    timing_ms: TimingMs,
    /// Why the daemon has no result, in its newest words.
    reason: Option<String>,
    is_interrupted: bool,
}

/// Waits until the daemon converges, stops collecting, or the time is up; Ctrl-C ends the wait as well.
///
/// # Errors
/// When the daemon ends meanwhile.
pub fn await_verdict(client: &mut Client, wanted: &Wanted) -> Result<Verdict, CliError> {
    let interrupt = Interrupt::register()?;
    let start = Instant::now();
    let bar = progress::spinner("waiting for frames");
    let mut verdict = Verdict {
        newest: None,
        progress: None,
        timing_ms: TimingMs::default(),
        reason: None,
        is_interrupted: false,
    };
    while !verdict.is_converged() && start.elapsed() < wanted.within && !interrupt.is_set() {
        if let Some(progress) = newest_progress(client)? {
            bar.set_message(output::status::progress_line(&progress));
            verdict.progress = Some(progress);
        }
        let is_new = |message: &CalibrationMessage| message.sequence > wanted.after_sequence;
        match client.wait_calibration(GLANCE)?.filter(is_new) {
            Some(message) => verdict.newest = Some(message),
            None => {
                let snapshot = client.status(ANSWER_WITHIN)?.snapshot;
                verdict.reason = snapshot.reason.map(|reason| reason.sentence);
                if snapshot.activity == Activity::Idle {
                    break;
                }
            }
        }
    }
    bar.finish_and_clear();
    verdict.is_interrupted = interrupt.is_set();
    verdict.timing_ms.total = Some(start.elapsed().as_secs_f64() * 1e3);
    Ok(verdict)
}

fn newest_progress(client: &mut Client) -> Result<Option<ProgressMessage>, CliError> {
    let mut newest = None;
    while let Some(progress) = client.next_progress(Duration::ZERO)? {
        newest = Some(progress);
    }
    Ok(newest)
}

impl Verdict {
    /// Whether the newest result passed every test.
    pub fn is_converged(&self) -> bool {
        self.newest.as_ref().is_some_and(|message| message.calibration.state == State::Converged)
    }

    /// Adds what the daemon's stages have taken since its start: right only for a daemon that was started for this result.
    ///
    /// # Errors
    /// When the daemon ends meanwhile.
    pub fn add_stage_times(&mut self, client: &mut Client) -> Result<(), CliError> {
        let sequence = |health: Option<&HealthMessage>| health.map_or(0, |health| health.sequence);
        // The last word may be older than the last solution.
        let before = sequence(client.latest_health()?);
        let start = Instant::now();
        while sequence(client.latest_health()?) == before && start.elapsed() < ANSWER_WITHIN {
            client.next_progress(GLANCE)?;
        }
        let stages = client.latest_health()?.map(|health| health.stages.clone()).unwrap_or_default();
        let total = |name: &str| {
            stages.iter().find(|stage| stage.stage == name).map(|stage| stage.total_ns as f64 * 1e-6)
        };
        (self.timing_ms.detect, self.timing_ms.lift) = (total("detect"), total("lift"));
        (self.timing_ms.associate, self.timing_ms.estimate) = (total("associate"), total("solve"));
        Ok(())
    }

    /// Prints the result, against the truth where it is known.
    ///
    /// # Errors
    /// When stdout cannot be written, or there is no result at all.
    pub fn print(&self, truth: Option<&[Motion]>, output: Output) -> Result<Exit, CliError> {
        let Some(message) = &self.newest else {
            return self.print_nothing(output);
        };
        let counts = self.progress.as_ref().map(|progress| progress.frame_sets).unwrap_or_default();
        let document = CalibrationDocument::new(&Findings {
            cameras: &message.cameras,
            calibration: &message.calibration,
            frame_sets: FrameSets {
                seen: counts.seen,
                used: message.calibration.frame_sets_used as u64,
                refused: counts.refused.total(),
                refused_for: self.progress.is_some().then(|| counts.refused.into()),
            },
            pair_skews: &[],
            timing_ms: self.timing_ms,
            truth,
            provenance: Some(ProvenanceEntry::new(message, now_ns())),
        });
        if output.json {
            output::print_json(&document)?;
        } else {
            output::print_text(&output::text::calibration(&document))?;
        }
        Ok(if document.is_converged() { Exit::Done } else { Exit::NoResult })
    }

    /// A document all the same: who asked for JSON gets JSON.
    fn print_nothing(&self, output: Output) -> Result<Exit, CliError> {
        let sentence = match &self.reason {
            _ if self.is_interrupted => "interrupted before there was a result".to_owned(),
            Some(reason) => format!("no result in this time: {reason}"),
            None => "no result in this time: let the cameras see more edges, or wait longer".to_owned(),
        };
        if output.json {
            output::print_json(&AnswerDocument::without_result(&sentence))?;
        }
        say(format_args!("pelical: {sentence}"));
        Ok(Exit::NoResult)
    }
}
