//! Why there is no learned matcher, or none for this pair of images: each message is one sentence that says what to do.

use std::path::PathBuf;

/// Every way the learned matcher can fail; the caller goes on without it.
#[derive(Debug, thiserror::Error)]
pub enum LearnedError {
    /// ONNX Runtime is not there, or not usable: install it.
    #[error(
        "cannot load ONNX Runtime from {}: {what}; install ONNX Runtime 1.24 or newer (as in the Python package onnxruntime) and set matcher.runtime, or the environment variable ORT_DYLIB_PATH, to its libonnxruntime.so",
        path.display()
    )]
    Runtime {
        /// What was loaded.
        path: PathBuf,
        /// What the system said.
        what: String,
    },
    /// This process has loaded another library, and a process can have only one: restart.
    #[error(
        "this process already uses ONNX Runtime from {}; restart it to use {}", loaded.display(), asked.display()
    )]
    RuntimeInUse {
        /// The one in use.
        loaded: PathBuf,
        /// The one asked for.
        asked: PathBuf,
    },
    /// A model file cannot be read, or is no model: fix or export it again.
    #[error(
        "cannot load the model {}: {what}; docs/models.md says which models fit and how to export them", path.display()
    )]
    Model {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The models do not make a matcher together: change `matcher.models`.
    #[error(
        "matcher.models has {found}; allowed are one model `dense` alone, `dense` and `glue`, `dense` and `wireframe`, or `lines` alone (docs/models.md)"
    )]
    Combination {
        /// The contracts that were found.
        found: String,
    },
    /// A model failed on an image or a pair of images.
    #[error("the model {} failed: {what}", path.display())]
    Run {
        /// The file.
        path: PathBuf,
        /// What the runtime said, or what is wrong with its answer.
        what: String,
    },
}
