//! Results with arrays.

use crate::words::{Error, Keywords, remedy};
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::fmt::Write as _;
use tpm_runtime::estimate::ParameterReport;
use tpm_runtime::report::{number, plus_minus};
use tpm_runtime::session::{self, Spelling as _};

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

/// Identified parameters, and everything that is known about them.
#[pyclass(frozen, module = "tpm")]
pub(crate) struct Identification {
    pub(crate) result: session::Identification,
}

impl Identification {
    fn named(&self, name: &str) -> PyResult<&ParameterReport> {
        let all = self.result.parameters.iter().chain(&self.result.physical);
        all.into_iter().find(|own| own.name == name).ok_or_else(|| PyKeyError::new_err(name.to_owned()))
    }
}

/// One number of every parameter, NaN where there is none.
fn each<'py>(
    py: Python<'py>,
    parameters: &[ParameterReport],
    of: impl Fn(&ParameterReport) -> Option<f64>,
) -> Bound<'py, PyArray1<f64>> {
    parameters.iter().map(|own| of(own).unwrap_or(f64::NAN)).collect::<Vec<f64>>().into_pyarray(py)
}

fn matrix<'py>(py: Python<'py>, rows: &[Vec<Option<f64>>]) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let columns = rows.first().map_or(0, Vec::len);
    let all: Vec<f64> = rows.iter().flatten().map(|entry| entry.unwrap_or(f64::NAN)).collect();
    all.into_pyarray(py).reshape([rows.len(), columns])
}

#[pymethods]
impl Identification {
    #[getter]
    fn model(&self) -> &str {
        &self.result.model
    }

    #[getter]
    fn names(&self) -> Vec<&str> {
        self.result.parameters.iter().map(|own| own.name.as_str()).collect()
    }

    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        each(py, &self.result.parameters, |own| own.value)
    }

    #[getter]
    fn std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        each(py, &self.result.parameters, |own| own.std)
    }

    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.result.covariance)
    }

    #[getter]
    fn physical_names(&self) -> Vec<&str> {
        self.result.physical.iter().map(|own| own.name.as_str()).collect()
    }

    #[getter]
    fn physical_values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        each(py, &self.result.physical, |own| own.value)
    }

    #[getter]
    fn physical_std<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        each(py, &self.result.physical, |own| own.std)
    }

    #[getter]
    fn physical_covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, &self.result.physical_covariance)
    }

    #[getter]
    const fn rank(&self) -> usize {
        self.result.rank
    }

    #[getter]
    const fn condition(&self) -> Option<f64> {
        self.result.condition
    }

    #[getter]
    const fn residual(&self) -> f64 {
        self.result.residual
    }

    #[getter]
    fn warnings(&self) -> Vec<String> {
        let told = |warning: &session::Warning| Keywords.with(&warning.to_string(), warning.remedy().as_ref());
        self.result.warnings.iter().map(told).collect()
    }

    #[getter]
    fn trusted(&self) -> bool {
        self.result.is_complete()
    }

    #[getter]
    fn shortfall(&self) -> Option<String> {
        self.result.shortfall()
    }

    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, &self.result)
    }

    fn json(&self) -> PyResult<String> {
        json(&self.result)
    }

    fn __getitem__(&self, name: &str) -> PyResult<f64> {
        Ok(self.named(name)?.value.unwrap_or(f64::NAN))
    }

    fn __str__(&self) -> String {
        self.result.text(&remedy)
    }

    fn __repr__(&self) -> String {
        let trusted = if self.trusted() { "" } else { ", not everything is identified" };
        format!("<tpm.Identification of {}: rank {}{trusted}>", self.result.model, self.result.rank)
    }

    fn _repr_html_(&self) -> String {
        let mut html = format!("<table><caption>{}</caption>", escaped(&self.result.model));
        html.push_str("<tr><th>parameter</th><th>unit</th><th>identified</th><th>status</th></tr>");
        for own in self.result.parameters.iter().chain(&self.result.physical) {
            let value = match (own.value, own.std) {
                (Some(value), Some(std)) if std > 0.0 => plus_minus(value, std),
                (Some(value), _) => number(value),
                (None, _) => "-".to_owned(),
            };
            let cells = [&own.name, own.unit.as_deref().unwrap_or(""), &value, own.status.name()];
            html.push_str("<tr>");
            for cell in cells {
                // Writing to a string cannot fail.
                let _ = write!(html, "<td>{}</td>", escaped(cell));
            }
            html.push_str("</tr>");
        }
        html.push_str("</table>");
        for said in self.shortfall().iter().chain(&self.warnings()) {
            let _ = write!(html, "<p>{}</p>", escaped(said));
        }
        html
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}
