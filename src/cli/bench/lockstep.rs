//! Cameras that play frames from memory, in step with each other: at a given rate, or as fast as the pipeline takes them.
//!
//! A camera that is never waited for would only measure how fast frames can be thrown away. Here the next set is released when one has
//! gone through the line stage, so the pipeline is always busy and nothing is lost by the feeding.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread;
use std::time::{Duration, Instant};

use crate::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame, StampNs};

/// Between the stamps of two sets, ns: 30 sets per second.
const PERIOD_NS: u64 = 33_333_333;
/// Sets released ahead of the last one done: enough to keep every thread busy, fewer than the pipeline has room for.
const AHEAD: u64 = 3;
/// Between two looks whether a set was released.
const POLL: Duration = Duration::from_micros(200);

/// When frames are due.
#[derive(Debug)]
pub enum Gate {
    /// So long apart, from the first frame anybody asks for.
    Paced(Duration, OnceLock<Instant>),
    /// When released; counts the sets.
    Released(AtomicU64),
}

impl Gate {
    /// A gate for so many sets per second, or for as many as are released.
    pub fn new(rate_hz: Option<f64>) -> Self {
        match rate_hz {
            Some(rate_hz) => Gate::Paced(Duration::from_secs_f64(1.0 / rate_hz), OnceLock::new()),
            None => Gate::Released(AtomicU64::new(AHEAD)),
        }
    }

    /// Says that so many sets are through, or lost.
    pub fn release_after(&self, n_sets: u64) {
        if let Gate::Released(released) = self {
            // Relaxed: the number is all that is handed over.
            released.fetch_max(n_sets + AHEAD, Ordering::Relaxed);
        }
    }

    /// Waits until a set is due, at most `timeout`; whether it is.
    fn wait_for(&self, set: u64, timeout: Duration) -> bool {
        match self {
            Gate::Paced(period, start) => {
                let due = period.mul_f64(set as f64);
                let wait = due.saturating_sub(start.get_or_init(Instant::now).elapsed());
                thread::sleep(wait.min(timeout));
                wait <= timeout
            }
            Gate::Released(released) => {
                let start = Instant::now();
                // Relaxed: as above.
                while released.load(Ordering::Relaxed) <= set {
                    if start.elapsed() > timeout {
                        return false;
                    }
                    thread::sleep(POLL);
                }
                true
            }
        }
    }
}

/// One camera with its frames.
#[derive(Debug, Clone)]
pub struct Lockstep {
    /// The camera.
    pub info: CameraInfo,
    /// Played round and round.
    pub frames: Arc<[RgbdFrame]>,
    /// Shared by all cameras.
    pub gate: Arc<Gate>,
}

impl DeviceFactory for Lockstep {
    fn name(&self) -> &'static str {
        "lockstep"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        Ok(vec![self.info.clone()])
    }

    fn open(&self, _serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        Ok(Box::new(LockstepSource { camera: self.clone(), next: 0 }))
    }
}

struct LockstepSource {
    camera: Lockstep,
    next: u64,
}

impl FrameSource for LockstepSource {
    fn info(&self) -> &CameraInfo {
        &self.camera.info
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        (frame.width, frame.height) = (0, 0);
        let Lockstep { frames, gate, .. } = &self.camera;
        let from = frames.get((self.next % frames.len().max(1) as u64) as usize);
        let from = from.ok_or(CaptureError::EndOfStream)?;
        if !gate.wait_for(self.next, timeout) {
            return Err(CaptureError::Timeout(timeout));
        }
        frame.rgb.clone_from(&from.rgb);
        frame.depth.clone_from(&from.depth);
        (frame.width, frame.height, frame.depth_unit_m) = (from.width, from.height, from.depth_unit_m);
        (frame.depth_camera, frame.turn_rate) = (from.depth_camera, from.turn_rate);
        let stamp_ns = i64::try_from(self.next.saturating_mul(PERIOD_NS)).unwrap_or(i64::MAX);
        (frame.stamp, frame.sequence) = (StampNs(stamp_ns), self.next);
        self.next += 1;
        Ok(())
    }
}
