//! The rows of `kill -9`: at random moments of the start, of serving and of writing; and how soon a start serves what is kept.

use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nalgebra::Vector3;
use pelical::ipc::{Archived, CalibrationMessage, Client, Outcome};
use pelical::solver::State;
use pelical::store::{StoredCalibration, decode, encode};

use crate::daemon::Daemon;
use crate::random::Random;
use crate::row::finish;
use crate::site::{ANSWER, PATIENCE, Place, Site, Wishes};
use crate::table::{Seen, median_and_worst, time};

/// Calibrations that are kept meanwhile.
const KEEP: u32 = 12;
/// A calibration that was accepted this long before a kill is on the disk.
const SETTLED: Duration = Duration::from_secs(1);
/// From the start of the process to the stored calibration at a client.
const SERVED_WITHIN: Duration = Duration::from_millis(300);
/// As above, of a start that cleans up after a killed daemon; what was half made is cleared away after a second.
const SERVED_AFTER_KILL: Duration = Duration::from_secs(5);

/// What the campaign has seen of the history.
struct Witness {
    originals: Vec<StoredCalibration>,
    /// Every calibration that was accepted, and when.
    accepted: Vec<(u64, Instant)>,
    served: Vec<Duration>,
    unwritten: usize,
    mid_write: usize,
}

/// Kills a daemon so many times while calibrations are made as fast as it takes them.
pub fn kills(site: &Site, (n, shared_memory): (u32, bool)) -> Result<Seen> {
    let place = site.place(&Wishes { shared_memory, is_lazy: true, keep: KEEP, ..Wishes::default() })?;
    let originals = two_calibrations(site, &place)?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut random = Random::new(site.seed ^ u64::from(shared_memory));
    let mut witness =
        Witness { originals, accepted: Vec::new(), served: Vec::new(), unwritten: 0, mid_write: 0 };
    for number in 1..=n {
        one_kill(&place, &mut random, (&mut witness, &mut seen)).with_context(|| format!("kill {number}"))?;
    }
    let mut daemon = place.start()?;
    check_start(&place, &daemon, (&mut witness, &mut seen))?;
    finish(&mut daemon, &audit, &mut seen)?;
    let (median, worst) = median_and_worst(&witness.served);
    seen.recovered(worst, SERVED_AFTER_KILL);
    seen.say(format!(
        "{n} kills, {} calibrations accepted, {} kills in the middle of a write, {} calibrations killed within the write that \
         follows their publishing; every start read the whole history and served the newest on the disk, after {} (median)",
        witness.accepted.len(),
        witness.mid_write,
        witness.unwritten,
        time(median)
    ));
    Ok(seen)
}

fn one_kill(place: &Place, random: &mut Random, (witness, seen): (&mut Witness, &mut Seen)) -> Result<()> {
    let mut daemon = place.start()?;
    if random.below(3) == 0 {
        // In the middle of its start.
        std::thread::sleep(random.time_ms(0.5, 400.0));
    } else {
        let lasts = random.time_ms(1.0, 1500.0);
        let lived = make_calibrations(place, &daemon, lasts, (random, witness, seen));
        lived.map_err(|error| error.context(format!("alive: {}; {}", daemon.is_alive(), daemon.tail())))?;
    }
    daemon.kill()?;
    let killed = Instant::now();
    seen.failures.extend(daemon.panics());
    let on_disk = place.kept_ids();
    let newest = on_disk.last().copied().unwrap_or_default();
    let lost: Vec<Instant> =
        witness.accepted.iter().filter(|(id, _)| *id > newest).map(|(_, at)| *at).collect();
    let oldest = lost.iter().map(|at| killed.duration_since(*at)).max();
    ensure!(
        oldest.is_none_or(|age| age < SETTLED),
        "{} accepted {oldest:?} before the kill are lost",
        lost.len()
    );
    witness.unwritten += lost.len();
    witness.mid_write += usize::from(has_unfinished(place));
    // Their numbers were never on the disk and are given again.
    witness.accepted.retain(|(id, _)| *id <= newest);
    Ok(())
}

/// By turns the one and the other pose, so that a mix of two files would show.
fn make_calibrations(
    place: &Place,
    daemon: &Daemon,
    lasts: Duration,
    (random, witness, seen): (&mut Random, &mut Witness, &mut Seen),
) -> Result<()> {
    let mut client = check_start(place, daemon, (witness, seen))?;
    let began = Instant::now();
    while began.elapsed() < lasts {
        let known: Vec<u64> =
            witness.accepted.iter().rev().take(3).map(|(id, _)| *id).chain([1, 2]).collect();
        let id = known[random.below(known.len() as u64) as usize];
        let answer = client.rollback(id, ANSWER)?;
        if let (Outcome::Accepted, Some(id)) = (answer.outcome, answer.snapshot.calibration_id) {
            witness.accepted.push((id, Instant::now()));
        }
    }
    Ok(())
}

/// The newest calibration on the disk is served as `stored`, and the history is whole.
fn check_start(place: &Place, daemon: &Daemon, (witness, seen): (&mut Witness, &mut Seen)) -> Result<Client> {
    let on_disk = place.kept_ids();
    let mut client = place.client(PATIENCE).with_context(|| daemon.tail())?;
    let served = client.wait_calibration(PATIENCE)?.with_context(|| daemon.tail())?;
    witness.served.push(daemon.started.elapsed());
    let is_newest = served.provenance.id == on_disk.last().copied();
    // Live lines may have vouched for it already.
    let is_good = matches!(served.calibration.state, State::Stored | State::Converged);
    ensure!(is_newest && is_good, "served {:?} of {on_disk:?}", served.provenance.id);
    ensure!(is_known(&served, &witness.originals), "a pose that nobody has made is served");
    let (mut listed, mut below) = (Vec::new(), u64::MAX);
    while let Archived::Found(message) = client.archived_below(below, ANSWER)? {
        ensure!(is_known(&message, &witness.originals), "a pose that nobody has made is in the history");
        below = message.provenance.id.context("no number")?;
        listed.push(below);
    }
    let expected: Vec<u64> = on_disk.into_iter().rev().take(KEEP as usize).collect();
    seen.require(listed == expected, format!("the history has {listed:?}, the disk {expected:?}"));
    Ok(client)
}

fn is_known(message: &CalibrationMessage, originals: &[StoredCalibration]) -> bool {
    originals.iter().any(|original| {
        let poses = original.calibration.cameras.iter().zip(&message.calibration.cameras);
        poses.into_iter().all(|(original, found)| match (original, found) {
            // The wire carries every bit, but a rotation is made unit length again.
            (Some(original), Some(found)) => {
                let gap = original.reference_from_camera.inverse() * found.reference_from_camera;
                gap.translation.vector.norm() < 1e-12 && gap.rotation.angle() < 1e-9
            }
            _ => false,
        })
    })
}

fn has_unfinished(place: &Place) -> bool {
    let entries = std::fs::read_dir(place.kept()).into_iter().flatten().flatten();
    entries.into_iter().any(|entry| entry.path().extension().is_some_and(|extension| extension == "new"))
}

/// Two calibrations that differ by a millimetre, on the disk before the first start.
fn two_calibrations(site: &Site, place: &Place) -> Result<Vec<StoredCalibration>> {
    site.put_calibration(place)?;
    let file = |id: u64| place.kept().join(format!("calibration-{id:06}.yaml"));
    let first = decode(&std::fs::read(file(1))?)?;
    let mut second = StoredCalibration { id: 2, ..first.clone() };
    for pose in second.calibration.cameras.iter_mut().skip(1).flatten() {
        pose.reference_from_camera.translation.vector += Vector3::new(1e-3, 0.0, 0.0);
    }
    std::fs::write(file(2), encode(&second)?)?;
    Ok(vec![first, second])
}

/// How soon after its start a daemon serves what is kept, many times.
pub fn start_times(site: &Site, n: u32) -> Result<Seen> {
    let place = site.place(&Wishes { is_lazy: true, ..Wishes::default() })?;
    site.put_calibration(&place)?;
    let mut seen = Seen::default();
    let (mut times, mut published) = (Vec::new(), Vec::new());
    for _ in 0..n {
        let mut daemon = place.start()?;
        let mut client = place.client(PATIENCE)?;
        let served = client.wait_calibration(PATIENCE)?.context("nothing served")?;
        times.push(daemon.started.elapsed());
        let said = daemon.wait_for_lines(&["serving the stored calibration"], 1, PATIENCE)?;
        published.push(said.duration_since(daemon.started));
        seen.require(served.calibration.state == State::Stored, served.calibration.state.name());
        seen.require(daemon.stop(PATIENCE)?.code == Some(0), "exit code at the end");
        seen.failures.extend(daemon.panics());
    }
    let (median, worst) = median_and_worst(&times);
    seen.recovered(worst, SERVED_WITHIN);
    let (published_median, published_worst) = median_and_worst(&published);
    seen.say(format!(
        "{n} starts, from the start of the process to the stored calibration at a client that waits for it: median {}, worst {}; to its \
         publishing: median {}, worst {}",
        time(median),
        time(worst),
        time(published_median),
        time(published_worst)
    ));
    Ok(seen)
}
