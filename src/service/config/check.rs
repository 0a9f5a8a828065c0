//! From the sections of the file to checked options in internal units.

use std::collections::BTreeMap;
use std::path::Path;

use super::convert::synthetic_options;
use super::error::Refusal;
use super::recording::RecordingPaths;
use super::sections::{Backend, CameraEntry, CamerasSection, ConfigFile, LogSection, Pace, ReplaySection};
use super::store::StoreConfig;
use super::supervision::ReadyWhen;
use super::watch::OnMoved;
use crate::capture::realsense::RealsenseOptions;
use crate::capture::replay::{self, ReplayOptions};
use crate::capture::scripted::FaultScript;
use crate::capture::synthetic::SyntheticOptions;
use crate::ipc::{InstanceName, MAX_NAME_BYTES, Transport};
use crate::pipeline::{MAX_CAMERAS, PipelineOptions};
use crate::store::sha256_hex;

/// Everything the daemon needs to know, checked.
#[derive(Debug, Clone)]
pub struct Config {
    /// Name of this daemon.
    pub instance: InstanceName,
    /// What is logged, and how.
    pub log: LogSection,
    /// How clients reach the daemon.
    pub transport: Transport,
    /// When the service manager is told that the service is ready.
    pub ready_when: ReadyWhen,
    /// Which cameras.
    pub cameras: CamerasConfig,
    /// Everything between frames and results.
    pub pipeline: PipelineOptions,
    /// What is done about a camera that was moved after a result.
    pub on_moved: OnMoved,
    /// Where calibrations are kept, and how many.
    pub store: StoreConfig,
    /// SHA-256 of all effective values, in hex: the provenance of what is made with them.
    pub hash: String,
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
    /// What cameras suffer on purpose, by serial number.
    pub faults: BTreeMap<String, FaultScript>,
}

/// Where frames come from, with the options of that back end only.
#[derive(Debug, Clone)]
pub enum BackendConfig {
    /// A recording folder, or bags.
    Replay(RecordingPaths, ReplayOptions),
    /// A rendered room.
    Synthetic(SyntheticOptions),
    /// RealSense cameras.
    Realsense(RealsenseOptions),
}

/// One camera of the rig.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CameraChoice {
    /// Name in the rig.
    pub name: String,
    /// Serial number of the device.
    pub serial: String,
}

impl TryFrom<&ConfigFile> for Config {
    type Error = Refusal;

    fn try_from(file: &ConfigFile) -> Result<Self, Refusal> {
        let instance: Result<InstanceName, _> = file.instance.parse();
        Ok(Self {
            instance: instance.map_err(|error| Refusal::new("instance", error.to_string()))?,
            log: file.log.clone(),
            transport: super::ipc::transport(&file.ipc)?,
            ready_when: file.service.ready_when,
            cameras: CamerasConfig::try_from(&file.cameras)?,
            pipeline: super::convert::pipeline_options(file)?,
            on_moved: file.watch.on_moved,
            store: StoreConfig::try_from(&file.store)?,
            hash: hash(file)?,
        })
    }
}

impl Config {
    /// The same with relative paths read from `folder`, which is the config file's.
    pub fn relative_to(mut self, folder: &Path) -> Self {
        match &mut self.cameras.backend {
            BackendConfig::Replay(recording, _) => *recording = recording.relative_to(folder),
            BackendConfig::Realsense(options) => {
                options.playback.iter_mut().for_each(|recording| *recording = folder.join(&recording));
            }
            BackendConfig::Synthetic(_) => {}
        }
        super::matcher::relative_to(&mut self.pipeline.associate.learned, folder);
        if let Some(directory) = &mut self.store.directory {
            *directory = folder.join(&directory);
        }
        self
    }
}

fn hash(file: &ConfigFile) -> Result<String, Refusal> {
    let text = serde_yaml::to_string(file).map_err(|error| Refusal::new("", error.to_string()))?;
    Ok(sha256_hex(text.as_bytes()))
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
                let what = "is missing: the back end `replay` needs the folder of a recording, or .bag files";
                let recording = file.replay.recording.clone();
                if recording.0.is_empty() {
                    return Err(Refusal::new("cameras.replay.recording", what));
                }
                if recording.0.iter().any(|path| path.as_os_str().is_empty()) {
                    return Err(Refusal::new("cameras.replay.recording", what.replace("missing", "empty")));
                }
                BackendConfig::Replay(recording, ReplayOptions::from(&file.replay))
            }
            Backend::Synthetic => BackendConfig::Synthetic(synthetic_options(&file.synthetic)?),
            Backend::Realsense => BackendConfig::Realsense(super::realsense::options(&file.realsense)?),
        };
        let list = file.list.iter().map(choice).collect();
        let faults = super::faults::scripts(&file.faults)?;
        Ok(Self { backend, list, reference: file.reference.clone(), faults })
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
    if list.len() > MAX_CAMERAS {
        let what = format!("has {} cameras; at most {MAX_CAMERAS} are allowed", list.len());
        return Err(Refusal::new("cameras.list", what));
    }
    for (index, entry) in list.iter().enumerate() {
        let key = |key: &str| format!("cameras.list[{index}].{key}");
        check_text(key("name"), &entry.name)?;
        check_text(key("serial"), &entry.serial.0)?;
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

/// A name or serial number has to fit into shared memory, and into one line of any output.
fn check_text(key: String, text: &str) -> Result<(), Refusal> {
    if (1..=MAX_NAME_BYTES).contains(&text.len()) && !text.chars().any(char::is_control) {
        return Ok(());
    }
    let what = format!("{text:?}: allowed are 1 to {MAX_NAME_BYTES} bytes without control characters");
    Err(Refusal::new(key, what))
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
