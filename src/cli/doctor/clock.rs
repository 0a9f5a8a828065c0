//! The clock: does it tell the time of day, is it kept right, and does it jump? Ages of stored calibrations follow it.

use std::fs;
use std::thread;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use super::finding::Finding;
use super::system::System;

const CHECK: &str = "clock";
/// 2026-01-01, s since 1970: this program is not older.
const PROGRAM_MADE_S: u64 = 1_767_225_600;
/// How long the two clocks are compared, and by how much they may differ then.
const WATCHED: Duration = Duration::from_millis(100);
const JUMP: Duration = Duration::from_millis(10);
/// Files from the future by more than this were made before the clock was set back.
const AHEAD: Duration = Duration::from_secs(60);

/// Everything about the clock; `state` is the folder of stored calibrations.
pub fn check(system: &System, state: Option<&std::path::Path>) -> Vec<Finding> {
    let now = SystemTime::now();
    let mut findings = vec![time_of_day(now)];
    findings.extend(
        state.and_then(|folder| newest_file(system, folder, 3)).and_then(|newest| set_back(now, newest)),
    );
    findings.push(synchronised(system));
    if system.is_running {
        findings.extend(jump(watch()));
    }
    findings
}

fn time_of_day(now: SystemTime) -> Finding {
    let since_s = now.duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    if since_s >= PROGRAM_MADE_S {
        return Finding::ok(CHECK, "the time of day is plausible");
    }
    Finding::problem(
        CHECK,
        format!("the clock stands at {since_s} s since 1970, before this program was made"),
        (
            "a computer without a battery for its clock, and nobody has set it since the start",
            "set it (`sudo date -s ...`), or let systemd-timesyncd or chrony set it before pelicald starts",
        ),
    )
}

/// The newest change of a file in a folder and the folders in it.
fn newest_file(system: &System, folder: &std::path::Path, depth: usize) -> Option<SystemTime> {
    fn newest(folder: &std::path::Path, depth: usize) -> Option<SystemTime> {
        let entries = fs::read_dir(folder).ok()?.flatten();
        let times = entries.filter_map(|entry| {
            let metadata = entry.metadata().ok()?;
            if metadata.is_file() {
                return metadata.modified().ok();
            }
            if depth > 0 && metadata.is_dir() { newest(&entry.path(), depth - 1) } else { None }
        });
        times.max()
    }
    newest(&system.path(folder), depth)
}

fn set_back(now: SystemTime, newest: SystemTime) -> Option<Finding> {
    let ahead = newest.duration_since(now).ok().filter(|ahead| *ahead > AHEAD)?;
    Some(Finding::warning(
        CHECK,
        format!("the newest stored calibration is from {} s in the future", ahead.as_secs()),
        (
            "the clock was set back since it was made: its age is not known",
            "set the clock right; the calibration itself is as good as before",
        ),
    ))
}

fn synchronised(system: &System) -> Finding {
    if system.exists("/run/systemd/timesync/synchronized") {
        return Finding::ok(CHECK, "synchronised by systemd-timesyncd");
    }
    let keepers = ["/run/chrony/chronyd.pid", "/run/chronyd.pid", "/run/ntpd.pid", "/run/ptp4l"];
    if let Some(keeper) = keepers.iter().find(|file| system.exists(file)) {
        return Finding::ok(CHECK, format!("kept by another program ({keeper})"));
    }
    let cure = "sudo timedatectl set-ntp true, or run chrony; a robot on its own does without";
    if system.exists("/run/systemd/timesync") {
        let why = ("systemd-timesyncd runs and has reached no server yet", cure);
        return Finding::warning(CHECK, "not synchronised", why);
    }
    let why = (
        "neither systemd-timesyncd nor chrony or ntpd runs here: ages of stored calibrations drift with it",
        cure,
    );
    Finding::warning(CHECK, "nobody keeps the clock right", why)
}

/// How far the clock moved in a while, by itself and by the clock that nobody sets.
fn watch() -> (Duration, Duration) {
    let (wall, monotonic) = (SystemTime::now(), Instant::now());
    thread::sleep(WATCHED);
    let wall = wall.elapsed().unwrap_or(Duration::ZERO);
    (wall, monotonic.elapsed())
}

fn jump((wall, monotonic): (Duration, Duration)) -> Option<Finding> {
    let off = wall.abs_diff(monotonic);
    (off > JUMP).then(|| {
        let why = (
            "somebody sets the clock right now, again and again: two programs that keep it, or a virtual machine's host",
            "let one program keep the clock, and let it slew instead of step",
        );
        let (off_ms, watched_ms) = (off.as_millis(), WATCHED.as_millis());
        Finding::warning(CHECK, format!("the clock jumped by {off_ms} ms within {watched_ms} ms"), why)
    })
}

#[cfg(test)]
mod tests {
    use super::super::finding::Grade;
    use super::*;

    #[test]
    fn a_clock_that_stands_in_1970_is_a_problem_and_one_that_was_set_back_a_warning() {
        assert_eq!(time_of_day(UNIX_EPOCH + Duration::from_secs(77)).grade, Grade::Problem);
        let now = UNIX_EPOCH + Duration::from_secs(PROGRAM_MADE_S + 5);
        assert_eq!(time_of_day(now).grade, Grade::Ok);
        assert!(set_back(now, now + Duration::from_secs(3600)).is_some_and(|f| f.finding.contains("3600 s")));
        assert_eq!(set_back(now, now + Duration::from_secs(5)), None);
        assert_eq!(set_back(now, now - Duration::from_secs(3600)), None);
    }

    #[test]
    fn a_jump_shows_between_the_clocks() {
        let ms = Duration::from_millis;
        assert_eq!(jump((ms(101), ms(100))), None);
        for wall in [ms(600), ms(0)] {
            let found = jump((wall, ms(100))).expect("a jump");
            assert!(found.finding.contains(" ms within 100 ms"), "{found:?}");
        }
    }
}
