//! `pelical devices`: the cameras that a config file's back end has now.

use serde::Serialize;

use super::args::DevicesArgs;
use super::error::CliError;
use super::output;
use crate::capture::CameraInfo;
use crate::service::config;

#[derive(Serialize)]
struct DevicesDocument {
    schema: &'static str,
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
    let config = config::load_or_default(args.config.as_deref())?;
    let factory = config.cameras.factory()?;
    let devices: Vec<DeviceEntry> = factory.list()?.iter().map(DeviceEntry::from).collect();
    if args.output.json {
        let schema = "pelical.devices/1";
        return output::print_json(&DevicesDocument { schema, backend: factory.name(), devices });
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
