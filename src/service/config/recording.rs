//! `cameras.replay.recording`: one path, or a list of bags.

use std::fmt;
use std::path::{Path, PathBuf};

use serde::de::{self, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// A folder, a bag, or several bags; empty where the key is null or left out.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct RecordingPaths(pub Vec<PathBuf>);

impl RecordingPaths {
    /// The same with relative paths read from `folder`.
    pub(super) fn relative_to(&self, folder: &Path) -> Self {
        Self(self.0.iter().map(|path| folder.join(path)).collect())
    }
}

impl Serialize for RecordingPaths {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.as_slice() {
            [] => serializer.serialize_none(),
            [path] => path.serialize(serializer),
            paths => paths.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for RecordingPaths {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PathsVisitor)
    }
}

struct PathsVisitor;

impl<'de> Visitor<'de> for PathsVisitor {
    type Value = RecordingPaths;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a folder, a .bag file, or a list of .bag files")
    }

    fn visit_str<E: de::Error>(self, path: &str) -> Result<RecordingPaths, E> {
        Ok(RecordingPaths(vec![PathBuf::from(path)]))
    }

    fn visit_unit<E: de::Error>(self) -> Result<RecordingPaths, E> {
        Ok(RecordingPaths::default())
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<RecordingPaths, A::Error> {
        let mut paths = Vec::new();
        while let Some(path) = list.next_element()? {
            paths.push(path);
        }
        Ok(RecordingPaths(paths))
    }
}
