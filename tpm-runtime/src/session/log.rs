//! From a log to parameters.

use crate::estimate::named::EstimateReport;
use crate::estimate::physical::PhysicalSettings;
use crate::estimate::{
    Differentiable, Estimate, EstimateError, Frozen, MeasuredMotion, OutputErrorFault, Settings, Weights,
    estimate_measured_motion,
};
use crate::interpret::InterpretedDerivatives;
use crate::log::{Log, LogError, LogOptions, Periodic, PeriodicFault, ReadingReport, Recording, Refine, find_periodic};
use crate::report::{Remedy, displayed};
use crate::run::{Dynamics, Spectra, correct_actuators};
use crate::session::error::{SessionError, Setting};
use crate::session::identification::{Identification, LogFingerprint, Provenance, Source};
use crate::session::log_report::{ActuatorReport, HoldResiduals, LogReport};
use crate::session::model::{DeclaredModel, Identifiable};
use crate::session::refine::refine;
use crate::session::refinement_report::RefinementReport;
use crate::session::summary::{self, Lumped};
use crate::session::warning::{Data, Warning};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::format;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_core::derivatives::RowDerivatives;
use tpm_core::harmonics::Hold;
use tpm_core::model::Model;

/// The other hold explains a log clearly better when it leaves less than this share of the residual.
const CLEARLY_BETTER: f64 = 0.7;
/// A difference of successive periods above this share of the motion is flagged.
const UNSTEADY: f64 = 0.02;

/// A log to identify from, and what is known about it. Every setting is by the model's names and in its units.
///
/// A path alone is a request with nothing known: `"run.csv".into()`.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
#[non_exhaustive]
pub struct LogRequest {
    /// The file: columns of text with a header, or another format that is built in.
    pub path: PathBuf,
    /// Column of a coordinate or input (or of `t_s`), where it is not called like it.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub map: BTreeMap<String, String>,
    /// Factor from the numbers of a signal's column to its unit in the model; it stands in place of a unit that the column states.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub scale: BTreeMap<String, f64>,
    /// Value that is added to a signal after the factor, unit of the signal.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub offset: BTreeMap<String, f64>,
    /// First sample to use, from 0; found when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from_sample: Option<usize>,
    /// Period of the motion, s; found when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub period: Option<f64>,
    /// What the inputs do between samples.
    #[serde(serialize_with = "displayed")]
    pub hold: Hold,
    /// Known dynamics between the recorded value of an input and its force, by input.
    #[serde(skip)]
    pub actuators: BTreeMap<String, Dynamics>,
    /// Highest harmonic to use; chosen from the spectrum when not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub harmonics: Option<usize>,
    /// How much every equation counts.
    pub weights: Weights,
    /// Whether the estimates are refined by simulating the model.
    pub refine: Refine,
    /// Values of the constants that are known at run time, by name.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub constants: BTreeMap<String, f64>,
    /// Values known before, by parameter or physical parameter: what an unobservable direction keeps, or where the search for a
    /// physical parameter starts.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub prior: BTreeMap<String, f64>,
    /// Values that are held, by parameter or physical parameter.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub frozen: BTreeMap<String, f64>,
    /// Least and largest value of a physical parameter; infinite for none.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub bounds: BTreeMap<String, (f64, f64)>,
}

impl LogRequest {
    /// A log of which nothing is known beside its file.
    #[must_use]
    pub fn new(path: impl Into<PathBuf>) -> Self {
        LogRequest { path: path.into(), ..LogRequest::default() }
    }

    /// Says in which column a signal stands.
    #[must_use]
    pub fn map(mut self, signal: &str, column: &str) -> Self {
        self.map.insert(signal.to_string(), column.to_string());
        self
    }

    /// Gives a constant that is known at run time its value.
    #[must_use]
    pub fn constant(mut self, name: &str, value: f64) -> Self {
        self.constants.insert(name.to_string(), value);
        self
    }

    /// Says what the inputs do between samples.
    #[must_use]
    pub fn hold(mut self, hold: Hold) -> Self {
        self.hold = hold;
        self
    }

    /// The settings by index, with every name checked against the model; physical parameters are those named so.
    pub(super) fn options(&self, model: &dyn Model<f64>, physical: &[String]) -> Result<LogOptions, SessionError> {
        let dims = model.dims();
        let names = |count: usize, name: &dyn Fn(usize) -> String| -> Vec<String> { (0..count).map(name).collect() };
        let parameters = names(dims.parameters, &|j| model.parameter(j).name.to_string());
        let either: Vec<String> = parameters.iter().chain(physical).cloned().collect();
        let constants = names(dims.constants, &|i| model.constant(i).name.to_string());
        let inputs = names(dims.inputs, &|i| model.input(i).name.to_string());
        for (setting, given, known) in [
            (Setting::Prior, self.prior.keys().collect::<Vec<_>>(), &either),
            (Setting::Frozen, self.frozen.keys().collect(), &either),
            (Setting::Constant, self.constants.keys().collect(), &constants),
            (Setting::Actuator, self.actuators.keys().collect(), &inputs),
        ] {
            if let Some(name) = given.into_iter().find(|name| !known.contains(name)) {
                return Err(SessionError::UnknownName { setting, name: name.clone(), known: known.clone() });
            }
        }
        let missing: Vec<String> =
            constants.iter().filter(|name| !self.constants.contains_key(*name)).cloned().collect();
        if !missing.is_empty() {
            return Err(SessionError::Constants { names: missing });
        }
        let held = parameters.iter().enumerate();
        Ok(LogOptions {
            from_sample: self.from_sample,
            period: self.period,
            hold: self.hold,
            actuators: inputs.iter().map(|name| self.actuators.get(name).copied().unwrap_or_default()).collect(),
            harmonics: self.harmonics,
            weights: self.weights,
            refine: self.refine,
            constants: constants.iter().map(|name| self.constants[name]).collect(),
            prior: if parameters.iter().all(|name| !self.prior.contains_key(name)) {
                Vec::new()
            } else {
                parameters.iter().map(|name| self.prior.get(name).copied()).collect()
            },
            frozen: held
                .filter_map(|(parameter, name)| Some(Frozen { parameter, value: *self.frozen.get(name)? }))
                .collect(),
            ..self.columns()
        })
    }

    /// What is said of the columns alone.
    pub(super) fn columns(&self) -> LogOptions {
        LogOptions {
            map: self.map.clone(),
            scale: self.scale.clone(),
            offset: self.offset.clone(),
            ..LogOptions::default()
        }
    }

    /// What is said of physical parameters.
    fn physical(&self) -> PhysicalSettings {
        PhysicalSettings {
            prior: self.prior.clone(),
            frozen: self.frozen.clone(),
            bounds: self.bounds.clone(),
            constants: self.constants.clone(),
        }
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

/// Share of the force that rounding leaves unexplained; a record whose harmonics leave no more has nothing that a refinement could use.
const EXPLAINED: f64 = 1e-7;

/// Identifies a model from a log: parameters, physical parameters behind lumped ones, what the log does not show.
///
/// # Errors
/// [`SessionError`] when the log cannot be read or does not repeat, or a setting does not fit the model.
pub fn from_log(model: &impl Identifiable, log: impl Into<LogRequest>) -> Result<Identification, SessionError> {
    let request = log.into();
    let declared = model.declaration()?;
    let evaluated = model.evaluated();
    let lumped = declared.as_deref().and_then(|declared| Lumped::of(declared.prepared()));
    let physical = lumped.as_ref().map(Lumped::names).unwrap_or_default();
    let options = request.options(evaluated, &physical)?;
    let path = request.path.display().to_string();
    let recording = Recording::open(&request.path, evaluated, &options)?;
    let hash = recording.fingerprint.clone();
    let (mut log, reading) = repeating(recording, evaluated.dims().coordinates, &options);
    let mended = log.mend(evaluated.dims().coordinates);
    if let (None, Some(name)) = (&lumped, request.bounds.keys().next()) {
        return Err(SessionError::NothingLumped { name: name.clone() });
    }
    let derivatives = declared.as_deref().map(|declared| {
        let prepared = declared.prepared();
        InterpretedDerivatives::new(&prepared.model, &prepared.form)
    });
    let derivatives = derivatives.as_ref().map(|derivatives| derivatives as &dyn RowDerivatives<f64>);
    let mut result = identify_with(evaluated, derivatives, &log, &options)?;
    result.warnings.extend(lone_readings(evaluated, &log, &mended));
    if let Some(report) = &mut result.log {
        report.reading = reading;
    }
    if let Some(lumped) = lumped {
        lumped.complete(&mut result, request.physical())?;
    }
    result.provenance = Provenance {
        model: declared.as_ref().map(|declared: &Cow<'_, DeclaredModel>| declared.hash()),
        logs: vec![LogFingerprint { path, hash }],
        options: summary::options(&request),
        ..summary::provenance()
    };
    Ok(result)
}

/// The segment of a recording that is analysed: the longest one that repeats or, where none does, the longest one.
pub(super) fn repeating(mut recording: Recording, coordinates: usize, options: &LogOptions) -> (Log, ReadingReport) {
    let segments = &recording.segments;
    let mut longest_first: Vec<usize> = (0..segments.len()).collect();
    longest_first.sort_by_key(|&i| std::cmp::Reverse(segments[i].len()));
    let repeats = |i: &usize| periodic_part(&segments[*i], coordinates, options).is_ok();
    let used = match longest_first[..] {
        [only] => only,
        _ => longest_first.iter().copied().find(repeats).unwrap_or(longest_first[0]),
    };
    recording.report.used = (segments.len() > 1).then_some(used);
    (recording.segments.swap_remove(used), recording.report)
}

/// One warning for every coordinate of which readings were replaced.
fn lone_readings(model: &dyn Model<f64>, log: &Log, mended: &[(usize, usize, f64)]) -> Vec<Warning> {
    let of = |c: usize| {
        let own: Vec<_> = mended.iter().filter(|(channel, ..)| *channel == c).collect();
        own.first().map(|(_, first, _)| Warning::LoneReadings {
            coordinate: model.coordinate(c).name.into(),
            count: own.len(),
            line: log.lines[*first],
            farthest: own.iter().map(|(.., by)| by.abs()).fold(0.0, f64::max),
            unit: model.coordinate(c).unit.map(Into::into),
        })
    };
    (0..model.dims().coordinates).filter_map(of).collect()
}

/// Identifies the parameters in which a model is linear from one log.
///
/// # Errors
/// [`LogError`].
pub fn identify_log(model: &dyn Model<f64>, log: &Log, options: &LogOptions) -> Result<Identification, LogError> {
    identify_with(model, None, log, options)
}

/// [`identify_log`], refined by simulating the model where the derivatives of its rows are known.
fn identify_with(
    model: &dyn Model<f64>,
    derivatives: Option<&dyn RowDerivatives<f64>>,
    log: &Log,
    options: &LogOptions,
) -> Result<Identification, LogError> {
    let dims = model.dims();
    if options.constants.len() != dims.constants {
        return Err(LogError::Constants {
            needed: dims.constants,
            given: options.constants.len(),
            names: (0..dims.constants).map(|i| model.constant(i).name.into()).collect(),
        });
    }
    let (periodic, spectra) = periodic_spectra(log, dims.coordinates, options)?;
    let settings = Settings {
        harmonics: options.harmonics,
        weights: options.weights,
        prior: options.prior.iter().map(|value| value.unwrap_or(0.0)).collect(),
        frozen: options.frozen.clone(),
        ..Settings::default()
    };
    let run = |hold: Hold, settings: &Settings| -> Result<(MeasuredMotion, Estimate), EstimateError> {
        let record = MeasuredMotion::new(model, &options.constants, &spectra, hold, settings)?;
        let mut records = [record];
        let estimate = estimate_measured_motion(&mut records, settings)?;
        let [record] = records;
        Ok((record, estimate))
    };
    let (record, estimate) =
        run(options.hold, &settings).map_err(|source| LogError::Estimate { path: log.path.clone(), source })?;
    // The other hold is judged on the same harmonics, otherwise it could leave out what it does not explain.
    let same = Settings { harmonics: Some(record.harmonics()), ..settings.clone() };
    let other = run(options.hold.other(), &same).ok().map(|(_, e)| e.residual);
    let hold_residuals = match options.hold {
        Hold::None => HoldResiduals { none: Some(estimate.residual), zoh: other },
        Hold::Zoh => HoldResiduals { none: other, zoh: Some(estimate.residual) },
    };
    let ideal = options.actuators.iter().all(Dynamics::is_ideal);
    let refines = options.refine == Refine::OutputError && ideal && estimate.residual > EXPLAINED;
    let refined = match derivatives.filter(|_| refines) {
        Some(derivatives) => {
            let machine = Differentiable { model, derivatives };
            Some(refine(machine, log, (&periodic, &spectra), options, (&record, &estimate), &settings))
        }
        None => None,
    };
    let (estimate, refinement, remarks) = match refined {
        Some(Ok(refined)) => (refined.estimate, Some(refined.report), refined.warnings),
        Some(Err(fault)) => {
            let report = RefinementReport::refused(&estimate.values, &fault);
            let remark = |message| match fault {
                OutputErrorFault::NotConverged { .. } => Warning::Unsettled { message },
                _ => Warning::Estimator { message },
            };
            let remarks = report.note.iter().cloned().map(remark).collect();
            (estimate, Some(report), remarks)
        }
        None => (estimate, None, Vec::new()),
    };
    let log_report = LogReport {
        path: log.path.clone(),
        reading: ReadingReport::default(),
        samples: log.len(),
        sample_time: log.sample_time,
        steady_from_sample: periodic.steady_from,
        from_sample: periodic.from,
        from_line: log.lines.get(periodic.from).copied().unwrap_or(0),
        period: periodic.samples_per_period * log.sample_time,
        samples_per_period: periodic.samples_per_period,
        periods: periodic.periods,
        mismatch: periodic.mismatch,
        window: spectra.window.to_string(),
        lines: (0..dims.rows).map(|r| record.used(r).to_vec()).collect(),
        motion_harmonics: record.motion_harmonics(),
        row_residuals: (0..dims.rows)
            .map(|r| {
                let (residual, force) = record.row_power(r, &estimate.values);
                if force > 0.0 { residual / force } else { 0.0 }
            })
            .collect(),
        actuators: (options.actuators.iter().take(dims.inputs).enumerate())
            .filter(|(_, dynamics)| !dynamics.is_ideal())
            .map(|(i, dynamics)| {
                let low_pass = dynamics.filter.map(|filter| (filter.natural_frequency, filter.quality));
                let report = ActuatorReport { delay: dynamics.delay, low_pass, bandwidth: dynamics.bandwidth };
                (model.input(i).name.to_string(), report)
            })
            .collect(),
        hold_residuals,
        refinement,
    };
    let mut warnings = warnings(model, &record, &estimate, options, &log_report);
    warnings.extend(remarks);
    let EstimateReport { parameters, unobservable, combinations, covariance, combination_covariance } =
        EstimateReport::new(model, &options.prior, Some(&estimate));
    let mut result = Identification {
        source: Source::Log,
        model: model.name().into(),
        estimator: Default::default(),
        frequency_name: String::new(),
        outcome: None,
        stop: None,
        seed: None,
        hold: options.hold,
        harmonics: record.harmonics(),
        parameters,
        physical: Vec::new(),
        unobservable,
        combinations,
        covariance,
        combination_covariance,
        physical_covariance: Vec::new(),
        rank: estimate.rank,
        condition: Some(estimate.condition).filter(|condition| condition.is_finite()),
        residual: estimate.residual,
        runs: Vec::new(),
        stability: None,
        log: Some(log_report),
        warnings,
        provenance: summary::provenance(),
        current: estimate.values.clone(),
        estimate: Some(estimate),
    };
    let mean = |channel: &Vec<f64>| channel.iter().sum::<f64>() / channel.len().max(1) as f64;
    let position: Vec<f64> = log.channels[..dims.coordinates].iter().map(mean).collect();
    summary::warn_of_negative_inertias(&mut result, model, &options.constants, &position);
    summary::distrust(&mut result);
    Ok(result)
}

/// The part of a log that repeats, and its spectra.
pub(super) fn periodic_spectra(
    log: &Log,
    coordinates: usize,
    options: &LogOptions,
) -> Result<(Periodic, Spectra), LogError> {
    let periodic = periodic_part(log, coordinates, options)?;
    let used: Vec<&[f64]> = log.channels.iter().map(|c| &c[periodic.from..]).collect();
    let mut spectra = Spectra::analyse(&used, log.sample_time, periodic.samples_per_period, periodic.periods)
        .map_err(|source| LogError::Spectrum { path: log.path.clone(), source })?;
    correct_actuators(&mut spectra, coordinates, &options.actuators);
    Ok((periodic, spectra))
}

fn periodic_part(log: &Log, coordinates: usize, options: &LogOptions) -> Result<Periodic, LogError> {
    let range = |what: String, remedy: Remedy| LogError::BadRange {
        path: log.path.clone(),
        what,
        remedy,
        samples: log.len(),
        sample_time: log.sample_time,
    };
    if let Some(from) = options.from_sample
        && from >= log.len()
    {
        return Err(range(format!("the first sample {from} lies behind the end"), Remedy::FromSample));
    }
    if let Some(period) = options.period
        && !(period.is_finite() && period >= 3.0 * log.sample_time)
    {
        let what = format!("{period} s is not a period (it is given in seconds, and has three samples at least)");
        return Err(range(what, Remedy::Period));
    }
    let stated = options.period.map(|p| {
        let samples = p / log.sample_time;
        // A period printed in decimals is whole samples when it is nearly so.
        if (samples - samples.round()).abs() < 1e-6 * samples.max(1.0) { samples.round() } else { samples }
    });
    let start = options.from_sample.unwrap_or(0);
    let from = log.lines.get(start).copied().unwrap_or(0);
    let to = log.lines.last().copied().unwrap_or(0);
    find_periodic(&log.channels, coordinates, stated, options.from_sample).map_err(|fault| match fault {
        PeriodicFault::None => LogError::NoPeriod { path: log.path.clone(), from, to },
        PeriodicFault::Mismatch { period, mismatch } => {
            LogError::NotPeriodic { path: log.path.clone(), from, to, period: period * log.sample_time, mismatch }
        }
        PeriodicFault::Range => match options.period {
            Some(period) => {
                let what = format!("no whole period of {period} s lies behind sample {start} (it is given in seconds)");
                range(what, Remedy::Period)
            }
            None => range(format!("no whole period lies behind sample {start}"), Remedy::FromSample),
        },
    })
}

fn warnings(
    model: &dyn Model<f64>,
    record: &MeasuredMotion,
    estimate: &Estimate,
    options: &LogOptions,
    log: &LogReport,
) -> Vec<Warning> {
    let mut warnings = Vec::new();
    let HoldResiduals { none, zoh } = log.hold_residuals;
    let (stated, other) = match options.hold {
        Hold::None => (none, zoh),
        Hold::Zoh => (zoh, none),
    };
    if let (Some(left), Some(left_by_better)) = (stated, other)
        && left_by_better < CLEARLY_BETTER * left
    {
        let better = options.hold.other();
        warnings.push(Warning::OtherHold { stated: options.hold, left, better, left_by_better });
    }
    if log.periods == 1 {
        warnings.push(Warning::OnePeriod);
    }
    if log.mismatch > UNSTEADY {
        warnings.push(Warning::Unsteady { mismatch: log.mismatch });
    }
    if options.from_sample.is_none() && 2 * log.steady_from_sample > log.samples {
        warnings.push(Warning::MostlyLeftOut { left_out: log.steady_from_sample, samples: log.samples });
    }
    if let Some((from, to)) = record.left_out() {
        warnings.push(Warning::HarmonicsLeftOut { from, to });
    }
    warnings.extend(summary::doubts(model, estimate, Data::Log));
    warnings
}
