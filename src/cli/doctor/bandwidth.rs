//! Whether the streams of the config fit the buses that the cameras are plugged into.

use std::collections::BTreeMap;

use super::cameras::UsbCamera;
use super::finding::Finding;
use super::system::System;
use crate::capture::realsense::{RealsenseOptions, VideoMode};
use crate::service::config::{BackendConfig, CamerasConfig};

/// What a D400 sends for a pixel, of colour (YUYV) as of depth (Z16).
const BITS_PER_PIXEL: f64 = 16.0;
/// Share of a bus that cameras were seen to get: on 5000 Mbit/s two with 1280 x 720 at 30 frames per second run, a third fails
/// (librealsense issues 1492 and 13792).
const USABLE_SHARE: f64 = 0.4;

/// One finding for each bus with cameras; none where the config has no live cameras.
pub fn check(system: &System, cameras: &[UsbCamera], config: &CamerasConfig) -> Vec<Finding> {
    let BackendConfig::Realsense(options) = &config.backend else { return Vec::new() };
    if !options.playback.is_empty() {
        return Vec::new();
    }
    let used = |camera: &&UsbCamera| {
        config.list.is_empty() || config.list.iter().any(|choice| choice.serial == camera.serial)
    };
    // The serial of the USB device may be another than the camera's own: then all that are plugged in count.
    let listed: Vec<&UsbCamera> = cameras.iter().filter(used).collect();
    let counted = if listed.is_empty() { cameras.iter().collect() } else { listed };
    let mut buses: BTreeMap<u32, Vec<&UsbCamera>> = BTreeMap::new();
    for camera in counted {
        if let Some(bus) = camera.bus {
            buses.entry(bus).or_default().push(camera);
        }
    }
    buses.iter().map(|(bus, on_it)| one_bus(system, *bus, on_it, options)).collect()
}

fn one_bus(system: &System, bus: u32, cameras: &[&UsbCamera], options: &RealsenseOptions) -> Finding {
    const CHECK: &str = "usb_bandwidth";
    let ports: Vec<&str> = cameras.iter().map(|camera| camera.port.as_str()).collect();
    let wanted = cameras.len() as f64 * (mbit_per_s(options.color) + mbit_per_s(options.depth));
    let found =
        format!("bus {bus} has {} ({}), whose streams take {wanted:.0}", count(cameras), ports.join(", "));
    let speed = system
        .read(format!("/sys/bus/usb/devices/usb{bus}/speed"))
        .and_then(|speed| speed.parse::<f64>().ok());
    match speed {
        Some(speed) if wanted > USABLE_SHARE * speed => Finding::warning(
            CHECK,
            format!("{found} of its {speed:.0} Mbit/s"),
            (
                "cameras of one bus share one controller, of which two fifths are usable in practice: beyond, frames are incomplete, or a \
                 stream does not start",
                "plug some of them into ports of another controller (`lsusb -t`), or choose smaller modes or a lower rate in \
                 cameras.realsense.color and .depth",
            ),
        ),
        Some(speed) => Finding::ok(CHECK, format!("{found} of its {speed:.0} Mbit/s")),
        None => Finding::ok(CHECK, format!("{found} Mbit/s; how much it has is not told")),
    }
}

fn count(cameras: &[&UsbCamera]) -> String {
    match cameras.len() {
        1 => "one camera".to_owned(),
        n => format!("{n} cameras"),
    }
}

fn mbit_per_s(mode: VideoMode) -> f64 {
    let VideoMode { width_px, height_px, rate_hz } = mode;
    (width_px * height_px * rate_hz) as f64 * BITS_PER_PIXEL * 1e-6
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::realsense_models;
    use crate::capture::synthetic::SyntheticOptions;
    use crate::cli::doctor::finding::Grade;

    fn cameras(buses: &[u32]) -> Vec<UsbCamera> {
        let camera = |(index, &bus): (usize, &u32)| UsbCamera {
            model: realsense_models::find(0x8086, 0x0b3a).expect("a D435i"),
            port: format!("{bus}-{}", index + 1),
            serial: format!("{index}"),
            bus: Some(bus),
            speed_mbit_per_s: Some(5000.0),
            nodes: Vec::new(),
        };
        buses.iter().enumerate().map(camera).collect()
    }

    fn rig_of(backend: BackendConfig) -> CamerasConfig {
        CamerasConfig { backend, list: Vec::new(), reference: None, faults: BTreeMap::new() }
    }

    fn findings(buses: &[u32]) -> Vec<Finding> {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for bus in ["usb2", "usb4"] {
            let place = folder.path().join("sys/bus/usb/devices").join(bus);
            std::fs::create_dir_all(&place).expect("made");
            std::fs::write(place.join("speed"), "5000\n").expect("written");
        }
        let system = System::new(Some(folder.path()));
        let realsense = BackendConfig::Realsense(RealsenseOptions {
            color: VideoMode { width_px: 1280, height_px: 720, rate_hz: 30 },
            depth: VideoMode { width_px: 1280, height_px: 720, rate_hz: 30 },
            ..RealsenseOptions::default()
        });
        check(&system, &cameras(buses), &rig_of(realsense))
    }

    #[test]
    fn three_large_streams_on_one_bus_are_warned_of_and_spread_over_two_they_are_not() {
        let crowded = findings(&[2, 2, 2]);
        assert_eq!(crowded.len(), 1);
        assert_eq!(crowded[0].grade, Grade::Warning);
        assert!(
            crowded[0].finding.contains("3 cameras (2-1, 2-2, 2-3), whose streams take 2654 of its 5000"),
            "{crowded:?}"
        );
        let spread = findings(&[2, 2, 4]);
        assert_eq!(spread.iter().map(|finding| finding.grade).collect::<Vec<_>>(), [Grade::Ok, Grade::Ok]);
        let unknown = findings(&[7]);
        assert!(
            unknown[0].finding.contains("one camera") && unknown[0].finding.contains("not told"),
            "{unknown:?}"
        );
    }

    #[test]
    fn rendered_and_recorded_cameras_need_no_bus() {
        let system = System::new(None);
        assert!(
            check(
                &system,
                &cameras(&[2]),
                &rig_of(BackendConfig::Synthetic(SyntheticOptions::pair(60.0, 0.3, 1)))
            )
            .is_empty()
        );
    }
}
