//! The paper's configurations: where the source camera stands on the rig with protractor and ruler.

use crate::capture::synthetic::{SyntheticFactory, SyntheticOptions};

/// Room for the largest configuration, so that all of one seed stand in the same room.
const LEAST_RIG_RADIUS_M: f64 = 0.225;

/// One setting of protractor and ruler.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Configuration {
    /// How much further to the right the source camera looks, deg.
    pub angle_deg: u32,
    /// Where the source camera stands along the target's x axis, cm.
    pub distance_cm: u32,
}

impl Configuration {
    /// Every angle at every distance, by angle and then distance.
    pub fn grid(angles_deg: &[u32], distances_cm: &[u32]) -> Vec<Self> {
        let row =
            |&angle_deg: &u32| distances_cm.iter().map(move |&distance_cm| Self { angle_deg, distance_cm });
        angles_deg.iter().flat_map(row).collect()
    }

    /// The rig in the room of this seed: the same room for every configuration, paths and noise of its own.
    pub fn options(self, seed: u64) -> SyntheticOptions {
        let (yaw_deg, baseline_m) = (f64::from(self.angle_deg), f64::from(self.distance_cm) / 100.0);
        SyntheticOptions {
            noise_seed: Some((seed << 20) + u64::from(self.angle_deg << 8) + u64::from(self.distance_cm)),
            least_rig_radius_m: LEAST_RIG_RADIUS_M,
            ..SyntheticOptions::exact_pair(yaw_deg, baseline_m, seed)
        }
    }

    /// The rig and its path.
    pub fn factory(self, seed: u64) -> SyntheticFactory {
        SyntheticFactory::new(self.options(seed))
    }
}
