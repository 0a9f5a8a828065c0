//! The keys `estimate.estimator` and `estimate.association`.

use serde::{Deserialize, Serialize};

use crate::pipeline::Association;
use crate::solver::Estimator;

/// What the file calls an estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EstimatorName {
    /// Consensus over all lines.
    Consensus,
    /// The paper's own.
    Pelical,
}

impl From<Estimator> for EstimatorName {
    fn from(estimator: Estimator) -> Self {
        match estimator {
            Estimator::Consensus => EstimatorName::Consensus,
            Estimator::Pelical => EstimatorName::Pelical,
        }
    }
}

impl From<EstimatorName> for Estimator {
    fn from(name: EstimatorName) -> Self {
        match name {
            EstimatorName::Consensus => Estimator::Consensus,
            EstimatorName::Pelical => Estimator::Pelical,
        }
    }
}

/// What the file calls the sources that score candidate matches.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AssociationName {
    /// All that there are.
    Auto,
    /// None.
    Geometric,
    /// Descriptors.
    Descriptor,
    /// The learned matcher.
    Onnx,
}

impl From<Association> for AssociationName {
    fn from(association: Association) -> Self {
        match association {
            Association::Auto => AssociationName::Auto,
            Association::Geometric => AssociationName::Geometric,
            Association::Descriptor => AssociationName::Descriptor,
            Association::Onnx => AssociationName::Onnx,
        }
    }
}

impl From<AssociationName> for Association {
    fn from(name: AssociationName) -> Self {
        match name {
            AssociationName::Auto => Association::Auto,
            AssociationName::Geometric => Association::Geometric,
            AssociationName::Descriptor => Association::Descriptor,
            AssociationName::Onnx => Association::Onnx,
        }
    }
}
