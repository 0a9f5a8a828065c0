//! The bytes of one file: a first line with the length and the checksum of the rest, which is YAML. The first line is a comment
//! of YAML, so that any reader of YAML can take the file as it is.

use sha2::{Digest, Sha256};

use super::document::Document;
use super::entry::StoredCalibration;

/// How a file begins; the number changes with the meaning of anything in it.
const HEAD: &str = "# pelical.stored/1";

/// Why a file is not a stored calibration.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FormatError {
    /// The first line is another one.
    #[error("its first line is not that of a stored calibration of this version ({HEAD} ...)")]
    Head,
    /// Something is missing at the end, or there is more than was written.
    #[error("it has {found} bytes behind its first line instead of {expected}: it was cut or added to")]
    Length {
        /// Bytes that are there.
        found: usize,
        /// Bytes that were written.
        expected: usize,
    },
    /// The bytes are not those that were written.
    #[error("its checksum does not match: it was damaged or edited")]
    Checksum,
    /// The checksum is right, but the text says something impossible.
    #[error("{0}")]
    Content(String),
}

/// The text of a file.
///
/// # Errors
/// When the calibration is not one that could be read again.
pub fn encode(entry: &StoredCalibration) -> Result<String, FormatError> {
    let content = |error: serde_yaml::Error| FormatError::Content(error.to_string());
    let body = serde_yaml::to_string(&Document::from(entry)).map_err(content)?;
    let text = format!("{HEAD} bytes={} sha256={}\n{body}", body.len(), sha256_hex(body.as_bytes()));
    // What a reader would refuse is never written.
    decode(text.as_bytes())?;
    Ok(text)
}

/// What a file says, checked.
///
/// # Errors
/// Says what is wrong with it.
pub fn decode(bytes: &[u8]) -> Result<StoredCalibration, FormatError> {
    let end = bytes.iter().position(|&byte| byte == b'\n').ok_or(FormatError::Head)?;
    let (head, body) = (&bytes[..end], &bytes[end + 1..]);
    let (expected, checksum) = head_of(head).ok_or(FormatError::Head)?;
    if body.len() != expected {
        return Err(FormatError::Length { found: body.len(), expected });
    }
    if sha256_hex(body) != checksum {
        return Err(FormatError::Checksum);
    }
    let document: Document =
        serde_yaml::from_slice(body).map_err(|error| FormatError::Content(error.to_string()))?;
    StoredCalibration::try_from(document).map_err(FormatError::Content)
}

/// Length and checksum of the rest.
fn head_of(line: &[u8]) -> Option<(usize, &str)> {
    let rest = std::str::from_utf8(line).ok()?.strip_prefix(HEAD)?.strip_prefix(" bytes=")?;
    let (length, checksum) = rest.split_once(" sha256=")?;
    Some((length.parse().ok()?, checksum))
}

/// SHA-256 in hex.
pub fn sha256_hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
