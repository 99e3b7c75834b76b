//! What follows from results and logs: predictions, comparisons, inspections. Each is the dictionary that the command line's JSON is; results
//! come as their JSON.

use crate::log::{Keywords, log_of, with_settings};
use crate::model::Model;
use crate::result::{TrackOf, dictionary, tracks};
use crate::words::{Error, Fault};
use crate::work::{Limit, detached};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use tpm_codegen::identified::{Identified, READABLE_SCHEMAS};
use tpm_runtime::report::{Align, TextTable, cells};
use tpm_runtime::session::{self, StoredResult};

/// A result as it is read back.
pub(crate) fn stored(text: &str) -> PyResult<StoredResult> {
    StoredResult::parse(text).map_err(|fault| Error::new_err(fault.to_string()))
}

/// What a result knows of the parameters.
pub(crate) fn identified(text: &str) -> PyResult<Identified> {
    Identified::from_json(text).map_err(|fault| {
        let known = READABLE_SCHEMAS.join(" or ");
        Error::new_err(format!("this is no result of an identification (schema {known}): {fault}"))
    })
}

/// A result that was read back as text: its parameters and its warnings.
#[pyfunction]
pub(crate) fn described(text: &str) -> PyResult<String> {
    #[derive(serde::Deserialize)]
    struct Parameter {
        name: String,
        unit: Option<String>,
        value: Option<f64>,
        std: Option<f64>,
        status: String,
    }
    #[derive(serde::Deserialize)]
    struct Whole {
        model: String,
        parameters: Vec<Parameter>,
        #[serde(default)]
        physical: Vec<Parameter>,
        #[serde(default)]
        warnings: Vec<String>,
        #[serde(default)]
        shortfall: Option<String>,
    }
    stored(text)?;
    let whole: Whole = serde_json::from_str(text).map_err(|error| Error::new_err(error.to_string()))?;
    let mut table = TextTable::new(&[
        ("parameter", Align::Left),
        ("unit", Align::Left),
        ("identified", Align::Decimal),
        ("std. dev.", Align::Decimal),
        ("", Align::Left),
    ]);
    for own in whole.parameters.iter().chain(&whole.physical) {
        let [value, std] = cells(own.value, own.std);
        let status = if own.status == "identified" { String::new() } else { own.status.replace('_', " ") };
        table.row(&[own.name.clone(), own.unit.clone().unwrap_or_else(|| "-".to_owned()), value, std, status]);
    }
    let said = whole.warnings.iter().map(|warning| format!("warning: {warning}\n"));
    let said = said.chain(whole.shortfall.iter().map(|why| format!("{why}\n")));
    Ok(format!(
        "model {}, a result that was read back\n\n{}\n{}",
        whole.model,
        table.finish(),
        said.collect::<String>()
    ))
}

/// Predicts a log with the parameters of a result, whose JSON is given: the prediction's JSON and what it compares over time.
#[pyfunction]
pub(crate) fn validate<'py>(
    py: Python<'py>,
    model: &Model,
    log: &Bound<'py, PyAny>,
    result: &str,
    settings: Keywords<'_, 'py>,
) -> PyResult<(Bound<'py, PyDict>, Vec<TrackOf<'py>>, Option<String>)> {
    let (request, time) = with_settings(log_of(log)?, settings)?;
    let known = identified(result)?;
    let declared = &*model.declared;
    let found = detached(py, Limit::of(time), || Ok(session::validate(declared, request, known)?))?;
    Ok((dictionary(py, &found)?, tracks(py, &found), found.shortfall()))
}

/// Looks at a log before anything is identified from it, for a model where one is given.
#[pyfunction]
pub(crate) fn inspect<'py>(
    py: Python<'py>,
    log: &Bound<'py, PyAny>,
    model: Option<&Model>,
    settings: Keywords<'_, 'py>,
) -> PyResult<Bound<'py, PyDict>> {
    let (request, time) = with_settings(log_of(log)?, settings)?;
    let declared = model.map(|model| &*model.declared);
    let found = detached(py, Limit::of(time), || {
        Ok(match declared {
            Some(model) => session::inspect_for(model, request)?,
            None => session::inspect(request)?,
        })
    })?;
    dictionary(py, &found)
}

/// What changed between two results of different data.
#[pyfunction]
pub(crate) fn compare<'py>(py: Python<'py>, a: &str, b: &str) -> PyResult<Bound<'py, PyDict>> {
    let (a, b) = (stored(a)?, stored(b)?);
    let compared = || session::compare(&a, &b).map_err(|fault| Fault::Input(fault.to_string()));
    dictionary(py, &detached(py, Limit::None, compared)?)
}
