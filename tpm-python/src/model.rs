//! Models: what they say, what they show, and what logs say of them.

use crate::arrays::of_arrays;
use crate::log::with_settings;
use crate::result::{Identification, dictionary};
use crate::table::Table;
use crate::words::{Error, Fault};
use crate::work::{detached, requested};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use tpm_codegen::diagnostic::{self, Diagnostic};
use tpm_codegen::emit::estimator::{EstimatorSource, Identified, Part};
use tpm_codegen::generate::{Language, Options, Scalar, generate};
use tpm_codegen::language::AtTerm;
use tpm_runtime::experiment::{Value, written_value};
use tpm_runtime::session::{
    CampaignFolder, DeclaredModel, ExperimentRequest, Identifiable as _, LogRequest, Session, from_logs,
};
use tpm_runtime::study::{self, AskedPattern, ShownError, shown};
use tpm_symbolic::harmonic::expand::{ExpandError, ExpandOptions, expand_with};
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::regressor::prepare::prepare;

/// A model of a machine: its text, its exact form, and its evaluation.
#[pyclass(frozen, module = "tpm")]
pub(crate) struct Model {
    pub(crate) declared: Arc<DeclaredModel>,
    /// The file, beside which an experiment is looked for.
    pub(crate) path: Option<PathBuf>,
}

/// One name, or several.
#[derive(FromPyObject)]
enum Names {
    One(String),
    Several(Vec<String>),
}

/// A log of one file, or several.
#[derive(FromPyObject)]
enum Paths {
    One(PathBuf),
    Several(Vec<PathBuf>),
}

impl Model {
    fn of(
        py: Python<'_>,
        path: Option<PathBuf>,
        read: impl FnOnce() -> Result<DeclaredModel, Fault> + Send,
    ) -> PyResult<Self> {
        Ok(Model { declared: Arc::new(detached(py, false, read)?), path })
    }

    /// The session of an experiment on this model.
    pub(crate) fn session(&self, request: &ExperimentRequest) -> Result<Session, Fault> {
        let Some(file) = request.file.as_deref().or(self.path.as_deref()) else {
            return Err(Fault::Input(
                "a model that came as text has no file beside which an experiment is; give experiment=FILE".to_owned(),
            ));
        };
        Ok(Session::open((*self.declared).clone(), file, request)?)
    }

    fn identified(&self, py: Python<'_>, requests: Vec<LogRequest>) -> PyResult<Identification> {
        let model = &*self.declared;
        let result = detached(py, false, || Ok(from_logs(model, requests)?))?;
        Ok(Identification { result })
    }
}

/// A fault at its place in a model's text.
fn located(declared: &DeclaredModel, diagnostic: &Diagnostic) -> Fault {
    Fault::Input(diagnostic::render(declared.text(), diagnostic))
}

fn at(declared: &DeclaredModel, fault: &impl AtTerm) -> Fault {
    located(declared, &declared.parsed().locate(fault))
}

/// Exact values by name: numbers, fractions, or texts such as "1/3".
fn exact(name: &str, values: Option<BTreeMap<String, Bound<'_, PyAny>>>) -> PyResult<Vec<(String, Rational)>> {
    let value = |(key, value): (String, Bound<'_, PyAny>)| {
        let text = value.str()?.to_string();
        let number = rational::parse(text.trim()).ok_or_else(|| {
            Error::new_err(format!("{name}={{\"{key}\": {text}}}: the value is not a number such as 2, 1/3 or 0.25"))
        })?;
        Ok((key, number))
    };
    values.unwrap_or_default().into_iter().map(value).collect()
}

/// A value of an experiment file. A text is written as in the file, or stands for itself.
fn value_of(value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if let Ok(text) = value.extract::<String>() {
        return Ok(written_value(&text));
    }
    if let Ok(flag) = value.extract::<bool>() {
        return Ok(Value::Boolean(flag));
    }
    if let Ok(number) = value.extract::<i64>() {
        return Ok(Value::Integer(number));
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(Value::Float(number));
    }
    if let Ok(entries) = value.extract::<BTreeMap<String, Bound<'_, PyAny>>>() {
        let entry = |(key, inner): (String, Bound<'_, PyAny>)| Ok((key, value_of(&inner)?));
        return Ok(Value::Table(entries.into_iter().map(entry).collect::<PyResult<_>>()?));
    }
    if let Ok(items) = value.extract::<Vec<Bound<'_, PyAny>>>() {
        return Ok(Value::Array(items.iter().map(value_of).collect::<PyResult<_>>()?));
    }
    let message = "a value of an experiment is a number, a bool, a text, or a list or dict of these";
    Err(PyTypeError::new_err(format!("{message}, not {}", value.get_type().name()?)))
}

/// What is asked of an experiment.
pub(crate) fn experiment_request(
    experiment: Option<PathBuf>,
    changes: Option<BTreeMap<String, Bound<'_, PyAny>>>,
    pattern: Option<String>,
    bounds: Option<BTreeMap<String, (f64, f64)>>,
) -> PyResult<ExperimentRequest> {
    let change = |(key, value): (String, Bound<'_, PyAny>)| Ok((key, value_of(&value)?));
    Ok(ExperimentRequest {
        file: experiment,
        changes: changes.unwrap_or_default().into_iter().map(change).collect::<PyResult<_>>()?,
        pattern,
        bounds: bounds.unwrap_or_default(),
        ..ExperimentRequest::default()
    })
}

#[pymethods]
impl Model {
    #[staticmethod]
    fn from_file(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Self::of(py, Some(path.clone()), move || Ok(DeclaredModel::open(path)?))
    }

    #[staticmethod]
    #[pyo3(signature = (text, name = "model"))]
    fn from_text(py: Python<'_>, text: &str, name: &str) -> PyResult<Self> {
        Self::of(py, None, || Ok(DeclaredModel::parse(name, text)?))
    }

    #[getter]
    fn name(&self) -> String {
        self.declared.prepared().model.name.to_string()
    }

    #[getter]
    fn text(&self) -> String {
        self.declared.text().text().to_owned()
    }

    #[getter]
    fn coordinates(&self) -> Vec<String> {
        let model = self.declared.evaluated();
        (0..model.dims().coordinates).map(|c| model.coordinate(c).name.to_owned()).collect()
    }

    #[getter]
    fn inputs(&self) -> Vec<String> {
        let model = self.declared.evaluated();
        (0..model.dims().inputs).map(|i| model.input(i).name.to_owned()).collect()
    }

    #[getter]
    fn parameters(&self) -> Vec<String> {
        let model = self.declared.evaluated();
        (0..model.dims().parameters).map(|j| model.parameter(j).name.to_owned()).collect()
    }

    #[getter]
    fn remarks(&self) -> String {
        self.declared.remarks()
    }

    #[pyo3(signature = (pattern = None, *, harmonics = None, allow_large = false))]
    fn expand(
        &self,
        py: Python<'_>,
        pattern: Option<&str>,
        harmonics: Option<usize>,
        allow_large: bool,
    ) -> PyResult<Table> {
        let declared = &*self.declared;
        let expanded = || {
            let (parsed, pattern) = (declared.parsed(), declared.pattern(pattern)?);
            let (model, _, constants) = parsed.for_read_tables().map_err(|error| at(declared, &error))?;
            let prepared = prepare(model).map_err(|error| at(declared, &error))?;
            let mut step = |_| if requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) };
            let harmonics = harmonics.or_else(|| parsed.declared_harmonics(pattern));
            let mut options = ExpandOptions { progress: Some(&mut step), harmonics, ..ExpandOptions::default() };
            let table = expand_with(&prepared.model, &prepared.form, pattern, &mut options);
            let table = table.map_err(|error| match error {
                ExpandError::Stopped { .. } => Fault::Interrupted,
                ExpandError::TooLarge { .. } => {
                    let help = "to expand it all the same, give allow_large=True";
                    located(declared, &parsed.locate(&error).help(help))
                }
                error => at(declared, &error),
            })?;
            Ok(table.gathered(constants, prepared.model.is_constant()))
        };
        Ok(Table { table: detached(py, allow_large, expanded)? })
    }

    #[pyo3(signature = (pattern = None, *, values = None, harmonics = None, any_motion = false, rest = None, allow_large = false))]
    #[allow(clippy::too_many_arguments)]
    fn identifiability<'py>(
        &self,
        py: Python<'py>,
        pattern: Option<Names>,
        values: Option<BTreeMap<String, Bound<'py, PyAny>>>,
        harmonics: Option<usize>,
        any_motion: bool,
        rest: Option<BTreeMap<String, Bound<'py, PyAny>>>,
        allow_large: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let declared = &*self.declared;
        let fault = |error| match error {
            ShownError::Model(diagnostic) => located(declared, &diagnostic),
            other => Fault::Input(other.to_string()),
        };
        if any_motion || declared.prepared().model.patterns.is_empty() && pattern.is_none() {
            let rest = exact("rest", rest)?;
            let found = detached(py, allow_large, || study::any_motion(declared.parsed(), &rest).map_err(fault))?;
            return dictionary(py, &found);
        }
        if rest.is_some() {
            return Err(Error::new_err("rest=...: a pattern says how coordinates move; give any_motion=True"));
        }
        let values = exact("values", values)?;
        let names = match pattern {
            None => vec![None],
            Some(Names::One(name)) => vec![Some(name)],
            Some(Names::Several(names)) => names.into_iter().map(Some).collect(),
        };
        let found = detached(py, allow_large, || {
            let mut asked = Vec::with_capacity(names.len());
            for name in &names {
                let pattern = declared.pattern(name.as_deref())?;
                let name = name.clone().unwrap_or_else(|| "the pattern".to_owned());
                asked.push(AskedPattern { name, pattern, harmonics, values: values.clone() });
            }
            shown(declared.parsed(), &asked).map_err(fault)
        })?;
        dictionary(py, &found)
    }

    #[pyo3(signature = (t, signals, **settings))]
    pub(crate) fn identify(
        &self,
        py: Python<'_>,
        t: &Bound<'_, PyAny>,
        signals: &Bound<'_, PyAny>,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Identification> {
        let request = with_settings(of_arrays(t, signals)?, settings)?;
        self.identified(py, vec![request])
    }

    #[pyo3(signature = (log, **settings))]
    fn identify_log(
        &self,
        py: Python<'_>,
        log: Paths,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Identification> {
        let paths = match log {
            Paths::One(path) => vec![path],
            Paths::Several(paths) => paths,
        };
        let requests: PyResult<Vec<LogRequest>> =
            paths.into_iter().map(|path| with_settings(LogRequest::new(path), settings)).collect();
        self.identified(py, requests?)
    }

    #[pyo3(signature = (experiment = None, *, changes = None, pattern = None, bounds = None, runs = None))]
    fn identify_simulated(
        &self,
        py: Python<'_>,
        experiment: Option<PathBuf>,
        changes: Option<BTreeMap<String, Bound<'_, PyAny>>>,
        pattern: Option<String>,
        bounds: Option<BTreeMap<String, (f64, f64)>>,
        runs: Option<PathBuf>,
    ) -> PyResult<Identification> {
        let request = experiment_request(experiment, changes, pattern, bounds)?;
        let result = detached(py, false, || {
            let session = self.session(&request)?;
            let mut watch = |_: &_, _: &_, _: &_| !requested();
            Ok(match &runs {
                Some(folder) => CampaignFolder::identify(folder, &session, &mut watch)?,
                None => session.identify(None, &mut watch)?,
            })
        })?;
        Ok(Identification { result })
    }

    #[pyo3(signature = (lang = "c", *, prefix = None, real = "double", parts = None, params = None, forgetting = false, strokes = false))]
    #[allow(clippy::too_many_arguments)]
    fn generate(
        &self,
        py: Python<'_>,
        lang: &str,
        prefix: Option<&str>,
        real: &str,
        parts: Option<Vec<String>>,
        params: Option<PyRef<'_, Identification>>,
        forgetting: bool,
        strokes: bool,
    ) -> PyResult<BTreeMap<String, String>> {
        let declared = &*self.declared;
        let language =
            Language::from_name(lang).ok_or_else(|| Error::new_err(format!("lang=\"{lang}\": give one of c, rust")))?;
        let scalar = match real {
            "double" => Scalar::Double,
            "float" => Scalar::Float,
            _ => return Err(Error::new_err(format!("real=\"{real}\": give one of double, float"))),
        };
        let part = |name: &String| {
            let known = || Part::ALL.map(Part::name).join(", ");
            Part::from_name(name)
                .ok_or_else(|| Error::new_err(format!("parts: there is no part \"{name}\"; give some of {}", known())))
        };
        let parts: Vec<Part> = parts.iter().flatten().map(part).collect::<PyResult<_>>()?;
        let identified: Option<Identified> = params.map(|own| Identified::from(&own.result));
        detached(py, false, || {
            let whole =
                |message: String| located(declared, &Diagnostic::error(declared.parsed().ast.name.span, message));
            let mut source = EstimatorSource::of(declared.parsed()).map_err(|fault| located(declared, &fault))?;
            if !parts.is_empty() {
                source = source.with(&parts).map_err(|error| whole(error.to_string()))?;
            }
            let command = format!("tpm.Model.generate(\"{lang}\")");
            let options = Options {
                identified: identified.as_ref(),
                forgetting,
                strokes,
                prefix,
                scalar,
                ..Options::new(language, &command)
            };
            let files = generate(&source, &options).map_err(|error| whole(error.to_string()))?;
            Ok(files.into_iter().map(|file| (file.name, file.text)).collect())
        })
    }

    fn __repr__(&self) -> String {
        format!("<tpm.Model {}: {}>", self.name(), self.parameters().join(", "))
    }
}

/// Identifies a model from arrays: stamps in seconds, and coordinates and applied inputs by name.
#[pyfunction]
#[pyo3(signature = (model, t, signals, **settings))]
pub(crate) fn identify(
    py: Python<'_>,
    model: &Model,
    t: &Bound<'_, PyAny>,
    signals: &Bound<'_, PyAny>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<Identification> {
    model.identify(py, t, signals, settings)
}
