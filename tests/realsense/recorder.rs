//! Recordings written by the SDK's own software device: streams that the test defines, pushed frame by frame through its recorder.
//!
//! The functions of the software device are in the library, not in `realsense-sys`: they are declared here as librealsense's
//! `h/rs_internal.h` of 2.56 does.
#![allow(unsafe_code, reason = "the C interface of the SDK; nothing of this is in the programs")]

use std::ffi::{CString, c_char, c_int, c_void};
use std::path::Path;
use std::ptr::null_mut;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use realsense_sys as sys;

type Error = *mut *mut sys::rs2_error;

/// One recorder at a time: the SDK (2.56) appends what `rs2_register_extrinsics` is told to a list of the whole process before it takes
/// its own lock, and two tests at once ended in a segmentation fault. Cameras and playback register in another way, which is locked.
static RECORDER: Mutex<()> = Mutex::new(());

/// Frames that the recorder has not written yet. Above 16 a stream the SDK drops what is pushed.
static IN_FLIGHT: AtomicUsize = AtomicUsize::new(0);
const MAX_IN_FLIGHT: usize = 8;

/// Number of the accelerometer among the streams of a device.
const ACCEL_ID: c_int = 3;

#[repr(C)]
struct VideoStream {
    stream: sys::rs2_stream,
    index: c_int,
    id: c_int,
    width: c_int,
    height: c_int,
    rate_hz: c_int,
    bytes_per_pixel: c_int,
    format: sys::rs2_format,
    intrinsics: sys::rs2_intrinsics,
}

#[repr(C)]
struct MotionStream {
    stream: sys::rs2_stream,
    index: c_int,
    id: c_int,
    rate_hz: c_int,
    format: sys::rs2_format,
    intrinsics: sys::rs2_motion_device_intrinsic,
}

#[repr(C)]
struct VideoFrameIn {
    pixels: *mut c_void,
    deleter: Option<unsafe extern "C" fn(*mut c_void)>,
    stride: c_int,
    bytes_per_pixel: c_int,
    timestamp_ms: f64,
    domain: sys::rs2_timestamp_domain,
    number: c_int,
    profile: *const sys::rs2_stream_profile,
    depth_unit_m: f32,
}

#[repr(C)]
struct MotionFrameIn {
    data: *mut c_void,
    deleter: Option<unsafe extern "C" fn(*mut c_void)>,
    timestamp_ms: f64,
    domain: sys::rs2_timestamp_domain,
    number: c_int,
    profile: *const sys::rs2_stream_profile,
}

unsafe extern "C" {
    fn rs2_create_software_device(error: Error) -> *mut sys::rs2_device;
    fn rs2_software_device_add_sensor(
        device: *mut sys::rs2_device,
        name: *const c_char,
        error: Error,
    ) -> *mut sys::rs2_sensor;
    fn rs2_software_device_register_info(
        device: *mut sys::rs2_device,
        info: sys::rs2_camera_info,
        value: *const c_char,
        error: Error,
    );
    fn rs2_software_sensor_add_video_stream_ex(
        sensor: *mut sys::rs2_sensor,
        stream: VideoStream,
        is_default: c_int,
        error: Error,
    ) -> *mut sys::rs2_stream_profile;
    fn rs2_software_sensor_add_motion_stream_ex(
        sensor: *mut sys::rs2_sensor,
        stream: MotionStream,
        is_default: c_int,
        error: Error,
    ) -> *mut sys::rs2_stream_profile;
    fn rs2_software_sensor_on_video_frame(sensor: *mut sys::rs2_sensor, frame: VideoFrameIn, error: Error);
    fn rs2_software_sensor_on_motion_frame(sensor: *mut sys::rs2_sensor, frame: MotionFrameIn, error: Error);
    fn rs2_software_sensor_add_read_only_option(
        sensor: *mut sys::rs2_sensor,
        option: sys::rs2_option,
        value: f32,
        error: Error,
    );
}

/// Calls a function of the SDK whose last argument is the error, and fails the test with what the error says.
macro_rules! sdk {
    ($function:path, $($argument:expr),* $(,)?) => {{
        let mut error: *mut sys::rs2_error = null_mut();
        // SAFETY: the arguments are what the test created and has not deleted.
        let answer = unsafe { $function($($argument,)* &mut error) };
        if !error.is_null() {
            // SAFETY: the SDK has set it; its message lives as long as it does.
            let what = unsafe { std::ffi::CStr::from_ptr(sys::rs2_get_error_message(error)) };
            panic!("{}: {}", stringify!($function), what.to_string_lossy());
        }
        answer
    }};
}

/// Intrinsics as the SDK has them.
#[derive(Debug, Clone, Copy)]
pub struct Lens {
    pub size: (i32, i32),
    /// fx, fy, ppx, ppy.
    pub pinhole: [f32; 4],
    pub model: sys::rs2_distortion,
    pub coeffs: [f32; 5],
}

/// What is recorded.
#[derive(Debug, Clone)]
pub struct Script {
    pub serial: String,
    pub color: Lens,
    pub depth: Lens,
    /// Rotation, column-major, and translation, m.
    pub color_from_depth: ([f32; 9], [f32; 3]),
    /// How the accelerometer is turned, column-major; `None` where the recording does not say.
    pub color_from_accel: Option<[f32; 9]>,
    pub depth_unit_m: f32,
    /// Of colour and depth, as the recording declares it.
    pub rate_hz: i32,
    /// How far behind its colour a depth image is.
    pub depth_late_ms: f64,
    /// The first is pushed three times before: the SDK loses what comes while its streams start.
    pub frames: Vec<Moment>,
    pub usb: &'static str,
}

/// One colour and depth image, and the IMU samples before it.
#[derive(Debug, Clone)]
pub struct Moment {
    pub stamp_ms: f64,
    /// RGB, row-major.
    pub rgb: Vec<u8>,
    pub depth: Vec<u16>,
    /// Stamp and rad/s.
    pub gyro: Vec<(f64, [f32; 3])>,
    /// Stamp and m/s².
    pub accel: Vec<(f64, [f32; 3])>,
}

impl Lens {
    fn intrinsics(&self) -> sys::rs2_intrinsics {
        let [fx, fy, ppx, ppy] = self.pinhole;
        sys::rs2_intrinsics {
            width: self.size.0,
            height: self.size.1,
            ppx,
            ppy,
            fx,
            fy,
            model: self.model,
            coeffs: self.coeffs,
        }
    }
}

struct Streams {
    depth: (*mut sys::rs2_sensor, *mut sys::rs2_stream_profile),
    color: (*mut sys::rs2_sensor, *mut sys::rs2_stream_profile),
    motion: *mut sys::rs2_sensor,
    gyro: *mut sys::rs2_stream_profile,
    accel: *mut sys::rs2_stream_profile,
    /// What stands in for the accelerometer where extrinsics are registered.
    stand_in: Option<(*mut sys::rs2_sensor, *mut sys::rs2_stream_profile)>,
}

/// Writes the recording; it is complete when this returns.
pub fn record(script: &Script, path: &Path) {
    let _alone = RECORDER.lock().unwrap_or_else(PoisonError::into_inner);
    IN_FLIGHT.store(0, Ordering::SeqCst);
    let device = sdk!(rs2_create_software_device,);
    for (info, value) in [
        (sys::rs2_camera_info_RS2_CAMERA_INFO_NAME, "Intel RealSense D435I"),
        (sys::rs2_camera_info_RS2_CAMERA_INFO_SERIAL_NUMBER, script.serial.as_str()),
        (sys::rs2_camera_info_RS2_CAMERA_INFO_FIRMWARE_VERSION, "5.15.1.0"),
        (sys::rs2_camera_info_RS2_CAMERA_INFO_PRODUCT_ID, "0B3A"),
        (sys::rs2_camera_info_RS2_CAMERA_INFO_USB_TYPE_DESCRIPTOR, script.usb),
    ] {
        let value = CString::new(value).unwrap();
        sdk!(rs2_software_device_register_info, device, info, value.as_ptr());
    }
    let streams = add_streams(script, device);
    if let Some(stand_in) = streams.stand_in {
        place_accel(script, stand_in);
    }
    let file = CString::new(path.to_str().unwrap()).unwrap();
    let recorder = sdk!(sys::rs2_create_record_device, device, file.as_ptr());
    let list = sdk!(sys::rs2_query_sensors, recorder);
    let queue = sdk!(sys::rs2_create_frame_queue, 1);
    let sensors: Vec<_> = (0..3).map(|index| sdk!(sys::rs2_create_sensor, list, index)).collect();
    let profiles: [&[*mut sys::rs2_stream_profile]; 3] =
        [&[streams.depth.1], &[streams.color.1], &[streams.accel, streams.gyro]];
    for (sensor, profiles) in sensors.iter().zip(profiles) {
        let mut profiles: Vec<*const sys::rs2_stream_profile> =
            profiles.iter().map(|profile| profile.cast_const()).collect();
        let n_profiles = c_int::try_from(profiles.len()).unwrap();
        sdk!(sys::rs2_open_multiple, *sensor, profiles.as_mut_ptr(), n_profiles);
        sdk!(sys::rs2_start_queue, *sensor, queue);
    }
    let pushed = push_all(script, &streams);
    for sensor in &sensors {
        sdk!(sys::rs2_stop, *sensor);
        sdk!(sys::rs2_close, *sensor);
    }
    // SAFETY: each was created above and is deleted once, what refers to another first.
    unsafe {
        sensors.into_iter().for_each(|sensor| sys::rs2_delete_sensor(sensor));
        sys::rs2_delete_frame_queue(queue);
        sys::rs2_delete_sensor_list(list);
        sys::rs2_delete_device(recorder);
        sys::rs2_delete_device(device);
    }
    drop(pushed);
}

fn add_streams(script: &Script, device: *mut sys::rs2_device) -> Streams {
    let sensor = |name: &str| {
        let name = CString::new(name).unwrap();
        sdk!(rs2_software_device_add_sensor, device, name.as_ptr())
    };
    let video = |sensor, stream, id, (lens, format, bytes_per_pixel): (&Lens, sys::rs2_format, c_int)| {
        let stream = VideoStream {
            stream,
            index: 0,
            id,
            width: lens.size.0,
            height: lens.size.1,
            rate_hz: script.rate_hz,
            bytes_per_pixel,
            format,
            intrinsics: lens.intrinsics(),
        };
        sdk!(rs2_software_sensor_add_video_stream_ex, sensor, stream, 1)
    };
    let motion = |sensor, stream, id, rate_hz| {
        let intrinsics = sys::rs2_motion_device_intrinsic {
            data: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
            noise_variances: [0.0; 3],
            bias_variances: [0.0; 3],
        };
        let format = sys::rs2_format_RS2_FORMAT_MOTION_XYZ32F;
        let stream = MotionStream { stream, index: 0, id, rate_hz, format, intrinsics };
        sdk!(rs2_software_sensor_add_motion_stream_ex, sensor, stream, 1)
    };
    let stereo = sensor("Stereo Module");
    let unit = sys::rs2_option_RS2_OPTION_DEPTH_UNITS;
    sdk!(rs2_software_sensor_add_read_only_option, stereo, unit, script.depth_unit_m);
    let z16 = (&script.depth, sys::rs2_format_RS2_FORMAT_Z16, 2);
    let depth = video(stereo, sys::rs2_stream_RS2_STREAM_DEPTH, 1, z16);
    let rgb = sensor("RGB Camera");
    let rgb8 = (&script.color, sys::rs2_format_RS2_FORMAT_RGB8, 3);
    let color = video(rgb, sys::rs2_stream_RS2_STREAM_COLOR, 2, rgb8);
    let imu = sensor("Motion Module");
    let accel = motion(imu, sys::rs2_stream_RS2_STREAM_ACCEL, ACCEL_ID, 100);
    let gyro = motion(imu, sys::rs2_stream_RS2_STREAM_GYRO, 4, 200);
    let (rotation, translation) = script.color_from_depth;
    sdk!(sys::rs2_register_extrinsics, depth, color, sys::rs2_extrinsics { rotation, translation });
    let stand_in = script.color_from_accel.map(|rotation| {
        let spare = sensor("Spare");
        let y8 = (&script.depth, sys::rs2_format_RS2_FORMAT_Y8, 1);
        let stand_in = video(spare, sys::rs2_stream_RS2_STREAM_INFRARED, ACCEL_ID, y8);
        let extrinsics = sys::rs2_extrinsics { rotation, translation: [-0.0202, 0.0051, 0.0117] };
        sdk!(sys::rs2_register_extrinsics, accel, color, extrinsics);
        sdk!(sys::rs2_register_extrinsics, stand_in, color, extrinsics);
        (spare, stand_in)
    });
    Streams { depth: (stereo, depth), color: (rgb, color), motion: imu, gyro, accel, stand_in }
}

/// Makes the software device know of the accelerometer's extrinsics, which it does of a stream by its number and only when an image of
/// that number comes (librealsense 2.56): one image of a stand-in does it, before there is a recorder.
fn place_accel(script: &Script, (sensor, profile): (*mut sys::rs2_sensor, *mut sys::rs2_stream_profile)) {
    let (width, height) = script.depth.size;
    let mut pixels = vec![0u8; usize::try_from(width * height).unwrap()];
    let queue = sdk!(sys::rs2_create_frame_queue, 1);
    sdk!(sys::rs2_open, sensor, profile.cast_const());
    sdk!(sys::rs2_start_queue, sensor, queue);
    wait_for_the_writer();
    let image = VideoFrameIn {
        pixels: pixels.as_mut_ptr().cast(),
        deleter: Some(written),
        stride: width,
        bytes_per_pixel: 1,
        timestamp_ms: 1.0,
        domain: sys::rs2_timestamp_domain_RS2_TIMESTAMP_DOMAIN_HARDWARE_CLOCK,
        number: 1,
        profile: profile.cast_const(),
        depth_unit_m: 0.0,
    };
    sdk!(rs2_software_sensor_on_video_frame, sensor, image);
    sdk!(sys::rs2_stop, sensor);
    sdk!(sys::rs2_close, sensor);
    // SAFETY: created above, deleted once; with it goes the image, whose pixels are dropped after it.
    unsafe { sys::rs2_delete_frame_queue(queue) };
    drop(pixels);
}

/// What was pushed, which the SDK reads from until the recorder is deleted.
fn push_all(script: &Script, streams: &Streams) -> Vec<Moment> {
    let first = script.frames.first().expect("a frame to record");
    let warm_up = (1..4).rev().map(|lead| {
        let stamp_ms = first.stamp_ms - 990.0 / f64::from(script.rate_hz) * f64::from(lead);
        Moment { stamp_ms, gyro: Vec::new(), accel: Vec::new(), ..first.clone() }
    });
    let mut moments: Vec<Moment> = warm_up.chain(script.frames.iter().cloned()).collect();
    let mut n_samples = 0;
    for (number, moment) in (1..).zip(&mut moments) {
        for (samples, profile) in [(&mut moment.gyro, streams.gyro), (&mut moment.accel, streams.accel)] {
            for (stamp_ms, xyz) in samples {
                n_samples += 1;
                let frame = MotionFrameIn {
                    data: xyz.as_mut_ptr().cast(),
                    deleter: Some(written),
                    timestamp_ms: *stamp_ms,
                    domain: sys::rs2_timestamp_domain_RS2_TIMESTAMP_DOMAIN_HARDWARE_CLOCK,
                    number: n_samples,
                    profile,
                };
                wait_for_the_writer();
                sdk!(rs2_software_sensor_on_motion_frame, streams.motion, frame);
            }
        }
        let stamp_ms = moment.stamp_ms;
        let image =
            |pixels: *mut c_void,
             (lens, bytes_per_pixel): (&Lens, c_int),
             (profile, late_ms): (*mut sys::rs2_stream_profile, f64)| VideoFrameIn {
                pixels,
                deleter: Some(written),
                stride: lens.size.0 * bytes_per_pixel,
                bytes_per_pixel,
                timestamp_ms: stamp_ms + late_ms,
                domain: sys::rs2_timestamp_domain_RS2_TIMESTAMP_DOMAIN_HARDWARE_CLOCK,
                number,
                profile,
                depth_unit_m: script.depth_unit_m,
            };
        wait_for_the_writer();
        let late = (streams.depth.1, script.depth_late_ms);
        let depth = image(moment.depth.as_mut_ptr().cast(), (&script.depth, 2), late);
        sdk!(rs2_software_sensor_on_video_frame, streams.depth.0, depth);
        wait_for_the_writer();
        let color = image(moment.rgb.as_mut_ptr().cast(), (&script.color, 3), (streams.color.1, 0.0));
        sdk!(rs2_software_sensor_on_video_frame, streams.color.0, color);
    }
    moments
}

/// Waits until one more frame surely finds a buffer, and counts it.
fn wait_for_the_writer() {
    let until = Instant::now() + Duration::from_secs(20);
    while IN_FLIGHT.load(Ordering::SeqCst) >= MAX_IN_FLIGHT {
        assert!(Instant::now() < until, "the recorder writes nothing");
        thread::sleep(Duration::from_micros(200));
    }
    IN_FLIGHT.fetch_add(1, Ordering::SeqCst);
}

/// Called when the SDK has done with a frame. The pixels are the test's, which frees them itself.
unsafe extern "C" fn written(_pixels: *mut c_void) {
    IN_FLIGHT.fetch_sub(1, Ordering::SeqCst);
}
