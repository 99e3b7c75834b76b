//! Whether a machine is still the one that was identified.
//!
//! Two questions about a new log: do the old parameters still explain it, which nothing is fitted for; and identified anew, have parameters
//! moved beyond what chance makes of two independent results. Invariant: a regression passes exactly when all of its checks pass.

use crate::compare::{CompareError, Comparison, Difference, StoredFault, StoredResult, Verdict, compare};
use crate::error::SessionError;
use crate::identification::Identification;
use crate::log::{LogRequest, from_log};
use crate::model::Identifiable;
use crate::validate::{Validation, validate};
use serde::Serialize;
use tpm_codegen::identified::Identified;

/// How one check came out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "outcome", content = "why")]
#[non_exhaustive]
pub enum CheckOutcome {
    /// As before.
    Passed,
    /// Not as before, and what is different.
    Failed(String),
    /// Nothing can be said, and why.
    Skipped(String),
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[non_exhaustive]
pub struct Check {
    /// What is checked: a parameter, or what the parameters do together.
    pub name: String,
    /// How it came out.
    #[serde(flatten)]
    pub outcome: CheckOutcome,
}

/// A log against an earlier result; serialises as `tpm.regression/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Regression {
    /// `tpm.regression/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// Name of the log.
    pub log: String,
    /// The checks, in the order in which they are told.
    pub checks: Vec<Check>,
    /// What changed; nothing where the two results have nothing in common that both show.
    pub comparison: Option<Comparison>,
    /// How well the earlier parameters predict the log.
    pub validation: Validation,
}

/// Why a log cannot be held against a result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RegressionError {
    /// The log cannot be used.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The earlier result and that of the log cannot be compared.
    #[error(transparent)]
    Compare(#[from] CompareError),
    /// The result of the log holds numbers that cannot be compared.
    #[error(transparent)]
    Stored(#[from] StoredFault),
}

impl Regression {
    /// The checks that failed.
    pub fn failed(&self) -> impl Iterator<Item = &Check> {
        self.checks.iter().filter(|check| matches!(check.outcome, CheckOutcome::Failed(_)))
    }

    /// Whether the machine is still the one that was identified, as far as the log shows.
    #[must_use]
    pub fn passed(&self) -> bool {
        self.failed().next().is_none()
    }
}

/// Holds a log against an earlier result: whether its parameters still predict the log, whether the log is explained by the model at all,
/// and for every parameter whether it has moved beyond chance. All parameters together are held to a false alarm in
/// [`Comparison::LEVEL`] of the logs of a machine that has not changed.
///
/// # Errors
/// [`RegressionError`] when the log cannot be read or identified, the earlier result has no value for a parameter, or units do not agree.
pub fn check_against(
    model: &impl Identifiable,
    log: impl Into<LogRequest>,
    earlier: (&StoredResult, &Identified),
) -> Result<Regression, RegressionError> {
    let (request, (stored, known)) = (log.into(), earlier);
    let validation = validate(model, request.clone(), known)?;
    let again = from_log(model, request)?;
    let comparison = match compare(stored, &StoredResult::of(&again)?) {
        Ok(comparison) => Some(comparison),
        Err(CompareError::Nothing { .. }) => None,
        Err(fault) => return Err(fault.into()),
    };
    let check = |name: &str, outcome| Check { name: name.to_owned(), outcome };
    let or_passed = |why: Option<String>| why.map_or(CheckOutcome::Passed, CheckOutcome::Failed);
    let mut checks = vec![
        check("the earlier parameters predict the log", or_passed(validation.shortfall())),
        check("the model explains the log", explained(&again)),
    ];
    match &comparison {
        None => {
            let why = "the log and the earlier result show nothing in common".to_owned();
            checks.push(check("parameters", CheckOutcome::Skipped(why)));
        }
        Some(comparison) => {
            let mut told: Vec<&str> = Vec::new();
            for own in comparison.families().flat_map(|family| &family.differences) {
                // A parameter that is not lumped stands in both families.
                if !told.contains(&own.name.as_str()) {
                    told.push(&own.name);
                    checks.push(check(&own.name, moved(own)));
                }
            }
            let together = comparison.verdict == Verdict::ChangedTogether;
            let why = together.then(|| comparison.in_words());
            checks.push(check("all parameters together", or_passed(why)));
        }
    }
    Ok(Regression {
        schema: "tpm.regression/1",
        model: again.model.clone(),
        log: validation.log.clone(),
        checks,
        comparison,
        validation,
    })
}

/// Whether the model explains the log when its parameters are free. A log that does not show everything is no fault of the machine.
fn explained(again: &Identification) -> CheckOutcome {
    let distrusted = again.warnings.iter().find(|warning| warning.is_distrust());
    match (distrusted, again.shortfall()) {
        (Some(warning), _) => CheckOutcome::Failed(warning.to_string()),
        (None, Some(why)) if !again.is_explained() => CheckOutcome::Failed(why),
        (None, Some(why)) => CheckOutcome::Skipped(why),
        (None, None) => CheckOutcome::Passed,
    }
}

/// Whether a parameter has moved beyond chance.
fn moved(own: &Difference) -> CheckOutcome {
    match (&own.untested, own.changed) {
        (Some(why), _) => CheckOutcome::Skipped(why.clone()),
        (None, true) => CheckOutcome::Failed(own.in_words()),
        (None, false) => CheckOutcome::Passed,
    }
}
