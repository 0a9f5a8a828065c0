//! Cameras of a recording that hold each frame back until the pipeline is through with those before.

use std::sync::Arc;
use std::time::Duration;

use crate::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame};
use crate::cli::gate::Gate;

/// A back end whose frames wait for a gate.
pub struct Held {
    /// The recording; its frames come as soon as they are asked for.
    pub backend: Arc<dyn DeviceFactory>,
    /// Shared by all cameras.
    pub gate: Arc<Gate>,
}

impl DeviceFactory for Held {
    fn name(&self) -> &'static str {
        self.backend.name()
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        self.backend.list()
    }

    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        let source = self.backend.open(serial)?;
        Ok(Box::new(HeldSource { source, gate: Arc::clone(&self.gate), next: 0 }))
    }
}

struct HeldSource {
    source: Box<dyn FrameSource>,
    gate: Arc<Gate>,
    next: u64,
}

impl FrameSource for HeldSource {
    fn info(&self) -> &CameraInfo {
        self.source.info()
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        if !self.gate.wait_for(self.next, timeout) {
            (frame.width, frame.height) = (0, 0);
            return Err(CaptureError::Timeout(timeout));
        }
        // A frame that cannot be read is passed over by the source as well.
        self.next += 1;
        self.source.next_frame(frame, timeout)
    }
}
