//! What the daemon has kept: provenance of a calibration, and the list of `history`.

use std::fmt::Write as _;

use serde::Serialize;

use super::text::table;
use super::time::{age_in_words, age_s, utc};
use crate::ipc::{CalibrationMessage, CameraIdentity, InstanceName, Snapshot};

/// Where a published calibration comes from.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ProvenanceEntry {
    /// Its number in the history; null where it is not kept.
    pub id: Option<u64>,
    /// When it was made, RFC 3339.
    pub made: String,
    /// Since then; null when the clock stands before that.
    pub age_s: Option<f64>,
    /// The number of the older one that somebody went back to; null for none.
    pub restored_from: Option<u64>,
    /// Version of the program that made it.
    pub version: String,
    /// SHA-256 of the effective config it was made with.
    pub config_sha256: String,
    /// Every camera, the reference too.
    pub cameras: Vec<IdentityEntry>,
}

/// Which camera it is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct IdentityEntry {
    /// Name in the rig.
    pub name: String,
    /// Serial number.
    pub serial: String,
    /// Firmware; null where the back end does not tell it.
    pub firmware: Option<String>,
}

impl ProvenanceEntry {
    /// That of a message, as of now.
    pub fn new(message: &CalibrationMessage, now_ns: u64) -> Self {
        let identity = |camera: &CameraIdentity| IdentityEntry {
            name: camera.name.clone(),
            serial: camera.serial.clone(),
            firmware: camera.firmware.clone(),
        };
        let provenance = &message.provenance;
        Self {
            id: provenance.id,
            made: utc(message.stamp_ns),
            age_s: age_s(message.stamp_ns, now_ns),
            restored_from: provenance.restored_from,
            version: provenance.version.clone(),
            config_sha256: provenance.config_hash.clone(),
            cameras: message.cameras.iter().map(identity).collect(),
        }
    }

    /// For people: `2026-11-22T09:33:29.000Z, 3 h ago, calibration 17`.
    pub fn text(&self) -> String {
        let id = self.id.map_or_else(|| "not kept in a history".to_owned(), |id| format!("calibration {id}"));
        let restored = self.restored_from.map_or_else(String::new, |from| format!(", gone back to {from}"));
        format!("{}, {}, {id}{restored}", self.made, age_in_words(self.age_s))
    }
}

/// `pelical.history/1`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HistoryDocument {
    /// Name and version of this layout.
    pub schema: &'static str,
    /// Name of the daemon.
    pub instance: String,
    /// Why the newest, and perhaps others, are not on the disk and would be lost with the daemon; null where all are.
    pub store_fault: Option<String>,
    /// Newest first.
    pub calibrations: Vec<HistoryEntry>,
}

/// One kept calibration.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HistoryEntry {
    /// Where it comes from; its `id` is what `rollback` takes.
    #[serde(flatten)]
    pub provenance: ProvenanceEntry,
    /// Whether it is the one that is published.
    pub is_published: bool,
    /// Name of the reference camera.
    pub reference: String,
    /// Frame sets it was made of.
    pub frame_sets: u64,
    /// Matches of all pairs.
    pub matches: usize,
    /// Largest standard deviation of any camera's place.
    pub worst_sigma_mm: f64,
    /// Largest standard deviation of any camera's direction.
    pub worst_sigma_deg: f64,
}

impl HistoryDocument {
    /// The document of messages, newest first, of a daemon that is as it says, as of now.
    pub fn new(
        instance: &InstanceName,
        messages: &[CalibrationMessage],
        (daemon, now_ns): (&Snapshot, u64),
    ) -> Self {
        let published = daemon.calibration_id;
        let entry = |message: &CalibrationMessage| {
            let rig = &message.calibration;
            let sigma = |first: usize| {
                let variances = rig.cameras.iter().flatten().flat_map(|pose| {
                    pose.covariance.diagonal().iter().skip(first).take(3).copied().collect::<Vec<_>>()
                });
                variances.fold(0.0, f64::max).sqrt()
            };
            HistoryEntry {
                provenance: ProvenanceEntry::new(message, now_ns),
                is_published: message.provenance.id == published && published.is_some(),
                reference: message.cameras.get(rig.reference).map_or_else(String::new, |c| c.name.clone()),
                frame_sets: rig.frame_sets_used as u64,
                matches: rig.pairs.iter().map(|pair| pair.matches).sum(),
                worst_sigma_mm: sigma(0) * 1e3,
                worst_sigma_deg: sigma(3).to_degrees(),
            }
        };
        Self {
            schema: "pelical.history/1",
            instance: instance.to_string(),
            store_fault: daemon.store_fault.clone(),
            calibrations: messages.iter().map(entry).collect(),
        }
    }

    /// For people, ending with a line break.
    pub fn text(&self) -> String {
        if self.calibrations.is_empty() {
            return "no calibration has been accepted yet\n".to_owned();
        }
        let header = ["id", "made", "age", "cameras", "sets", "matches", "sigma mm", "sigma deg", ""];
        let rows = self.calibrations.iter().enumerate().map(|(idx, entry)| {
            let provenance = &entry.provenance;
            let names: Vec<&str> = provenance.cameras.iter().map(|camera| camera.name.as_str()).collect();
            let mut notes = String::new();
            if let Some(from) = provenance.restored_from {
                let _ = write!(notes, "gone back to {from} ");
            }
            if entry.is_published {
                notes += "published ";
            }
            // They are written in their order: while there is a fault, the newest is not.
            if idx == 0 && self.store_fault.is_some() {
                notes += "not kept";
            }
            vec![
                provenance.id.unwrap_or_default().to_string(),
                provenance.made.clone(),
                age_in_words(provenance.age_s),
                names.join(" "),
                entry.frame_sets.to_string(),
                entry.matches.to_string(),
                format!("{:.1}", entry.worst_sigma_mm),
                format!("{:.3}", entry.worst_sigma_deg),
                notes.trim_end().to_owned(),
            ]
        });
        let fault = self.store_fault.iter().map(|fault| format!("\nnot kept    {fault}\n"));
        table(&header, &rows.collect::<Vec<_>>()) + &fault.collect::<String>()
    }
}
