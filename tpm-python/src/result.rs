//! Results as the library gives them: their JSON, their text, and what is computed from their logs.

use crate::model::Model;
use crate::words::{Error, Fault, Keywords, remedy};
use crate::work::{Limit, detached};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;
use tpm_runtime::document::{Document, Issue, Step};
use tpm_runtime::log::Track;
use tpm_runtime::session::{self, DeclaredModel, LogRequest, Spelling as _, Validation, evidence};

/// A value as the command line prints it with `--json`.
pub(crate) fn json(value: &impl serde::Serialize) -> PyResult<String> {
    let mut text = serde_json::to_string_pretty(value)
        .map_err(|error| Error::new_err(format!("the result cannot be written as JSON: {error}")))?;
    text.push('\n');
    Ok(text)
}

/// A serialisable value as a Python dictionary.
pub(crate) fn dictionary<'py>(py: Python<'py>, value: &impl serde::Serialize) -> PyResult<Bound<'py, PyDict>> {
    Ok(py.import("json")?.getattr("loads")?.call1((json(value)?,))?.cast_into()?)
}

/// Signals over the times of a track: its name, the times, and every signal with its name.
pub(crate) type TrackOf<'py> = (String, Bound<'py, PyArray1<f64>>, Vec<(String, Bound<'py, PyArray1<f64>>)>);

/// What a prediction compares over time.
pub(crate) fn tracks<'py>(py: Python<'py>, found: &Validation) -> Vec<TrackOf<'py>> {
    let of = |track: Track| {
        let signals = track.signals.into_iter().map(|(name, values)| (name, values.into_pyarray(py)));
        (track.name, track.time.into_pyarray(py), signals.collect())
    };
    found.tracks().into_iter().map(of).collect()
}

/// The result of an identification, and the logs that it comes from; none for one that comes from runs.
#[pyclass(frozen, module = "tpm._tpm")]
pub(crate) struct Found {
    pub(crate) result: session::Identification,
    logs: Option<(Arc<DeclaredModel>, Vec<LogRequest>)>,
}

impl Found {
    pub(crate) fn of_logs(result: session::Identification, model: Arc<DeclaredModel>, logs: Vec<LogRequest>) -> Self {
        Found { result, logs: Some((model, logs)) }
    }

    pub(crate) fn of_runs(result: session::Identification) -> Self {
        Found { result, logs: None }
    }

    fn logs(&self) -> Result<&(Arc<DeclaredModel>, Vec<LogRequest>), Fault> {
        self.logs.as_ref().ok_or_else(|| {
            Fault::Input(
                "the result comes from runs of a campaign, and has no log to compare with the model".to_owned(),
            )
        })
    }

    /// Measured beside predicted, log by log.
    fn shown(&self, py: Python<'_>) -> PyResult<Vec<Validation>> {
        let (model, logs) = self.logs()?;
        detached(py, Limit::None, || Ok(evidence(&**model, logs.clone(), &self.result)?))
    }

    fn document(&self, py: Python<'_>) -> PyResult<Document> {
        let shown = if self.logs.is_some() { self.shown(py)? } else { Vec::new() };
        let document = Document::of_identification(&self.result, &shown, &remedy);
        Ok(match &self.logs {
            Some((model, _)) => document.of_machine(model, &self.result, &step),
            None => document,
        })
    }
}

/// The call of a step after an identification.
fn step(step: Step) -> Option<String> {
    match step {
        Step::Prediction => Some("tpm.validate(model, t, signals, result)".to_owned()),
        Step::Inertias => Some("tpm.inertias(model, result, \"arm.urdf\")".to_owned()),
        Step::Code => Some("model.generate(\"c\", params=result)".to_owned()),
        _ => None,
    }
}

#[pymethods]
impl Found {
    fn json(&self) -> PyResult<String> {
        json(&self.result)
    }

    fn text(&self) -> String {
        self.result.text(&remedy)
    }

    fn warnings(&self) -> Vec<String> {
        let told = |warning: &session::Warning| Keywords.with(&warning.to_string(), warning.remedy().as_ref());
        self.result.warnings.iter().map(told).collect()
    }

    /// What is compared over time, log by log.
    fn tracks<'py>(&self, py: Python<'py>) -> PyResult<Vec<Vec<TrackOf<'py>>>> {
        Ok(self.shown(py)?.iter().map(|shown| tracks(py, shown)).collect())
    }

    /// The page of the result, and its figures as SVG by name.
    fn page(
        &self,
        py: Python<'_>,
        title: Option<String>,
        author: Option<String>,
        date: Option<String>,
    ) -> PyResult<(String, Vec<(String, String)>)> {
        let document = self.document(py)?.issued(Issue { title, author, date });
        let fault = |error: &dyn std::fmt::Display| Error::new_err(error.to_string());
        let html = document.html().map_err(|error| fault(&error))?;
        let figures = document.figures().map(|(name, figure)| Ok((name.to_owned(), figure.svg()?)));
        let figures: Result<_, tpm_runtime::plot::PlotError> = figures.collect();
        Ok((html, figures.map_err(|error| fault(&error))?))
    }

    /// The model with the forces that it lacks, and its result; nothing where none make it better.
    fn completed(&self, py: Python<'_>, time: Option<f64>) -> PyResult<Option<(Model, Found)>> {
        let (model, logs) = self.logs()?;
        let found = detached(py, Limit::of(time), || Ok(session::completed(&**model, logs.clone(), &self.result)?))?;
        Ok(found.map(|(whole, result)| {
            let whole = Arc::new(whole);
            let found = Found::of_logs(result, Arc::clone(&whole), logs.clone());
            (Model { declared: whole, path: None }, found)
        }))
    }
}
