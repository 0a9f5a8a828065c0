//! The running streams of one camera or recording: started together, read one by one, stopped together.
//!
//! A recording that is not played in real time waits wherever a queue is full, in the call that stops it too: its frames are thrown
//! away meanwhile.

use std::ffi::c_int;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use realsense_rust::device::Device;
use realsense_rust::kind::Rs2StreamKind;

use super::device::SensorPlan;
use super::raw::{self, AnyFrame, RunningSensor};

/// Images that a queue holds while nobody takes them; of a camera the SDK drops the oldest.
const VIDEO_QUEUE: c_int = 4;
/// Samples of gyroscope and accelerometer likewise: 1 s.
const MOTION_QUEUE: c_int = 512;

/// Streams that a camera can do without.
const MOTION: [Rs2StreamKind; 2] = [Rs2StreamKind::Gyro, Rs2StreamKind::Accel];

/// Running sensors with what they stream.
pub(super) struct Streams {
    running: Vec<RunningSensor>,
    kinds: Vec<Vec<Rs2StreamKind>>,
    is_recorded: bool,
}

impl Drop for Streams {
    fn drop(&mut self) {
        let running = &self.running;
        let stop = || running.iter().for_each(RunningSensor::stop);
        if self.is_recorded { throwing_away(running, stop) } else { stop() }
    }
}

impl Streams {
    /// Starts all sensors of a camera. Gyroscope and accelerometer may fail: the camera goes on without.
    pub(super) fn of_camera(plans: Vec<SensorPlan>) -> Result<Self, String> {
        Self { running: Vec::new(), kinds: Vec::new(), is_recorded: false }.started(plans)
    }

    /// Starts all streams of a recording, at its first frame.
    pub(super) fn of_recording(plans: Vec<SensorPlan>, recording: &Device) -> Result<Self, String> {
        // Else it would begin with the first stream that is started, and the others would miss what comes meanwhile.
        raw::set_paused(recording, true)?;
        let streams = Self { running: Vec::new(), kinds: Vec::new(), is_recorded: true }.started(plans)?;
        raw::set_paused(recording, false)?;
        Ok(streams)
    }

    fn started(mut self, plans: Vec<SensorPlan>) -> Result<Self, String> {
        for plan in plans {
            if plan.kinds.iter().all(|kind| MOTION.contains(kind)) {
                self.start_motion(plan);
                continue;
            }
            let SensorPlan { sensor, profiles, chosen, kinds } = plan;
            let running = RunningSensor::start(sensor, (&profiles, &chosen), VIDEO_QUEUE);
            self.running.push(running.map_err(|(_, what)| what)?);
            self.kinds.push(kinds);
        }
        Ok(self)
    }

    /// Starts gyroscope and accelerometer; where they do not start together, the gyroscope alone, which decides something.
    fn start_motion(&mut self, plan: SensorPlan) {
        let SensorPlan { mut sensor, profiles, chosen, kinds } = plan;
        let streams = || chosen.iter().copied().zip(kinds.iter().copied());
        let is_gyro = |&(_, kind): &(c_int, Rs2StreamKind)| kind == Rs2StreamKind::Gyro;
        let attempts: [Vec<_>; 2] = [streams().collect(), streams().filter(is_gyro).collect()];
        // A sensor with one stream has no second attempt.
        let n_attempts = if attempts[0].len() > 1 { 2 } else { 1 };
        for streams in attempts.into_iter().take(n_attempts).filter(|streams| !streams.is_empty()) {
            let (chosen, kinds): (Vec<c_int>, Vec<Rs2StreamKind>) = streams.into_iter().unzip();
            match RunningSensor::start(sensor, (&profiles, &chosen), MOTION_QUEUE) {
                Ok(running) => {
                    self.running.push(running);
                    self.kinds.push(kinds);
                    return;
                }
                Err((back, what)) => {
                    sensor = back;
                    tracing::warn!(streams = ?kinds, "motion sensor does not start, the camera goes on without: {what}");
                }
            }
        }
    }

    /// Where a stream comes from; `None` where it does not run.
    pub(super) fn position(&self, kind: Rs2StreamKind) -> Option<usize> {
        self.kinds.iter().position(|kinds| kinds.contains(&kind))
    }

    /// How many sensors run.
    pub(super) fn len(&self) -> usize {
        self.running.len()
    }

    /// The next frame of a sensor, waited for; `None` where none comes in time.
    pub(super) fn next_frame(&self, sensor: usize, timeout: Duration) -> Option<AnyFrame> {
        self.running.get(sensor)?.next_frame(timeout)
    }
}

/// Calls `call` while another thread sees to it that no queue is full.
fn throwing_away<T>(running: &[RunningSensor], call: impl FnOnce() -> T) -> T {
    // Relaxed: nothing is handed over.
    let is_done = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            while !is_done.load(Ordering::Relaxed) {
                running.iter().for_each(empty);
                thread::sleep(Duration::from_millis(1));
            }
        });
        let answer = call();
        is_done.store(true, Ordering::Relaxed);
        answer
    })
}

fn empty(running: &RunningSensor) {
    while running.next_frame(Duration::ZERO).is_some() {}
}
