//! What a bag must be before the crate `rosbag` may read it.
//!
//! That crate panics on an index outside of the file, reserves what a record promises and unpacks chunks without a limit, also
//! where no chunk belongs. So every record's head is walked here first, and every chunk is unpacked once up to its promised size.

use std::fs::File;
use std::io::Read as _;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;

const MAGIC: &[u8] = b"#ROSBAG V2.0\n";
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";
/// Bytes of a record's head: names of topics and a few numbers.
const MAX_HEAD_BYTES: u32 = 1 << 16;
/// Bytes of a chunk, packed or not: the SDK closes one with the message that takes it beyond 768 kB.
const MAX_CHUNK_BYTES: u32 = 64 << 20;

/// Kinds of records, by the number in their field `op`.
const MESSAGE: u8 = 2;
const BAG: u8 = 3;
const INDEX: u8 = 4;
const CHUNK: u8 = 5;
const CHUNK_INFO: u8 = 6;
const CONNECTION: u8 = 7;

/// A bag as bytes.
#[derive(Debug)]
pub(super) struct Guard {
    file: File,
    /// First byte behind the head of the bag.
    start: u64,
    /// First byte behind the chunks.
    index: u64,
    end: u64,
}

/// Fields of a record's head.
struct Head {
    fields: Vec<u8>,
    data_at: u64,
    data_len: u32,
}

impl Guard {
    /// Checks the bag's head and its index; the error is a sentence.
    pub(super) fn new(file: File) -> Result<Self, String> {
        let end = file.metadata().map_err(|error| error.to_string())?.len();
        let mut guard = Self { file, start: MAGIC.len() as u64, index: end, end };
        guard.check_magic()?;
        let head = guard.head((guard.start, end))?;
        head.expect_op(&[BAG])?;
        let index = u64::from_le_bytes(head.field("index_pos")?);
        if index == 0 {
            return Err("the bag is not indexed: its recording was not ended properly; record again, or repair it with \
                        `rosbag reindex`"
                .into());
        }
        guard.start = head.end();
        if !(guard.start..=end).contains(&index) {
            return Err(format!(
                "the bag is truncated or damaged: its index should begin at byte {index} of {end}"
            ));
        }
        guard.index = index;
        let count = |name| head.field(name).map(u32::from_le_bytes);
        guard.check_index(count("conn_count")?, count("chunk_count")?)?;
        Ok(guard)
    }

    /// A path to the very file that was checked, also when another one has taken its name since.
    pub(super) fn handle(&self) -> PathBuf {
        PathBuf::from(format!("/proc/self/fd/{}", self.file.as_raw_fd()))
    }

    /// First byte at which a chunk can begin.
    pub(super) fn start(&self) -> u64 {
        self.start
    }

    /// Checks the chunk at a position of the file, which begins at `from` or later: its size, and every record in it. Returns the first
    /// byte behind it. Uses `unpacked` as a buffer.
    pub(super) fn check_chunk(&self, at: u64, from: u64, unpacked: &mut Vec<u8>) -> Result<u64, String> {
        if at < from {
            return Err(format!(
                "the index of the bag is damaged: it names a chunk at byte {at}, where none can begin before byte {from}"
            ));
        }
        let head = self.head((at, self.index))?;
        head.expect_op(&[CHUNK])?;
        let size = u32::from_le_bytes(head.field("size")?);
        if size.max(head.data_len) > MAX_CHUNK_BYTES {
            return Err(format!(
                "the chunk at byte {at} has {} bytes; at most {MAX_CHUNK_BYTES} are read",
                size.max(head.data_len)
            ));
        }
        let packed = self.read(head.data_at, head.data_len)?;
        match head.value("compression") {
            Some(b"none") => *unpacked = packed,
            Some(b"lz4") => unpack(&packed, size, unpacked).map_err(|what| damaged_chunk(at, &what))?,
            other => {
                let other = String::from_utf8_lossy(other.unwrap_or_default()).into_owned();
                return Err(format!(
                    "the chunk at byte {at} has the compression \"{other}\"; none and lz4 are read"
                ));
            }
        }
        if unpacked.len() != size as usize {
            let what = format!("{} bytes are promised, there are {}", size, unpacked.len());
            return Err(damaged_chunk(at, &what));
        }
        check_records(unpacked).map_err(|what| damaged_chunk(at, what))?;
        Ok(head.end())
    }

    fn check_magic(&self) -> Result<(), String> {
        let magic = self.read(0, MAGIC.len() as u32);
        if magic.as_ref().is_ok_and(|magic| magic == MAGIC) {
            return Ok(());
        }
        let sqlite = self.read(0, SQLITE_MAGIC.len() as u32);
        if sqlite.is_ok_and(|magic| magic == SQLITE_MAGIC) {
            return Err(
                "is a .db3 recording of a newer SDK; only .bag files are read: convert it with `rs-convert`"
                    .into(),
            );
        }
        Err("is not a bag: it does not begin with \"#ROSBAG V2.0\"".into())
    }

    /// Walks the records behind the chunks: connections and places of chunks alone, as many as the head says.
    fn check_index(&self, n_connections: u32, n_chunks: u32) -> Result<(), String> {
        let (mut connections, mut chunks, mut at) = (0, 0, self.index);
        while at < self.end {
            let head = self.head((at, self.end))?;
            match head.expect_op(&[CONNECTION, CHUNK_INFO, INDEX])? {
                CONNECTION => connections += 1,
                CHUNK_INFO => chunks += 1,
                _ => {}
            }
            at = head.end();
        }
        if (connections, chunks) != (n_connections, n_chunks) {
            return Err(format!(
                "the bag is truncated: its index names {connections} of {n_connections} connections and {chunks} of \
                 {n_chunks} chunks"
            ));
        }
        Ok(())
    }

    /// The head of the record at a position, all of whose bytes lie before the end.
    fn head(&self, (at, end): (u64, u64)) -> Result<Head, String> {
        let truncated = || format!("the bag is truncated or damaged: the record at byte {at} is not whole");
        let number = |at: u64| -> Result<u32, String> {
            if at + 4 > end {
                return Err(truncated());
            }
            let bytes = self.read(at, 4)?;
            bytes.first_chunk().map(|bytes| u32::from_le_bytes(*bytes)).ok_or_else(truncated)
        };
        let len = number(at)?;
        let data_len_at = at + 4 + u64::from(len);
        if len > MAX_HEAD_BYTES || data_len_at > end {
            return Err(truncated());
        }
        let fields = self.read(at + 4, len)?;
        let head = Head { fields, data_at: data_len_at + 4, data_len: number(data_len_at)? };
        if head.end() > end { Err(truncated()) } else { Ok(head) }
    }

    fn read(&self, at: u64, len: u32) -> Result<Vec<u8>, String> {
        let mut bytes = vec![0; len as usize];
        self.file
            .read_exact_at(&mut bytes, at)
            .map_err(|error| format!("byte {at} cannot be read: {error}"))?;
        Ok(bytes)
    }
}

impl Head {
    fn end(&self) -> u64 {
        self.data_at + u64::from(self.data_len)
    }

    fn value(&self, name: &str) -> Option<&[u8]> {
        value(&self.fields, name)
    }

    fn field<const N: usize>(&self, name: &str) -> Result<[u8; N], String> {
        let bytes = self.value(name).and_then(|value| value.try_into().ok());
        bytes.ok_or_else(|| format!("the bag is damaged: a record has no field `{name}` of {N} bytes"))
    }

    fn expect_op(&self, allowed: &[u8]) -> Result<u8, String> {
        let [op] = self.field("op")?;
        if allowed.contains(&op) {
            return Ok(op);
        }
        Err(format!("the bag is damaged: a record of kind {op} stands where only {allowed:?} are allowed"))
    }
}

fn damaged_chunk(at: u64, what: &str) -> String {
    format!("the chunk at byte {at} is damaged: {what}")
}

fn unpack(packed: &[u8], size: u32, unpacked: &mut Vec<u8>) -> Result<(), String> {
    unpacked.clear();
    let decoder = lz4::Decoder::new(packed).map_err(|error| error.to_string())?;
    // One byte more shows that there is more than promised.
    decoder.take(u64::from(size) + 1).read_to_end(unpacked).map_err(|error| error.to_string())?;
    Ok(())
}

/// Walks the records in a chunk: messages and connections alone.
fn check_records(mut bytes: &[u8]) -> Result<(), &'static str> {
    while !bytes.is_empty() {
        let (fields, behind) = prefixed(bytes).ok_or("a record is not whole")?;
        let (_, behind) = prefixed(behind).ok_or("a record is not whole")?;
        match value(fields, "op") {
            Some(&[MESSAGE | CONNECTION]) => {}
            _ => return Err("it holds a record that is neither a message nor a connection"),
        }
        bytes = behind;
    }
    Ok(())
}

/// The first field of this name, as `rosbag` looks for it.
fn value<'a>(mut fields: &'a [u8], name: &str) -> Option<&'a [u8]> {
    while let Some((field, behind)) = prefixed(fields) {
        let value = field.strip_prefix(name.as_bytes()).and_then(|rest| rest.strip_prefix(b"="));
        if value.is_some() {
            return value;
        }
        fields = behind;
    }
    None
}

/// Bytes with their length in front, and what is behind them.
fn prefixed(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (len, behind) = bytes.split_first_chunk()?;
    behind.split_at_checked(u32::from_le_bytes(*len) as usize)
}
