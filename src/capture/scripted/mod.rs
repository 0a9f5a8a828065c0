//! Any back end plus a script of faults: what cameras do on a bad day, the same way each time.
//!
//! Decides how a fault shows at the interface of a camera. Frames are counted per camera over all openings, so a camera that
//! was unplugged once does not unplug at the same frame for ever.

mod script;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use super::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame, StampNs};

pub use script::{Fault, FaultScript, Replug};

/// ns; a 32-bit counter of microseconds, as in the D435i, starts again after 71.6 minutes.
const CLOCK_WRAP_NS: i64 = (1 << 32) * 1000;

/// Another factory's cameras, some of them with a script.
pub struct ScriptedFactory {
    inner: Box<dyn DeviceFactory>,
    devices: BTreeMap<String, Arc<Device>>,
}

/// What is remembered of a camera from one opening to the next.
#[derive(Debug, Default)]
struct Device {
    script: FaultScript,
    /// Frames that the camera took so far, lost ones too.
    taken: AtomicU64,
    /// Set while the camera gives no frames for want of a reset. Relaxed: it hands nothing over.
    is_wedged: AtomicBool,
    /// Set while the camera is away; locked when a camera comes or goes, never per frame.
    away: Mutex<Option<Away>>,
}

#[derive(Debug)]
struct Away {
    since: Instant,
    attempts: u32,
    replug: Replug,
}

impl ScriptedFactory {
    /// Wraps a factory; without a script its cameras pass through as they are.
    pub fn new(inner: Box<dyn DeviceFactory>) -> Self {
        Self { inner, devices: BTreeMap::new() }
    }

    /// Gives a script to the camera with this serial.
    #[must_use]
    pub fn with_script(mut self, serial: &str, script: FaultScript) -> Self {
        self.devices.insert(serial.to_owned(), Arc::new(Device { script, ..Device::default() }));
        self
    }
}

impl DeviceFactory for ScriptedFactory {
    fn name(&self) -> &'static str {
        "scripted"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        let mut cameras = self.inner.list()?;
        cameras.retain(|info| self.devices.get(&info.serial).is_none_or(|device| device.is_there()));
        Ok(cameras)
    }

    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        let device = self.devices.get(serial).cloned().unwrap_or_default();
        if !device.try_open() {
            let mut there = self.list()?;
            there.retain(|info| info.serial != serial);
            return Err(CaptureError::not_found(serial, &there));
        }
        let inner = self.inner.open(serial)?;
        Ok(Box::new(ScriptedSource {
            inner,
            device,
            entered: None,
            is_unplugged: false,
            stalls_left: 0,
            clock_gap_ns: 0,
        }))
    }

    fn reset(&self, serial: &str) -> Result<bool, CaptureError> {
        match self.devices.get(serial) {
            Some(device) if !device.is_there() => Err(CaptureError::not_found(serial, &self.list()?)),
            Some(device) => {
                device.is_wedged.store(false, Ordering::Relaxed);
                Ok(true)
            }
            None => self.inner.reset(serial),
        }
    }
}

impl Device {
    fn away(&self) -> MutexGuard<'_, Option<Away>> {
        self.away.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_there(&self) -> bool {
        self.away().as_ref().is_none_or(Away::is_over)
    }

    /// Whether the camera is (again) there to be opened; counts the attempt.
    fn try_open(&self) -> bool {
        let mut away = self.away();
        let Some(absence) = away.as_mut() else { return true };
        if absence.is_over() {
            *away = None;
            return true;
        }
        absence.attempts = absence.attempts.saturating_add(1);
        false
    }
}

impl Away {
    fn is_over(&self) -> bool {
        match self.replug {
            Replug::AfterAttempts(attempts) => self.attempts >= attempts,
            Replug::AfterTime(time) => self.since.elapsed() >= time,
            Replug::Never => false,
        }
    }
}

/// An open camera with a script.
struct ScriptedSource {
    inner: Box<dyn FrameSource>,
    device: Arc<Device>,
    /// The frame whose stall or unplugging has already been played.
    entered: Option<u64>,
    /// For good: who plugs the camera in again opens it again.
    is_unplugged: bool,
    stalls_left: u32,
    /// What the camera's clock is off by.
    clock_gap_ns: i64,
}

impl FrameSource for ScriptedSource {
    fn info(&self) -> &CameraInfo {
        self.inner.info()
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        let asked = Instant::now();
        loop {
            let left = timeout.saturating_sub(asked.elapsed());
            // Relaxed: the thread that owns the source is the only one that counts; a later owner got the source by a
            // channel or a join, which orders everything before it.
            let number = self.device.taken.load(Ordering::Relaxed);
            (frame.width, frame.height) = (0, 0);
            self.enter(number)?;
            if self.stalls_left > 0 || self.device.is_wedged.load(Ordering::Relaxed) {
                self.stalls_left = self.stalls_left.saturating_sub(1);
                thread::sleep(left);
                return Err(CaptureError::Timeout(timeout));
            }
            match self.inner.next_frame(frame, left) {
                Err(CaptureError::Timeout(_)) => return Err(CaptureError::Timeout(timeout)),
                other => other?,
            }
            // Relaxed: as above.
            self.device.taken.store(number + 1, Ordering::Relaxed);
            if self.spoil(number, frame) {
                return Ok(());
            }
            if asked.elapsed() >= timeout {
                return Err(CaptureError::Timeout(timeout));
            }
        }
    }
}

impl ScriptedSource {
    /// Plays, once, what happens before a frame comes.
    fn enter(&mut self, number: u64) -> Result<(), CaptureError> {
        let info = self.inner.info();
        if self.is_unplugged {
            return Err(CaptureError::Unplugged(info.serial.clone()));
        }
        if self.entered == Some(number) {
            return Ok(());
        }
        self.entered = Some(number);
        for fault in self.device.script.faults(&info.serial, number) {
            tell(&info.serial, number, fault);
            match fault {
                Fault::Stall { timeouts } => self.stalls_left = self.stalls_left.saturating_add(timeouts),
                Fault::Hang { duration } => thread::sleep(duration),
                Fault::Wedge => {
                    self.device.is_wedged.store(true, Ordering::Relaxed);
                    // The frame is lost; else it would wedge the camera again after each opening.
                    self.device.taken.store(number + 1, Ordering::Relaxed);
                }
                Fault::StampJump { by_ns } => self.clock_gap_ns = self.clock_gap_ns.saturating_add(by_ns),
                Fault::ClockWrap => self.clock_gap_ns = self.clock_gap_ns.saturating_sub(CLOCK_WRAP_NS),
                Fault::Unplug(replug) => {
                    self.is_unplugged = true;
                    *self.device.away() = Some(Away { since: Instant::now(), attempts: 0, replug });
                    // Relaxed: as in `next_frame`. The frame is lost with the camera.
                    self.device.taken.store(number + 1, Ordering::Relaxed);
                    return Err(CaptureError::Unplugged(info.serial.clone()));
                }
                Fault::Drop | Fault::ZeroDepth | Fault::HalfBlack => {}
            }
        }
        Ok(())
    }

    /// Plays what happens to the frame itself; `false` when it is lost.
    fn spoil(&self, number: u64, frame: &mut RgbdFrame) -> bool {
        frame.stamp = StampNs(frame.stamp.0.saturating_add(self.clock_gap_ns));
        let mut is_there = true;
        for fault in self.device.script.faults(&self.inner.info().serial, number) {
            match fault {
                Fault::Drop => is_there = false,
                Fault::ZeroDepth => frame.depth.fill(0),
                Fault::HalfBlack => {
                    let half = 3 * frame.width * (frame.height / 2);
                    frame.rgb.iter_mut().skip(half).for_each(|value| *value = 0);
                }
                Fault::Stall { .. } | Fault::Hang { .. } | Fault::Wedge | Fault::StampJump { .. } => {}
                Fault::ClockWrap | Fault::Unplug(_) => {}
            }
        }
        is_there
    }
}

/// Says that a fault is on purpose, and when it began. One that spoils a single frame is not worth a line.
fn tell(serial: &str, number: u64, fault: Fault) {
    match fault {
        Fault::Drop | Fault::ZeroDepth | Fault::HalfBlack => {}
        _ => tracing::info!(serial, frame = number, ?fault, "a fault is played, as the config asks"),
    }
}
