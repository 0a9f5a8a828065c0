//! Rows in which cameras misbehave: each daemon starts with nothing, suffers, and must still converge to the truth.

use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use pelical::ipc::{Client, ProgressMessage};
use pelical::solver::State;

use crate::daemon::Daemon;
use crate::rig::RATE_HZ;
use crate::row::{finish, grown};
use crate::site::{ANSWER, PATIENCE, Place, SERIALS, Site, Wishes, wait_for_status};
use crate::table::{Seen, time};

/// A camera that is gone is noticed within this, and back within that of its return.
const NOTICED: Duration = Duration::from_secs(2);
const BACK: Duration = Duration::from_secs(3);
/// What a daemon says when a fault begins.
pub const PLAYED: &str = "a fault is played";

/// A fault that begins at a frame and ends after a time.
pub struct Absence {
    /// As the config writes it.
    pub fault: &'static str,
    /// Which camera.
    pub camera: usize,
    pub for_s: f64,
}

/// Faults that meet single frames by chance, or jumps of clocks: it converges all the same.
pub fn converges(site: &Site, faults: Vec<String>) -> Result<Seen> {
    let n_played = faults.iter().filter(|fault| fault.contains("at_frame")).count();
    let place = site.place(&Wishes { faults, ..Wishes::default() })?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    if n_played > 0 {
        let last = daemon.wait_for_lines(&[PLAYED], n_played, PATIENCE)?;
        seen.recovered(complete_set(&mut client, last)?, PATIENCE);
        // There may have been a result before.
        client.recalibrate(ANSWER)?;
    }
    let took = converged(&mut client, &daemon)?;
    seen.say(format!("converged after {}", time(took)));
    let progress = newest(&mut client)?;
    let counts = progress.frame_sets;
    seen.say(format!("{} sets formed, {} refused", counts.seen, counts.refused.total()));
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

/// A fault that leaves nothing to calibrate from: no result, and the daemon goes on.
pub fn never_converges(site: &Site, faults: Vec<String>, lasts: Duration) -> Result<Seen> {
    let place = site.place(&Wishes { faults, ..Wishes::default() })?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let first = client.next_progress(PATIENCE)?.context("no frame sets")?;
    std::thread::sleep(lasts);
    let status = client.status(ANSWER)?.snapshot;
    seen.require(status.state != State::Converged, "a result from nothing");
    let code = status.reason.map_or_else(|| "none".to_owned(), |reason| format!("{:?}", reason.code));
    seen.say(format!("state {} ({code}) after {}", status.state.name(), time(lasts)));
    while let Some(progress) = client.next_progress(Duration::from_millis(300))? {
        if progress.sequence > first.sequence + 5 {
            seen.say("sets go on");
            break;
        }
    }
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

/// Cameras that go silent or away and come back: noticed, taken back, and the others do not notice.
pub fn absences(site: &Site, absences: &[Absence]) -> Result<Seen> {
    let mut seen = Seen::default();
    for absence in absences {
        one_absence(site, absence, &mut seen).with_context(|| SERIALS[absence.camera])?;
    }
    Ok(seen)
}

fn one_absence(site: &Site, absence: &Absence, seen: &mut Seen) -> Result<()> {
    let (camera, gone_for) = (absence.camera, Duration::from_secs_f64(absence.for_s));
    let fault = format!(
        "serial: {}, fault: {}, at_frame: 15, for_s: {:.1}",
        SERIALS[camera], absence.fault, absence.for_s
    );
    let place = site.place(&Wishes { faults: vec![fault], ..Wishes::default() })?;
    let returns = |_: &Daemon, began: Instant| {
        let returns = began + gone_for;
        std::thread::sleep(returns.saturating_duration_since(Instant::now()));
        Ok(returns)
    };
    outage(&place, camera, returns, seen)
}

/// A camera without frames from a fault on, until what is awaited here; then it is back soon. The others go on meanwhile.
pub fn outage(
    place: &Place,
    camera: usize,
    wait_for_return: impl FnOnce(&Daemon, Instant) -> Result<Instant>,
    seen: &mut Seen,
) -> Result<()> {
    let audit = place.audit();
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let began = daemon.wait_for_lines(&[PLAYED], 1, PATIENCE)?;
    let at_first = client.status(ANSWER)?.snapshot.cameras_streaming;
    let is_gone = |status: &pelical::ipc::Snapshot| status.cameras_streaming == 2;
    let (_, noticed) = wait_for_status(&mut client, ("noticed", PATIENCE), is_gone)?;
    let noticed_after = noticed.duration_since(began);
    seen.require(noticed_after <= NOTICED && at_first >= 2, format!("noticed after {}", time(noticed_after)));
    let before = newest(&mut client)?;
    let returns = wait_for_return(&daemon, began)?;
    let after = newest(&mut client)?;
    let back_after = complete_set(&mut client, returns)?;
    seen.recovered(back_after, BACK);
    let (sets, dropped) = grown(&before, &after);
    let expected = (before_to(&before, &after) * RATE_HZ).floor();
    seen.require(dropped == 0, format!("{dropped} sets of the others dropped"));
    seen.require(sets as f64 + 1.5 >= expected, format!("the others formed {sets} sets of {expected}"));
    seen.say(format!(
        "camera {}: noticed after {}, back {} after its return, the others formed {sets} sets meanwhile and dropped {dropped}",
        camera + 1,
        time(noticed_after),
        time(back_after)
    ));
    converged(&mut client, &daemon)?;
    finish(&mut daemon, &audit, seen)
}

/// A device call that never returns, and a stop in the middle of it.
pub fn hang_in_stop(site: &Site) -> Result<Seen> {
    let faults = vec![format!("serial: {}, fault: hang, at_frame: 10", SERIALS[1])];
    let place = site.place(&Wishes { faults, ..Wishes::default() })?;
    let mut seen = Seen::default();
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let began = daemon.wait_for_lines(&[PLAYED], 1, PATIENCE)?;
    let is_gone = |status: &pelical::ipc::Snapshot| status.cameras_streaming == 2;
    let (_, noticed) = wait_for_status(&mut client, ("noticed", PATIENCE), is_gone)?;
    seen.say(format!("noticed as stalled after {}", time(noticed.duration_since(began))));
    drop(client);
    let ended = daemon.stop(PATIENCE)?;
    seen.require(ended.took <= NOTICED, format!("the stop took {}", time(ended.took)));
    seen.require(ended.code == Some(0), format!("exit code {:?}", ended.code));
    seen.require(daemon.panics().is_empty(), format!("{:?}", daemon.panics()));
    seen.say(format!(
        "SIGTERM ended it after {} with code 0, the hanging thread left to itself",
        time(ended.took)
    ));
    Ok(seen)
}

/// No camera is there when the daemon starts.
pub fn none_at_start(site: &Site) -> Result<Seen> {
    let away = |serial| format!("serial: {serial}, fault: unplug, at_frame: 0, for_s: 4");
    let place = site.place(&Wishes { faults: SERIALS.map(away).to_vec(), ..Wishes::default() })?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let gone = daemon.wait_for_lines(&[PLAYED], 3, PATIENCE)?;
    let (answer, _) =
        wait_for_status(&mut client, ("without cameras", PATIENCE), |s| s.cameras_streaming == 0)?;
    seen.say(format!(
        "answers with {} of {} cameras",
        answer.snapshot.cameras_streaming, answer.snapshot.cameras
    ));
    seen.recovered(complete_set(&mut client, gone + Duration::from_secs(4))?, BACK);
    seen.say(format!("converged after {}", time(converged(&mut client, &daemon)?)));
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

/// How long after `since` a set of all cameras was told.
pub fn complete_set(client: &mut Client, since: Instant) -> Result<Duration> {
    std::thread::sleep(since.saturating_duration_since(Instant::now()));
    // What has waited for a reader is from before.
    while client.next_progress(Duration::ZERO)?.is_some() {}
    let until = Instant::now() + PATIENCE;
    while Instant::now() < until {
        if client.next_progress(ANSWER)?.is_some_and(|message| is_complete(&message)) {
            return Ok(since.elapsed());
        }
    }
    anyhow::bail!("no set of all cameras within {PATIENCE:?}")
}

fn is_complete(message: &ProgressMessage) -> bool {
    message.cameras.len() == SERIALS.len() && message.cameras.iter().all(|camera| camera.lines > 0)
}

/// The newest progress message.
pub fn newest(client: &mut Client) -> Result<ProgressMessage> {
    let mut newest = client.next_progress(ANSWER)?.context("no frame sets")?;
    while let Some(message) = client.next_progress(Duration::ZERO)? {
        newest = message;
    }
    Ok(newest)
}

/// Seconds between two messages.
fn before_to(before: &ProgressMessage, after: &ProgressMessage) -> f64 {
    after.published_ns.saturating_sub(before.published_ns) as f64 * 1e-9
}

/// How long after its start the daemon had a converged result.
pub fn converged(client: &mut Client, daemon: &Daemon) -> Result<Duration> {
    let what = ("converged", PATIENCE);
    let waited = wait_for_status(client, what, |status| status.state == State::Converged);
    let (_, at) = waited.inspect_err(|_| eprintln!("  {}", daemon.tail()))?;
    Ok(at.duration_since(daemon.started))
}
