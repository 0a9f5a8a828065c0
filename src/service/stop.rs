//! The wish to stop, as a flag: set by SIGTERM, by SIGINT, or by whoever runs the service in its own process.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGINT, SIGTERM};

use super::error::ServiceError;

/// Once set, it stays set.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Is set by the signals that ask a service to end.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn on_signals() -> Result<Self, ServiceError> {
        let stop = Self::default();
        for signal in [SIGTERM, SIGINT] {
            signal_hook::flag::register(signal, Arc::clone(&stop.0))
                .map_err(|source| ServiceError::System { what: "cannot listen for signals", source })?;
        }
        Ok(stop)
    }

    /// Whether it is time to stop.
    pub fn is_set(&self) -> bool {
        // Relaxed: nothing is handed over with the flag.
        self.0.load(Ordering::Relaxed)
    }
}
