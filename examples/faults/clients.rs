//! Rows in which clients misbehave: too many requests, requests that are none, clients that die while they wait.

use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use iceoryx2::prelude::{NodeBuilder, ServiceName, SignalHandlingMode, ipc};
use pelical::ipc::wire::{ArchiveRequestWire, ArchiveResponseWire, RequestWire, ResponseWire, VERSION};
use pelical::ipc::{Client, InstanceName, Transport};
use pelical::solver::State;

use crate::cameras::{complete_set, newest};
use crate::random::Random;
use crate::row::{finish, grown};
use crate::site::{ANSWER, PATIENCE, Place, Site, Wishes};
use crate::table::{Seen, time};

/// Clients of the flood; the daemon has room for 16.
const FLOODERS: usize = 12;
const FLOOD: Duration = Duration::from_secs(5);
/// Within this the daemon has closed the files of those that left.
const LETTING_GO: Duration = Duration::from_secs(1);
/// The code of an outcome and of a refusal in [`ResponseWire`].
const REFUSED: u32 = 3;
const UNREADABLE: u32 = 4;

/// Twelve clients ask as fast as they are answered.
pub fn flood(site: &Site) -> Result<Seen> {
    let place = prepared(site, false)?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    complete_set(&mut client, Instant::now())?;
    let before = newest(&mut client)?;
    let answered: Result<Vec<(u64, Duration)>> = std::thread::scope(|scope| {
        let flooders: Vec<_> = (0..FLOODERS).map(|_| scope.spawn(|| ask_fast(&place))).collect();
        flooders.into_iter().map(|flooder| flooder.join().map_err(|_| anyhow::anyhow!("a panic"))?).collect()
    });
    let answered = answered?;
    let after = newest(&mut client)?;
    let rate = answered.iter().map(|(n, _)| n).sum::<u64>() as f64 / FLOOD.as_secs_f64();
    let slowest = answered.iter().map(|(_, slowest)| *slowest).max().unwrap_or_default();
    let (sets, dropped) = grown(&before, &after);
    seen.require(rate >= 1000.0, format!("only {rate:.0} requests/s were answered"));
    seen.require(dropped == 0, format!("{dropped} sets dropped"));
    seen.say(format!(
        "{rate:.0} requests/s answered for {}, the slowest after {}; {sets} sets meanwhile, {dropped} dropped",
        time(FLOOD),
        time(slowest)
    ));
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

fn ask_fast(place: &Place) -> Result<(u64, Duration)> {
    let mut client = place.client(PATIENCE)?;
    let (mut n, mut slowest, began) = (0, Duration::ZERO, Instant::now());
    while began.elapsed() < FLOOD {
        let asked = Instant::now();
        client.status(ANSWER)?;
        (n, slowest) = (n + 1, slowest.max(asked.elapsed()));
    }
    Ok((n, slowest))
}

/// Requests of any bytes over the real channels, and processes that take the channels for others.
pub fn malformed(site: &Site, n_requests: usize) -> Result<Seen> {
    let place = prepared(site, true)?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    let mut random = Random::new(site.seed);
    let refused = send_requests(&place, n_requests, &mut random)?;
    seen.require(
        refused == n_requests,
        format!("{refused} of {n_requests} requests were refused as unreadable"),
    );
    seen.say(format!("{refused} of {n_requests} requests refused as unreadable, one by one"));
    let answered = send_questions(&place, n_requests / 10, &mut random)?;
    seen.say(format!("{answered} of {} questions for the history answered", n_requests / 10));
    seen.require(answered == n_requests / 10, "a question without an answer");
    take_for_others(&place)?;
    seen.say("other payload types and a second publisher are not let in");
    let status = client.status(ANSWER)?.snapshot;
    seen.require(status.calibration_id == Some(1), format!("calibration {:?}", status.calibration_id));
    seen.require(matches!(status.state, State::Stored | State::Converged), status.state.name());
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

fn service(place: &Place, topic: &str) -> Result<ServiceName> {
    let name = format!("pelical/{}/v{VERSION}/{topic}", place.instance);
    ServiceName::new(&name).map_err(|error| anyhow::anyhow!("{error:?}"))
}

fn node() -> Result<iceoryx2::prelude::Node<ipc::Service>> {
    let built =
        NodeBuilder::new().signal_handling_mode(SignalHandlingMode::Disabled).create::<ipc::Service>();
    built.map_err(|error| anyhow::anyhow!("{error:?}"))
}

/// Numbers that tend to break readers, or any.
fn number(random: &mut Random) -> u64 {
    match random.below(4) {
        0 => random.below(12),
        1 => u64::MAX - random.below(3),
        2 => 1 << random.below(64),
        _ => random.next(),
    }
}

/// How many of these requests were answered as unreadable.
fn send_requests(place: &Place, n: usize, random: &mut Random) -> Result<usize> {
    let node = node()?;
    let control = node.service_builder(&service(place, "control")?);
    let control = control.request_response::<RequestWire, ResponseWire>().open();
    let port = control.map_err(failed)?.client_builder().create().map_err(failed)?;
    let mut refused = 0;
    for _ in 0..n {
        let mut wire = RequestWire {
            version: if random.below(2) == 0 { VERSION } else { number(random) as u32 },
            kind: number(random) as u32,
            id: number(random),
            calibration: number(random),
        };
        // One that can be read would be done.
        if wire.version == VERSION && (1..=4).contains(&wire.kind) {
            wire.kind = 0;
        }
        let pending = port.send_copy(wire).map_err(failed)?;
        let until = Instant::now() + ANSWER;
        let answer = loop {
            if let Some(answer) = pending.receive().map_err(failed)? {
                break answer;
            }
            ensure!(Instant::now() < until, "no answer to {wire:?}");
            std::thread::yield_now();
        };
        let is_refused = (answer.outcome, answer.refusal, answer.id) == (REFUSED, UNREADABLE, wire.id);
        refused += usize::from(is_refused);
    }
    Ok(refused)
}

/// How many of these questions were answered.
fn send_questions(place: &Place, n: usize, random: &mut Random) -> Result<usize> {
    let node = node()?;
    let archive = node.service_builder(&service(place, "archive")?);
    let archive = archive.request_response::<ArchiveRequestWire, ArchiveResponseWire>().open();
    let port = archive.map_err(failed)?.client_builder().create().map_err(failed)?;
    let mut answered = 0;
    for _ in 0..n {
        let version = if random.below(2) == 0 { VERSION } else { number(random) as u32 };
        let wire = ArchiveRequestWire { version, reserved: number(random) as u32, below: number(random) };
        let pending = port.send_copy(wire).map_err(failed)?;
        let until = Instant::now() + ANSWER;
        while Instant::now() < until {
            if let Some(answer) = pending.receive().map_err(failed)? {
                answered += usize::from(answer.below == wire.below && (1..=3).contains(&answer.outcome));
                break;
            }
            std::thread::yield_now();
        }
    }
    Ok(answered)
}

/// Channels opened with other payloads, and another publisher beside the daemon's: all refused.
fn take_for_others(place: &Place) -> Result<()> {
    let node = node()?;
    let control =
        node.service_builder(&service(place, "control")?).request_response::<u64, [u8; 64]>().open();
    ensure!(control.is_err(), "the control channel was opened with other payloads");
    let topic = node.service_builder(&service(place, "calibration")?).publish_subscribe::<[u64; 9]>().open();
    ensure!(topic.is_err(), "the calibration was opened with another payload");
    let name = service(place, "calibration")?;
    let topic = node.service_builder(&name).publish_subscribe::<pelical::ipc::wire::CalibrationWire>().open();
    let publisher = topic.map_err(failed)?.publisher_builder().create();
    ensure!(publisher.is_err(), "a second publisher was let in");
    Ok(())
}

fn failed(error: impl std::fmt::Debug) -> anyhow::Error {
    anyhow::anyhow!("{error:?}")
}

/// Clients that are killed at random moments of their requests.
pub fn dying(site: &Site, n_clients: usize) -> Result<Seen> {
    let place = prepared(site, false)?;
    let (mut seen, audit) = (Seen::default(), place.audit());
    let mut daemon = place.start()?;
    let mut client = place.client(PATIENCE)?;
    complete_set(&mut client, Instant::now())?;
    let before = daemon.resources()?;
    let mut random = Random::new(site.seed ^ 0xD1E);
    for _ in 0..n_clients {
        kill_one(&place, &mut random)?;
    }
    // All the places are free again: those of the dead were taken back.
    let together: Result<Vec<Client>, _> = (0..FLOODERS).map(|_| place.try_client()).collect();
    let mut together = together.context("clients after the dead")?;
    for other in &mut together {
        other.status(ANSWER)?;
    }
    drop(together);
    client.status(ANSWER)?;
    // The daemon lets go of those that left when it next looks, some milliseconds later.
    let (left, mut after) = (Instant::now(), daemon.resources()?);
    while after.fds > before.fds + 4 && left.elapsed() < LETTING_GO {
        std::thread::sleep(Duration::from_millis(10));
        after = daemon.resources()?;
    }
    seen.recovered(left.elapsed(), LETTING_GO);
    seen.require(after.fds <= before.fds + 4, format!("{} files became {}", before.fds, after.fds));
    seen.say(format!(
        "{n_clients} clients killed, {FLOODERS} new ones connect at once; {} files open before, {} after",
        before.fds, after.fds
    ));
    finish(&mut daemon, &audit, &mut seen)?;
    Ok(seen)
}

/// One client process that asks on and on, killed at a random moment.
pub fn kill_one(place: &Place, random: &mut Random) -> Result<()> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["--ask-for-ever", place.instance.as_str()]);
    if let Transport::Files { directory } = &place.transport {
        command.arg("--ipc-directory").arg(directory);
    }
    let mut child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn()?;
    std::thread::sleep(random.time_ms(2.0, 150.0));
    child.kill()?;
    child.wait()?;
    Ok(())
}

/// The life of a client that will be killed.
pub fn ask_for_ever(instance: &InstanceName, transport: &Transport) -> Result<()> {
    let mut client = Client::connect_over(transport, instance)?;
    loop {
        client.status(ANSWER)?;
        client.archived_below(u64::MAX, ANSWER)?;
    }
}

/// A place with a calibration of an earlier run.
fn prepared(site: &Site, shared_memory: bool) -> Result<Place> {
    let place = site.place(&Wishes { shared_memory, ..Wishes::default() })?;
    site.put_calibration(&place)?;
    Ok(place)
}
