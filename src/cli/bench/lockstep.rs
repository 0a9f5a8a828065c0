//! Cameras that play frames from memory, in step with each other: at a given rate, or as fast as the pipeline takes them.
//!
//! A camera that is never waited for would only measure how fast frames can be thrown away. Here the next set is released when one has
//! gone through the line stage, so the pipeline is always busy and nothing is lost by the feeding.

use std::sync::Arc;
use std::time::Duration;

use crate::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame, StampNs};
use crate::cli::gate::Gate;

/// Between the stamps of two sets, ns: 30 sets per second.
const PERIOD_NS: u64 = 33_333_333;

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
