//! The config file: reads it, refuses what is wrong with file, line, key and what is allowed, and converts the user's units
//! into the options of the parts once.

mod backend;
mod check;
mod convert;
mod error;
mod estimator;
mod faults;
mod ipc;
mod locate;
mod matcher;
mod realsense;
mod recording;
mod sections;
mod serial;
mod store;
mod supervision;
mod synthetic;
#[cfg(test)]
mod tests;
mod watch;

use std::path::Path;

pub use backend::RigError;
pub use check::{BackendConfig, CameraChoice, CamerasConfig, Config};
pub use error::{ConfigError, Refusal};
pub use estimator::{AssociationName, EstimatorName};
pub use faults::{FaultEntry, FaultKind, FaultsSection};
pub use ipc::{IpcSection, IpcVariant};
pub use matcher::{MatcherSection, ProviderName};
pub use realsense::{RealsenseSection, RecoverySection, VideoModeSection};
pub use sections::*;
pub use serial::{Serial, UNQUOTED_SERIAL};
pub use store::{StoreConfig, StoreSection};
pub use supervision::{ReadyWhen, ServiceSection};
pub use synthetic::MoveEntry;
pub use watch::{OnMoved, WatchSection};

use crate::capture::nesting;

/// Where the installed service reads its config.
pub const INSTALLED_CONFIG: &str = "/etc/pelical/pelicald.yaml";

/// Reads and checks a config file; the file's sections come with the checked options, to be shown.
///
/// # Errors
/// Names the file, the line, the key and what is allowed.
pub fn load(file: &Path) -> Result<(ConfigFile, Config), ConfigError> {
    let text = std::fs::read_to_string(file)
        .map_err(|source| ConfigError::Read { file: file.to_owned(), source })?;
    // An editor's byte order mark is no part of the first key.
    let (sections, config) = checked(file, text.strip_prefix('\u{feff}').unwrap_or(&text))?;
    Ok((sections, config.relative_to(file.parent().unwrap_or(Path::new("")))))
}

/// The checked options of a config file, or the defaults without one.
///
/// # Errors
/// As [`load`].
pub fn load_or_default(file: Option<&Path>) -> Result<Config, ConfigError> {
    match file {
        Some(file) => load(file).map(|(_, config)| config),
        None => checked(Path::new("defaults"), "{}").map(|(_, config)| config),
    }
}

/// The config of `pelical demo`, which is the file `config/demo.yaml`.
///
/// # Errors
/// Never, unless that file was broken before this program was built; a test sees to it.
pub fn demo() -> Result<Config, ConfigError> {
    let text = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/config/demo.yaml"));
    checked(Path::new("demo.yaml"), text).map(|(_, config)| config)
}

fn checked(file: &Path, text: &str) -> Result<(ConfigFile, Config), ConfigError> {
    let sections = parse(file, text)?;
    let config = Config::try_from(&sections).map_err(|refusal| located(file, text, refusal))?;
    Ok((sections, config))
}

/// The text of a config file as sections, with defaults for what it does not say.
fn parse(file: &Path, text: &str) -> Result<ConfigFile, ConfigError> {
    if !text.lines().any(|line| !line.trim().is_empty() && !line.trim_start().starts_with('#')) {
        // A truncated file must not start a daemon with settings that nobody chose.
        let what = "the file has no content; `{}` means every default".to_owned();
        return Err(ConfigError::Text { file: file.to_owned(), line: 1, what });
    }
    if let Some(line) = nesting::too_deep(text) {
        return Err(ConfigError::Text { file: file.to_owned(), line, what: nesting::sentence() });
    }
    let sections: ConfigFile = serde_yaml::from_str(text).map_err(|error| text_error(file, text, &error))?;
    match unquoted_serial(text, &sections) {
        Some(refusal) => Err(located(file, text, refusal)),
        None => Ok(sections),
    }
}

fn located(file: &Path, text: &str, refusal: Refusal) -> ConfigError {
    let Refusal { key, what } = refusal;
    ConfigError::Value { file: file.to_owned(), line: locate::line_of(text, &key), key, what }
}

fn text_error(file: &Path, text: &str, error: &serde_yaml::Error) -> ConfigError {
    let message = error.to_string();
    let said_line =
        || error.location().map_or_else(|| text.lines().count().max(1), |location| location.line());
    // The place is said in front, as compilers do.
    let what = match message.rfind(" at line ") {
        Some(end) => &message[..end],
        None => message.as_str(),
    };
    let line = line_of_repetition(text, what).unwrap_or_else(said_line);
    ConfigError::Text { file: file.to_owned(), line, what: in_plain_words(what) }
}

/// Where a key stands again; the parser names the line of its section.
fn line_of_repetition(text: &str, what: &str) -> Option<usize> {
    let (section, key) = what.split_once("duplicate field `")?;
    locate::second_line_of(text, section.trim_end_matches(": "), key.trim_end_matches('`'))
}

/// Replaces the words of the parser that only programmers know.
fn in_plain_words(message: &str) -> String {
    const WORDS: [(&str, &str); 15] = [
        ("unknown field", "unknown key"),
        ("duplicate field", "this key stands here twice:"),
        ("missing field", "missing key"),
        ("unknown variant", "unknown value"),
        ("invalid type: unit value", "there is no value"),
        ("invalid type", "wrong kind of value"),
        ("expected f64", "expected a number"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("expected u32", "expected a whole number, 0 or more"),
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected field identifier", "expected a key"),
        ("a sequence", "a list"),
        ("value: sequence", "value: list"),
        (" as u128", ""),
        ("expected a boolean", "expected true or false"),
    ];
    WORDS.iter().fold(message.to_owned(), |text, (theirs, ours)| text.replace(theirs, ours))
}

/// A serial number such as 012345: YAML reads it as text because of its leading zero, but its writer cannot know, and the
/// next camera without a leading zero would be refused. The parser does not tell quotes; the text does, in every style.
fn unquoted_serial(text: &str, sections: &ConfigFile) -> Option<Refusal> {
    sections.cameras.list.iter().enumerate().find_map(|(index, entry)| {
        let serial = &entry.serial.0;
        let digits_only = !serial.is_empty() && serial.bytes().all(|byte| byte.is_ascii_digit());
        let quoted = ['"', '\''].iter().any(|quote| text.contains(&format!("{quote}{serial}{quote}")));
        (digits_only && !quoted)
            .then(|| Refusal::new(format!("cameras.list[{index}].serial"), UNQUOTED_SERIAL))
    })
}
