//! Where log lines go and in which form. stdout is never written: it belongs to data.

use std::io::IsTerminal;

use tracing::level_filters::LevelFilter;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt;
use tracing_subscriber::layer::{Layer, SubscriberExt};
use tracing_subscriber::registry::Registry;
use tracing_subscriber::reload;
use tracing_subscriber::util::SubscriberInitExt;

use super::config::{LogFormat, LogLevel, LogSection};

type BoxedLayer = Box<dyn Layer<Registry> + Send + Sync>;

/// Changes the level of a running log.
#[derive(Debug, Clone)]
pub struct LogHandle(reload::Handle<Targets, Registry>);

impl LogHandle {
    /// From now on this level.
    pub fn set_level(&self, level: LogLevel) {
        // An error says that this log is not the one of the process: then there is nothing to change.
        let _ = self.0.reload(filter(level));
    }
}

/// Starts the log of this process; a second start is ignored, the first one stays.
pub fn start(log: &LogSection) -> LogHandle {
    let (layer, trouble) = match log.format {
        LogFormat::Human => (human(), None),
        LogFormat::Json => (fmt::layer().json().with_writer(std::io::stderr).boxed(), None),
        LogFormat::Journald => match tracing_journald::layer() {
            Ok(layer) => (layer.with_syslog_identifier("pelicald".to_owned()).boxed(), None),
            Err(error) => (human(), Some(error)),
        },
    };
    let (filter, handle) = reload::Layer::new(filter(log.level));
    let started = tracing_subscriber::registry().with(layer.with_filter(filter)).try_init();
    if let (Ok(()), Some(error)) = (started, trouble) {
        tracing::warn!(%error, "log.format is journald, but there is no journal to write to: logging to stderr instead");
    }
    LogHandle(handle)
}

fn human() -> BoxedLayer {
    let wants_color = std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty());
    fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(wants_color && std::io::stderr().is_terminal())
        .boxed()
}

/// Our own events by the configured level; those of libraries only when they warn.
fn filter(level: LogLevel) -> Targets {
    let own = match level {
        LogLevel::Error => LevelFilter::ERROR,
        LogLevel::Warn => LevelFilter::WARN,
        LogLevel::Info => LevelFilter::INFO,
        LogLevel::Debug => LevelFilter::DEBUG,
        LogLevel::Trace => LevelFilter::TRACE,
    };
    Targets::new().with_default(own.min(LevelFilter::WARN)).with_target("pelical", own)
}
