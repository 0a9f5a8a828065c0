//! The library ONNX Runtime: found, loaded once per process, and asked for sessions on the wanted execution providers.
//!
//! Without an explicit load any use of the crate `ort` panics when there is no library, so nothing here precedes [`environment`].

use std::error::Error as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use ort::environment::Environment;
use ort::ep;
use ort::logging::LogLevel;
use ort::session::Session;
use ort::session::builder::{GraphOptimizationLevel, SessionBuilder};

use super::{LearnedError, LearnedOptions, Provider};

/// Says where the library is when the config does not.
const PATH_VARIABLE: &str = "ORT_DYLIB_PATH";

/// The library of this process. ONNX Runtime allows one environment per process, so it is kept until the end.
static LOADED: Mutex<Option<(PathBuf, Environment)>> = Mutex::new(None);

/// The environment of the library at `runtime`, else at `ORT_DYLIB_PATH`, else of the system's default name.
pub(super) fn environment(runtime: Option<&Path>) -> Result<Environment, LearnedError> {
    // A bare name from the config is a file, not a name for the system's search.
    let path = runtime.map_or_else(default_path, |path| std::path::absolute(path).unwrap_or(path.to_owned()));
    let mut loaded = LOADED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((loaded, environment)) = loaded.as_ref() {
        if *loaded == path {
            return Ok(environment.clone());
        }
        return Err(LearnedError::RuntimeInUse { loaded: loaded.clone(), asked: path });
    }
    let failed = |what: String| LearnedError::Runtime { path: path.clone(), what };
    let builder = ort::init_from(&path).map_err(|error| failed(load_reason(&error)))?;
    // What matters of its own notes comes back as an error, which says what to do as well.
    let logger =
        |_: LogLevel, _: &str, _: &str, _: &str, message: &str| tracing::debug!("{}", plain(message));
    let builder = builder.with_name("pelical").with_telemetry(false).with_logger(Arc::new(logger));
    let environment = builder.build().map_err(|error| failed(error.to_string()))?;
    environment.set_log_level(LogLevel::Warning);
    *loaded = Some((path, environment.clone()));
    Ok(environment)
}

fn default_path() -> PathBuf {
    use std::env::consts::{DLL_PREFIX, DLL_SUFFIX};
    let default = || format!("{DLL_PREFIX}onnxruntime{DLL_SUFFIX}").into();
    std::env::var_os(PATH_VARIABLE).filter(|path| !path.is_empty()).map_or_else(default, PathBuf::from)
}

/// What is wrong with a library, without repeating its path.
fn load_reason(error: &ort::LoadDynamicError) -> String {
    match error {
        ort::LoadDynamicError::Dlopen { error, .. } => {
            error.source().map_or_else(|| error.to_string(), ToString::to_string)
        }
        ort::LoadDynamicError::MissingApi { .. } => {
            "this library is not ONNX Runtime (it has no OrtGetApiBase)".to_owned()
        }
        ort::LoadDynamicError::InvalidVersionString => "it does not tell its version".to_owned(),
        ort::LoadDynamicError::BadVersion { version_str, .. } => format!("version {version_str} is too old"),
    }
}

/// Opens a model with those of the wanted execution providers that work, in their order; the CPU always does.
pub(super) fn open(
    environment: &Environment,
    path: &Path,
    options: &LearnedOptions,
) -> Result<Session, LearnedError> {
    let failed = |what: String| LearnedError::Model { path: path.to_owned(), what };
    let file = std::fs::File::open(path).and_then(|file| file.metadata());
    if !file.map_err(|error| failed(error.to_string()))?.is_file() {
        return Err(failed("it is not a file".to_owned()));
    }
    let text = |error: ort::Error| failed(plain(&error.to_string()));
    let (mut with_devices, devices) = with_providers(builder(environment, options).map_err(text)?, options);
    match with_devices.commit_from_file(path) {
        Ok(session) => return Ok(session),
        Err(error) if devices.is_empty() => return Err(text(error)),
        Err(error) => {
            let reason = plain(&error.to_string());
            tracing::warn!(model = %path.display(), ?devices, reason, "model not usable there: it runs on the CPU");
        }
    }
    builder(environment, options).and_then(|mut builder| builder.commit_from_file(path)).map_err(text)
}

fn builder(environment: &Environment, options: &LearnedOptions) -> ort::Result<SessionBuilder> {
    let builder = Session::builder(environment)?
        .with_log_level(LogLevel::Warning)?
        .with_optimization_level(GraphOptimizationLevel::All)?
        .with_intra_threads(options.threads)?
        // Threads that wait by spinning would take the cores of the frame path.
        .with_intra_op_spinning(false)?;
    Ok(builder)
}

/// The builder with the wanted devices that this library and machine have, and their names; the fallback is logged.
fn with_providers(
    mut builder: SessionBuilder,
    options: &LearnedOptions,
) -> (SessionBuilder, Vec<&'static str>) {
    let mut devices = Vec::new();
    for &provider in &options.providers {
        let wanted = match provider {
            // What comes after it is never asked.
            Provider::Cpu => break,
            Provider::Cuda => ep::CUDA::default().build(),
            Provider::TensorRt => ep::TensorRT::default().build(),
        };
        builder = match builder.with_execution_providers([wanted.error_on_failure()]) {
            Ok(builder) => {
                devices.push(provider.name());
                builder
            }
            Err(error) => {
                let (provider, reason) = (provider.name(), plain(&error.to_string()));
                tracing::warn!(
                    provider,
                    reason,
                    "execution provider not usable: the next one, at last the CPU, is used"
                );
                error.recover()
            }
        };
    }
    (builder, devices)
}

/// A message of the runtime as one line.
pub(super) fn plain(message: &str) -> String {
    message.split_whitespace().collect::<Vec<_>>().join(" ")
}
