//! The section `service`: what the service manager (systemd) is told.

use serde::{Deserialize, Serialize};

/// `service`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct ServiceSection {
    /// When the service counts as ready, for those that are started after it.
    pub ready_when: ReadyWhen,
}

impl Default for ServiceSection {
    fn default() -> Self {
        // A robot has to boot with a camera unplugged, too.
        Self { ready_when: ReadyWhen::Started }
    }
}

/// When the service counts as ready. Once it is, it stays so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ReadyWhen {
    /// Clients are answered and cameras are looked for; none needs to be there.
    Started,
    /// Every camera delivers frames.
    Cameras,
    /// There is a converged result.
    Calibrated,
}
