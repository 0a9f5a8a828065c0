//! `--association`: who proposes matches.

use clap::ValueEnum;

use crate::pipeline::Association;

/// A source of candidate matches, as arguments and documents name it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum AssociationChoice {
    /// No appearance: geometry alone.
    Geometric,
    /// Descriptors.
    Descriptor,
    /// The learned matcher of the config file's section `matcher`.
    Onnx,
    /// Descriptors, and the learned matcher where the config names its models.
    Auto,
}

impl AssociationChoice {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            AssociationChoice::Geometric => "geometric",
            AssociationChoice::Descriptor => "descriptor",
            AssociationChoice::Onnx => "onnx",
            AssociationChoice::Auto => "auto",
        }
    }
}

impl From<AssociationChoice> for Association {
    fn from(choice: AssociationChoice) -> Self {
        match choice {
            AssociationChoice::Geometric => Association::Geometric,
            AssociationChoice::Descriptor => Association::Descriptor,
            AssociationChoice::Onnx => Association::Onnx,
            AssociationChoice::Auto => Association::Auto,
        }
    }
}
