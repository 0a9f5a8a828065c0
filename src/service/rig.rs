//! The cameras of the daemon and what is done with their frames, as the config says: a pipeline, and the next one after a bug.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use crossbeam_channel::Sender;

use super::config::{CameraChoice, Config, RigError};
use super::error::ServiceError;
use crate::capture::DeviceFactory;
use crate::ipc::CameraIdentity;
use crate::pipeline::{CameraSlot, Parts, Pipeline, PipelineEvent, PipelineOptions, Snapshot};

/// How often cameras that the config does not name are looked for.
const LOOK_AGAIN: Duration = Duration::from_secs(1);

/// What the pipeline is started with, and started again after a bug.
pub struct Rig {
    /// The cameras as the pipeline opens them.
    pub slots: Vec<CameraSlot>,
    /// The same cameras as clients know them.
    pub identities: Vec<CameraIdentity>,
    /// Everything between frames and results.
    pub options: PipelineOptions,
    /// Lines and estimate; other ones in tests.
    pub make_parts: fn(&PipelineOptions) -> Parts,
}

impl Rig {
    /// As [`Rig::new`], but cameras that the config does not name are waited for until two are there: a robot may start before its
    /// bus does.
    ///
    /// # Errors
    /// As [`Rig::new`].
    pub fn awaited(config: &Config) -> Result<Self, ServiceError> {
        let mut was_told = false;
        loop {
            let rig = Self::new(config);
            match &rig {
                Err(ServiceError::Rig(error @ (RigError::NoCamera { .. } | RigError::OneCamera { .. })))
                    if config.cameras.is_live() =>
                {
                    if !was_told {
                        tracing::warn!("cameras are waited for: {error}");
                        was_told = true;
                    }
                    thread::sleep(LOOK_AGAIN);
                }
                _ => return rig,
            }
        }
    }

    /// Opens the back end.
    ///
    /// # Errors
    /// When it does not have the cameras.
    pub fn new(config: &Config) -> Result<Self, ServiceError> {
        let factory: Arc<dyn DeviceFactory> = Arc::from(config.cameras.factory().map_err(RigError::from)?);
        let cameras = config.cameras.rig(factory.as_ref())?;
        if let [only] = cameras.as_slice() {
            return Err(RigError::OneCamera { name: only.name.clone() }.into());
        }
        let slot = |camera: &CameraChoice| CameraSlot {
            factory: Arc::clone(&factory),
            serial: camera.serial.clone(),
            name: camera.name.clone(),
        };
        Ok(Self {
            slots: cameras.iter().map(slot).collect(),
            identities: identities(&cameras),
            options: config.pipeline.clone(),
            make_parts: Parts::new,
        })
    }

    /// Starts a pipeline that tells what happens over `events`.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn start(&self, events: Sender<PipelineEvent>) -> Result<Pipeline, ServiceError> {
        let parts = (self.make_parts)(&self.options);
        Ok(Pipeline::start_with(parts, self.slots.clone(), &self.options, events)?)
    }
}

/// The cameras of a config as clients know them.
pub fn identities(cameras: &[CameraChoice]) -> Vec<CameraIdentity> {
    let identity = |camera: &CameraChoice| CameraIdentity {
        name: camera.name.clone(),
        serial: camera.serial.clone(),
        // Known when the camera is opened.
        firmware: None,
    };
    cameras.iter().map(identity).collect()
}

/// The cameras with the firmware that each told when it was opened last.
pub fn with_firmware(identities: &[CameraIdentity], snapshot: &Snapshot) -> Vec<CameraIdentity> {
    let firmware = |index: usize| snapshot.cameras.get(index).and_then(|camera| camera.firmware.clone());
    let identity = |(index, identity): (usize, &CameraIdentity)| CameraIdentity {
        firmware: firmware(index),
        ..identity.clone()
    };
    identities.iter().enumerate().map(identity).collect()
}
