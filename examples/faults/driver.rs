//! Rows in which opening a camera again does not help: only a reset brings it back, or only another process.

use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

use crate::cameras::{PLAYED, complete_set, outage};
use crate::daemon::Daemon;
use crate::row::{finish, judge};
use crate::site::{PATIENCE, SERIALS, Site, Wishes, history};
use crate::table::{Seen, time};

/// The exit code that stands for a driver that hangs.
const CAMERA_HANGS: i32 = 74;
/// `leave_after_s` of the row, and how much later than that the daemon is gone at the latest.
const LEAVE_AFTER: Duration = Duration::from_secs(2);
const MARGIN: Duration = Duration::from_secs(3);
/// From the end of one process to the stored calibration of the next.
const SERVED: Duration = Duration::from_secs(5);

/// Cameras that give no frames, however often they are opened, until they are reset.
pub fn reset_helps(site: &Site) -> Result<Seen> {
    let mut seen = Seen::default();
    for (camera, serial) in SERIALS.iter().enumerate() {
        let place = site.place(&Wishes {
            faults: vec![format!("serial: {serial}, fault: wedge, at_frame: 15")],
            recovery: "reopens_before_reset: 2, reset_interval_s: 1.0",
            reopen_after_s: Some(1.0),
            ..Wishes::default()
        })?;
        let was_reset = |daemon: &Daemon, began: Instant| {
            let at = daemon.wait_for_lines(&["camera was reset"], 1, PATIENCE)?;
            ensure!(at >= began, "reset before it was wedged");
            Ok(at)
        };
        outage(&place, camera, was_reset, &mut seen).context(*serial)?;
    }
    Ok(seen)
}

/// A device call that never returns: the daemon leaves with a code of its own, and is started again as a service manager does it.
pub fn another_process_helps(site: &Site) -> Result<Seen> {
    let hangs = Wishes {
        faults: vec![format!("serial: {}, fault: hang, at_frame: 15", SERIALS[1])],
        recovery: "leave_after_s: 2.0",
        ..Wishes::default()
    };
    let place = site.place(&hangs)?;
    site.put_calibration(&place)?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let began = daemon.wait_for_lines(&[PLAYED], 1, PATIENCE)?;
    let ended = daemon.wait(PATIENCE)?;
    let (left, took) = (Instant::now(), began.elapsed());
    seen.require(ended.code == Some(CAMERA_HANGS), format!("exit code {:?}", ended.code));
    seen.require(took <= LEAVE_AFTER + MARGIN, format!("it left after {}", time(took)));
    daemon.wait_for_lines(&["hangs in the driver"], 1, PATIENCE)?;
    seen.say(format!(
        "left {} after the call with code {CAMERA_HANGS}, the log names the thread",
        time(took)
    ));
    judge(&daemon, &audit, &mut seen);
    let kept = place.kept_ids();
    // The driver has let go of the camera with the process.
    site.configure(&place, &Wishes::default())?;
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let served = client.wait_calibration(PATIENCE)?.with_context(|| daemon.tail())?;
    seen.recovered(left.elapsed(), SERVED);
    let listed: Vec<u64> = history(&mut client)?.into_iter().rev().collect();
    seen.require(listed == kept, format!("the history has {listed:?}, the disk had {kept:?}"));
    let newest = kept.last().copied();
    seen.require(served.provenance.id == newest, format!("{:?} is served of {kept:?}", served.provenance.id));
    let back = complete_set(&mut client, daemon.started)?;
    seen.say(format!(
        "started again: the kept calibration is served, all cameras {} after the start",
        time(back)
    ));
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}
