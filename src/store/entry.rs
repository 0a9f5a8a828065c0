//! A calibration as it is kept: the result, where it comes from, and of which cameras it is.

use crate::solver::RigCalibration;

/// A calibration with its provenance.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredCalibration {
    /// Its number in the store, from 1; never used again.
    pub id: u64,
    /// When it was made, ns since 1970.
    pub made_ns: u64,
    /// That it is an older one which somebody went back to; `None` where it was made.
    pub restored: Option<Restored>,
    /// Version of the program that made it.
    pub version: String,
    /// Hash of the config it was made with, in hex.
    pub config_hash: String,
    /// What became of the frame sets until it was made.
    pub frame_sets: FrameSets,
    /// One per camera, in the order of `calibration.cameras`.
    pub cameras: Vec<StoredCamera>,
    /// The result; converged, so that every camera has a pose.
    pub calibration: RigCalibration,
}

/// The decision to go back to an older calibration.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Restored {
    /// Number of the older one.
    pub from: u64,
    /// When it was decided, ns since 1970.
    pub at_ns: u64,
}

/// What became of the frame sets.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct FrameSets {
    /// Complete sets.
    pub seen: u64,
    /// Taken as evidence.
    pub used: u64,
    /// Not taken.
    pub refused: u64,
    /// Lost because a stage was busy.
    pub dropped: u64,
}

/// Which camera it is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StoredCamera {
    /// Name in the rig.
    pub name: String,
    /// Serial number; empty where the back end has none.
    pub serial: String,
    /// Firmware, where the back end tells it.
    pub firmware: Option<String>,
}

/// Why a stored calibration is not one of these cameras.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum OtherRig {
    /// Some camera is missing on either side.
    #[error("it is of the cameras {stored}; the rig has {rig}")]
    Cameras {
        /// Those of the calibration.
        stored: String,
        /// Those of the rig.
        rig: String,
    },
    /// The poses are told in another camera's frame.
    #[error("it is told in the frame of {stored}; the reference of the rig is {rig}")]
    Reference {
        /// That of the calibration.
        stored: String,
        /// That of the rig.
        rig: String,
    },
}

impl StoredCalibration {
    /// The same in the camera order and with the names of a rig, whose first camera is the reference.
    ///
    /// # Errors
    /// When it is a calibration of other cameras, or in another one's frame.
    pub fn for_rig(&self, rig: &[StoredCamera]) -> Result<Self, OtherRig> {
        let find = |camera: &StoredCamera| self.cameras.iter().position(|stored| stored.is_same(camera));
        // Where each camera of the rig stands in the stored order.
        let places: Option<Vec<usize>> = rig.iter().map(find).collect();
        let is_one_to_one = |places: &Vec<usize>| {
            (0..self.cameras.len()).all(|stored| places.iter().filter(|&&place| place == stored).count() == 1)
        };
        let Some(places) = places.filter(is_one_to_one) else {
            return Err(OtherRig::Cameras { stored: in_words(&self.cameras), rig: in_words(rig) });
        };
        if places.first() != Some(&self.calibration.reference) {
            let stored = self.cameras.get(self.calibration.reference..).unwrap_or_default();
            let [stored, rig] = [stored, rig].map(|cameras| in_words(cameras.get(..1).unwrap_or_default()));
            return Err(OtherRig::Reference { stored, rig });
        }
        let now = |stored: usize| places.iter().position(|&place| place == stored).unwrap_or_default();
        let mut same = self.clone();
        same.calibration.reference = 0;
        same.calibration.cameras =
            places.iter().map(|&place| self.calibration.cameras.get(place).cloned().flatten()).collect();
        for pair in &mut same.calibration.pairs {
            (pair.target, pair.source) = (now(pair.target), now(pair.source));
        }
        for (stored, camera) in same.cameras.iter_mut().zip(rig) {
            *stored = camera.clone();
        }
        for (camera, &place) in same.cameras.iter_mut().zip(&places) {
            camera.firmware = self.cameras.get(place).and_then(|stored| stored.firmware.clone());
        }
        Ok(same)
    }
}

impl StoredCamera {
    /// By serial number; by name where there is none.
    fn is_same(&self, other: &Self) -> bool {
        self.serial == other.serial && (!self.serial.is_empty() || self.name == other.name)
    }
}

/// For people: `left (0123), right (0456)`.
fn in_words(cameras: &[StoredCamera]) -> String {
    let one = |camera: &StoredCamera| format!("{} ({})", camera.name, camera.serial);
    cameras.iter().map(one).collect::<Vec<_>>().join(", ")
}
