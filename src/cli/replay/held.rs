//! Cameras of a recording that end with the first frame that cannot be read, and that can hold each frame back until the pipeline is
//! through with those before.

use std::sync::Arc;
use std::time::Duration;

use crossbeam_channel::Sender;

use crate::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource, RgbdFrame};
use crate::cli::gate::Gate;

/// A recording whose frames may wait for a gate, and none of which is lost.
pub struct Held {
    /// The recording; with a gate its frames come as soon as they are asked for.
    pub backend: Arc<dyn DeviceFactory>,
    /// Shared by all cameras.
    pub gate: Option<Arc<Gate>>,
    /// Where the first frame goes that cannot be read.
    pub faults: Sender<CaptureError>,
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
        Ok(Box::new(HeldSource { source, gate: self.gate.clone(), faults: self.faults.clone(), next: 0 }))
    }
}

struct HeldSource {
    source: Box<dyn FrameSource>,
    gate: Option<Arc<Gate>>,
    faults: Sender<CaptureError>,
    next: u64,
}

impl FrameSource for HeldSource {
    fn info(&self) -> &CameraInfo {
        self.source.info()
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        if self.gate.as_ref().is_some_and(|gate| !gate.wait_for(self.next, timeout)) {
            (frame.width, frame.height) = (0, 0);
            return Err(CaptureError::Timeout(timeout));
        }
        match self.source.next_frame(frame, timeout) {
            // A device would go on with the next frame; of a recording all are wanted.
            Err(fault @ (CaptureError::BadData { .. } | CaptureError::Io { .. })) => {
                // One is enough.
                let _ = self.faults.try_send(fault);
                Err(CaptureError::EndOfStream)
            }
            answer => {
                self.next += u64::from(answer.is_ok());
                answer
            }
        }
    }
}
