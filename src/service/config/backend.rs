//! From the checked section `cameras` to a back end and the cameras of the rig.

use super::check::{BackendConfig, CameraChoice, CamerasConfig};
use crate::capture::realsense;
use crate::capture::recording::Recording;
use crate::capture::replay::ReplayFactory;
use crate::capture::scripted::ScriptedFactory;
use crate::capture::synthetic::{SyntheticCamera, SyntheticFactory};
use crate::capture::{CameraInfo, CaptureError, DeviceFactory};
use crate::geometry::motion::Motion;
use crate::ipc::MAX_NAME_BYTES;

/// Why the cameras of the config cannot form a rig with this back end.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The back end cannot be reached.
    #[error(transparent)]
    Capture(#[from] CaptureError),
    /// The back end has no camera at all.
    #[error("the back end `{backend}` has no camera: plug one in, or name the expected ones in cameras.list")]
    NoCamera {
        /// Name of the back end.
        backend: &'static str,
    },
    /// One camera is no rig.
    #[error(
        "the rig has one camera, \"{name}\", and nothing to calibrate it against: at least two are needed; list them in \
         cameras.list"
    )]
    OneCamera {
        /// Its name.
        name: String,
    },
    /// A name or serial number of the back end has no room in shared memory.
    #[error(
        "\"{text}\" is longer than {MAX_NAME_BYTES} bytes: list the cameras under shorter names in cameras.list"
    )]
    TooLong {
        /// The name or serial number.
        text: String,
    },
    /// The reference is not a camera of the rig.
    #[error("cameras.reference: \"{reference}\" is not a camera of the rig; allowed are {names}")]
    Reference {
        /// Asked for.
        reference: String,
        /// The names that are there, joined.
        names: String,
    },
}

impl CamerasConfig {
    /// The back end that was chosen.
    ///
    /// # Errors
    /// When it cannot be reached, as a recording that is not there.
    pub fn factory(&self) -> Result<Box<dyn DeviceFactory>, CaptureError> {
        let backend: Box<dyn DeviceFactory> = match &self.backend {
            BackendConfig::Replay(recording, options) => {
                Box::new(ReplayFactory::new(Recording::open_all(&recording.0)?, *options)?)
            }
            BackendConfig::Synthetic(options) => Box::new(SyntheticFactory::new(options.clone())),
            BackendConfig::Realsense(options) => realsense::factory(options)?,
        };
        if self.faults.is_empty() {
            return Ok(backend);
        }
        let scripted = self.faults.iter().fold(ScriptedFactory::new(backend), |factory, (serial, script)| {
            factory.with_script(serial, script.clone())
        });
        Ok(Box::new(scripted))
    }

    /// The cameras of the rig, the reference first. Listed cameras need not be there yet.
    ///
    /// # Errors
    /// When there is none, or the reference is not among them.
    pub fn rig(&self, factory: &dyn DeviceFactory) -> Result<Vec<CameraChoice>, RigError> {
        if let Some(listed) = self.listed() {
            return listed;
        }
        let choice = |info: CameraInfo| CameraChoice { name: info.name, serial: info.serial };
        let rig: Vec<CameraChoice> = factory.list()?.into_iter().map(choice).collect();
        if rig.is_empty() {
            return Err(RigError::NoCamera { backend: factory.name() });
        }
        self.reference_first(rig)
    }

    /// The rig where the config alone tells its cameras, so that the back end need not be asked; `None` where it does not.
    pub fn listed(&self) -> Option<Result<Vec<CameraChoice>, RigError>> {
        let cameras = match &self.backend {
            _ if !self.list.is_empty() => self.list.clone(),
            // Planning its path takes seconds, which the names of its cameras do not need.
            BackendConfig::Synthetic(options) => {
                let choice = |camera: &SyntheticCamera| CameraChoice {
                    name: camera.info.name.clone(),
                    serial: camera.info.serial.clone(),
                };
                options.cameras.iter().map(choice).collect()
            }
            BackendConfig::Replay(..) | BackendConfig::Realsense(_) => return None,
        };
        Some(self.reference_first(cameras))
    }

    /// Whether cameras may come that are not there yet, so that a rig without them is worth waiting for.
    pub fn is_live(&self) -> bool {
        matches!(&self.backend, BackendConfig::Realsense(options) if options.playback.is_empty())
    }

    fn reference_first(&self, mut rig: Vec<CameraChoice>) -> Result<Vec<CameraChoice>, RigError> {
        let texts = rig.iter().flat_map(|camera| [&camera.name, &camera.serial]);
        if let Some(text) = texts.into_iter().find(|text| text.len() > MAX_NAME_BYTES) {
            return Err(RigError::TooLong { text: text.clone() });
        }
        if let Some(reference) = &self.reference {
            let position = rig.iter().position(|camera| camera.name == *reference).ok_or_else(|| {
                let names: Vec<&str> = rig.iter().map(|camera| camera.name.as_str()).collect();
                RigError::Reference { reference: reference.clone(), names: names.join(", ") }
            })?;
            rig[..=position].rotate_right(1);
        }
        Ok(rig)
    }

    /// Where the cameras of a rig truly are, in the frame of the rig's first; `None` where the back end cannot know.
    pub fn truth(&self, rig: &[CameraChoice]) -> Option<Vec<Motion>> {
        let BackendConfig::Synthetic(options) = &self.backend else { return None };
        let place = |camera: &CameraChoice| {
            let found = options.cameras.iter().find(|made| made.info.serial == camera.serial);
            found.map(|made| made.reference_from_camera)
        };
        let places: Vec<Motion> = rig.iter().map(place).collect::<Option<_>>()?;
        let first_from_reference = places.first()?.inverse();
        Some(
            places.iter().map(|reference_from_camera| first_from_reference * reference_from_camera).collect(),
        )
    }
}
