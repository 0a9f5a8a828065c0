//! From the sections of the file to checked options in internal units.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::error::Refusal;
use super::sections::{
    Backend, CameraEntry, CamerasSection, ConfigFile, EstimateSection, LinesSection, LogSection, Pace,
    ReplaySection, SyncSection, SyntheticSection,
};
use crate::capture::replay::{self, ReplayOptions};
use crate::ipc::{InstanceName, MAX_NAME_BYTES};
use crate::lines::{DetectOptions, LiftOptions};
use crate::solver::EstimateOptions;

/// Everything the daemon needs to know, checked.
#[derive(Debug, Clone)]
pub struct Config {
    /// Name of this daemon.
    pub instance: InstanceName,
    /// What is logged, and how.
    pub log: LogSection,
    /// Which cameras.
    pub cameras: CamerasConfig,
    /// What counts as one moment.
    pub sync: SyncConfig,
    /// What counts as a segment.
    pub detect: DetectOptions,
    /// Noise and limits of lifting.
    pub lift: LiftOptions,
    /// Limits of the estimate.
    pub estimate: EstimateOptions,
}

/// Back end and cameras.
#[derive(Debug, Clone)]
pub struct CamerasConfig {
    /// Where frames come from.
    pub backend: BackendConfig,
    /// The cameras of the rig; empty means every camera of the back end.
    pub list: Vec<CameraChoice>,
    /// Name of the reference camera; `None` means the first.
    pub reference: Option<String>,
}

/// Where frames come from, with the options of that back end only.
#[derive(Debug, Clone)]
pub enum BackendConfig {
    /// A recording folder.
    Replay(PathBuf, ReplayOptions),
    /// A rendered room.
    Synthetic(SyntheticSection),
}

/// One camera of the rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraChoice {
    /// Name in the rig.
    pub name: String,
    /// Serial number of the device.
    pub serial: String,
}

/// What counts as one moment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SyncConfig {
    /// Largest difference of the stamps in one frame set.
    pub max_skew: Duration,
    /// Without a frame for this long a camera counts as stalled.
    pub stalled_after: Duration,
}

impl TryFrom<&ConfigFile> for Config {
    type Error = Refusal;

    fn try_from(file: &ConfigFile) -> Result<Self, Refusal> {
        let instance: Result<InstanceName, _> = file.instance.parse();
        Ok(Self {
            instance: instance.map_err(|error| Refusal::new("instance", error.to_string()))?,
            log: file.log.clone(),
            cameras: CamerasConfig::try_from(&file.cameras)?,
            sync: SyncConfig::try_from(&file.sync)?,
            detect: DetectOptions::try_from(&file.lines)?,
            lift: LiftOptions::try_from(&file.lines)?,
            estimate: EstimateOptions::try_from(&file.estimate)?,
        })
    }
}

impl Config {
    /// The same with relative paths read from `folder`, which is the config file's.
    pub fn relative_to(mut self, folder: &Path) -> Self {
        if let BackendConfig::Replay(recording, _) = &mut self.cameras.backend {
            *recording = folder.join(&recording);
        }
        self
    }
}

impl TryFrom<&CamerasSection> for CamerasConfig {
    type Error = Refusal;

    fn try_from(file: &CamerasSection) -> Result<Self, Refusal> {
        check_list(&file.list)?;
        check_reference(file)?;
        let choice =
            |entry: &CameraEntry| CameraChoice { name: entry.name.clone(), serial: entry.serial.0.clone() };
        let backend = match file.backend {
            Backend::Replay => {
                let what = "is missing: the back end `replay` needs the folder of a recording";
                let recording = file.replay.recording.clone();
                let recording = recording.ok_or_else(|| Refusal::new("cameras.replay.recording", what))?;
                BackendConfig::Replay(recording, ReplayOptions::from(&file.replay))
            }
            Backend::Synthetic => BackendConfig::Synthetic(file.synthetic.clone()),
        };
        Ok(Self { backend, list: file.list.iter().map(choice).collect(), reference: file.reference.clone() })
    }
}

impl From<&ReplaySection> for ReplayOptions {
    fn from(file: &ReplaySection) -> Self {
        let pace = match file.pace {
            Pace::RealTime => replay::Pace::RealTime,
            Pace::Unpaced => replay::Pace::Unpaced,
        };
        Self { pace, repeat: file.repeat, preload: file.preload }
    }
}

fn check_list(list: &[CameraEntry]) -> Result<(), Refusal> {
    for (index, entry) in list.iter().enumerate() {
        let key = |key: &str| format!("cameras.list[{index}].{key}");
        if entry.name.is_empty() || entry.name.len() > MAX_NAME_BYTES {
            let what = format!("{:?}: allowed are 1 to {MAX_NAME_BYTES} bytes", entry.name);
            return Err(Refusal::new(key("name"), what));
        }
        if entry.serial.0.is_empty() || entry.serial.0.len() > MAX_NAME_BYTES {
            let what = format!("{:?}: allowed are 1 to {MAX_NAME_BYTES} bytes", entry.serial.0);
            return Err(Refusal::new(key("serial"), what));
        }
        if list[..index].iter().any(|earlier| earlier.name == entry.name) {
            let what =
                format!("{:?} is the name of an earlier camera; every camera needs its own", entry.name);
            return Err(Refusal::new(key("name"), what));
        }
        if list[..index].iter().any(|earlier| earlier.serial == entry.serial) {
            let what = format!("{:?} is the serial number of an earlier camera", entry.serial.0);
            return Err(Refusal::new(key("serial"), what));
        }
    }
    Ok(())
}

/// Names of an unlisted rig are known only when the back end has been asked.
fn check_reference(file: &CamerasSection) -> Result<(), Refusal> {
    let Some(reference) = &file.reference else { return Ok(()) };
    if file.list.is_empty() || file.list.iter().any(|entry| entry.name == *reference) {
        return Ok(());
    }
    let names: Vec<&str> = file.list.iter().map(|entry| entry.name.as_str()).collect();
    let what = format!("{reference:?} is not a camera of the list; allowed are {}", names.join(", "));
    Err(Refusal::new("cameras.reference", what))
}

impl TryFrom<&SyncSection> for SyncConfig {
    type Error = Refusal;

    fn try_from(file: &SyncSection) -> Result<Self, Refusal> {
        let SyncSection { max_skew_ms, stalled_after_ms } = *file;
        within("sync.max_skew_ms", max_skew_ms, (0.0, 1_000.0))?;
        within("sync.stalled_after_ms", stalled_after_ms, (10.0, 60_000.0))?;
        if max_skew_ms >= stalled_after_ms {
            let what = format!("{max_skew_ms} must be below sync.stalled_after_ms ({stalled_after_ms})");
            return Err(Refusal::new("sync.max_skew_ms", what));
        }
        Ok(Self { max_skew: from_ms(max_skew_ms), stalled_after: from_ms(stalled_after_ms) })
    }
}

impl TryFrom<&LinesSection> for DetectOptions {
    type Error = Refusal;

    fn try_from(file: &LinesSection) -> Result<Self, Refusal> {
        within("lines.min_length_px", file.min_length_px, (10.0, 1_000.0))?;
        Ok(Self { min_length_px: file.min_length_px })
    }
}

impl TryFrom<&LinesSection> for LiftOptions {
    type Error = Refusal;

    fn try_from(file: &LinesSection) -> Result<Self, Refusal> {
        let LinesSection { sigma_inverse_depth_per_m, min_inlier_ratio, .. } = *file;
        within("lines.sigma_inverse_depth_per_m", sigma_inverse_depth_per_m, (1e-5, 1.0))?;
        within("lines.min_inlier_ratio", min_inlier_ratio, (0.1, 1.0))?;
        Ok(Self { sigma_inverse_depth_per_m, min_inlier_ratio })
    }
}

impl TryFrom<&EstimateSection> for EstimateOptions {
    type Error = Refusal;

    fn try_from(file: &EstimateSection) -> Result<Self, Refusal> {
        within("estimate.max_baseline_m", file.max_baseline_m, (0.01, 20.0))?;
        Ok(Self { max_baseline_m: file.max_baseline_m })
    }
}

/// Refuses a value outside a range, not-a-number included.
fn within(key: &str, value: f64, (low, high): (f64, f64)) -> Result<(), Refusal> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(Refusal::new(key, format!("{value} is out of range: allowed is {low} to {high}")))
}

fn from_ms(milliseconds: f64) -> Duration {
    Duration::from_secs_f64(milliseconds * 1e-3)
}
