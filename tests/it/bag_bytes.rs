//! Bags made in code: what librealsense recorded, taken apart and put together again with anything changed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rosbag::{ChunkRecord, IndexRecord, MessageRecord, RosBag};

/// A topic and the body of one message.
pub type Message = (String, Vec<u8>);

/// `tests/fixtures/bags/<name>`.
pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/bags").join(name)
}

/// All messages of a bag, in their order.
pub fn messages(path: &Path) -> Vec<Message> {
    let bag = RosBag::new(path).unwrap();
    let mut topics = BTreeMap::new();
    for record in bag.index_records() {
        if let IndexRecord::Connection(connection) = record.unwrap() {
            topics.insert(connection.id, connection.storage_topic.to_owned());
        }
    }
    let mut found = Vec::new();
    for record in bag.chunk_records() {
        let ChunkRecord::Chunk(chunk) = record.unwrap() else { continue };
        for record in chunk.messages() {
            if let MessageRecord::MessageData(message) = record.unwrap() {
                found.push((topics[&message.conn_id].clone(), message.data.to_vec()));
            }
        }
    }
    found
}

/// How chunks are stored, by the name in their head.
#[derive(Clone, Copy)]
pub enum Compression {
    None,
    Lz4,
    /// The bytes are not compressed at all, but said to be.
    Claimed(&'static str),
}

/// A bag of these messages, four to a chunk.
pub fn bag(messages: &[Message], compression: Compression) -> Vec<u8> {
    let mut topics: Vec<&str> = Vec::new();
    let mut chunks = Vec::new();
    for some in messages.chunks(4) {
        let mut chunk = Vec::new();
        for (topic, body) in some {
            let id = topics.iter().position(|known| known == topic).unwrap_or_else(|| {
                topics.push(topic);
                topics.len() - 1
            });
            let fields: [(&str, &[u8]); 3] =
                [("op", &[2]), ("conn", &(id as u32).to_le_bytes()), ("time", &[1; 8])];
            chunk.extend(record(&fields, body));
        }
        chunks.push(chunk);
    }
    let chunks: Vec<Vec<u8>> =
        chunks.iter().map(|chunk| chunk_record(chunk, chunk.len(), compression)).collect();
    file(&chunks, &topics)
}

/// A bag of whole chunk records.
pub fn file(chunks: &[Vec<u8>], topics: &[&str]) -> Vec<u8> {
    let begin = |idx: usize| chunks[..idx].iter().map(|chunk| chunk.len() as u64).sum();
    let begins: Vec<u64> = (0..chunks.len()).map(begin).collect();
    file_naming(&begins, chunks, topics)
}

/// A bag whose index names chunks at these bytes, counted from the first chunk.
pub fn file_naming(begins: &[u64], chunks: &[Vec<u8>], topics: &[&str]) -> Vec<u8> {
    let head = |index: u64| {
        let counts = [topics.len() as u32, begins.len() as u32].map(u32::to_le_bytes);
        let fields: [(&str, &[u8]); 4] = [
            ("op", &[3]),
            ("index_pos", &index.to_le_bytes()),
            ("conn_count", &counts[0]),
            ("chunk_count", &counts[1]),
        ];
        [b"#ROSBAG V2.0\n".to_vec(), record(&fields, &[b' '; 100])].concat()
    };
    let start = head(0).len();
    let body = chunks.concat();
    let mut bytes = [head((start + body.len()) as u64), body].concat();
    for (id, topic) in topics.iter().enumerate() {
        let about: [(&str, &[u8]); 3] =
            [("type", b"any"), ("md5sum", &[b'0'; 32]), ("message_definition", b"")];
        let about: Vec<u8> = about.iter().flat_map(|(name, value)| field(name, value)).collect();
        let fields: [(&str, &[u8]); 3] =
            [("op", &[7]), ("conn", &(id as u32).to_le_bytes()), ("topic", topic.as_bytes())];
        bytes.extend(record(&fields, &about));
    }
    for begin in begins {
        let fields: [(&str, &[u8]); 6] = [
            ("op", &[6]),
            ("ver", &[1, 0, 0, 0]),
            ("chunk_pos", &(start as u64 + begin).to_le_bytes()),
            ("start_time", &[0; 8]),
            ("end_time", &[0; 8]),
            ("count", &[0; 4]),
        ];
        bytes.extend(record(&fields, &[]));
    }
    bytes
}

/// A chunk record that says `size`.
pub fn chunk_record(records: &[u8], size: usize, compression: Compression) -> Vec<u8> {
    let (name, data) = match compression {
        Compression::None => ("none", records.to_vec()),
        Compression::Claimed(name) => (name, records.to_vec()),
        Compression::Lz4 => ("lz4", lz4_frame(records)),
    };
    let fields: [(&str, &[u8]); 3] =
        [("op", &[5]), ("compression", name.as_bytes()), ("size", &(size as u32).to_le_bytes())];
    record(&fields, &data)
}

fn lz4_frame(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).unwrap();
    std::io::Write::write_all(&mut encoder, bytes).unwrap();
    let (frame, result) = encoder.finish();
    result.unwrap();
    frame
}

/// Fields, then data, each with its length in front.
pub fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let head: Vec<u8> = fields.iter().flat_map(|(name, value)| field(name, value)).collect();
    [&(head.len() as u32).to_le_bytes()[..], &head, &(data.len() as u32).to_le_bytes()[..], data].concat()
}

fn field(name: &str, value: &[u8]) -> Vec<u8> {
    let len = (name.len() + 1 + value.len()) as u32;
    [&len.to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
}

/// A string as messages have it.
pub fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}
