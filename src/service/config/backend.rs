//! From the checked section `cameras` to a back end and the cameras of the rig.

use super::check::{BackendConfig, CamerasConfig};
use crate::capture::recording::Recording;
use crate::capture::replay::ReplayFactory;
use crate::capture::{CameraInfo, CaptureError, DeviceFactory};

impl CamerasConfig {
    /// The back end that was chosen.
    ///
    /// # Errors
    /// When it cannot be reached, as a recording that is not there.
    pub fn factory(&self) -> Result<Box<dyn DeviceFactory>, CaptureError> {
        match &self.backend {
            BackendConfig::Replay(recording, options) => {
                Ok(Box::new(ReplayFactory::new(Recording::open(recording)?, *options)?))
            }
            BackendConfig::Synthetic(_) => todo!(),
        }
    }

    /// The cameras of the rig among those of the back end, under the names of the config, the reference first.
    ///
    /// # Errors
    /// When a camera or the reference is not there.
    pub fn choose(&self, available: &[CameraInfo]) -> Result<Vec<CameraInfo>, CaptureError> {
        let mut rig: Vec<CameraInfo> = if self.list.is_empty() {
            available.to_vec()
        } else {
            let find = |choice: &super::CameraChoice| {
                let found = available.iter().find(|info| info.serial == choice.serial);
                let found = found.ok_or_else(|| CaptureError::not_found(&choice.serial, available))?;
                Ok(CameraInfo { name: choice.name.clone(), ..found.clone() })
            };
            self.list.iter().map(find).collect::<Result<_, CaptureError>>()?
        };
        if let Some(reference) = &self.reference {
            let position = rig.iter().position(|info| info.name == *reference);
            let position = position.ok_or_else(|| CaptureError::not_found(reference, available))?;
            rig[..=position].rotate_right(1);
        }
        Ok(rig)
    }
}
