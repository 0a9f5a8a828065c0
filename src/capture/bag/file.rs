//! One bag file: its connections, and its messages chunk by chunk.
//!
//! The crate `rosbag` maps the file into memory; it is asked to do so anew for every chunk, so that no more than the chunk at hand
//! takes room. Whoever cuts a file while it is mapped ends the process, as with every mapped file.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

use rosbag::{ChunkRecord, IndexRecord, MessageRecord, RosBag};

use super::guard::Guard;
use super::topic::Topic;
use crate::capture::CaptureError;

/// Where a message stands in a bag; later ones are greater.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Place {
    chunk: u32,
    nth: u32,
}

/// An open bag whose index was checked.
pub(super) struct BagFile {
    path: PathBuf,
    guard: Guard,
    topics: BTreeMap<u32, Topic>,
    /// Positions in the file.
    chunks: Vec<u64>,
}

impl BagFile {
    /// Opens a bag and reads its index.
    ///
    /// # Errors
    /// When it is no bag, or its index is not whole.
    pub(super) fn open(path: &Path) -> Result<Self, CaptureError> {
        let bad = |what: String| CaptureError::bad_data(path, what);
        let file = File::open(path).map_err(|error| CaptureError::io(path, error))?;
        if !file.metadata().is_ok_and(|metadata| metadata.is_file()) {
            return Err(bad("is not a file".into()));
        }
        let guard = Guard::new(file).map_err(bad)?;
        let bag = RosBag::new(guard.handle()).map_err(|error| CaptureError::io(path, error))?;
        let (mut topics, mut chunks) = (BTreeMap::new(), Vec::new());
        for record in bag.index_records() {
            match record.map_err(|error| bad(in_words(&error)))? {
                IndexRecord::Connection(connection) => {
                    if let Some(topic) = Topic::parse(connection.storage_topic) {
                        topics.insert(connection.id, topic);
                    }
                }
                IndexRecord::ChunkInfo(info) => chunks.push(info.chunk_pos),
                IndexRecord::IndexData(_) => {}
            }
        }
        Ok(Self { path: path.to_path_buf(), guard, topics, chunks })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Shows every message of the topics that count, in the order of the file.
    pub(super) fn each_message(
        &self,
        mut visit: impl FnMut(Place, Topic, &[u8]) -> Result<(), String>,
    ) -> Result<(), String> {
        let (mut unpacked, mut from) = (Vec::new(), self.guard.start());
        for (chunk, &at) in (0..).zip(&self.chunks) {
            // In the order of the file and side by side, as every recorder writes them: a short index that names one chunk again and
            // again would make much of a small bag.
            from = self.guard.check_chunk(at, from, &mut unpacked)?;
            self.with_chunk(at, |records| {
                for (nth, record) in (0..).zip(records) {
                    let MessageRecord::MessageData(message) = record.map_err(|error| in_words(&error))?
                    else {
                        continue;
                    };
                    if let Some(topic) = self.topics.get(&message.conn_id) {
                        visit(Place { chunk, nth }, *topic, message.data)?;
                    }
                }
                Ok(())
            })?;
        }
        Ok(())
    }

    /// Reads one message again.
    pub(super) fn read_message<T>(
        &self,
        place: Place,
        read: impl FnOnce(&[u8]) -> Result<T, String>,
    ) -> Result<T, String> {
        let gone = || "the file is not the one that was opened: a message is gone".to_owned();
        let at = *self.chunks.get(place.chunk as usize).ok_or_else(gone)?;
        self.with_chunk(at, |mut records| match records.nth(place.nth as usize) {
            Some(Ok(MessageRecord::MessageData(message))) => read(message.data),
            _ => Err(gone()),
        })
    }

    fn with_chunk<T>(
        &self,
        at: u64,
        read: impl FnOnce(rosbag::MessageRecordsIterator<'_>) -> Result<T, String>,
    ) -> Result<T, String> {
        let bag = RosBag::new(self.guard.handle()).map_err(|error| error.to_string())?;
        let mut records = bag.chunk_records();
        records.seek(at).map_err(|error| in_words(&error))?;
        match records.next() {
            Some(Ok(ChunkRecord::Chunk(chunk))) => read(chunk.messages()),
            Some(Err(error)) => Err(in_words(&error)),
            _ => Err(format!("the index of the bag is damaged: there is no chunk at byte {at}")),
        }
    }
}

impl fmt::Debug for BagFile {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("BagFile").field("path", &self.path).finish_non_exhaustive()
    }
}

fn in_words(error: &rosbag::Error) -> String {
    format!("the bag is damaged: {error}")
}
