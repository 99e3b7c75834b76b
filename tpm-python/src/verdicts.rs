//! What follows from results and logs: predictions, comparisons, inspections, checks. Each is the dictionary that the command line's JSON is.

use crate::arrays::of_arrays;
use crate::log::with_settings;
use crate::model::Model;
use crate::result::{Identification, dictionary};
use crate::words::{Error, Fault};
use crate::work::detached;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use tpm_runtime::session::{self, LogRequest, StoredResult};

/// Results as they are read back from files.
fn stored(result: &Identification) -> PyResult<StoredResult> {
    StoredResult::of(&result.result).map_err(|fault| Error::new_err(fault.to_string()))
}

impl Model {
    fn validated<'py>(
        &self,
        py: Python<'py>,
        request: LogRequest,
        known: &Identification,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (model, known) = (&*self.declared, &known.result);
        let found = detached(py, false, || Ok(session::validate(model, request, known)?))?;
        dictionary(py, &found)
    }
}

/// Predicts arrays with the parameters of a result: nothing is fitted.
#[pyfunction]
#[pyo3(signature = (model, t, signals, result, **settings))]
pub(crate) fn validate<'py>(
    py: Python<'py>,
    model: &Model,
    t: &Bound<'py, PyAny>,
    signals: &Bound<'py, PyAny>,
    result: &Identification,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    model.validated(py, with_settings(of_arrays(t, signals)?, settings)?, result)
}

/// Predicts a log with the parameters of a result: nothing is fitted.
#[pyfunction]
#[pyo3(signature = (model, log, result, **settings))]
pub(crate) fn validate_log<'py>(
    py: Python<'py>,
    model: &Model,
    log: PathBuf,
    result: &Identification,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    model.validated(py, with_settings(LogRequest::new(log), settings)?, result)
}

/// Looks at a log before anything is identified from it, for a model where one is given.
#[pyfunction]
#[pyo3(signature = (log, model = None, **settings))]
pub(crate) fn inspect_log<'py>(
    py: Python<'py>,
    log: PathBuf,
    model: Option<&Model>,
    settings: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyDict>> {
    let request = with_settings(LogRequest::new(log), settings)?;
    let declared = model.map(|model| &*model.declared);
    let found = detached(py, false, || {
        Ok(match declared {
            Some(model) => session::inspect_for(model, request)?,
            None => session::inspect(request)?,
        })
    })?;
    dictionary(py, &found)
}

/// What changed between two results of different data.
#[pyfunction]
pub(crate) fn compare<'py>(py: Python<'py>, a: &Identification, b: &Identification) -> PyResult<Bound<'py, PyDict>> {
    let (a, b) = (stored(a)?, stored(b)?);
    let found = detached(py, false, || session::compare(&a, &b).map_err(|fault| Fault::Input(fault.to_string())))?;
    dictionary(py, &found)
}
