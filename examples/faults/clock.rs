//! The row in which the machine's wall clock jumps. Nobody can set the clock of a machine that others use: the daemon gets its wall clock
//! through a small preloaded library, which reads from a file by how much it is off.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use pelical::ipc::{Client, Outcome};
use pelical::solver::State;

use crate::cameras::{converged, newest};
use crate::daemon::Daemon;
use crate::private::wait_until;
use crate::row::{finish, grown};
use crate::site::{ANSWER, PATIENCE, Place, Site, Wishes, history};
use crate::table::{Seen, time};

const LIBRARY: &str = include_str!("clock.c");
const YEAR_S: i64 = 365 * 86_400;
/// How far the clock is off, one after the other: an hour ahead, two hours back, near 1970, far ahead.
const OFF_BY_S: [i64; 4] = [3_600, -3_600, -50 * YEAR_S, 60 * YEAR_S];

/// Frames go on, results are kept and served by their numbers, whatever the date.
pub fn wall_clock_jumps(site: &Site) -> Result<Seen> {
    let place = site.place(&Wishes::default())?;
    let Some(library) = built(&place.folder) else {
        return Ok(Seen::skipped("needs a C compiler (cc) for the preloaded clock"));
    };
    let offset = place.folder.join("offset");
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = start(&place, (&library, &offset))?;
    let mut client = place.client(PATIENCE)?;
    converged(&mut client, &daemon)?;
    for off_by_s in OFF_BY_S {
        std::fs::write(&offset, off_by_s.to_string())?;
        one_jump(&mut client, &mut seen).with_context(|| format!("off by {off_by_s} s"))?;
    }
    let n = OFF_BY_S.len() as u64 + 1;
    let listed = history(&mut client)?;
    seen.require(listed == (1..=n).rev().collect::<Vec<_>>(), format!("the history has {listed:?}"));
    // It starts in 1970, long before its calibrations were made.
    std::fs::write(&offset, OFF_BY_S[2].to_string())?;
    wait_until("kept", PATIENCE, || Ok(place.kept_ids().last() == Some(&n)))?;
    daemon.kill()?;
    drop((daemon, client));
    let mut daemon = start(&place, (&library, &offset))?;
    let mut client = place.client(PATIENCE)?;
    let served = client.wait_calibration(PATIENCE)?.context("nothing served")?;
    let is_right = served.provenance.id == Some(n) && served.calibration.state == State::Stored;
    seen.require(is_right, format!("served {:?} {}", served.provenance.id, served.calibration.state.name()));
    seen.say(format!("a start in the past serves the newest of {n} by number"));
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

/// After a jump: sets come at their pace, none is dropped, and a new calibration is made and kept.
fn one_jump(client: &mut Client, seen: &mut Seen) -> Result<()> {
    // Going back counts anew: what is told from then on.
    std::thread::sleep(Duration::from_millis(500));
    let before = newest(client)?;
    std::thread::sleep(Duration::from_secs(2));
    let after = newest(client)?;
    let (sets, dropped) = grown(&before, &after);
    seen.require(sets >= 8 && dropped == 0, format!("{sets} sets, {dropped} dropped in 2 s"));
    seen.require(
        after.latency_ns < 1_000_000_000,
        format!("latency {}", time(Duration::from_nanos(after.latency_ns))),
    );
    let outcome = client.rollback(1, ANSWER)?.outcome;
    ensure!(outcome == Outcome::Accepted, "{outcome:?}");
    seen.say(format!("{sets} sets in 2 s, none dropped"));
    Ok(())
}

fn start(place: &Place, (library, offset): (&Path, &Path)) -> Result<Daemon> {
    let mut command = place.command();
    command.env("LD_PRELOAD", library).env("FAULTS_CLOCK", offset);
    Daemon::start(command)
}

fn built(folder: &Path) -> Option<PathBuf> {
    let (source, library) = (folder.join("clock.c"), folder.join("clock.so"));
    std::fs::write(&source, LIBRARY).ok()?;
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).arg(&source).arg("-ldl");
    cc.status().is_ok_and(|status| status.success()).then_some(library)
}
