//! A client that looks at everything a daemon publishes while a fault lasts: nothing wrong may be among it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use pelical::geometry::motion::Motion;
use pelical::ipc::{CalibrationMessage, Client, InstanceName, Transport};
use pelical::solver::State;

/// A result further from the truth is wrong, deg and mm: the limits of `pelical evaluate`.
const WRONG_BEYOND: (f64, f64) = (0.5, 15.0);
const LOOK: Duration = Duration::from_millis(100);

/// What was published so far.
#[derive(Debug, Clone, Default)]
pub struct Audited {
    pub messages: usize,
    pub converged: usize,
    /// Largest distance of a converged or stored result from the truth, deg and mm.
    pub worst: (f64, f64),
    /// What must not be.
    pub wrong: Vec<String>,
}

/// Looks on until it is finished.
pub struct Audit {
    is_over: Arc<AtomicBool>,
    seen: Arc<Mutex<Audited>>,
    thread: Option<JoinHandle<()>>,
}

impl Audit {
    /// `truth` is `reference_from_camera` by camera.
    pub fn start(transport: Transport, instance: InstanceName, truth: Vec<Motion>) -> Self {
        let (is_over, seen) = (Arc::<AtomicBool>::default(), Arc::<Mutex<Audited>>::default());
        let (ends, notes) = (Arc::clone(&is_over), Arc::clone(&seen));
        let thread = std::thread::spawn(move || {
            let mut client = None;
            // Relaxed: nothing is handed over with the flag.
            while !ends.load(Ordering::Relaxed) {
                if client.is_none() {
                    client = Client::connect_over(&transport, &instance).ok();
                }
                match client.as_mut().map(|client| client.wait_calibration(LOOK)) {
                    Some(Ok(Some(message))) => judge(&message, &truth, &mut locked(&notes)),
                    Some(Ok(None)) => {}
                    // Killed, or not there yet.
                    Some(Err(_)) | None => {
                        client = None;
                        std::thread::sleep(LOOK / 10);
                    }
                }
            }
        });
        Self { is_over, seen, thread: Some(thread) }
    }

    /// So far.
    pub fn seen(&self) -> Audited {
        locked(&self.seen).clone()
    }
}

impl Drop for Audit {
    fn drop(&mut self) {
        // Relaxed: as above.
        self.is_over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn locked(seen: &Mutex<Audited>) -> std::sync::MutexGuard<'_, Audited> {
    seen.lock().unwrap_or_else(PoisonError::into_inner)
}

fn judge(message: &CalibrationMessage, truth: &[Motion], seen: &mut Audited) {
    seen.messages += 1;
    let state = message.calibration.state;
    if !matches!(state, State::Converged | State::Stored) {
        return;
    }
    seen.converged += usize::from(state == State::Converged);
    match distance(message, truth) {
        Some((deg, mm)) => {
            seen.worst = (seen.worst.0.max(deg), seen.worst.1.max(mm));
            if deg > WRONG_BEYOND.0 || mm > WRONG_BEYOND.1 {
                seen.wrong.push(format!("{} {deg:.2} deg, {mm:.1} mm from the truth", state.name()));
            }
        }
        None => seen.wrong.push(format!("{} without the pose of every camera", state.name())),
    }
}

/// Largest distance of a camera from the truth, deg and mm; `None` when a camera has no pose.
pub fn distance(message: &CalibrationMessage, truth: &[Motion]) -> Option<(f64, f64)> {
    let cameras = &message.calibration.cameras;
    let mut worst = (0.0f64, 0.0f64);
    for (pose, truth) in cameras.iter().zip(truth) {
        let found = pose.as_ref()?.reference_from_camera;
        let deg = (found.rotation.inverse() * truth.rotation).angle().to_degrees();
        let mm = (found.translation.vector - truth.translation.vector).norm() * 1e3;
        worst = (worst.0.max(deg), worst.1.max(mm));
    }
    (cameras.len() == truth.len()).then_some(worst)
}
