//! Cameras on the bus: are they there, how fast is their connection, and may the daemon use them?

use std::fs;
use std::path::Path;

use super::finding::Finding;
use super::system::{System, User};
use crate::capture::realsense_models::{self, Model};

const USB_DEVICES: &str = "/sys/bus/usb/devices";
/// Mbit/s of USB 3.
const SUPER_SPEED_MBIT_PER_S: f64 = 5000.0;
/// Folders below a USB device; sysfs has no deeper ones on the way to a node.
const MAX_DEPTH: usize = 10;

/// A camera as sysfs shows it.
#[derive(Debug, Clone)]
pub struct UsbCamera {
    /// What it is.
    pub model: &'static Model,
    /// Place on the bus, as `2-1`.
    pub port: String,
    /// Serial number of its USB device; empty where it does not tell.
    pub serial: String,
    /// The bus, which is one half of a controller; `None` where sysfs does not tell.
    pub bus: Option<u32>,
    /// Mbit/s; `None` where sysfs does not tell.
    pub speed_mbit_per_s: Option<f64>,
    /// Device nodes: that of USB first, then video, hidraw and iio.
    pub nodes: Vec<String>,
}

impl UsbCamera {
    fn label(&self) -> String {
        let serial = if self.serial.is_empty() { String::new() } else { format!(", {}", self.serial) };
        format!("{} ({}{serial})", self.model.name, self.port)
    }
}

/// Every known camera on the bus, by its port.
pub fn on_bus(system: &System) -> Vec<UsbCamera> {
    system.names(USB_DEVICES).iter().filter_map(|port| camera(system, port)).collect()
}

fn camera(system: &System, port: &str) -> Option<UsbCamera> {
    let folder = format!("{USB_DEVICES}/{port}");
    let text = |name: &str| system.read(format!("{folder}/{name}"));
    let hex = |name: &str| u16::from_str_radix(&text(name)?, 16).ok();
    let model = realsense_models::find(hex("idVendor")?, hex("idProduct")?)?;
    let number = |name: &str| text(name)?.parse::<u32>().ok();
    let usb_node = number("busnum")
        .zip(number("devnum"))
        .map(|(bus, device)| format!("/dev/bus/usb/{bus:03}/{device:03}"));
    let mut nodes: Vec<String> = usb_node.into_iter().collect();
    let mut found = Vec::new();
    collect_nodes(&system.path(&folder), MAX_DEPTH, &mut found);
    found.sort();
    nodes.extend(found);
    Some(UsbCamera {
        model,
        port: port.to_owned(),
        serial: text("serial").unwrap_or_default(),
        bus: number("busnum"),
        speed_mbit_per_s: text("speed").and_then(|speed| speed.parse().ok()),
        nodes,
    })
}

/// Nodes of the devices below a folder of sysfs; links lead out of it and are not followed.
fn collect_nodes(folder: &Path, depth: usize, nodes: &mut Vec<String>) {
    let class = folder.file_name().unwrap_or_default();
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        if !entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            continue;
        }
        if class == "video4linux" || class == "hidraw" || name.starts_with("iio:device") {
            nodes.push(format!("/dev/{name}"));
        } else if depth > 0 {
            collect_nodes(&entry.path(), depth - 1, nodes);
        }
    }
}

/// Findings about the cameras on the bus, with whether the config's back end needs them.
pub fn check(system: &System, cameras: &[UsbCamera], is_needed: bool) -> Vec<Finding> {
    let mut findings = vec![presence(cameras, is_needed)];
    findings.extend(cameras.iter().map(speed));
    let user = system.daemon_user();
    findings.extend(cameras.iter().map(|camera| permissions(system, camera, &user)));
    findings
}

fn presence(cameras: &[UsbCamera], is_needed: bool) -> Finding {
    const CHECK: &str = "devices";
    let labels: Vec<String> = cameras.iter().map(UsbCamera::label).collect();
    if let Some(camera) = cameras.iter().find(|camera| camera.model.name.contains("recovery")) {
        let why = (
            "it starts into recovery when its firmware is broken or an update was interrupted",
            "install the firmware again with librealsense's rs-fw-update -r",
        );
        return Finding::problem(CHECK, format!("{} is in recovery mode", camera.label()), why);
    }
    match cameras.len() {
        0 if is_needed => Finding::problem(
            CHECK,
            "no RealSense D400 camera on USB, and the config's back end needs them",
            (
                "no device with vendor 8086 and a known product is on the bus: not plugged in, without power, or a broken cable",
                "plug the cameras in with USB 3 cables, into ports that give enough power; `lsusb -d 8086:` must show them",
            ),
        ),
        0 => Finding::ok(CHECK, "no RealSense D400 camera on USB; the config's back end needs none"),
        n => Finding::ok(CHECK, format!("{n} on USB: {}", labels.join(", "))),
    }
}

fn speed(camera: &UsbCamera) -> Finding {
    const CHECK: &str = "usb_speed";
    let label = camera.label();
    match camera.speed_mbit_per_s {
        Some(speed) if speed >= SUPER_SPEED_MBIT_PER_S => {
            Finding::ok(CHECK, format!("{label} runs at {speed} Mbit/s"))
        }
        Some(speed) => Finding::problem(
            CHECK,
            format!("{label} runs at {speed} Mbit/s, which is USB 2"),
            (
                "a USB 2 cable, port or hub is in between, or the plug is not all the way in: colour and depth of 640 x 480 at 30 \
                 frames per second do not go through",
                "use a USB 3 port and a short USB 3 cable, plug it in quickly and fully, and leave out the hub",
            ),
        ),
        None => Finding::warning(
            CHECK,
            format!("{label}: the speed of its connection is not known"),
            ("sysfs has no file `speed` for it", "look at `lsusb -t`: it should be 5000M or more"),
        ),
    }
}

fn permissions(system: &System, camera: &UsbCamera, user: &User) -> Finding {
    const CHECK: &str = "permissions";
    let label = camera.label();
    let blocked =
        camera.nodes.iter().filter_map(|node| match (system.rights(node), system.may_use(user, node)) {
            (Some(rights), Some(false)) => {
                Some(format!("{node} (mode {:04o}, group {})", rights.mode, rights.gid))
            }
            (Some(_), _) => None,
            (None, _) => Some(format!("{node} (not there)")),
        });
    let blocked: Vec<String> = blocked.collect();
    if blocked.is_empty() {
        let (n_nodes, name) = (camera.nodes.len(), &user.name);
        return Finding::ok(CHECK, format!("{label}: all {n_nodes} nodes can be used by {name}"));
    }
    Finding::problem(
        CHECK,
        format!("{label}: {} cannot be read and written by {}", blocked.join(", "), user.name),
        (
            "the udev rules have not been applied to this device: not installed, or the device was there before they were",
            "sudo udevadm control --reload && sudo udevadm trigger --action=change --subsystem-match=usb \
             --subsystem-match=video4linux --subsystem-match=hidraw --subsystem-match=iio, or unplug the camera and plug it in again; \
             video nodes need the group `video`",
        ),
    )
}
