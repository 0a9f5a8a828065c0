//! Serial numbers in config files: strings only, because a number loses its leading zeros.

use std::fmt;

use serde::de::{self, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

/// A serial number, which must be written as a string.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
#[serde(transparent)]
pub struct Serial(pub String);

/// What to say about a serial number that was written without quotes.
pub const UNQUOTED_SERIAL: &str = "a serial number is a string: write it in quotes (\"012345\"), as a number its leading zeros would be lost";

impl<'de> Deserialize<'de> for Serial {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(SerialVisitor)
    }
}

struct SerialVisitor;

impl Visitor<'_> for SerialVisitor {
    type Value = Serial;

    fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("a string in quotes")
    }

    fn visit_str<E: de::Error>(self, text: &str) -> Result<Serial, E> {
        Ok(Serial(text.to_owned()))
    }

    fn visit_u64<E: de::Error>(self, _: u64) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }

    fn visit_i64<E: de::Error>(self, _: i64) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }

    fn visit_u128<E: de::Error>(self, _: u128) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }

    fn visit_f64<E: de::Error>(self, _: f64) -> Result<Serial, E> {
        Err(E::custom(UNQUOTED_SERIAL))
    }
}
