//! Campaigns in a folder: what to play next goes out as arrays, what was recorded comes in.

use crate::arrays::of_arrays;
use crate::log::{TIME, with_columns};
use crate::model::{Arrays, Model, Simulated, experiment_request, record_arrays};
use crate::result::{Found, dictionary};
use crate::words::Fault;
use crate::work::{Limit, detached};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use tpm_runtime::campaign::trial_columns;
use tpm_runtime::motion::Record;
use tpm_runtime::session::{CampaignFolder, LogRequest, NextRun, NextStep, SessionError};

/// A campaign in a folder: model, experiment, and every finished run.
#[pyclass(frozen, module = "tpm._tpm")]
pub(crate) struct Campaign {
    folder: CampaignFolder,
}

/// A run to be played.
#[pyclass(frozen, module = "tpm._tpm")]
pub(crate) struct Run {
    next: NextRun,
    columns: Vec<(String, Vec<f64>)>,
}

/// What became of a submitted run.
#[pyclass(frozen, module = "tpm._tpm")]
pub(crate) struct Submission {
    /// Whether the run is kept.
    #[pyo3(get)]
    kept: bool,
    /// Why the campaign has ended; nothing while it goes on.
    #[pyo3(get)]
    outcome: Option<&'static str>,
    /// The run.
    #[pyo3(get)]
    run: Py<PyDict>,
    /// The identification from all runs so far, or why there is none; the run stays submitted in both cases.
    result: PyResult<Py<Found>>,
}

impl Campaign {
    fn take(&self, py: Python<'_>, request: LogRequest, stopped: bool) -> PyResult<Submission> {
        let submitted = detached(py, Limit::None, || Ok(self.folder.submit(request, stopped)?))?;
        Ok(Submission {
            kept: submitted.kept,
            outcome: submitted.outcome.map(|outcome| outcome.describe()),
            run: dictionary(py, &submitted.run)?.unbind(),
            result: match submitted.result {
                Ok(result) => Ok(Py::new(py, Found::of_runs(result))?),
                Err(fault) => Err(Fault::from(fault).into()),
            },
        })
    }
}

#[pymethods]
impl Campaign {
    #[staticmethod]
    #[pyo3(signature = (folder, model, experiment = None, *, changes = None, pattern = None, bounds = None))]
    #[allow(clippy::too_many_arguments)]
    fn begin(
        py: Python<'_>,
        folder: PathBuf,
        model: &Model,
        experiment: Option<PathBuf>,
        changes: Option<BTreeMap<String, Bound<'_, PyAny>>>,
        pattern: Option<String>,
        bounds: Option<BTreeMap<String, (f64, f64)>>,
    ) -> PyResult<Self> {
        let request = experiment_request(experiment, changes, pattern, bounds)?;
        let begun = || Ok(CampaignFolder::begin(&folder, model.session(&request)?)?);
        Ok(Campaign { folder: detached(py, Limit::None, begun)? })
    }

    #[staticmethod]
    #[pyo3(signature = (folder, *, bounds = None))]
    fn open(py: Python<'_>, folder: PathBuf, bounds: Option<BTreeMap<String, (f64, f64)>>) -> PyResult<Self> {
        let opened = || Ok(CampaignFolder::open(&folder, bounds.unwrap_or_default())?);
        Ok(Campaign { folder: detached(py, Limit::None, opened)? })
    }

    /// What to play next; nothing when the campaign has ended.
    fn next(&self, py: Python<'_>) -> PyResult<Option<Run>> {
        let next = detached(py, Limit::None, || Ok(self.folder.next()?))?;
        let plant = self.folder.session().machine().plant();
        Ok(match next {
            NextStep::Play(next) => Some(Run { columns: trial_columns(plant, &next.trial), next: *next }),
            NextStep::Ended(_) => None,
        })
    }

    #[pyo3(signature = (t, signals, *, stopped = false, **settings))]
    fn submit(
        &self,
        py: Python<'_>,
        t: &Bound<'_, PyAny>,
        signals: &Bound<'_, PyAny>,
        stopped: bool,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Submission> {
        self.take(py, with_columns(of_arrays(t, signals)?, settings)?, stopped)
    }

    #[pyo3(signature = (log, *, stopped = false, **settings))]
    fn submit_log(
        &self,
        py: Python<'_>,
        log: PathBuf,
        stopped: bool,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Submission> {
        self.take(py, with_columns(LogRequest::new(log), settings)?, stopped)
    }

    /// Plays a run on the simulated machine of the experiment: stamps, and coordinates and inputs by name.
    fn simulate<'py>(&self, py: Python<'py>, run: &Run) -> PyResult<Simulated<'py>> {
        let session = self.folder.session();
        let record: Record = detached(py, Limit::None, || Ok::<_, Fault>(session.simulate(&run.next.trial)?))?;
        Ok(record_arrays(py, session.machine().plant(), record))
    }

    fn result(&self, py: Python<'_>) -> PyResult<Found> {
        Ok(Found::of_runs(detached(py, Limit::None, || Ok::<_, Fault>(self.folder.result()?))?))
    }

    /// Why the campaign has ended; nothing while it goes on.
    #[getter]
    fn outcome(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        Ok(match detached(py, Limit::None, || Ok::<_, Fault>(self.folder.next()?))? {
            NextStep::Play(_) => None,
            NextStep::Ended(outcome) => Some(outcome.describe()),
        })
    }

    fn __repr__(&self) -> PyResult<String> {
        let kept = self.folder.store().fingerprints().map_err(|error| Fault::from(SessionError::from(error)))?.len();
        Ok(format!("<tpm.Campaign in {}: {kept} runs>", self.folder.store().folder().display()))
    }
}

#[pymethods]
impl Run {
    /// Number of the run, from 1.
    #[getter]
    const fn number(&self) -> usize {
        self.next.trial.run
    }

    /// Stamps, s.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let time = self.columns.iter().find(|(name, _)| name == TIME).map(|(_, values)| values.clone());
        time.unwrap_or_default().into_pyarray(py)
    }

    /// Reference with its derivatives, and feed-forward, by the names of the columns that `tpm campaign next` writes.
    #[getter]
    fn samples<'py>(&self, py: Python<'py>) -> Arrays<'py> {
        let signals = self.columns.iter().filter(|(name, _)| name != TIME);
        signals.map(|(name, values)| (name.clone(), values.clone().into_pyarray(py))).collect()
    }

    /// Feedback, limits and timing.
    #[getter]
    fn terms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        dictionary(py, &self.next.terms)
    }

    fn __repr__(&self) -> String {
        format!("<tpm.Run {}: {} samples>", self.number(), self.next.trial.samples())
    }
}

#[pymethods]
impl Submission {
    #[getter]
    fn result(&self, py: Python<'_>) -> PyResult<Py<Found>> {
        match &self.result {
            Ok(found) => Ok(found.clone_ref(py)),
            Err(fault) => Err(fault.clone_ref(py)),
        }
    }

    fn __repr__(&self) -> String {
        let kept = if self.kept { "kept" } else { "not kept" };
        self.outcome
            .map_or_else(|| format!("<tpm.Submission {kept}>"), |outcome| format!("<tpm.Submission {kept}; {outcome}>"))
    }
}
