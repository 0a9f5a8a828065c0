//! The key `estimate.estimator`.

use serde::{Deserialize, Serialize};

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
