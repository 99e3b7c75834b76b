//! From a log to parameters.

use crate::against_prior;
use crate::completing::completed_text;
use crate::entry::Entry;
use crate::error::{MachineError, SessionError};
use crate::identification::{Identification, LogFingerprint, Provenance};
use crate::log_fault::LogFault;
use crate::model::{DeclaredModel, Identifiable};
use crate::options::LogOptions;
use crate::pooled_logs::pooled;
use crate::reading::RecordSettings;
use crate::recorded_log;
use crate::rows::Rows;
use crate::settings::EstimationSettings;
use crate::summary::{self, Lumped};
use crate::warning::Warning;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::Model;
use tpm_estimate::{Frozen, Settings};
use tpm_log::{InMemory, LogError, LogSource, Recording, Samples, rates_alone};
use tpm_symbolic::number::rational::{Rational, to_f64};
use tpm_symbolic::regressor::base_parameters::{Motions, base_parameters};
use tpm_symbolic::regressor::prepare::Prepared;

/// Units of the inertias of a mechanism.
const INERTIAS: [&str; 3] = ["kg", "kg*m", "kg*m^2"];

/// A log to identify from, and what is known about it. Every setting is by the model's names and in its units.
///
/// A path alone is a request with nothing known: `"run.csv".into()`.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct LogRequest {
    /// The file: columns of text with a header, or another format that is built in.
    pub path: PathBuf,
    /// The log itself, where it is in memory; the path is then its name in messages.
    #[serde(skip)]
    pub memory: Option<InMemory>,
    /// How it is read.
    #[serde(flatten)]
    pub reading: RecordSettings,
    /// What the estimation is to do, and what is known of the machine.
    #[serde(flatten)]
    pub estimation: EstimationSettings,
}

impl LogRequest {
    /// A log of which nothing is known beside its file.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>) -> Self {
        LogRequest { path: path.into(), ..LogRequest::default() }
    }

    /// A log in memory of which nothing else is known; messages call it `name`.
    #[must_use]
    pub fn of_samples(name: impl Into<PathBuf>, samples: Samples) -> Self {
        LogRequest { memory: Some(InMemory::Samples(samples)), ..LogRequest::new(name) }
    }

    /// The bytes of a log's file, of which nothing else is known; messages and the result call it `name`.
    #[must_use]
    pub fn of_bytes(name: impl Into<PathBuf>, bytes: Arc<Vec<u8>>) -> Self {
        LogRequest { memory: Some(InMemory::Bytes(bytes)), ..LogRequest::new(name) }
    }

    /// Where its columns are.
    pub(super) fn source(&self) -> LogSource<'_> {
        match &self.memory {
            Some(memory) => LogSource::Memory(&self.path, memory),
            None => LogSource::File(&self.path),
        }
    }

    /// Says in which column a signal stands.
    #[must_use]
    pub fn map(mut self, signal: &str, column: &str) -> Self {
        self.reading.columns.map.insert(signal.to_string(), column.to_string());
        self
    }

    /// Gives a constant that is known at run time its value.
    #[must_use]
    pub fn constant(mut self, name: &str, value: f64) -> Self {
        self.estimation.constants.insert(name.to_string(), value);
        self
    }

    /// Says what the inputs do between samples.
    #[must_use]
    pub fn hold(mut self, hold: Hold) -> Self {
        self.reading.hold = hold;
        self
    }

    /// The settings by index, with every name checked against the model; physical parameters are those named so.
    pub(super) fn options(&self, model: &dyn Model<f64>, physical: &[String]) -> Result<LogOptions, SessionError> {
        self.estimation.resolve(&self.reading, model, physical)
    }
}

impl From<&str> for LogRequest {
    fn from(path: &str) -> Self {
        LogRequest::new(path)
    }
}

impl From<&Path> for LogRequest {
    fn from(path: &Path) -> Self {
        LogRequest::new(path)
    }
}

impl From<PathBuf> for LogRequest {
    fn from(path: PathBuf) -> Self {
        LogRequest::new(path)
    }
}

/// Identifies a model from a log: parameters, physical parameters behind lumped ones, what the log does not show.
///
/// # Errors
/// [`SessionError`] when the log cannot be read or shows nothing, or a setting does not fit the model.
pub fn from_log(model: &impl Identifiable, log: impl Into<LogRequest>) -> Result<Identification, SessionError> {
    from_logs(model, [log])
}

/// Identifies a model from several logs of one machine: each by itself, then all together, weighed by what each of them shows. What
/// is known of the machine (priors, held values, bounds, constants) is taken from the first request, what is known of a log from its own.
///
/// # Errors
/// [`SessionError`] without a log, when one cannot be read or shows nothing, or a setting does not fit the model.
pub fn from_logs<R: Into<LogRequest>>(
    model: &impl Identifiable,
    logs: impl IntoIterator<Item = R>,
) -> Result<Identification, SessionError> {
    let requests: Vec<LogRequest> = logs.into_iter().map(Into::into).collect();
    with_rates_alone(model, &requests, &|model| of_requests(model, &requests))
}

/// What `work` makes of a model; where a log has the rates of coordinates and not their positions, what it makes of the model for such sensors.
pub(super) fn with_rates_alone<T>(
    model: &dyn Identifiable,
    requests: &[LogRequest],
    work: &dyn Fn(&dyn Identifiable) -> Result<T, SessionError>,
) -> Result<T, SessionError> {
    let fault = match work(model) {
        Err(fault @ SessionError::Log(LogFault::Reading(LogError::MissingColumn { .. }))) => fault,
        result => return result,
    };
    let Some(declared) = model.declaration()?.filter(|declared| declared.parsed().mechanism.is_none()) else {
        return Err(fault);
    };
    let evaluated = declared.evaluated();
    let mut names = BTreeSet::new();
    for request in requests {
        let columns = &request.options(evaluated, &[])?.reading.columns;
        let alone = rates_alone(request.source(), evaluated, columns).map_err(LogFault::from)?;
        names.extend(alone.into_iter().map(|c| evaluated.coordinate(c).name.to_string()));
    }
    if names.is_empty() {
        return Err(fault);
    }
    let names: Vec<String> = names.into_iter().collect();
    work(&declared.with_rates_measured(&names).map_err(MachineError::from)?)
}

/// [`from_logs`] of logs that have all signals of the model.
fn of_requests(model: &dyn Identifiable, requests: &[LogRequest]) -> Result<Identification, SessionError> {
    let Some(first) = requests.first() else { return Err(SessionError::NoLog) };
    if requests.len() > 1 && requests.iter().any(|request| !request.estimation.calibration.is_empty()) {
        return Err(SessionError::CalibrationOfLogs);
    }
    let declared = model.declaration()?;
    if let Some((whole, used)) =
        declared.as_deref().map_or(Ok(None), |declared| with_their_coordinates(declared, requests))?
    {
        let mut result = of_requests(&whole, requests)?;
        result.warnings.insert(0, used);
        return Ok(result);
    }
    let simulated = declared.as_deref().filter(|declared| declared.is_only_simulated());
    let rows = match simulated {
        // A compiled model does not say which of its coordinates are measured; its declaration does.
        Some(declared) => Rows::new(declared, Some(declared)),
        None => Rows::new(model, declared.as_deref()),
    };
    let evaluated = rows.model();
    let lumped = declared.as_deref().and_then(|declared| Lumped::of(declared.prepared()));
    let physical = lumped.as_ref().map(Lumped::names).unwrap_or_default();
    if let (None, Some(name)) = (&lumped, first.estimation.bounds.keys().next()) {
        return Err(SessionError::NothingLumped { name: name.clone() });
    }
    let mut known = first.options(evaluated, &physical)?;
    if let Some(lumped) = &lumped {
        let mut prior = known.stated_prior();
        lumped.state(&mut prior, &first.estimation.prior, &first.estimation.constants);
        known.state(&prior);
    }
    if let Some(declared) = declared.as_deref() {
        state_mechanism(&mut known.estimation, declared, evaluated, &first.estimation.constants);
    }
    let mut parts = Vec::with_capacity(requests.len());
    let mut fingerprints: Vec<LogFingerprint> = Vec::with_capacity(requests.len());
    for request in requests {
        let constants = first.estimation.constants.clone();
        let own = EstimationSettings { constants, ..request.estimation.clone() };
        let options = own.resolve(&request.reading, evaluated, &physical)?.of_machine(&known);
        let entry = Entry { rows: &rows, declared: declared.as_deref(), options: &options };
        let (part, hash) = if recorded_log::is_for(declared.as_deref(), evaluated, &options.reading.columns) {
            entry.as_recorded(request.source())?
        } else {
            entry.evenly(request.source())?
        };
        let path = request.path.display().to_string();
        if let Some(same) = fingerprints.iter().find(|other| other.hash == hash) {
            return Err(SessionError::LogTwice { path, other: same.path.clone() });
        }
        fingerprints.push(LogFingerprint { path, hash });
        parts.push(part);
    }
    let mut result = pooled(evaluated, parts, &known)
        .map_err(|source| LogFault::Estimate { path: first.path.display().to_string(), source })?;
    if let Some(lumped) = lumped {
        lumped.complete(&mut result, (evaluated, &known.stated_prior()), first.estimation.physical())?;
    }
    if let Some(declared) = &declared {
        summary::warn_of_negative_gains(&mut result, &declared.prepared().model, evaluated.dims().order);
        if declared.parsed().mechanism.is_some() {
            let inputs = (0..evaluated.dims().inputs).map(|i| evaluated.input(i).name.to_string()).collect();
            against_prior::warn_of_common_factor(&mut result, inputs);
        }
    }
    // Where the text cannot have them, the request for a completed model says why.
    result.completed_model = declared.as_deref().and_then(|declared| completed_text(declared, &result).ok().flatten());
    result.provenance = Provenance {
        model: declared.as_ref().map(|declared: &Cow<'_, DeclaredModel>| declared.hash()),
        logs: fingerprints,
        options: summary::options(first),
        ..summary::provenance()
    };
    Ok(result.judged())
}

/// The model before its coordinates are eliminated, where all logs have those too: every equation then is a row, and what sensors say of
/// the eliminated coordinates is used. Bounds are those of parameters behind lumped ones, and keep the form that has these.
fn with_their_coordinates(
    declared: &DeclaredModel,
    requests: &[LogRequest],
) -> Result<Option<(DeclaredModel, Warning)>, SessionError> {
    let eliminated = declared.eliminated();
    if eliminated.is_empty() || requests.iter().any(|request| !request.estimation.bounds.is_empty()) {
        return Ok(None);
    }
    let whole = declared.with_all_coordinates().map_err(MachineError::from)?;
    for request in requests {
        let options = request.options(whole.evaluated(), &[]);
        let Ok(options) = options else { return Ok(None) };
        // What keeps a log from being read with these columns is said where it is read without them.
        if Recording::open(request.source(), whole.evaluated(), &options.reading.columns).is_err() {
            return Ok(None);
        }
    }
    Ok(Some((whole, Warning::AllCoordinates { coordinates: eliminated })))
}

/// States what is known of the parameters of a mechanism before it moves: directions that no motion shows, and inertias, which load the
/// drives. `evaluated` has the parameters of the settings.
pub(super) fn state_mechanism(
    settings: &mut Settings,
    declared: &DeclaredModel,
    evaluated: &dyn Model<f64>,
    constants: &BTreeMap<String, f64>,
) {
    if declared.parsed().mechanism.is_some() {
        settings.hidden = hidden(declared.prepared(), constants, &settings.frozen);
        let is_inertia = |j: &usize| evaluated.parameter(*j).unit.is_some_and(|unit| INERTIAS.contains(&unit));
        settings.load = (0..evaluated.dims().parameters).filter(is_inertia).collect();
    }
}

/// Directions in parameter space that no motion shows while some parameters are held, exact but for one rounding: noise seems to show
/// them, and the combinations that the data show would be those of the noise. Nothing where they are not known.
fn hidden(prepared: &Prepared, constants: &BTreeMap<String, f64>, frozen: &[Frozen]) -> Vec<Vec<f64>> {
    let model = &prepared.model;
    let value = |symbol| Some((symbol, Rational::from_float(*constants.get(model.quantity(symbol).name.as_str())?)?));
    let motions = Motions { values: model.run_time_constants().filter_map(value).collect(), ..Motions::default() };
    let Ok(base) = base_parameters(model, &prepared.form, &motions) else { return Vec::new() };
    let held: Vec<usize> = frozen.iter().map(|frozen| frozen.parameter).collect();
    let dense = |direction: Vec<(usize, Rational)>| {
        let mut whole = vec![0.0; base.parameters.len()];
        direction.iter().for_each(|(column, factor)| whole[*column] = to_f64(factor));
        whole
    };
    base.hidden(&held).into_iter().map(dense).collect()
}
