//! A result as its file has it.

use crate::identification::{Identification, READABLE_SCHEMAS};
use crate::meaning::Severity;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Why a text is no result of an identification.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StoredFault {
    /// It is no JSON of the form.
    #[error("this is no result of an identification: {0}")]
    Form(#[from] serde_json::Error),
    /// It is JSON of another kind.
    #[error("this is no result of an identification (schema {})", READABLE_SCHEMAS.join(" or "))]
    Schema,
    /// A covariance does not belong to the parameters beside it.
    #[error("the covariance of {of} is not a square matrix of {count} rows without negative variances")]
    Covariance {
        /// The parameters.
        of: &'static str,
        /// Their number.
        count: usize,
    },
}

/// The result of an identification as its file has it, as far as a comparison needs it: `tpm.identification/1` or `/2`.
#[derive(Clone, Debug, Deserialize)]
pub struct StoredResult {
    pub(super) model: String,
    #[serde(default)]
    pub(super) source: Option<String>,
    pub(super) parameters: Vec<StoredParameter>,
    #[serde(default)]
    pub(super) physical: Vec<StoredParameter>,
    #[serde(default)]
    pub(super) combinations: Vec<StoredCombination>,
    #[serde(default)]
    pub(super) covariance: Covariance,
    #[serde(default)]
    pub(super) combination_covariance: Covariance,
    #[serde(default)]
    pub(super) physical_covariance: Covariance,
    #[serde(default)]
    pub(super) residual: Option<f64>,
    #[serde(default)]
    pub(super) warnings: Vec<String>,
    #[serde(default)]
    pub(super) findings: Vec<Finding>,
    #[serde(default)]
    pub(super) provenance: StoredProvenance,
    #[serde(default)]
    completed_model: Option<String>,
    /// Which way the parameters came from those of another model; nothing for a result of an identification.
    #[serde(default)]
    way: Option<String>,
    #[serde(default)]
    refinement: Option<StoredRefinement>,
    #[serde(default)]
    log: Option<StoredLogReport>,
}

/// Covariance by row and column, with nothing for what has none.
pub(super) type Covariance = Vec<Vec<Option<f64>>>;

#[derive(Clone, Debug, Deserialize)]
pub(super) struct StoredParameter {
    pub(super) name: String,
    pub(super) unit: Option<String>,
    pub(super) value: Option<f64>,
    pub(super) std: Option<f64>,
    pub(super) status: String,
}

#[derive(Clone, Debug, Deserialize)]
pub(super) struct StoredCombination {
    pub(super) terms: BTreeMap<String, String>,
    pub(super) value: f64,
}

/// The kind of a warning, and how grave it is.
#[derive(Clone, Debug, Deserialize)]
pub(super) struct Finding {
    pub(super) kind: String,
    #[serde(default)]
    pub(super) severity: Option<Severity>,
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(super) struct StoredProvenance {
    pub(super) model: Option<String>,
    pub(super) logs: Vec<StoredLog>,
    pub(super) seed: Option<u64>,
    options: BTreeMap<String, serde_json::Value>,
}

#[derive(Clone, Debug, Deserialize)]
struct StoredLogReport {
    #[serde(default)]
    refinement: Option<StoredRefinement>,
}

/// A refinement by a simulation, which weighs by the noise.
#[derive(Clone, Debug, Deserialize)]
struct StoredRefinement {
    #[serde(default)]
    used: bool,
}

#[derive(Clone, Debug, Deserialize)]
pub(super) struct StoredLog {
    pub(super) path: String,
    pub(super) hash: String,
}

impl StoredResult {
    /// Reads the text of a result.
    ///
    /// # Errors
    /// [`StoredFault`] when the text is no such result, or its covariances do not fit its parameters.
    pub fn parse(text: &str) -> Result<Self, StoredFault> {
        let whole: serde_json::Value = serde_json::from_str(text)?;
        Self::of_json(whole)
    }

    /// A result as it would be read back from its file.
    ///
    /// # Errors
    /// [`StoredFault`] when the result holds numbers that JSON does not have.
    pub fn of(result: &Identification) -> Result<Self, StoredFault> {
        Self::of_json(serde_json::to_value(result)?)
    }

    fn of_json(whole: serde_json::Value) -> Result<Self, StoredFault> {
        // Named first, since a file of another kind lacks fields too.
        if !READABLE_SCHEMAS.iter().any(|schema| whole["schema"] == *schema) {
            return Err(StoredFault::Schema);
        }
        let result: Self = serde_json::from_value(whole)?;
        for (of, covariance, count) in [
            ("the parameters", &result.covariance, result.parameters.len()),
            ("the physical parameters", &result.physical_covariance, result.physical.len()),
        ] {
            if !covariance.is_empty() && !is_square(covariance, count) {
                return Err(StoredFault::Covariance { of, count });
            }
        }
        let (count, width) = (result.combinations.len(), result.parameters.len() + result.combinations.len());
        let rows = &result.combination_covariance;
        if !rows.is_empty() && (rows.len() != count || rows.iter().any(|row| row.len() != width)) {
            return Err(StoredFault::Covariance { of: "the combinations", count });
        }
        Ok(result)
    }

    /// Name of the model.
    #[must_use]
    pub fn model(&self) -> &str {
        &self.model
    }

    /// The text of the model with the forces that it lacks, where these make it better.
    #[must_use]
    pub fn completed_model(&self) -> Option<&str> {
        self.completed_model.as_deref()
    }

    /// Whether all equations counted alike: the values are those of the model whose forces are nearest.
    pub fn weighed_equally(&self) -> bool {
        let of_log = self.log.as_ref().and_then(|log| log.refinement.as_ref());
        let refined = self.refinement.as_ref().or(of_log).is_some_and(|refinement| refinement.used);
        let equal = self.provenance.options.get("weights").is_some_and(|weights| weights == "equal");
        self.way.is_some() || equal && !refined
    }

    /// Names of all parameters in which the model is linear.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.parameters.iter().map(|parameter| parameter.name.as_str())
    }

    /// What tells the model of this result from others, for messages.
    pub(super) fn described_model(&self) -> String {
        match &self.provenance.model {
            Some(hash) => format!("{} ({hash})", self.model),
            None => self.model.to_string(),
        }
    }
}

fn is_square(covariance: &Covariance, count: usize) -> bool {
    let diagonal = || covariance.iter().enumerate().map(|(i, row)| row.get(i).copied().flatten());
    covariance.len() == count
        && covariance.iter().all(|row| row.len() == count)
        && diagonal().all(|variance| variance.is_none_or(|variance| variance >= 0.0))
}
