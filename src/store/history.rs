//! The calibrations that are kept, in memory: what clients ask for is answered from here, without waiting for a disk.

use super::entry::StoredCalibration;

/// Calibrations in the order of their numbers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct History {
    entries: Vec<StoredCalibration>,
    last_id: u64,
}

impl History {
    /// Oldest first.
    pub fn entries(&self) -> &[StoredCalibration] {
        &self.entries
    }

    /// The one with this number.
    pub fn get(&self, id: u64) -> Option<&StoredCalibration> {
        self.entries.iter().find(|entry| entry.id == id)
    }

    /// The newest one with a smaller number.
    pub fn newest_below(&self, id: u64) -> Option<&StoredCalibration> {
        self.entries.iter().rev().find(|entry| entry.id < id)
    }

    /// The number of the next one.
    pub fn next_id(&self) -> u64 {
        self.last_id + 1
    }

    /// Adds one with the next number, or a greater one.
    pub fn add(&mut self, entry: StoredCalibration) {
        self.note_id(entry.id);
        self.entries.push(entry);
    }

    /// This number is taken.
    pub fn note_id(&mut self, id: u64) {
        self.last_id = self.last_id.max(id);
    }

    /// Forgets all but the newest `keep`; the smallest number that is left, or the next one.
    pub fn keep_newest(&mut self, keep: usize) -> u64 {
        let surplus = self.entries.len().saturating_sub(keep);
        self.entries.drain(..surplus);
        self.entries.first().map_or(self.next_id(), |oldest| oldest.id)
    }
}
