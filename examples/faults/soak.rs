//! The soak: minutes of random faults and random clients on one daemon, whose memory and open files must stay flat.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Result;
use pelical::ipc::Client;

use crate::audit::Audit;
use crate::clients::kill_one;
use crate::daemon::{Daemon, Resources};
use crate::random::Random;
use crate::row::finish;
use crate::site::{ANSWER, PATIENCE, Place, SERIALS, Site, Wishes, history};
use crate::table::{Seen, time};

const SAMPLE: Duration = Duration::from_secs(10);
/// Share of the time in which memory is still being touched for the first time.
const WARM_UP: f64 = 0.25;
/// Growth after that which counts as flat: share of the memory, open files.
const FLAT: (f64, f64) = (0.05, 3.0);
/// Faults of every frame of every camera, with their chances.
const FAULTS: [&str; 6] = [
    "fault: drop, chance: 0.02",
    "fault: zero_depth, chance: 0.02",
    "fault: half_black, chance: 0.02",
    "fault: stall, chance: 0.002, for_s: 1.5",
    "fault: unplug, chance: 0.002, for_s: 2",
    "fault: hang, chance: 0.001, for_s: 1",
];

/// What the daemon held after so many minutes.
type Sample = (f64, Resources);

/// Runs for so many minutes.
pub fn soak(site: &Site, minutes: f64) -> Result<Seen> {
    let all = |serial| FAULTS.iter().map(move |fault| format!("serial: {serial}, {fault}"));
    let faults = SERIALS.into_iter().flat_map(all).collect();
    let place = site.place(&Wishes { faults, ..Wishes::default() })?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let (mut random, mut asked, mut samples) = (Random::new(site.seed ^ 0x50A6), 0, Vec::new());
    let began = Instant::now();
    while began.elapsed().as_secs_f64() < minutes * 60.0 && daemon.is_alive() {
        if began.elapsed() >= SAMPLE * (samples.len() as u32 + 1) {
            samples.push(sample(&daemon, began)?);
        }
        be_a_client(&place, &mut client, &mut random)?;
        asked += 1;
        std::thread::sleep(random.time_ms(100.0, 2000.0));
    }
    tell((&daemon, &audit), asked, &mut seen);
    tell_growth(&samples, &mut seen);
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

fn sample(daemon: &Daemon, began: Instant) -> Result<Sample> {
    let (minutes, held) = (began.elapsed().as_secs_f64() / 60.0, daemon.resources()?);
    eprintln!("  {minutes:5.1} min  {:7} KiB  {:3} files", held.rss_kib, held.fds);
    Ok((minutes, held))
}

/// One of the things that clients do, the harmless ones more often.
fn be_a_client(place: &Place, client: &mut Client, random: &mut Random) -> Result<()> {
    match random.below(20) {
        0 => drop(client.recalibrate(ANSWER)?),
        1 => drop(client.rollback(random.below(9), ANSWER)?),
        2 => drop(client.cancel(ANSWER)?),
        3 | 4 => kill_one(place, random)?,
        5..8 => drop(history(client)?),
        8..11 => drop(place.client(PATIENCE)?.status(ANSWER)?),
        11 => {
            let mut command = Command::new(place.program("pelical"));
            command.args(["--instance", place.instance.as_str(), "--ipc-directory"]);
            command.arg(place.folder.join("ipc")).args(["status", "--json"]);
            command.stdout(Stdio::null()).stderr(Stdio::null()).status()?;
        }
        _ => drop(client.status(ANSWER)?),
    }
    Ok(())
}

fn tell((daemon, audit): (&Daemon, &Audit), asked: u32, seen: &mut Seen) {
    let count = |part: &str| daemon.lines_with(&[part]).len();
    let audited = audit.seen();
    seen.say(format!(
        "{} stalls, hangs and absences played and {asked} actions of clients; cameras came back {} times; {} calibrations, {} messages",
        count("a fault is played"),
        count("camera is streaming"),
        count("calibrated state"),
        audited.messages
    ));
}

/// Memory and files at both ends, and the slope between.
fn tell_growth(samples: &[Sample], seen: &mut Seen) {
    let warm = &samples[(samples.len() as f64 * WARM_UP) as usize..];
    let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return };
    let lasts = warm.last().map_or(0.0, |last| last.0 - warm[0].0);
    let memory = slope(warm, |held| held.rss_kib as f64);
    let files = slope(warm, |held| held.fds as f64);
    let mean = warm.iter().map(|(_, held)| held.rss_kib as f64).sum::<f64>() / warm.len().max(1) as f64;
    seen.say(format!(
        "resident memory {:.1} MiB after {}, {:.1} MiB after {:.1} min, slope after warm-up {:+.1} KiB/min; open files {}, {}, slope {:+.3}/min",
        first.1.rss_kib as f64 / 1024.0,
        time(Duration::from_secs_f64(first.0 * 60.0)),
        last.1.rss_kib as f64 / 1024.0,
        last.0,
        memory,
        first.1.fds,
        last.1.fds,
        files
    ));
    seen.require(memory * lasts <= FLAT.0 * mean, "resident memory grows");
    seen.require(files * lasts <= FLAT.1, "open files grow");
}

/// Least squares, per minute.
fn slope(samples: &[Sample], value: impl Fn(&Resources) -> f64) -> f64 {
    let n = samples.len() as f64;
    let mean_t = samples.iter().map(|(t, _)| t).sum::<f64>() / n;
    let mean_v = samples.iter().map(|(_, held)| value(held)).sum::<f64>() / n;
    let (mut above, mut below) = (0.0, 0.0);
    for (t, held) in samples {
        above += (t - mean_t) * (value(held) - mean_v);
        below += (t - mean_t).powi(2);
    }
    if below > 0.0 { above / below } else { 0.0 }
}
