//! The section `matcher`: what the learned matcher is made of, and where it runs.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::convert::within;
use super::error::Refusal;
use crate::learned::{LearnedOptions, Provider};

/// `matcher`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a section of keys with values")]
pub struct MatcherSection {
    /// The library of ONNX Runtime; `null`: where the environment or the system says.
    pub runtime: Option<PathBuf>,
    /// Model files; empty: there is no learned matcher.
    pub models: Vec<PathBuf>,
    /// Where models run, the preferred one first.
    pub providers: Vec<ProviderName>,
    /// Threads on the CPU; 0: one per core.
    pub threads: usize,
}

impl Default for MatcherSection {
    fn default() -> Self {
        let LearnedOptions { runtime, models, providers, threads } = LearnedOptions::default();
        Self { runtime, models, providers: providers.into_iter().map(ProviderName::from).collect(), threads }
    }
}

/// What the file calls an execution provider.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ProviderName {
    /// Any machine.
    Cpu,
    /// A graphics processor, through CUDA.
    Cuda,
    /// A graphics processor, through TensorRT.
    TensorRt,
}

impl From<Provider> for ProviderName {
    fn from(provider: Provider) -> Self {
        match provider {
            Provider::Cpu => ProviderName::Cpu,
            Provider::Cuda => ProviderName::Cuda,
            Provider::TensorRt => ProviderName::TensorRt,
        }
    }
}

impl From<ProviderName> for Provider {
    fn from(name: ProviderName) -> Self {
        match name {
            ProviderName::Cpu => Provider::Cpu,
            ProviderName::Cuda => Provider::Cuda,
            ProviderName::TensorRt => Provider::TensorRt,
        }
    }
}

/// The options of the learned matcher; paths are as in the file.
///
/// # Errors
/// Names the first value that is not allowed. Whether files are there is found out when the matcher is loaded.
pub(super) fn learned_options(file: &MatcherSection) -> Result<LearnedOptions, Refusal> {
    within("matcher.threads", file.threads as f64, (0.0, 64.0))?;
    let is_empty = |path: &Path| path.as_os_str().is_empty();
    if file.runtime.as_deref().is_some_and(is_empty) {
        return Err(Refusal::new("matcher.runtime", "is empty: allowed are a file, or null"));
    }
    if let Some(index) = file.models.iter().position(|path| is_empty(path)) {
        return Err(Refusal::new(format!("matcher.models[{index}]"), "is empty: a model file is needed"));
    }
    if file.providers.is_empty() {
        return Err(Refusal::new("matcher.providers", "is empty: allowed are cpu, cuda and tensorrt"));
    }
    if let Some(index) =
        (1..file.providers.len()).find(|&at| file.providers[..at].contains(&file.providers[at]))
    {
        return Err(Refusal::new(format!("matcher.providers[{index}]"), "stands here twice"));
    }
    Ok(LearnedOptions {
        runtime: file.runtime.clone(),
        models: file.models.clone(),
        providers: file.providers.iter().copied().map(Provider::from).collect(),
        threads: file.threads,
    })
}

/// The same with relative paths read from `folder`, which is the config file's.
pub(super) fn relative_to(options: &mut LearnedOptions, folder: &Path) {
    for path in options.runtime.iter_mut().chain(&mut options.models) {
        *path = folder.join(&*path);
    }
}
