//! `pelical devices`: the cameras that a config file's back end has now.

use std::path::PathBuf;

use serde::Serialize;

use super::args::DevicesArgs;
use super::error::CliError;
use super::output;
use super::talk::say;
use crate::capture::CameraInfo;
use crate::service::config;

#[derive(Serialize)]
struct DevicesDocument {
    schema: &'static str,
    /// The config file that was read; null for the defaults.
    config: Option<PathBuf>,
    backend: &'static str,
    devices: Vec<DeviceEntry>,
}

#[derive(Serialize)]
struct DeviceEntry {
    name: String,
    serial: String,
    width_px: u32,
    height_px: u32,
    depth_unit_m: f64,
    firmware: Option<String>,
}

/// Lists the cameras.
///
/// # Errors
/// When the config or the back end is not usable.
pub fn run(args: &DevicesArgs) -> Result<(), CliError> {
    let installed = || Some(PathBuf::from(config::INSTALLED_CONFIG)).filter(|file| file.exists());
    let file = args.config.clone().or_else(installed);
    let config = config::load_or_default(file.as_deref())?;
    let factory = config.cameras.factory()?;
    let devices: Vec<DeviceEntry> = factory.list()?.iter().map(DeviceEntry::from).collect();
    if args.output.json {
        let (schema, backend) = ("pelical.devices/1", factory.name());
        return output::print_json(&DevicesDocument { schema, config: file, backend, devices });
    }
    match &file {
        Some(file) => say(format_args!("pelical: the cameras of {}", file.display())),
        None => say(format_args!(
            "pelical: no {}: these are the cameras of the defaults; name a config with --config",
            config::INSTALLED_CONFIG
        )),
    }
    let row = |device: &DeviceEntry| {
        let size = format!("{} x {}", device.width_px, device.height_px);
        let firmware = device.firmware.clone().unwrap_or_else(|| "-".to_owned());
        vec![device.name.clone(), device.serial.clone(), firmware, size, factory.name().to_owned()]
    };
    let rows: Vec<_> = devices.iter().map(row).collect();
    output::print_text(&output::text::table(&["camera", "serial", "firmware", "size px", "back end"], &rows))
}

impl From<&CameraInfo> for DeviceEntry {
    fn from(info: &CameraInfo) -> Self {
        Self {
            name: info.name.clone(),
            serial: info.serial.clone(),
            width_px: info.camera.width_px(),
            height_px: info.camera.height_px(),
            depth_unit_m: info.depth_unit_m,
            firmware: info.firmware.clone(),
        }
    }
}
