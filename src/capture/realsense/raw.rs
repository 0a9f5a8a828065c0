//! The C interface of the SDK, where `realsense-rust` has nothing for it: sensors streaming into queues, control of playback, the
//! bytes of an image. The only `unsafe` of this crate; nothing raw leaves this module.
#![allow(unsafe_code, reason = "calls into a C library")]

use std::ffi::{CStr, c_int, c_uint};
use std::ptr::{NonNull, null_mut};
use std::time::Duration;

use realsense_rust::device::Device;
use realsense_rust::frame::{AccelFrame, ColorFrame, DepthFrame, GyroFrame, ImageFrame};
use realsense_rust::kind::Rs2StreamKind;
use realsense_rust::sensor::Sensor;
use realsense_rust::stream_profile::StreamProfile;
use realsense_sys as sys;

/// Calls a function of the SDK, whose last argument takes its error, and makes a `Result` of that.
macro_rules! checked {
    ($function:path, $($argument:expr),+) => {{
        let mut error: *mut sys::rs2_error = null_mut();
        // SAFETY: every caller in this module hands in pointers that the SDK gave and that are still alive.
        let answer = unsafe { $function($($argument,)+ &mut error) };
        told(error).map(|()| answer)
    }};
}

/// What the SDK says of an error, which it frees.
fn told(error: *mut sys::rs2_error) -> Result<(), String> {
    if error.is_null() {
        return Ok(());
    }
    // SAFETY: not null, so the SDK has made it; its text lives until it is freed, and is copied before.
    unsafe {
        let text = CStr::from_ptr(sys::rs2_get_error_message(error)).to_string_lossy().into_owned();
        sys::rs2_free_error(error);
        Err(text)
    }
}

/// The pointer in a device, which `realsense-rust` keeps to itself.
fn device_ptr(device: &Device) -> *mut sys::rs2_device {
    const { assert!(size_of::<Device>() == size_of::<NonNull<sys::rs2_device>>()) }
    // SAFETY: in the version that Cargo.toml pins, this pointer is the only field; the assertion above holds it to that.
    unsafe { *(&raw const *device).cast::<*mut sys::rs2_device>() }
}

/// A sensor of a device: one or more streams that are opened together.
pub(super) struct DeviceSensor(NonNull<sys::rs2_sensor>);

// SAFETY: the SDK locks its sensors; they may be used from any thread, as realsense-rust says of its own.
unsafe impl Send for DeviceSensor {}

impl Drop for DeviceSensor {
    fn drop(&mut self) {
        // SAFETY: made by `rs2_create_sensor`, deleted once.
        unsafe { sys::rs2_delete_sensor(self.0.as_ptr()) }
    }
}

impl DeviceSensor {
    /// Every sensor of a device.
    pub(super) fn all(device: &Device) -> Result<Vec<Self>, String> {
        let list = checked!(sys::rs2_query_sensors, device_ptr(device))?;
        let sensors = checked!(sys::rs2_get_sensors_count, list).and_then(|n_sensors| {
            let sensor = |index| {
                let sensor = checked!(sys::rs2_create_sensor, list, index)?;
                NonNull::new(sensor).map(Self).ok_or_else(|| "a sensor is null".to_owned())
            };
            (0..n_sensors).map(sensor).collect()
        });
        // SAFETY: made above, deleted once; sensors do not need it.
        unsafe { sys::rs2_delete_sensor_list(list) };
        sensors
    }

    /// The same sensor with its options; it does not delete it.
    pub(super) fn options(&self) -> Sensor {
        Sensor::from(self.0)
    }

    /// What it can stream.
    pub(super) fn profiles(&self) -> Result<ProfileList, String> {
        let list = checked!(sys::rs2_get_stream_profiles, self.0.as_ptr())?;
        NonNull::new(list).map(ProfileList).ok_or_else(|| "the list of streams is null".to_owned())
    }

    /// Opens streams and starts them into a queue, which whoever calls deletes.
    fn start(
        &self,
        (profiles, chosen): (&ProfileList, &[c_int]),
        capacity: c_int,
    ) -> Result<NonNull<sys::rs2_frame_queue>, String> {
        let mut pointers: Vec<*const sys::rs2_stream_profile> = Vec::new();
        for &index in chosen {
            let profile = profiles.pointer(index).ok_or_else(|| "a stream is gone".to_owned())?;
            pointers.push(profile.as_ptr().cast_const());
        }
        let n_streams = c_int::try_from(pointers.len()).map_err(|error| error.to_string())?;
        checked!(sys::rs2_open_multiple, self.0.as_ptr(), pointers.as_mut_ptr(), n_streams)?;
        let started = checked!(sys::rs2_create_frame_queue, capacity).and_then(|queue| {
            let queue = NonNull::new(queue).ok_or_else(|| "the queue is null".to_owned())?;
            let started = checked!(sys::rs2_start_queue, self.0.as_ptr(), queue.as_ptr());
            started.map(|()| queue).inspect_err(|_| {
                // SAFETY: made above, deleted once; the sensor was not started with it.
                unsafe { sys::rs2_delete_frame_queue(queue.as_ptr()) }
            })
        });
        started.inspect_err(|_| {
            let _ = checked!(sys::rs2_close, self.0.as_ptr());
        })
    }
}

/// What a sensor can stream. The profiles it shows are its own: they must not outlive it.
pub(super) struct ProfileList(NonNull<sys::rs2_stream_profile_list>);

impl Drop for ProfileList {
    fn drop(&mut self) {
        // SAFETY: made by `rs2_get_stream_profiles`, deleted once.
        unsafe { sys::rs2_delete_stream_profiles_list(self.0.as_ptr()) }
    }
}

impl ProfileList {
    /// How many there are.
    pub(super) fn n_profiles(&self) -> c_int {
        checked!(sys::rs2_get_stream_profiles_count, self.0.as_ptr()).unwrap_or(0)
    }

    fn pointer(&self, index: c_int) -> Option<NonNull<sys::rs2_stream_profile>> {
        let profile = checked!(sys::rs2_get_stream_profile, self.0.as_ptr(), index).ok()?;
        NonNull::new(profile.cast_mut())
    }

    /// One of them.
    pub(super) fn profile(&self, index: c_int) -> Option<StreamProfile> {
        StreamProfile::try_from(self.pointer(index)?).ok()
    }
}

/// A frame of any stream.
pub(super) enum AnyFrame {
    Color(ColorFrame),
    Depth(DepthFrame),
    Gyro(GyroFrame),
    Accel(AccelFrame),
}

/// A sensor that streams into a queue of its own, until it is stopped.
pub(super) struct RunningSensor {
    sensor: DeviceSensor,
    queue: NonNull<sys::rs2_frame_queue>,
}

// SAFETY: as of the sensor; the queue is made to be filled by one thread and read by others, under a lock of its own.
unsafe impl Send for RunningSensor {}
// SAFETY: as above; what is called on the sensor through a shared reference is its stop, which the SDK locks.
unsafe impl Sync for RunningSensor {}

impl Drop for RunningSensor {
    fn drop(&mut self) {
        self.stop();
        // SAFETY: made by `start`, deleted once, and no sensor fills it any more.
        unsafe { sys::rs2_delete_frame_queue(self.queue.as_ptr()) }
    }
}

impl RunningSensor {
    /// Opens some streams of a sensor, by their places in its list, and starts them; gives the sensor back where it cannot.
    pub(super) fn start(
        sensor: DeviceSensor,
        (profiles, chosen): (&ProfileList, &[c_int]),
        capacity: c_int,
    ) -> Result<Self, (DeviceSensor, String)> {
        match sensor.start((profiles, chosen), capacity) {
            Ok(queue) => Ok(Self { sensor, queue }),
            Err(what) => Err((sensor, what)),
        }
    }

    /// Stops the stream; nothing when it is stopped already, or the device is gone. A recording that is not played in real time waits
    /// for room in the queue first.
    pub(super) fn stop(&self) {
        // What goes wrong here is told to nobody: a device that is gone cannot be stopped.
        let _ = checked!(sys::rs2_stop, self.sensor.0.as_ptr());
        let _ = checked!(sys::rs2_close, self.sensor.0.as_ptr());
    }

    /// The next frame, waited for; `None` where none comes in time, or an unusable one.
    pub(super) fn next_frame(&self, timeout: Duration) -> Option<AnyFrame> {
        let mut frame: *mut sys::rs2_frame = null_mut();
        let timeout_ms = c_uint::try_from(timeout.as_millis()).unwrap_or(c_uint::MAX);
        let came = if timeout_ms == 0 {
            checked!(sys::rs2_poll_for_frame, self.queue.as_ptr(), &mut frame)
        } else {
            checked!(sys::rs2_try_wait_for_frame, self.queue.as_ptr(), timeout_ms, &mut frame)
        };
        let frame = NonNull::new(frame).filter(|_| came.is_ok_and(|came| came != 0))?;
        let is_a = |extension| {
            checked!(sys::rs2_is_frame_extendable_to, frame.as_ptr(), extension).is_ok_and(|is_it| is_it != 0)
        };
        let taken = if is_a(sys::rs2_extension_RS2_EXTENSION_DEPTH_FRAME) {
            DepthFrame::try_from(frame).map(AnyFrame::Depth)
        } else if is_a(sys::rs2_extension_RS2_EXTENSION_MOTION_FRAME) {
            match kind(frame) {
                Some(Rs2StreamKind::Accel) => AccelFrame::try_from(frame).map(AnyFrame::Accel),
                _ => GyroFrame::try_from(frame).map(AnyFrame::Gyro),
            }
        } else {
            ColorFrame::try_from(frame).map(AnyFrame::Color)
        };
        if taken.is_err() {
            // SAFETY: nobody has taken it, so that it is still ours to release, once.
            unsafe { sys::rs2_release_frame(frame.as_ptr()) }
        }
        taken.ok()
    }
}

/// Which stream a frame is of.
fn kind(frame: NonNull<sys::rs2_frame>) -> Option<Rs2StreamKind> {
    let profile = checked!(sys::rs2_get_frame_stream_profile, frame.as_ptr()).ok()?;
    StreamProfile::try_from(NonNull::new(profile.cast_mut())?).ok().map(|profile| profile.kind())
}

/// The bytes of an image, padding of rows included.
pub(super) fn bytes<K>(image: &ImageFrame<K>) -> &[u8] {
    // SAFETY: the SDK gives so many bytes at this address; they stay as they are while the frame is held, as the borrow says.
    unsafe {
        let data: *const std::ffi::c_void = image.get_data();
        std::slice::from_raw_parts(data.cast::<u8>(), image.get_data_size())
    }
}

/// Plays a recording as far apart as it was recorded, or as fast as its frames are taken.
pub(super) fn set_real_time(recording: &Device, real_time: bool) -> Result<(), String> {
    checked!(sys::rs2_playback_device_set_real_time, device_ptr(recording), c_int::from(real_time))
}

/// Holds a recording, or lets it go on.
pub(super) fn set_paused(recording: &Device, paused: bool) -> Result<(), String> {
    if paused {
        checked!(sys::rs2_playback_device_pause, device_ptr(recording))
    } else {
        checked!(sys::rs2_playback_device_resume, device_ptr(recording))
    }
}

/// Whether a recording has been played to its end.
pub(super) fn is_at_its_end(recording: &Device) -> bool {
    let status = checked!(sys::rs2_playback_device_get_current_status, device_ptr(recording));
    status == Ok(sys::rs2_playback_status_RS2_PLAYBACK_STATUS_STOPPED)
}
