//! Rows in which the state directory takes nothing: full, and read-only. Each is a small memory file system of its own.

use std::time::Duration;

use anyhow::{Context, Result, ensure};
use pelical::ipc::{Client, Outcome};
use pelical::solver::State;

use crate::audit::Audit;
use crate::cameras::converged;
use crate::daemon::Daemon;
use crate::private::{NEEDS_ROOT, Private, wait_until};
use crate::row::finish;
use crate::site::{ANSWER, PATIENCE, Place, Site, Wishes, history, ids_in};
use crate::table::{Seen, time};

/// The store tries again every 10 s.
const KEPT_AGAIN: Duration = Duration::from_secs(15);

/// What makes a disk refuse, and what ends that.
pub enum Refusal {
    Full,
    ReadOnly,
}

impl Refusal {
    fn begin(&self, private: &Private, place: &Place) -> Result<()> {
        match self {
            Refusal::Full => private.fill(&place.state, 0),
            Refusal::ReadOnly => remount(private, place, "ro"),
        }
    }

    fn end(&self, private: &Private, place: &Place) -> Result<()> {
        match self {
            Refusal::Full => private.free(&place.state),
            Refusal::ReadOnly => remount(private, place, "rw"),
        }
    }
}

fn remount(private: &Private, place: &Place, mode: &str) -> Result<()> {
    let state = place.state.display().to_string();
    private.run(&["mount", "-o", &format!("remount,{mode}"), &state])
}

/// Published as always, said in the status, kept as soon as the disk takes it; a restart meanwhile serves what is there.
pub fn refuses(site: &Site, refusal: &Refusal) -> Result<Seen> {
    if !Private::is_possible() {
        return Ok(Seen::skipped(NEEDS_ROOT));
    }
    let place = site.place(&Wishes::default())?;
    let private = Private::new(&format!("mount -t tmpfs -o size=1m tmpfs {}", place.state.display()))?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let (mut daemon, mut client) = start(&private, &place)?;
    converged(&mut client, &daemon)?;
    wait_until("kept", PATIENCE, || Ok(kept(&private, &place) == [1]))?;
    refusal.begin(&private, &place)?;
    let fault = refused_rollback(&mut client, 1)?;
    seen.say(format!("published; the status says \"{}\"", short(&fault)));
    seen.require(kept(&private, &place) == [1], "what was kept has changed");
    refusal.end(&private, &place)?;
    let took =
        wait_until("kept again", KEPT_AGAIN, || Ok(client.status(ANSWER)?.snapshot.store_fault.is_none()))?;
    seen.recovered(took, KEPT_AGAIN);
    seen.require(kept(&private, &place) == [1, 2], format!("kept are {:?}", kept(&private, &place)));
    seen.say("kept once there was room");
    refusal.begin(&private, &place)?;
    daemon.kill()?;
    drop((daemon, client));
    restarted(&private, &place, (&audit, &mut seen))?;
    Ok(seen)
}

/// A daemon that starts while the disk refuses.
fn restarted(private: &Private, place: &Place, (audit, seen): (&Audit, &mut Seen)) -> Result<()> {
    let (mut daemon, mut client) = start(private, place)?;
    let served = client.wait_calibration(PATIENCE)?.context("nothing served")?;
    let is_right = served.provenance.id == Some(2) && served.calibration.state == State::Stored;
    seen.require(is_right, format!("served {:?} {}", served.provenance.id, served.calibration.state.name()));
    let listed = history(&mut client)?;
    seen.require(listed == [2, 1], format!("the history has {listed:?}"));
    seen.say(format!(
        "kill -9 and a start meanwhile: calibration 2 served after {}, history whole",
        time(daemon.started.elapsed())
    ));
    finish(&mut daemon, audit, seen)
}

fn start(private: &Private, place: &Place) -> Result<(Daemon, Client)> {
    let daemon = Daemon::start(private.inside(&place.command()))?;
    Ok((daemon, place.client(PATIENCE)?))
}

fn kept(private: &Private, place: &Place) -> Vec<u64> {
    ids_in(&private.seen(&place.kept()))
}

/// Goes back to a calibration, which makes a new one that the disk does not take; what the status says of that.
fn refused_rollback(client: &mut Client, id: u64) -> Result<String> {
    let outcome = client.rollback(id, ANSWER)?.outcome;
    ensure!(outcome == Outcome::Accepted, "{outcome:?}");
    let mut fault = None;
    wait_until("said to be not kept", PATIENCE, || {
        fault = client.status(ANSWER)?.snapshot.store_fault;
        Ok(fault.is_some())
    })?;
    fault.context("no fault")
}

/// The reason without the path, which differs from run to run.
fn short(fault: &str) -> String {
    fault.rsplit(": ").next().unwrap_or(fault).to_owned()
}
