//! The rows in which the machine's shared memory is full: a `/dev/shm` of the daemon's own, of 64 MiB.

use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use serde_json::Value;

use crate::daemon::Daemon;
use crate::private::{NEEDS_ROOT, Private, wait_until};
use crate::site::{PATIENCE, Place, Site, Wishes};
use crate::table::Seen;

const SHM: &str = "/dev/shm";
/// Within this the kept calibration is served once there is room.
const LIMIT: Duration = Duration::from_secs(5);
const MOUNTS: &str = "mount -t tmpfs -o size=64m tmpfs /dev/shm && mkdir -p /tmp/iceoryx2 && mount -t tmpfs tmpfs /tmp/iceoryx2";

/// Full before the start: refused with words; once there is room, the same start serves what is kept.
pub fn full_at_start(site: &Site) -> Result<Seen> {
    let Some((place, private)) = prepared(site)? else { return Ok(Seen::skipped(NEEDS_ROOT)) };
    let mut seen = Seen::default();
    private.fill(Path::new(SHM), 16 << 20)?;
    let mut daemon = Daemon::start(private.inside(&place.command()))?;
    let ended = daemon.wait(PATIENCE)?;
    seen.require(ended.code == Some(1), format!("exit code {:?}", ended.code));
    daemon.wait_for_lines(&["KiB are needed"], 1, PATIENCE)?;
    seen.say("exit code 1, the log says how much is missing");
    private.free(Path::new(SHM))?;
    let freed = Instant::now();
    let mut daemon = Daemon::start(private.inside(&place.command()))?;
    served(&private, &place)?;
    seen.recovered(freed.elapsed(), LIMIT);
    seen.say("then it starts and serves the kept calibration");
    seen.require(daemon.stop(PATIENCE)?.code == Some(0), "exit code at the end");
    seen.failures.extend(daemon.panics());
    Ok(seen)
}

/// Full while it runs, to the last byte.
pub fn full_while_running(site: &Site) -> Result<Seen> {
    let Some((place, private)) = prepared(site)? else { return Ok(Seen::skipped(NEEDS_ROOT)) };
    let mut seen = Seen::default();
    let mut daemon = Daemon::start(private.inside(&place.command()))?;
    served(&private, &place)?;
    private.fill(Path::new(SHM), 0)?;
    let mut refused = 0;
    for _ in 0..20 {
        let said = private.inside(&client(&place)).output()?.stderr;
        refused += u32::from(String::from_utf8_lossy(&said).contains("a client needs"));
        std::thread::sleep(Duration::from_millis(100));
    }
    seen.say(format!("{refused} of 20 new clients were told that memory is full"));
    seen.require(refused == 20, "a client was not told why it is not served");
    seen.require(daemon.is_alive(), "the daemon is dead");
    private.free(Path::new(SHM))?;
    let freed = Instant::now();
    served(&private, &place)?;
    seen.recovered(freed.elapsed(), LIMIT);
    seen.say("with room again it serves the kept calibration to new clients");
    seen.require(daemon.stop(PATIENCE)?.code == Some(0), "exit code at the end");
    seen.failures.extend(daemon.panics());
    Ok(seen)
}

/// A place over shared memory with a calibration of an earlier run.
fn prepared(site: &Site) -> Result<Option<(Place, Private)>> {
    if !Private::is_possible() {
        return Ok(None);
    }
    let place = site.place(&Wishes { shared_memory: true, is_lazy: true, ..Wishes::default() })?;
    site.put_calibration(&place)?;
    Ok(Some((place, Private::new(MOUNTS)?)))
}

/// Waits for a client that is served the kept calibration.
fn served(private: &Private, place: &Place) -> Result<()> {
    wait_until("served", PATIENCE, || {
        Ok(status(private, place).is_some_and(|status| status["calibration_id"] == 1))
    })?;
    Ok(())
}

/// The client program.
fn client(place: &Place) -> Command {
    let mut command = Command::new(place.program("pelical"));
    command.args(["--instance", place.instance.as_str(), "status", "--json"]);
    command
}

/// What the client program says inside; `None` when it was not answered.
fn status(private: &Private, place: &Place) -> Option<Value> {
    let output = private.inside(&client(place)).output().ok()?;
    let answered = || -> Result<Value> {
        ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        Ok(serde_json::from_slice(&output.stdout)?)
    };
    answered().ok()
}
