//! A new config for the running daemon, on SIGHUP: all or nothing. The whole file is checked first; then either every change is of a
//! key that can be changed live, or the old config stays as it is and the keys that need a restart are named.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::SIGHUP;

use super::config::{self, Config, ConfigError, ConfigFile};
use super::error::ServiceError;

/// Keys that can be changed while the daemon runs; whatever is not here needs a restart.
const LIVE_KEYS: [&str; 3] = ["log.level", "service.ready_when", "watch.on_moved"];

/// Waits for SIGHUP, and knows what runs.
#[derive(Debug)]
pub struct Reloader {
    file: PathBuf,
    running: ConfigFile,
    is_asked: Arc<AtomicBool>,
}

/// Why the old config stays.
#[derive(Debug, thiserror::Error)]
pub enum ReloadError {
    /// The new one is wrong.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// It is right, but cannot be changed to while the daemon runs.
    #[error(
        "{} cannot be changed while the daemon runs: nothing was changed; restart it, or undo the change (live are: {})",
        keys.join(", "), LIVE_KEYS.join(", ")
    )]
    NeedsRestart {
        /// What differs and is not live.
        keys: Vec<String>,
    },
}

/// A config that was taken.
#[derive(Debug)]
pub struct Reloaded {
    /// The new one.
    pub config: Config,
    /// What differs from the old one.
    pub keys: Vec<String>,
}

impl Reloader {
    /// Listens from now on; `running` is what the file said at the start.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn on_signal(file: &Path, running: ConfigFile) -> Result<Self, ServiceError> {
        let is_asked = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register(SIGHUP, Arc::clone(&is_asked))
            .map_err(|source| ServiceError::System { what: "cannot listen for signals", source })?;
        Ok(Self { file: file.to_owned(), running, is_asked })
    }

    /// Whether a reload was asked for since the last question.
    pub fn take_request(&self) -> bool {
        // Relaxed: nothing is handed over with the flag.
        self.is_asked.swap(false, Ordering::Relaxed)
    }

    /// Takes the file as it is now, or leaves everything as it was.
    ///
    /// # Errors
    /// When the file is wrong, or needs a restart.
    pub fn reload(&mut self) -> Result<Reloaded, ReloadError> {
        let (sections, config) = config::load(&self.file)?;
        let keys = changed_keys(&self.running, &sections);
        let needs_restart: Vec<String> =
            keys.iter().filter(|key| !LIVE_KEYS.contains(&key.as_str())).cloned().collect();
        if !needs_restart.is_empty() {
            return Err(ReloadError::NeedsRestart { keys: needs_restart });
        }
        self.running = sections;
        Ok(Reloaded { config, keys })
    }
}

/// The dotted keys whose values differ; a list counts as one value.
fn changed_keys(before: &ConfigFile, after: &ConfigFile) -> Vec<String> {
    let mut keys = Vec::new();
    let value = |file: &ConfigFile| serde_yaml::to_value(file).unwrap_or_default();
    collect_changes("", &value(before), &value(after), &mut keys);
    keys
}

fn collect_changes(
    place: &str,
    before: &serde_yaml::Value,
    after: &serde_yaml::Value,
    keys: &mut Vec<String>,
) {
    if before == after {
        return;
    }
    let (Some(then), Some(now)) = (before.as_mapping(), after.as_mapping()) else {
        return keys.push(place.to_owned());
    };
    // Both are whole: every section writes all of its keys.
    for (key, value) in now {
        let name = key.as_str().unwrap_or_default();
        let place = if place.is_empty() { name.to_owned() } else { format!("{place}.{name}") };
        collect_changes(&place, then.get(key).unwrap_or(&serde_yaml::Value::Null), value, keys);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reloader whose file says `before`, and then `after`.
    fn reload(before: &str, after: &str) -> (Reloader, Result<Reloaded, ReloadError>) {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let file = folder.path().join("c.yaml");
        std::fs::write(&file, before).expect("written");
        let (running, _) = config::load(&file).expect("a good config");
        let mut reloader = Reloader { file: file.clone(), running, is_asked: Arc::default() };
        std::fs::write(&file, after).expect("written");
        let result = reloader.reload();
        (reloader, result)
    }

    #[test]
    fn live_keys_are_taken_and_named() {
        let (reloader, taken) = reload("{}", "log: {level: debug}\nwatch: {on_moved: recalibrate}\n");
        let taken = taken.expect("only live keys");
        assert_eq!(taken.keys, ["log.level", "watch.on_moved"]);
        assert_eq!(taken.config.on_moved, config::OnMoved::Recalibrate);
        assert_eq!(reloader.running.log.level, config::LogLevel::Debug);
    }

    #[test]
    fn one_key_that_needs_a_restart_leaves_all_as_it_was() {
        let after = "log: {level: debug}\nsync: {max_skew_ms: 5}\ncameras:\n  synthetic: {seed: 3}\n  list: [{name: a, serial: \"1\"}]\nstore: {keep: 7}\n";
        let (reloader, refused) = reload("{}", after);
        let error = refused.expect_err("a restart is needed");
        let ReloadError::NeedsRestart { keys } = &error else { panic!("{error}") };
        assert_eq!(keys, &["cameras.synthetic.seed", "cameras.list", "sync.max_skew_ms", "store.keep"]);
        assert!(error.to_string().contains("nothing was changed"), "{error}");
        assert_eq!(reloader.running.log.level, config::LogLevel::Info);
    }

    #[test]
    fn a_wrong_file_is_refused_with_its_line() {
        let (_, refused) = reload("{}", "log:\n  level: loud\n");
        let error = refused.expect_err("wrong").to_string();
        assert!(error.contains("c.yaml:2: log.level"), "{error}");
    }

    #[test]
    fn the_same_content_changes_nothing_however_it_is_written() {
        let (_, taken) = reload("{}", "# all defaults\nlog: {level: info}\n");
        assert_eq!(taken.expect("nothing to refuse").keys, [""; 0]);
    }

    #[test]
    fn every_live_key_is_a_key() {
        let whole = serde_yaml::to_value(ConfigFile::default()).expect("serialisable");
        for key in LIVE_KEYS {
            let found = key.split('.').try_fold(&whole, |value, part| value.get(part));
            assert!(found.is_some(), "{key}");
        }
    }
}
