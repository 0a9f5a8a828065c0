//! Lists, opens and resets RealSense devices by their serial numbers.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use std::collections::HashSet;

use realsense_rust::context::Context;
use realsense_rust::device::Device;
use realsense_rust::kind::Rs2CameraInfo;

use super::device;
use super::left_out::LeftOut;
use super::options::RealsenseOptions;
use super::source::RealsenseSource;
use crate::capture::{CameraInfo, CaptureError, DeviceFactory, FrameSource};

/// The RealSense cameras of this host, or recordings that the SDK plays as if they were.
pub struct RealsenseFactory {
    options: RealsenseOptions,
    contexts: Contexts,
    left_out: LeftOut,
}

/// Contexts that nobody uses now. Making one takes 0.1 s; one that hangs in a device is never given back, so that it blocks
/// nobody else.
#[derive(Clone, Default)]
pub(super) struct Contexts(Arc<Mutex<Vec<Context>>>);

/// A context in use.
pub(super) struct Session {
    context: Option<Context>,
    home: Contexts,
}

impl Contexts {
    fn session(&self) -> Result<Session, CaptureError> {
        let idle = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        let context = match idle {
            Some(context) => context,
            None => Context::new().map_err(|error| CaptureError::device("any", error))?,
        };
        Ok(Session { context: Some(context), home: self.clone() })
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        if let Some(context) = self.context.take() {
            self.home.0.lock().unwrap_or_else(PoisonError::into_inner).push(context);
        }
    }
}

impl Session {
    /// Every device that is there now, by serial number; devices in recovery, which have none, are left out.
    pub(super) fn devices(&self) -> Vec<(String, Device)> {
        let found =
            self.context.as_ref().map_or_else(Vec::new, |context| context.query_devices(HashSet::new()));
        let mut devices: Vec<(String, Device)> =
            found.into_iter().map(|device| (device::serial(&device), device)).collect();
        devices.retain(|(serial, _)| !serial.is_empty());
        devices.sort_by(|(a, _), (b, _)| a.cmp(b));
        devices
    }

    /// Whether the device with this serial is there.
    pub(super) fn has(&self, serial: &str) -> bool {
        self.devices().iter().any(|(there, _)| there == serial)
    }
}

impl RealsenseFactory {
    /// A factory with these options; nothing is opened yet.
    pub fn new(options: RealsenseOptions) -> Self {
        Self { options, contexts: Contexts::default(), left_out: LeftOut::default() }
    }

    /// The recording of this serial number, or all of them.
    fn recordings(&self) -> Result<Vec<(String, Recording)>, CaptureError> {
        let mut recordings: Vec<(String, Recording)> = Vec::new();
        for path in &self.options.playback {
            let recording = Recording::open(path)?;
            let serial = device::serial(&recording.device);
            if recordings.iter().any(|(earlier, _)| *earlier == serial) {
                let what = format!(
                    "is of the camera \"{serial}\", as an earlier recording is: one of each is played"
                );
                return Err(CaptureError::bad_data(path, what));
            }
            recordings.push((serial, recording));
        }
        Ok(recordings)
    }

    fn list_live(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        let session = self.contexts.session()?;
        let mut cameras = Vec::new();
        for (serial, device) in session.devices() {
            match device::plan(&device, &self.options) {
                Ok(plan) => {
                    self.left_out.is_news(&serial, None);
                    cameras.push(plan.info);
                }
                Err(obstacle) => {
                    let what = obstacle.sentence();
                    if self.left_out.is_news(&serial, Some(what)) {
                        tracing::warn!(serial, "camera is left out: {what}");
                    }
                }
            }
        }
        Ok(cameras)
    }

    fn list_recorded(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        let recordings = self.recordings()?;
        let info = |(serial, recording): &(String, Recording)| {
            let plan = device::plan(&recording.device, &self.options);
            plan.map(|plan| plan.info).map_err(|obstacle| obstacle.of(serial))
        };
        recordings.iter().map(info).collect()
    }

    fn open_live(&self, serial: &str) -> Result<RealsenseSource, CaptureError> {
        let session = self.contexts.session()?;
        let devices = session.devices();
        let serials: Vec<String> = devices.iter().map(|(there, _)| there.clone()).collect();
        let found = devices.into_iter().find(|(there, _)| there == serial);
        let (_, device) = found.ok_or_else(|| not_found(serial, &serials))?;
        tell_usb(serial, &device);
        RealsenseSource::live(device, session, &self.options)
    }

    fn open_recorded(&self, serial: &str) -> Result<RealsenseSource, CaptureError> {
        let recordings = self.recordings()?;
        let serials: Vec<String> = recordings.iter().map(|(there, _)| there.clone()).collect();
        let found = recordings.into_iter().find(|(there, _)| there == serial);
        let (_, recording) = found.ok_or_else(|| not_found(serial, &serials))?;
        RealsenseSource::recorded(recording, &self.options)
    }
}

impl DeviceFactory for RealsenseFactory {
    fn name(&self) -> &'static str {
        "realsense"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        let is_live = self.options.playback.is_empty();
        guarded("any", || if is_live { self.list_live() } else { self.list_recorded() })
    }

    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        let is_live = self.options.playback.is_empty();
        let open = || if is_live { self.open_live(serial) } else { self.open_recorded(serial) };
        guarded(serial, open).map(|source| Box::new(source) as Box<dyn FrameSource>)
    }

    fn reset(&self, serial: &str) -> Result<bool, CaptureError> {
        if !self.options.playback.is_empty() {
            return Ok(false);
        }
        guarded(serial, || {
            let session = self.contexts.session()?;
            let devices = session.devices();
            let serials: Vec<String> = devices.iter().map(|(there, _)| there.clone()).collect();
            let found = devices.into_iter().find(|(there, _)| there == serial);
            let (_, device) = found.ok_or_else(|| not_found(serial, &serials))?;
            device.hardware_reset();
            Ok(true)
        })
    }
}

/// A recording that the SDK has opened as a device.
pub(super) struct Recording {
    pub(super) device: Device,
    /// Plays it for as long as it is there.
    _context: Context,
}

impl Recording {
    fn open(path: &Path) -> Result<Self, CaptureError> {
        // The SDK's own message for a missing file is about its format.
        std::fs::metadata(path).map_err(|source| CaptureError::io(path, source))?;
        let mut context = Context::new().map_err(|error| CaptureError::bad_data(path, error.to_string()))?;
        let device =
            context.add_device(path).map_err(|error| CaptureError::bad_data(path, error.to_string()))?;
        Ok(Self { device, _context: context })
    }
}

fn not_found(serial: &str, there: &[String]) -> CaptureError {
    let quoted: Vec<String> = there.iter().map(|serial| format!("\"{serial}\"")).collect();
    let available = if quoted.is_empty() { "none".to_owned() } else { quoted.join(", ") };
    CaptureError::NotFound { serial: serial.to_owned(), available }
}

fn tell_usb(serial: &str, device: &Device) {
    let usb = device::text(device, Rs2CameraInfo::UsbTypeDescriptor);
    let firmware = device::text(device, Rs2CameraInfo::FirmwareVersion);
    if is_slow_usb(&usb) {
        tracing::warn!(
            serial,
            usb,
            "camera runs at the speed of USB 2, with fewer modes and more lost frames: try another cable or port"
        );
    }
    tracing::info!(serial, usb, firmware, "camera found");
}

/// Whether the version of USB that the SDK tells ("3.2", "2.1") is below 3; unknown is not.
fn is_slow_usb(version: &str) -> bool {
    version.split('.').next().and_then(|major| major.parse::<u32>().ok()).is_some_and(|major| major < 3)
}

/// `realsense-rust` panics at numbers that a newer library knows and it does not: an error of this device, not the end of the program.
fn guarded<T>(serial: &str, call: impl FnOnce() -> Result<T, CaptureError>) -> Result<T, CaptureError> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|_| {
        let what =
            "the SDK told something that this program does not know: is librealsense much newer than 2.56?";
        Err(CaptureError::device(serial, what))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usb_2_is_slow_and_unknown_is_not() {
        assert!(is_slow_usb("2.1") && is_slow_usb("2.0") && is_slow_usb("1.1"));
        assert!(!is_slow_usb("3.2") && !is_slow_usb("3.1") && !is_slow_usb("") && !is_slow_usb("Undefined"));
    }

    #[test]
    fn a_host_without_cameras_is_an_empty_list_and_an_unknown_serial_is_not_found() {
        let factory = RealsenseFactory::new(RealsenseOptions::default());
        let there = factory.list().expect("an SDK without cameras");
        assert!(there.is_empty(), "these tests expect no camera: {there:?}");
        assert!(
            matches!(factory.open("012345"), Err(CaptureError::NotFound { serial, .. }) if serial == "012345")
        );
        assert!(matches!(factory.reset("012345"), Err(CaptureError::NotFound { .. })));
    }

    #[test]
    fn a_panic_of_the_sdk_is_an_error_of_the_device() {
        let refused = guarded::<()>("12", || std::panic::resume_unwind(Box::new("an unknown number")));
        assert!(matches!(refused, Err(CaptureError::Device { serial, .. }) if serial == "12"));
    }
}
