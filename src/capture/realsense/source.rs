//! One open RealSense camera: its streams, brought together to frames.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use nalgebra::UnitQuaternion;
use realsense_rust::device::Device;
use realsense_rust::frame::{ColorFrame, DepthFrame, FrameEx, ImageFrame};
use realsense_rust::kind::{Rs2StreamKind, Rs2TimestampDomain};

use super::age::AgeAlarm;
use super::clock::{WrappingClock, ns_from_ms};
use super::device;
use super::factory::{Recording, Session};
use super::forces::Forces;
use super::obstacle::Obstacle;
use super::options::{Pace, RealsenseOptions};
use super::pairing::{Pairing, Stream};
use super::pixels::{self, Layout};
use super::raw::{self, AnyFrame};
use super::settings;
use super::streams::Streams;
use super::turning::Turning;
use crate::capture::{CameraInfo, CaptureError, FrameSource, FrameTiming, RgbdFrame, StampClock, StampNs};

/// Longest wait for one stream before the others are looked after.
const SLICE: Duration = Duration::from_millis(20);
/// How long a frame waits for the samples up to its stamp: live, and where nobody is in a hurry.
const MOTION_WAIT: (Duration, Duration) = (Duration::from_millis(4), Duration::from_millis(100));
/// After so long without frames a camera is asked for on the bus, and so often.
const SILENCE: Duration = Duration::from_secs(1);
/// A recording in no hurry loses no image of one stream for want of the other, unless that one says nothing for so long.
const LOSSLESS_WAIT: Duration = Duration::from_secs(1);

/// A colour image, its domain and arrival.
type ColorImage = (ColorFrame, StampClock, i64);

/// An open camera or recording.
pub(super) struct RealsenseSource {
    info: CameraInfo,
    /// Images are given back to the SDK before its sensors stop.
    pairing: Pairing<ColorImage, DepthFrame>,
    streams: Streams,
    turning: Turning,
    /// `None` where no accelerometer is read.
    forces: Option<Forces>,
    clock: WrappingClock,
    origin: Origin,
    alarm: AgeAlarm,
    told_clock: bool,
    last_frame: Instant,
    /// When a stream that was waited for gave an image last.
    last_answer: Instant,
}

/// Where the frames come from; dropped last.
enum Origin {
    Live { session: Session, asked: Instant },
    Recorded { recording: Recording, pace: Pace, ended: bool },
}

impl RealsenseSource {
    /// Starts a camera.
    pub(super) fn live(
        device: Device,
        session: Session,
        options: &RealsenseOptions,
    ) -> Result<Self, CaptureError> {
        let serial = device::serial(&device);
        let plan = device::plan(&device, options).map_err(|obstacle| obstacle.of(&serial))?;
        let told = |what: String| Obstacle::told(what).of(&serial);
        let sensors = raw::DeviceSensor::all(&device).map_err(told)?;
        settings::apply(&sensors, options, &serial);
        let streams = Streams::of_camera(plan.sensors).map_err(told)?;
        let origin = Origin::Live { session, asked: Instant::now() };
        let camera = (plan.info, plan.rate_hz, plan.color_from_accel);
        Ok(Self::new(camera, (streams, origin), options))
    }

    /// Starts playing a recording, from its first frame.
    pub(super) fn recorded(recording: Recording, options: &RealsenseOptions) -> Result<Self, CaptureError> {
        let serial = device::serial(&recording.device);
        let refused = |what: String| CaptureError::device(&serial, what);
        let plan = device::plan(&recording.device, options).map_err(|obstacle| obstacle.of(&serial))?;
        raw::set_real_time(&recording.device, options.pace == Pace::RealTime).map_err(refused)?;
        let streams = Streams::of_recording(plan.sensors, &recording.device).map_err(refused)?;
        let origin = Origin::Recorded { recording, pace: options.pace, ended: false };
        let camera = (plan.info, plan.rate_hz, plan.color_from_accel);
        Ok(Self::new(camera, (streams, origin), options))
    }

    fn new(
        (info, rate_hz, color_from_accel): (CameraInfo, f64, Option<UnitQuaternion<f64>>),
        (streams, origin): (Streams, Origin),
        options: &RealsenseOptions,
    ) -> Self {
        Self {
            info,
            pairing: Pairing::for_rate(rate_hz),
            streams,
            turning: Turning::default(),
            forces: color_from_accel.map(Forces::new),
            clock: WrappingClock::default(),
            origin,
            alarm: AgeAlarm::new(options.late_after),
            told_clock: false,
            last_frame: Instant::now(),
            last_answer: Instant::now(),
        }
    }

    /// Waits for a stream; while it says nothing, the others are looked after.
    fn wait_for(&mut self, stream: Rs2StreamKind, timeout: Duration) {
        let awaited = self.streams.position(stream);
        if let Some(frame) = awaited.and_then(|at| self.streams.next_frame(at, timeout)) {
            self.last_answer = Instant::now();
            return self.take(frame);
        }
        let is_lossless = matches!(&self.origin, Origin::Recorded { pace: Pace::Unpaced, .. })
            && self.last_answer.elapsed() < LOSSLESS_WAIT;
        for at in (0..self.streams.len()).filter(|&at| Some(at) != awaited) {
            while !(is_lossless && self.pairing.is_full()) {
                let Some(frame) = self.streams.next_frame(at, Duration::ZERO) else { break };
                self.take(frame);
            }
        }
    }

    fn take(&mut self, frame: AnyFrame) {
        match frame {
            AnyFrame::Color(image) => {
                if let Some((stamp_ns, clock)) = self.stamp(image.timestamp(), image.timestamp_domain()) {
                    self.pairing.add_color(stamp_ns, (image, clock, wall_clock_ns()));
                }
            }
            AnyFrame::Depth(image) => {
                if let Some((stamp_ns, _)) = self.stamp(image.timestamp(), image.timestamp_domain()) {
                    self.pairing.add_depth(stamp_ns, image);
                }
            }
            AnyFrame::Accel(sample) => {
                let stamp = self.stamp(sample.timestamp(), sample.timestamp_domain());
                if let (Some((stamp_ns, _)), Some(forces)) = (stamp, &mut self.forces) {
                    forces.add(stamp_ns, *sample.acceleration());
                }
            }
            AnyFrame::Gyro(sample) => {
                if let Some((stamp_ns, _)) = self.stamp(sample.timestamp(), sample.timestamp_domain()) {
                    self.turning.add(stamp_ns, *sample.rotational_velocity());
                }
            }
        }
    }

    /// A stamp of any stream on the clock that goes on; `None` where it is no time.
    fn stamp(&mut self, ms: f64, domain: Rs2TimestampDomain) -> Option<(i64, StampClock)> {
        let ns = ns_from_ms(ms)?;
        Some(match domain {
            Rs2TimestampDomain::HardwareClock => (self.clock.unwrapped(ns), StampClock::Device),
            Rs2TimestampDomain::GlobalTime => (ns, StampClock::Translated),
            Rs2TimestampDomain::SystemTime => (ns, StampClock::Host),
        })
    }

    /// What turned and accelerated since the last frame.
    fn gather_motion(&mut self, stamp_ns: i64) {
        let [gyro, accel] =
            [Rs2StreamKind::Gyro, Rs2StreamKind::Accel].map(|kind| self.streams.position(kind));
        let Some(sensor) = gyro.or(accel) else { return };
        let is_hurried = !matches!(&self.origin, Origin::Recorded { pace: Pace::Unpaced, .. });
        let until = Instant::now() + if is_hurried { MOTION_WAIT.0 } else { MOTION_WAIT.1 };
        loop {
            let is_turn_missing = gyro.is_some() && !self.turning.reaches(stamp_ns);
            // A live frame never waits for the accelerometer, which decides nothing.
            let is_force_missing = accel.is_some()
                && !is_hurried
                && self.forces.as_ref().is_some_and(|forces| !forces.reaches(stamp_ns));
            let left = until.saturating_duration_since(Instant::now());
            let wait = if is_turn_missing || is_force_missing { left } else { Duration::ZERO };
            let Some(frame) = self.streams.next_frame(sensor, wait) else { return };
            self.take(frame);
        }
    }

    fn fill(
        &mut self,
        frame: &mut RgbdFrame,
        (stamp_ns, (color, clock, arrival_ns), depth): (i64, ColorImage, DepthFrame),
    ) -> Result<(), CaptureError> {
        let refused = |what: &str| CaptureError::device(&self.info.serial, what);
        pixels::copy_rgb(raw::bytes(&color), layout(&color), &mut frame.rgb)
            .ok_or_else(|| refused("a colour image is not as large as it says"))?;
        pixels::copy_depth(raw::bytes(&depth), layout(&depth), &mut frame.depth)
            .ok_or_else(|| refused("a depth image is not as large as it says"))?;
        (frame.width, frame.height) = (color.width(), color.height());
        (frame.stamp, frame.sequence) = (StampNs(stamp_ns), color.frame_number());
        (frame.depth_camera, frame.depth_unit_m) = (self.info.depth_camera, self.info.depth_unit_m);
        frame.turn_rate = self.turning.until(stamp_ns);
        frame.specific_force = self.forces.as_mut().and_then(|forces| forces.until(stamp_ns));
        let is_live = matches!(self.origin, Origin::Live { .. });
        frame.timing = FrameTiming { clock, arrival_ns: is_live.then_some(arrival_ns) };
        self.watch_time(stamp_ns, &frame.timing);
        Ok(())
    }

    /// Says what is wrong with the clocks, once, and with late frames, now and then.
    fn watch_time(&mut self, stamp_ns: i64, timing: &FrameTiming) {
        let (serial, now) = (&self.info.serial, Instant::now());
        self.last_frame = now;
        let Some(arrival_ns) = timing.arrival_ns else { return };
        if !std::mem::replace(&mut self.told_clock, true) {
            match timing.clock {
                StampClock::Host => tracing::warn!(
                    serial,
                    "stamps are times of arrival: the kernel passes no metadata on (librealsense's kernel patches, or its \
                     user-space back end)"
                ),
                StampClock::Device => tracing::warn!(
                    serial,
                    "stamps are of the camera's own clock: they form sets with those of no other camera \
                     (cameras.realsense.global_time)"
                ),
                StampClock::Translated | StampClock::Source => {}
            }
        }
        if !matches!(timing.clock, StampClock::Translated | StampClock::Host) {
            return;
        }
        if let Some(late) = self.alarm.on_frame(stamp_ns, arrival_ns, now) {
            let age_ms = late.age.as_millis() as u64;
            tracing::warn!(
                serial,
                age_ms,
                n_late = late.n_late,
                "frames are old when they arrive: bus or host is overloaded"
            );
        }
    }

    /// Why there is no frame.
    fn nothing(&mut self, timeout: Duration) -> CaptureError {
        let serial = &self.info.serial;
        match &mut self.origin {
            Origin::Recorded { recording, ended, .. } => {
                // What was read last may still be on its way: the end counts when it is found a second time.
                let was_ended = std::mem::replace(ended, raw::is_at_its_end(&recording.device));
                if was_ended && *ended {
                    return CaptureError::EndOfStream;
                }
            }
            Origin::Live { session, asked } => {
                if self.last_frame.elapsed() >= SILENCE && asked.elapsed() >= SILENCE {
                    *asked = Instant::now();
                    if !session.has(serial) {
                        return CaptureError::Unplugged(serial.clone());
                    }
                }
            }
        }
        CaptureError::Timeout(timeout)
    }
}

impl FrameSource for RealsenseSource {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        (frame.width, frame.height) = (0, 0);
        let until = Instant::now() + timeout;
        loop {
            let missing = match self.pairing.next_pair() {
                Ok(images) => {
                    self.gather_motion(images.0);
                    let filled = self.fill(frame, images);
                    if filled.is_err() {
                        (frame.width, frame.height) = (0, 0);
                    }
                    return filled;
                }
                Err(Stream::Color) => Rs2StreamKind::Color,
                Err(Stream::Depth) => Rs2StreamKind::Depth,
            };
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(self.nothing(timeout));
            }
            self.wait_for(missing, left.min(SLICE));
        }
    }
}

fn layout<K>(image: &ImageFrame<K>) -> Layout {
    Layout { width_px: image.width(), height_px: image.height(), stride_bytes: image.stride() }
}

fn wall_clock_ns() -> i64 {
    let since_epoch = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX)
}
