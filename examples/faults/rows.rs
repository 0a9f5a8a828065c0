//! The rows of the table, in their order.

use std::time::{Duration, Instant};

use anyhow::Result;

use crate::Arguments;
use crate::cameras::{self, Absence};
use crate::site::{SERIALS, Site};
use crate::table::{Row, Seen, time};
use crate::{clients, clock, disk, driver, kills, memory, soak};

/// Name, expectation, attempt.
type Planned<'a> = (&'static str, &'static str, Box<dyn Fn() -> Result<Seen> + 'a>);

/// Runs every row that is asked for; what goes wrong fails the row, not the campaign.
pub fn run(site: &Site, arguments: &Arguments) -> Vec<Row> {
    let only = &arguments.only;
    let wanted = |name: &str| only.is_empty() || only.iter().any(|part| name.contains(part.as_str()));
    let mut rows = Vec::new();
    let all = [frame_rows(site), absence_rows(site), place_rows(site), process_rows(site, arguments)];
    for (fault, expected, attempt) in all.into_iter().flatten().filter(|(name, ..)| wanted(name)) {
        let began = Instant::now();
        eprintln!("{fault} ...");
        let seen = attempt()
            .unwrap_or_else(|error| Seen { failures: vec![format!("{error:#}")], ..Seen::default() });
        let row = Row { fault: fault.to_owned(), expected: expected.to_owned(), seen };
        eprintln!("  {} after {}: {}", row.verdict(), time(began.elapsed()), row.told());
        rows.push(row);
    }
    rows
}

fn every_camera(fault: &str) -> Vec<String> {
    SERIALS.iter().map(|serial| format!("serial: {serial}, {fault}")).collect()
}

/// The clock of one camera goes wrong at a frame and right again at a later one.
fn jump(camera: usize, by_ms: &[(u32, f64)]) -> Vec<String> {
    let at = |(frame, by_ms): &(u32, f64)| {
        format!("serial: {}, fault: stamp_jump, at_frame: {frame}, by_ms: {by_ms:.1}", SERIALS[camera])
    };
    by_ms.iter().map(at).collect()
}

fn away(fault: &'static str) -> Vec<Absence> {
    (0..SERIALS.len()).map(|camera| Absence { fault, camera, for_s: 4.0 }).collect()
}

fn frame_rows(site: &Site) -> Vec<Planned<'_>> {
    let hour_ms = 3_600_000.0;
    vec![
        ("no fault, for comparison", "converges", Box::new(|| cameras::converges(site, Vec::new()))),
        (
            "frame drops: each frame of each camera lost with a chance of 20 %",
            "incomplete sets are used as they are; converges",
            Box::new(|| cameras::converges(site, every_camera("fault: drop, chance: 0.2"))),
        ),
        (
            "late stamps: one camera's stamps 60 ms late for 20 frames",
            "no set is made of frames of different moments; complete sets again at once",
            Box::new(move || cameras::converges(site, jump(1, &[(5, 60.0), (25, -60.0)]))),
        ),
        (
            "jumping stamps: one camera's clock 1 h ahead, 2 h back, right again",
            "its frames stand alone meanwhile; complete sets again once it is right",
            Box::new(move || {
                cameras::converges(site, jump(2, &[(5, hour_ms), (15, -2.0 * hour_ms), (25, hour_ms)]))
            }),
        ),
        (
            "clock wrap: the 32-bit microsecond clock of each camera starts again, at different frames",
            "complete sets again once all have wrapped",
            Box::new(|| {
                let at = |(serial, frame): (&&str, u32)| {
                    format!("serial: {serial}, fault: clock_wrap, at_frame: {frame}")
                };
                cameras::converges(site, SERIALS.iter().zip([8, 12, 17]).map(at).collect())
            }),
        ),
        (
            "zero depth: no depth reading in 30 % of the frames",
            "converges from the others",
            Box::new(|| cameras::converges(site, every_camera("fault: zero_depth, chance: 0.3"))),
        ),
        (
            "zero depth for good, all cameras",
            "no result, with a reason; the daemon goes on",
            Box::new(|| {
                let faults = every_camera("fault: zero_depth, chance: 1.0");
                cameras::never_converges(site, faults, Duration::from_secs(10))
            }),
        ),
        (
            "half the image black in 30 % of the frames",
            "converges",
            Box::new(|| cameras::converges(site, every_camera("fault: half_black, chance: 0.3"))),
        ),
    ]
}

fn absence_rows(site: &Site) -> Vec<Planned<'_>> {
    vec![
        (
            "stall: no frame of one camera for 4 s, each camera in turn",
            "noticed within 2 s, back within 3 s; the others go on, none of their sets is dropped",
            Box::new(|| cameras::absences(site, &away("stall"))),
        ),
        (
            "unplug and replug after 4 s, each camera in turn",
            "noticed within 2 s, back within 3 s of its return; the others go on, none of their sets is dropped",
            Box::new(|| cameras::absences(site, &away("unplug"))),
        ),
        (
            "no camera at the start, all plugged in after 4 s",
            "answers and waits; back within 3 s of their return",
            Box::new(|| cameras::none_at_start(site)),
        ),
        (
            "hang: a device call of one camera does not return for 4 s, each camera in turn",
            "noticed within 2 s, back within 3 s; the others go on, none of their sets is dropped",
            Box::new(|| cameras::absences(site, &away("hang"))),
        ),
        (
            "wedge: a camera gives no frames, however often it is opened, until it is reset, each camera in turn",
            "noticed within 2 s, reset after two openings in vain, back within 3 s of the reset; the others go on, none of their sets is dropped",
            Box::new(|| driver::reset_helps(site)),
        ),
        (
            "hang for good: a device call of one camera never returns (leave_after_s: 2)",
            "leaves within 5 s with code 74; started again, it serves the kept calibration within 5 s, history whole",
            Box::new(|| driver::another_process_helps(site)),
        ),
        (
            "hang in stop: a device call never returns, then SIGTERM",
            "ends within 2 s with code 0",
            Box::new(|| cameras::hang_in_stop(site)),
        ),
    ]
}

fn place_rows(site: &Site) -> Vec<Planned<'_>> {
    vec![
        (
            "full state directory (a tmpfs of 1 MiB, filled)",
            "published as always, the status says what is not kept; kept within 15 s once there is room; a start meanwhile serves the newest kept",
            Box::new(|| disk::refuses(site, &disk::Refusal::Full)),
        ),
        (
            "read-only state directory (remounted)",
            "the same",
            Box::new(|| disk::refuses(site, &disk::Refusal::ReadOnly)),
        ),
        (
            "full /dev/shm at the start (private, 64 MiB, 16 MiB left)",
            "refuses to start with words; serves the kept calibration at the next start with room",
            Box::new(|| memory::full_at_start(site)),
        ),
        (
            "full /dev/shm while it runs (to the last byte)",
            "goes on: all it ever needs was taken at its start; new clients are refused with words, and served once there is room",
            Box::new(|| memory::full_while_running(site)),
        ),
        (
            "system clock jumps: 1 h ahead, 2 h back, near 1970, 60 years ahead (the daemon's wall clock, through a preloaded library)",
            "frames, latency and order of the history do not know; a start in the past serves the newest by number",
            Box::new(|| clock::wall_clock_jumps(site)),
        ),
    ]
}

fn process_rows<'a>(site: &'a Site, arguments: &'a Arguments) -> Vec<Planned<'a>> {
    let kills = arguments.kills;
    let mut rows: Vec<Planned<'a>> = vec![
        (
            "client flood: 12 clients ask as fast as they can",
            "at least 1,000 requests/s are answered, no set is dropped",
            Box::new(|| clients::flood(site)),
        ),
        (
            "malformed requests over the real channels",
            "each is refused as unreadable; other payload types and a second publisher are not let in",
            Box::new(move || clients::malformed(site, if kills < 100 { 500 } else { 5_000 })),
        ),
        (
            "clients dying mid-request (SIGKILL)",
            "their places are free again, no file stays open",
            Box::new(move || clients::dying(site, if kills < 100 { 10 } else { 60 })),
        ),
        (
            "kill -9 at random moments, clients over files",
            "history readable, the newest calibration on the disk served as stored, nothing older lost, no leftover blocks the start",
            Box::new(move || kills::kills(site, (kills.div_ceil(2), false))),
        ),
        (
            "kill -9 at random moments, clients over shared memory",
            "the same",
            Box::new(move || kills::kills(site, (kills / 2, true))),
        ),
        (
            "no fault: start of the service to the stored calibration at a client",
            "under 300 ms",
            Box::new(move || kills::start_times(site, if kills < 100 { 5 } else { 20 })),
        ),
    ];
    if arguments.minutes > 0.0 {
        let minutes = arguments.minutes;
        rows.push((
            "soak: all of drop, zero depth, half black, stall, unplug, hang at random on every camera, clients at random",
            "resident memory and open files flat",
            Box::new(move || soak::soak(site, minutes)),
        ));
    }
    rows
}
