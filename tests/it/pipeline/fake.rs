//! Cameras in memory that a test steers while they run: 64 x 48 px, 200 frames per second, all by one clock.

use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use pelical::capture::{
    CameraInfo, CaptureError, DeviceFactory, FrameSource, FrameTiming, RgbdFrame, SpecificForce, StampClock,
    StampNs,
};
use pelical::geometry::camera::Pinhole;
use pelical::geometry::{Camera, Distortion};
use pelical::pipeline::CameraSlot;

pub const SIZE: (usize, usize) = (64, 48);
pub const PERIOD: Duration = Duration::from_millis(5);
/// Stamps of camera `i` lie `i` times this behind those of camera 0.
pub const SKEW: Duration = Duration::from_millis(1);
/// Stamps have nothing to do with any wall clock.
pub const FIRST_STAMP_NS: i64 = -7_000_000_000;

/// What a camera does when it is asked for a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mode {
    Run,
    Stall,
    Unplugged,
    /// Does not come back from `next_frame`.
    Hang,
    /// Frames of another size than promised.
    WrongSize,
    /// The same frames and stamps, but told to be of the camera's own clock.
    OwnClock,
    End,
    /// Is there, but does not open for us.
    Refuse,
    /// Is there, but fails when it is opened.
    Fail,
}

const MODES: [Mode; 9] = [
    Mode::Run,
    Mode::Stall,
    Mode::Unplugged,
    Mode::Hang,
    Mode::WrongSize,
    Mode::OwnClock,
    Mode::End,
    Mode::Refuse,
    Mode::Fail,
];

/// The test's hand on a camera.
#[derive(Debug)]
pub struct Control {
    mode: AtomicU8,
    /// Pixels by which the image moves per frame.
    pub shift_px: AtomicU64,
    /// How often it was opened, in vain too, and reset.
    pub openings: AtomicU64,
    pub resets: AtomicU64,
}

impl Control {
    pub fn set(&self, mode: Mode) {
        self.mode.store(mode as u8, Ordering::SeqCst);
    }

    fn mode(&self) -> Mode {
        MODES[usize::from(self.mode.load(Ordering::SeqCst))]
    }
}

pub fn intrinsics() -> Camera {
    let pinhole = Pinhole { fx_px: 60.0, fy_px: 60.0, cx_px: 31.5, cy_px: 23.5 };
    Camera::try_new((SIZE.0 as u32, SIZE.1 as u32), pinhole, Distortion::None).expect("valid intrinsics")
}

struct FakeFactory {
    info: CameraInfo,
    index: u32,
    control: Arc<Control>,
    start: Instant,
}

/// Cameras of these names, and a control for each.
pub fn rig(names: &[&str]) -> (Vec<CameraSlot>, Vec<Arc<Control>>) {
    let start = Instant::now();
    let mut slots = Vec::new();
    let mut controls = Vec::new();
    for (index, name) in (0..).zip(names) {
        let control = Arc::new(Control {
            mode: AtomicU8::new(Mode::Run as u8),
            shift_px: AtomicU64::new(0),
            openings: AtomicU64::new(0),
            resets: AtomicU64::new(0),
        });
        let serial = format!("serial of {name}");
        let info = CameraInfo {
            name: (*name).to_owned(),
            serial: serial.clone(),
            camera: intrinsics(),
            depth_camera: None,
            depth_unit_m: 0.001,
            firmware: None,
        };
        let factory = FakeFactory { info, index, control: Arc::clone(&control), start };
        slots.push(CameraSlot { factory: Arc::new(factory), serial, name: (*name).to_owned() });
        controls.push(control);
    }
    (slots, controls)
}

impl DeviceFactory for FakeFactory {
    fn name(&self) -> &'static str {
        "fake"
    }

    fn list(&self) -> Result<Vec<CameraInfo>, CaptureError> {
        Ok(vec![self.info.clone()])
    }

    fn open(&self, serial: &str) -> Result<Box<dyn FrameSource>, CaptureError> {
        self.control.openings.fetch_add(1, Ordering::SeqCst);
        let (serial, what) = (serial.to_owned(), String::new());
        match self.control.mode() {
            Mode::Unplugged => return Err(CaptureError::NotFound { serial, available: what }),
            Mode::Refuse => return Err(CaptureError::Refused { serial, what }),
            Mode::Fail => return Err(CaptureError::Device { serial, what }),
            _ => {}
        }
        let number = (self.start.elapsed().as_nanos() / PERIOD.as_nanos()) as u64;
        Ok(Box::new(FakeSource {
            info: self.info.clone(),
            index: self.index,
            control: Arc::clone(&self.control),
            start: self.start,
            number,
        }))
    }

    fn reset(&self, serial: &str) -> Result<bool, CaptureError> {
        if self.control.mode() == Mode::Unplugged {
            return Err(CaptureError::NotFound { serial: serial.to_owned(), available: String::new() });
        }
        self.control.resets.fetch_add(1, Ordering::SeqCst);
        Ok(true)
    }
}

struct FakeSource {
    info: CameraInfo,
    index: u32,
    control: Arc<Control>,
    start: Instant,
    number: u64,
}

impl FrameSource for FakeSource {
    fn info(&self) -> &CameraInfo {
        &self.info
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        match self.control.mode() {
            Mode::Run | Mode::WrongSize | Mode::OwnClock => {}
            Mode::Stall => {
                std::thread::sleep(timeout);
                return Err(CaptureError::Timeout(timeout));
            }
            Mode::Hang => {
                // The device's own time, not the test's: it hangs until the test lets go.
                while self.control.mode() == Mode::Hang {
                    std::thread::sleep(Duration::from_millis(1));
                }
                return Err(CaptureError::Timeout(timeout));
            }
            Mode::Unplugged => return Err(CaptureError::Unplugged(self.info.name.clone())),
            Mode::End => return Err(CaptureError::EndOfStream),
            Mode::Refuse | Mode::Fail => {
                let serial = self.info.serial.clone();
                return Err(CaptureError::Device { serial, what: "a fault".to_owned() });
            }
        }
        let due = self.start + PERIOD * self.number as u32;
        std::thread::sleep(due.saturating_duration_since(Instant::now()));
        // Like a device: what was due long ago is lost.
        self.number = self.number.max((self.start.elapsed().as_nanos() / PERIOD.as_nanos()) as u64);
        self.fill(frame);
        self.number += 1;
        Ok(())
    }
}

impl FakeSource {
    fn fill(&self, frame: &mut RgbdFrame) {
        let (width, height) = SIZE;
        let since_first = PERIOD * self.number as u32 + SKEW * self.index;
        frame.stamp = StampNs(FIRST_STAMP_NS + since_first.as_nanos() as i64);
        frame.sequence = self.number;
        let mean_m_per_s2 = nalgebra::Vector3::new(0.0, -SpecificForce::AT_REST_M_PER_S2, 0.0);
        frame.specific_force = Some(SpecificForce { mean_m_per_s2 });
        let is_own = self.control.mode() == Mode::OwnClock;
        let clock = if is_own { StampClock::Device } else { StampClock::Translated };
        frame.timing = FrameTiming { clock, arrival_ns: Some(0) };
        (frame.width, frame.height) = SIZE;
        if self.control.mode() == Mode::WrongSize {
            frame.width = 2 * width;
        }
        frame.depth_unit_m = self.info.depth_unit_m;
        frame.depth.clear();
        frame.depth.extend((0..width * height).map(|_| 1000));
        frame.rgb.clear();
        let shift = self.number * self.control.shift_px.load(Ordering::SeqCst);
        // A wall with bright and dark panels: straight edges with depth.
        let panel = |i: usize| if (((i % width) as u64 + shift) / 20).is_multiple_of(2) { 60 } else { 180 };
        frame.rgb.extend((0..width * height).flat_map(|i| [panel(i); 3]));
    }
}
