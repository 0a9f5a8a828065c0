//! The cameras of the daemon and what is done with their frames, as the config says: a pipeline, and the next one after a bug.

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use crossbeam_channel::Sender;

use super::config::{CameraChoice, CamerasConfig, Config, RigError};
use super::error::ServiceError;
use crate::capture::DeviceFactory;
use crate::ipc::CameraIdentity;
use crate::pipeline::{CameraSlot, Parts, Pipeline, PipelineEvent, PipelineOptions, Snapshot};

/// How often cameras that the config does not name are looked for.
const LOOK_AGAIN: Duration = Duration::from_secs(1);
/// Turns between two looks: who watches this thread need not wait for a whole pause.
const TURNS_BETWEEN: u32 = 5;

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
    /// Opens the back end. Cameras that the config does not name are waited for until there are enough of them: a robot may start
    /// before its bus does. `turn` is called again and again meanwhile, with what is missing in words.
    ///
    /// # Errors
    /// When the back end does not have the cameras, and waiting would not help.
    pub fn awaited(config: &Config, turn: &mut dyn FnMut(Option<String>)) -> Result<Self, ServiceError> {
        turn(None);
        let factory: Arc<dyn DeviceFactory> = Arc::from(config.cameras.factory().map_err(RigError::from)?);
        let may_come = config.cameras.is_live() && config.cameras.list.is_empty();
        let rig = || rig_of(&config.cameras, factory.as_ref());
        let cameras = if may_come { awaited(rig, LOOK_AGAIN, turn)? } else { rig()? };
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

/// The cameras of the rig as they are now.
fn rig_of(config: &CamerasConfig, factory: &dyn DeviceFactory) -> Result<Vec<CameraChoice>, RigError> {
    let cameras = config.rig(factory)?;
    match cameras.as_slice() {
        [only] => Err(RigError::OneCamera { name: only.name.clone() }),
        _ => Ok(cameras),
    }
}

/// Looks for cameras until there are two, and the reference is among them.
fn awaited(
    look: impl Fn() -> Result<Vec<CameraChoice>, RigError>,
    look_again: Duration,
    turn: &mut dyn FnMut(Option<String>),
) -> Result<Vec<CameraChoice>, RigError> {
    let mut told = None;
    loop {
        let missing = match look() {
            Err(
                error @ (RigError::NoCamera { .. } | RigError::OneCamera { .. } | RigError::Reference { .. }),
            ) => error.to_string(),
            answer => return answer,
        };
        if told.as_ref() != Some(&missing) {
            tracing::warn!("cameras are waited for: {missing}");
            told = Some(missing.clone());
        }
        for _ in 0..TURNS_BETWEEN {
            turn(Some(missing.clone()));
            thread::sleep(look_again / TURNS_BETWEEN);
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    type Look = Result<Vec<CameraChoice>, RigError>;

    fn cameras(names: &[&str]) -> Vec<CameraChoice> {
        names.iter().map(|name| CameraChoice { name: (*name).into(), serial: (*name).into() }).collect()
    }

    /// What comes of these looks, one after the other, and what was said to be missing.
    fn await_through(looks: Vec<Look>) -> (Look, Vec<String>) {
        let (looks, mut said) = (RefCell::new(looks.into_iter()), Vec::new());
        let look = || looks.borrow_mut().next().expect("no further look");
        let found = awaited(look, Duration::ZERO, &mut |missing| said.extend(missing));
        said.dedup();
        (found, said)
    }

    #[test]
    fn no_camera_one_camera_and_a_reference_that_comes_last_are_waited_for() {
        let (found, said) = await_through(vec![
            Err(RigError::NoCamera { backend: "realsense" }),
            Err(RigError::OneCamera { name: "left".into() }),
            Err(RigError::Reference { reference: "front".into(), names: "left, right".into() }),
            Ok(cameras(&["front", "left", "right"])),
        ]);
        assert_eq!(found.expect("they are there").len(), 3);
        let [none, one, reference] = said.as_slice() else { panic!("{said:?}") };
        assert!(
            none.contains("no camera") && one.contains("left") && reference.contains("front"),
            "{said:?}"
        );
    }

    #[test]
    fn what_waiting_does_not_help_is_an_error_at_once() {
        let (found, said) = await_through(vec![Err(RigError::TooLong { text: "a".into() })]);
        assert!(matches!(found, Err(RigError::TooLong { .. })) && said.is_empty(), "{said:?}");
    }
}
