//! The daemon's history: what is kept of each accepted calibration, what is served at the start, and going back.
//!
//! The history is in memory and on disk. Clients are answered from memory; a thread of its own writes, so that a slow or broken disk
//! delays nobody. A fault of the disk is logged and shown in the status, and the daemon goes on.

#[cfg(test)]
mod tests;

use std::time::Duration;

use super::config::StoreConfig;
use crate::ipc::{Archived, CalibrationMessage, CameraIdentity, InstanceName, Provenance, RefusalCode};
use crate::solver::State;
use crate::store::{FrameSets, History, Report, Restored, Store, StoredCalibration, StoredCamera, Writer};

/// How long the end of the daemon waits for the disk.
const FINISH_WITHIN: Duration = Duration::from_secs(2);

/// The history, if one is kept.
#[derive(Debug, Default)]
pub struct Storing {
    kept: Option<Kept>,
    /// Why something that should be kept is not, at present.
    fault: Option<String>,
}

#[derive(Debug)]
struct Kept {
    history: History,
    writer: Writer,
    keep: usize,
}

/// Why the daemon does not go back to a calibration.
pub type Refusal = (RefusalCode, String);

impl Storing {
    /// Reads what earlier daemons of this instance have kept.
    pub fn open(config: &StoreConfig, instance: &InstanceName) -> Self {
        let Some(directory) = &config.directory else {
            tracing::info!(
                "calibrations are not kept: neither store.directory nor $STATE_DIRECTORY names a folder"
            );
            return Self::default();
        };
        let store = Store::in_folder(directory.join(instance.as_str()));
        let folder = store.folder().to_owned();
        let opened = store.load().map_err(|error| error.to_string()).and_then(|loaded| {
            let writer = Writer::start(store).map_err(|error| format!("cannot start a thread: {error}"))?;
            Ok((loaded, writer))
        });
        match opened {
            Ok((loaded, writer)) => {
                for (file, what) in &loaded.damaged {
                    tracing::warn!(file = %file.display(), "passed over a stored calibration: {what}");
                }
                let mut history = loaded.history;
                history.keep_newest(config.keep);
                tracing::info!(folder = %folder.display(), kept = history.entries().len(), "history read");
                Self { kept: Some(Kept { history, writer, keep: config.keep }), fault: None }
            }
            // Its numbers are not known: writing could replace what it has.
            Err(what) => {
                let fault = format!("{what}; nothing is kept until the daemon is started again");
                tracing::error!("{fault}");
                Self { kept: None, fault: Some(fault) }
            }
        }
    }

    /// The newest calibration of these cameras, in their order; what is newer and does not fit is named in the log.
    pub fn newest_for(&self, rig: &[CameraIdentity]) -> Option<StoredCalibration> {
        let rig = stored_cameras(rig);
        let entries = self.kept.as_ref()?.history.entries();
        entries.iter().rev().find_map(|entry| match entry.for_rig(&rig) {
            Ok(entry) => Some(entry),
            Err(why) => {
                tracing::warn!(id = entry.id, "stored calibration is not served: {why}");
                None
            }
        })
    }

    /// Keeps a calibration that is being published; its number.
    pub fn add(&mut self, message: &CalibrationMessage, frame_sets: FrameSets) -> Option<u64> {
        let kept = self.kept.as_mut()?;
        let id = kept.history.next_id();
        kept.save(StoredCalibration {
            id,
            made_ns: message.stamp_ns,
            restored: None,
            version: message.provenance.version.clone(),
            config_hash: message.provenance.config_hash.clone(),
            frame_sets,
            cameras: stored_cameras(&message.cameras),
            calibration: message.calibration.clone(),
        });
        Some(id)
    }

    /// Goes back to an older calibration: it becomes the newest one, under a number of its own.
    ///
    /// # Errors
    /// When there is none of that number, or it is of other cameras.
    pub fn go_back(
        &mut self,
        id: u64,
        rig: &[CameraIdentity],
        at_ns: u64,
    ) -> Result<StoredCalibration, Refusal> {
        let unknown = |what: String| (RefusalCode::UnknownCalibration, what);
        let Some(kept) = &mut self.kept else {
            return Err(unknown(self.fault.clone().unwrap_or(NO_HISTORY.into())));
        };
        let Some(older) = kept.history.get(id) else {
            let what = format!("the history has no calibration {id}: `pelical history` lists those it has");
            return Err(unknown(what));
        };
        let older = older.for_rig(&stored_cameras(rig));
        let older = older.map_err(|why| (RefusalCode::OtherRig, format!("calibration {id}: {why}")))?;
        // The number of the one that was made, not of an earlier going back to it.
        let from = older.restored.map_or(id, |restored| restored.from);
        let restored = StoredCalibration {
            id: kept.history.next_id(),
            restored: Some(Restored { from, at_ns }),
            ..older
        };
        kept.save(restored.clone());
        Ok(restored)
    }

    /// The answer to a client's question for the newest calibration with a number below this.
    pub fn archived_below(&self, below: u64) -> Archived {
        let Some(kept) = &self.kept else {
            return Archived::NotKept { sentence: self.fault.clone().unwrap_or(NO_HISTORY.into()) };
        };
        let found = kept.history.newest_below(below);
        found.map_or(Archived::NoOlder, |entry| Archived::Found(Box::new(message(entry, State::Converged))))
    }

    /// Takes note of what the disk has done since this was called last.
    pub fn poll(&mut self) {
        let Some(kept) = &self.kept else { return };
        for report in kept.writer.reports() {
            take(report, &mut self.fault);
        }
        if !kept.writer.is_running() && self.fault.as_deref() != Some(WRITER_ENDED) {
            tracing::error!("{WRITER_ENDED}");
            self.fault = Some(WRITER_ENDED.to_owned());
        }
    }

    /// Why something that should be kept is not, at present.
    pub fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }

    /// Waits, but not for ever, until everything is on the disk.
    pub fn finish(mut self) {
        let Some(kept) = self.kept.take() else { return };
        let (last, is_done) = kept.writer.finish(FINISH_WITHIN);
        last.into_iter().for_each(|report| take(report, &mut self.fault));
        if !is_done {
            tracing::error!("the newest calibration may not be kept: it was not written in time");
        }
    }
}

const WRITER_ENDED: &str = "the thread that writes calibrations has ended, which is a bug; nothing is kept until the daemon is started again";
const NO_HISTORY: &str = "the daemon keeps no history: set store.directory in its config";

impl Kept {
    fn save(&mut self, entry: StoredCalibration) {
        self.history.add(entry.clone());
        let oldest_kept = self.history.keep_newest(self.keep);
        self.writer.save(entry, oldest_kept);
    }
}

/// Says what is new; the same fault again is none.
fn take(report: Report, fault: &mut Option<String>) {
    match report {
        Report::Saved { id } => {
            tracing::debug!(id, "calibration is on the disk");
            if fault.take().is_some() {
                tracing::info!(id, "calibrations are kept again");
            }
        }
        Report::Untidy { error } => tracing::warn!("old calibrations stay: {error}"),
        Report::Failed { id, error } => {
            let what = error.to_string();
            if fault.as_ref() != Some(&what) {
                tracing::warn!(id, "calibration is published but not kept, tried again: {what}");
            }
            *fault = Some(what);
        }
    }
}

/// What is published of a stored calibration; its number in this run is the caller's to give.
pub fn message(entry: &StoredCalibration, state: State) -> CalibrationMessage {
    let identity = |camera: &StoredCamera| CameraIdentity {
        name: camera.name.clone(),
        serial: camera.serial.clone(),
        firmware: camera.firmware.clone(),
    };
    let mut calibration = entry.calibration.clone();
    calibration.state = state;
    CalibrationMessage {
        sequence: 0,
        stamp_ns: entry.made_ns,
        provenance: Provenance {
            id: Some(entry.id),
            restored_from: entry.restored.map(|restored| restored.from),
            version: entry.version.clone(),
            config_hash: entry.config_hash.clone(),
        },
        cameras: entry.cameras.iter().map(identity).collect(),
        calibration,
    }
}

fn stored_cameras(cameras: &[CameraIdentity]) -> Vec<StoredCamera> {
    let stored = |camera: &CameraIdentity| StoredCamera {
        name: camera.name.clone(),
        serial: camera.serial.clone(),
        firmware: camera.firmware.clone(),
    };
    cameras.iter().map(stored).collect()
}
