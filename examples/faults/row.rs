//! What every row ends with: a clean stop, no panic, nothing wrong among what was published.

use std::time::Duration;

use anyhow::Result;
use pelical::ipc::ProgressMessage;

use crate::audit::Audit;
use crate::daemon::Daemon;
use crate::table::{Seen, time};

/// Longest time to the end of a daemon that is asked to.
const STOP: Duration = Duration::from_secs(3);

/// Stops the daemon and judges what it has said and published.
pub fn finish(daemon: &mut Daemon, audit: &Audit, seen: &mut Seen) -> Result<()> {
    seen.require(daemon.is_alive(), format!("the daemon is gone: {}", daemon.tail()));
    let ended = daemon.stop(Duration::from_secs(20))?;
    seen.require(ended.code == Some(0), format!("exit code {:?} at the end", ended.code));
    seen.require(ended.took <= STOP, format!("its end took {}", time(ended.took)));
    judge(daemon, audit, seen);
    Ok(())
}

/// The same of a daemon that has ended otherwise.
pub fn judge(daemon: &Daemon, audit: &Audit, seen: &mut Seen) {
    for line in daemon.panics() {
        seen.failures.push(line);
    }
    let audited = audit.seen();
    seen.failures.extend(audited.wrong.iter().cloned());
    if audited.converged > 0 {
        let (deg, mm) = audited.worst;
        seen.say(format!("published within {deg:.2} deg and {mm:.1} mm of the truth"));
    }
}

/// Sets on their way when a message is sent.
const UNDER_WAY: u64 = 1;

/// Sets that were formed between two messages, and those of them that were lost on the way to their publishing. What a busy estimator does not
/// take is not among these: it is published all the same.
pub fn grown(before: &ProgressMessage, after: &ProgressMessage) -> (u64, u64) {
    let formed = after.frame_sets.seen.saturating_sub(before.frame_sets.seen);
    let published = after.sequence.saturating_sub(before.sequence);
    (formed, formed.saturating_sub(published + UNDER_WAY))
}
