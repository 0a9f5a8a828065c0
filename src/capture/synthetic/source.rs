//! An open synthetic camera: which frame is due, when, and where its pictures come from.

use std::sync::Arc;
use std::time::{Duration, Instant};

use nalgebra::Vector3;

use super::World;
use super::options::Pace;
use super::view::View;
use crate::capture::{CameraInfo, CaptureError, FrameSource, RgbdFrame, SpecificForce, StampNs, TurnRate};
use crate::geometry::motion::{Motion, rotation_gap_rad};

/// One open camera.
#[derive(Debug)]
pub(super) struct SyntheticSource {
    world: Arc<World>,
    camera: usize,
    /// The frame set to deliver next.
    next: u64,
    view: View,
    /// Frames rendered ahead, repeated in turn; empty without.
    ahead: Vec<RgbdFrame>,
}

impl SyntheticSource {
    pub(super) fn new(world: Arc<World>, camera: usize) -> Self {
        let options = &world.options;
        let mut view = View::new(&world.scene, options, camera);
        let ahead = (0..options.render_ahead.unwrap_or(0) as u64)
            .map(|frame_set| {
                let mut frame = RgbdFrame::default();
                view.render(
                    &world.scene,
                    (&world.world_from_camera(camera, frame_set), frame_set),
                    &mut frame,
                );
                frame
            })
            .collect();
        Self { world, camera, next: 0, view, ahead }
    }

    /// Waits until a frame is due; skips frames that nobody took in time.
    fn wait(&mut self, timeout: Duration) -> Result<(), CaptureError> {
        let options = &self.world.options;
        if options.pace == Pace::Unpaced {
            return Ok(());
        }
        let period_ns = options.period.as_nanos().max(1);
        let elapsed_ns = self.world.epoch.get_or_init(Instant::now).elapsed().as_nanos();
        let newest = u64::try_from(elapsed_ns / period_ns).unwrap_or(u64::MAX);
        self.next = self.next.max(newest);
        let due_ns = u128::from(self.next) * period_ns;
        let wait = Duration::from_nanos(u64::try_from(due_ns.saturating_sub(elapsed_ns)).unwrap_or(u64::MAX));
        std::thread::sleep(wait.min(timeout));
        if wait > timeout { Err(CaptureError::Timeout(timeout)) } else { Ok(()) }
    }
}

impl SyntheticSource {
    /// How fast the camera turned from the pictures of the frame before to those of this one; none for the first, and without a
    /// gyro.
    fn turn_rate(&self, number: u64) -> Option<TurnRate> {
        let before = number.checked_sub(1).filter(|_| self.world.options.has_gyro)?;
        let turned_rad = rotation_gap_rad(&self.pose(before), &self.pose(number));
        let period_s = self.world.options.period.as_secs_f64().max(1e-9);
        Some(TurnRate { max_rad_per_s: turned_rad / period_s })
    }

    /// Up in the camera's axes, as long as gravity; the rig's own acceleration is neglected. None without an accelerometer.
    fn specific_force(&self, number: u64) -> Option<SpecificForce> {
        let up_m_per_s2 = SpecificForce::AT_REST_M_PER_S2 * Vector3::z();
        let mean_m_per_s2 = self.pose(number).inverse_transform_vector(&up_m_per_s2);
        self.world.options.has_accel.then_some(SpecificForce { mean_m_per_s2 })
    }

    /// From where the pictures of a frame are taken.
    fn pose(&self, number: u64) -> Motion {
        let shown = number.checked_rem(self.ahead.len() as u64).unwrap_or(number);
        self.world.world_from_camera(self.camera, shown)
    }
}

impl FrameSource for SyntheticSource {
    fn info(&self) -> &CameraInfo {
        &self.world.options.cameras[self.camera].info
    }

    fn next_frame(&mut self, frame: &mut RgbdFrame, timeout: Duration) -> Result<(), CaptureError> {
        (frame.width, frame.height) = (0, 0);
        self.wait(timeout)?;
        let number = self.next;
        if self.world.options.frame_sets.is_some_and(|count| number >= count) {
            return Err(CaptureError::EndOfStream);
        }
        match self.ahead.len() as u64 {
            0 => {
                let world_from_camera = self.world.world_from_camera(self.camera, number);
                self.view.render(&self.world.scene, (&world_from_camera, number), frame);
            }
            count => copy(&self.ahead[(number % count) as usize], frame),
        }
        frame.turn_rate = self.turn_rate(number);
        frame.specific_force = self.specific_force(number);
        frame.sequence = number;
        let stamp_ns = u128::from(number) * self.world.options.period.as_nanos();
        frame.stamp = StampNs(i64::try_from(stamp_ns).unwrap_or(i64::MAX));
        self.next = number + 1;
        Ok(())
    }
}

/// Copies the pictures; the buffers of `to` are reused.
fn copy(from: &RgbdFrame, to: &mut RgbdFrame) {
    (to.width, to.height, to.depth_unit_m) = (from.width, from.height, from.depth_unit_m);
    to.rgb.clone_from(&from.rgb);
    to.depth.clone_from(&from.depth);
}
