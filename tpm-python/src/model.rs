//! Models: what they say, what they show, and what logs say of them.

use crate::log::{Keywords, log_of, with_settings};
use crate::result::{Found, dictionary};
use crate::table::Table;
use crate::verdicts::identified;
use crate::words::{Error, Fault};
use crate::work::{Limit, detached, requested};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use tpm_codegen::diagnostic::{self, Diagnostic};
use tpm_codegen::emit::estimator::{EstimatorSource, Part};
use tpm_codegen::export::{Format, Request, Told, export};
use tpm_codegen::generate::{Language, Options, Scalar, generate};
use tpm_codegen::identified::Identified;
use tpm_codegen::language::AtTerm;
use tpm_runtime::experiment::{Value, written_value};
use tpm_runtime::motion::Record;
use tpm_runtime::session::{
    CampaignFolder, DeclaredModel, ExperimentRequest, Identifiable as _, Session, SessionError, from_logs,
};
use tpm_runtime::study::{self, AskedPattern, ShownError, shown};
use tpm_symbolic::harmonic::expand::{ExpandError, ExpandOptions, expand_with};
use tpm_symbolic::number::rational::{self, Rational};
use tpm_symbolic::regressor::prepare::prepare;

/// A model of a machine: its text, its exact form, and its evaluation.
#[pyclass(frozen, module = "tpm._tpm")]
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

impl Model {
    fn of(
        py: Python<'_>,
        path: Option<PathBuf>,
        read: impl FnOnce() -> Result<DeclaredModel, Fault> + Send,
    ) -> PyResult<Self> {
        Ok(Model { declared: Arc::new(detached(py, Limit::None, read)?), path })
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
        Ok(Table { table: detached(py, Limit::large(allow_large), expanded)? })
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
            let found =
                detached(py, Limit::large(allow_large), || study::any_motion(declared.parsed(), &rest).map_err(fault))?;
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
        let found = detached(py, Limit::large(allow_large), || {
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

    /// Identifies the model from logs: paths, or stamps and signals.
    fn identify(&self, py: Python<'_>, logs: Vec<Bound<'_, PyAny>>, settings: Keywords<'_, '_>) -> PyResult<Found> {
        let mut requests = Vec::with_capacity(logs.len());
        let mut limit = None;
        for log in &logs {
            let (request, time) = with_settings(log_of(log)?, settings)?;
            requests.push(request);
            limit = time;
        }
        let model = &*self.declared;
        let result = detached(py, Limit::of(limit), || Ok(from_logs(model, requests.clone())?))?;
        Ok(Found::of_logs(result, Arc::clone(&self.declared), requests))
    }

    /// One run of an experiment on the simulated machine: stamps, and coordinates and inputs by name.
    #[pyo3(signature = (experiment = None, *, changes = None, pattern = None))]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        experiment: Option<PathBuf>,
        changes: Option<BTreeMap<String, Bound<'py, PyAny>>>,
        pattern: Option<String>,
    ) -> PyResult<Simulated<'py>> {
        let request = experiment_request(experiment, changes, pattern, None)?;
        let (session, record) = detached(py, Limit::None, || {
            let session = self.session(&request)?;
            let (campaign, _) = session.campaign()?;
            let trial = campaign.next().ok_or(SessionError::NothingToPlay)?.clone();
            let record = session.simulate(&trial)?;
            drop(campaign);
            Ok((session, record))
        })?;
        Ok(record_arrays(py, session.machine().plant(), record))
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
    ) -> PyResult<Found> {
        let request = experiment_request(experiment, changes, pattern, bounds)?;
        let result = detached(py, Limit::None, || {
            let session = self.session(&request)?;
            let mut watch = |_: &_, _: &_, _: &_| !requested();
            Ok(match &runs {
                Some(folder) => CampaignFolder::identify(folder, &session, &mut watch)?,
                None => session.identify(None, &mut watch)?,
            })
        })?;
        Ok(Found::of_runs(result))
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
        params: Option<&str>,
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
        let identified: Option<Identified> = params.map(values_of).transpose()?;
        detached(py, Limit::None, || {
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

    /// The model with the values of a result, whose JSON is given, in the format of another program: its files, and what the format does not hold.
    fn export(&self, py: Python<'_>, format: &str, params: &str) -> PyResult<(BTreeMap<String, String>, Vec<String>)> {
        let declared = &*self.declared;
        let formats = [("casadi", Format::Casadi), ("st", Format::StructuredText), ("arduino", Format::Arduino)];
        let (_, format) = *formats.iter().find(|(name, _)| *name == format).ok_or_else(|| {
            Error::new_err(format!("to=\"{format}\": give one of {}", formats.map(|(name, _)| name).join(", ")))
        })?;
        let (values, told) = (values_of(params)?, Told::from_json(params));
        detached(py, Limit::None, || {
            let whole =
                |message: String| located(declared, &Diagnostic::error(declared.parsed().ast.name.span, message));
            let source = EstimatorSource::of(declared.parsed()).map_err(|fault| located(declared, &fault))?;
            let request = Request { identified: &values, told: &told, command: "tpm.Model.export" };
            let found = export(&source, format, &request).map_err(|error| whole(error.to_string()))?;
            let lost = told.actuators.iter().cloned().chain(found.lost).collect();
            Ok((found.files.into_iter().map(|file| (file.name, file.text)).collect(), lost))
        })
    }
}

/// The values of a result that predict: those nearest to the forces where the model lacks something.
fn values_of(text: &str) -> PyResult<Identified> {
    let found = identified(text)?;
    Ok(found.nearest_to_forces().unwrap_or(found))
}

/// Arrays by name.
pub(crate) type Arrays<'py> = BTreeMap<String, Bound<'py, PyArray1<f64>>>;
/// Stamps, and arrays by name.
pub(crate) type Simulated<'py> = (Bound<'py, PyArray1<f64>>, Arrays<'py>);

/// A recorded run as arrays.
pub(crate) fn record_arrays<'py>(
    py: Python<'py>,
    plant: &dyn tpm_runtime::model::Model<f64>,
    record: Record,
) -> Simulated<'py> {
    let samples = record.coordinates.first().map_or(0, Vec::len);
    let dims = plant.dims();
    let names = (0..dims.coordinates).map(|c| plant.coordinate(c).name.to_owned());
    let names = names.chain((0..dims.inputs).map(|i| plant.input(i).name.to_owned()));
    let signals = record.coordinates.into_iter().chain(record.inputs);
    let mut arrays: Arrays<'py> = names.zip(signals.map(|signal| signal.into_pyarray(py))).collect();
    for (c, rate) in record.rates.into_iter().enumerate() {
        if let Some(rate) = rate {
            arrays.insert(format!("dot({})", plant.coordinate(c).name), rate.into_pyarray(py));
        }
    }
    let t: Vec<f64> = (0..samples).map(|n| n as f64 * record.sample_time).collect();
    (t.into_pyarray(py), arrays)
}
