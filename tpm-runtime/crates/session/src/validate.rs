//! Prediction of another log by identified parameters: the inputs from the motion, and the motion from the inputs.
//!
//! Invariant: no parameter is fitted. The rows are evaluated on the log's own measured motion with the given parameters. The
//! inputs that they predict are compared with the recorded inputs: harmonic by harmonic, over the harmonics that stand
//! out of the noise, where the log repeats, and behind the same low pass where it does not. A row that changes, along this motion, with a
//! direction of the parameters that is open is not predicted: it is named.

use crate::between_stamps::{BetweenStamps, follow};
use crate::entry::alone;
use crate::error::SessionError;
use crate::friction::{FrictionCourse, OwnFriction};
use crate::identification::Identification;
use crate::log::{LogRequest, with_rates_alone};
use crate::log_fault::LogFault;
use crate::model::Identifiable;
use crate::options::LogOptions;
use crate::periodic_log::{repeating, spectra};
use crate::record::{record, stretches};
use crate::recorded_log;
use crate::rows::Rows;
use crate::simulation::{ChannelSimulation, Extent, Simulation, simulate};
use num_complex::Complex;
use serde::Serialize;
use std::collections::BTreeMap;
use std::f64::consts::PI;
use tpm_codegen::identified::{Identified, IdentifiedError, Weights, display, remedy};
use tpm_controller::derivatives::RowDerivatives;
use tpm_controller::model::{Buffer, EvalError, Model, require_len};
use tpm_estimate::{
    Differentiable, Domain, ForceCourse, LARGE_RESIDUAL, MeasuredMotion, Missed, Settings, predict_in_band,
};
use tpm_log::{Log, ReadingReport, Recording};
use tpm_motion::Dynamics;
use tpm_numerics::spectrum::Spectrum;

/// A row does not change along a direction when its terms cancel to this share of themselves: rest is noise of the motion.
const CANCELLED: f64 = 1e-3;

/// Instants of a period at which friction is told.
const INSTANTS: usize = 400;

/// Values over one period from phasors at harmonics.
fn over_period(lines: &[(usize, Complex<f64>)]) -> Vec<f64> {
    let at = |n: usize| {
        let phase = 2.0 * PI * n as f64 / INSTANTS as f64;
        lines.iter().map(|(k, line)| (line * Complex::from_polar(1.0, phase * *k as f64)).re).sum()
    };
    (0..INSTANTS).map(at).collect()
}

/// Measured and predicted force of one row.
#[derive(Clone, Debug, PartialEq)]
pub enum RowCourse {
    /// Harmonic by harmonic: its number, phasor of the applied force, phasor of the predicted one, unit of the row.
    Harmonics(Vec<(usize, Complex<f64>, Complex<f64>)>),
    /// Over time, behind the low pass.
    Time(ForceCourse),
}

/// Prediction error of one row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowPrediction {
    /// Name of the row.
    pub name: String,
    /// Unit of the row.
    pub unit: Option<String>,
    /// Root mean square of the applied force at the used harmonics; of the row's own terms where no force is applied.
    pub force: f64,
    /// Root mean square of the prediction error at the used harmonics.
    pub missed: f64,
    /// The prediction error as a share of `force`.
    pub share: f64,
    /// Measured and predicted force, for figures.
    #[serde(skip)]
    pub course: RowCourse,
    /// Its friction over the rate of its coordinate, for figures; nothing where the model has none there.
    #[serde(skip)]
    pub friction: Option<FrictionCourse>,
}

/// A row that is not predicted, since it changes along a direction of the parameters that neither data nor stated priors determine.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RowUnpredicted {
    /// Name of the row.
    pub name: String,
    /// The direction.
    pub direction: String,
    /// The parameters that take part in it.
    pub parameters: Vec<String>,
}

/// How well parameters predict a log; serialises as `tpm.validation/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Validation {
    /// `tpm.validation/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// Name of the log.
    pub log: String,
    /// What was assumed in reading the file, how the record was split, and what was left out.
    #[serde(skip_serializing_if = "ReadingReport::is_plain")]
    pub reading: ReadingReport,
    /// First sample that was used.
    pub from_sample: usize,
    /// Period, s; nothing where the log was used in the time domain.
    pub period: Option<f64>,
    /// Whole periods.
    pub periods: usize,
    /// Cut-off of the low pass on forces and predictions, Hz; nothing where harmonics were compared.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_off: Option<f64>,
    /// Hold of the inputs: `none` or `zoh`.
    pub hold: String,
    /// Highest harmonic that was compared; zero in the time domain.
    pub harmonics: usize,
    /// Prediction errors of the rows that are predicted.
    pub rows: Vec<RowPrediction>,
    /// Rows that are not predicted.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unpredicted: Vec<RowUnpredicted>,
    /// Largest share of any row that is predicted; nothing when none is.
    pub prediction_error: Option<f64>,
    /// The motion simulated from the inputs; nothing where the model cannot be simulated with what is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub simulation: Option<Simulation>,
    /// The free run between the stamps of a model that only a simulation compares with a log; rows are not predicted then.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub between_stamps: Option<BetweenStamps>,
    /// Why the motion is not simulated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_simulated: Option<String>,
    /// Whether the values are those that are nearest to the forces of the log of a model that lacks something, in place of those that hold
    /// beside what it lacks.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub nearest_values: bool,
    /// By how much later than it is recorded an input was found to act on the log of the result, s.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub delays: BTreeMap<String, f64>,
}

impl Validation {
    /// A prediction of which nothing is known yet.
    fn begun(model: &dyn Model<f64>, log: String, options: &LogOptions) -> Self {
        Self {
            schema: "tpm.validation/1",
            model: model.name().into(),
            log,
            reading: ReadingReport::default(),
            from_sample: options.reading.from_sample.unwrap_or(0),
            period: None,
            periods: 0,
            cut_off: None,
            hold: options.reading.hold.to_string(),
            harmonics: 0,
            rows: Vec::new(),
            unpredicted: Vec::new(),
            prediction_error: None,
            simulation: None,
            between_stamps: None,
            not_simulated: None,
            nearest_values: false,
            delays: BTreeMap::new(),
        }
    }

    /// Why the log is not predicted as it should be; nothing when it is. The bound on what may be missed is that of an identification.
    #[must_use]
    pub fn shortfall(&self) -> Option<String> {
        self.not_determined()
            .or_else(|| self.not_predicted())
            .or_else(|| self.not_followed())
            .or_else(|| self.between_stamps.as_ref()?.shortfall())
            .or_else(|| self.rows.is_empty().then(|| self.not_simulated.clone())?)
    }

    /// The rows on which the parameters say nothing.
    fn not_determined(&self) -> Option<String> {
        let row = |row: &RowUnpredicted| {
            let direction = &row.direction;
            format!("the result does not determine {direction}, and {} on this log changes along it", row.name)
        };
        let all: Vec<String> = self.unpredicted.iter().map(row).collect();
        let parameters = &self.unpredicted.first()?.parameters;
        Some(format!("{}; {}", all.join("; "), remedy(parameters)))
    }

    /// The row of which most is missed, where that is more than a model may miss.
    fn not_predicted(&self) -> Option<String> {
        let row =
            self.rows.iter().max_by(|a, b| a.share.total_cmp(&b.share)).filter(|row| row.share > LARGE_RESIDUAL)?;
        Some(format!(
            "{:.1} % of {} on this log is not predicted: the model lacks something that acts here, the machine is another one by now, or a \
             column is scaled or signed otherwise",
            100.0 * row.share,
            row.name
        ))
    }

    /// The coordinate that the model does not follow, one sample ahead or from the inputs alone.
    fn not_followed(&self) -> Option<String> {
        let simulation = self.simulation.as_ref()?;
        let astray = simulation.channels.iter().find(|channel| channel.one_step.fit.is_some_and(|fit| fit <= 0.0));
        if let Some(ChannelSimulation { name, .. }) = astray {
            return Some(format!(
                "one sample ahead {name} is predicted worse than by its mean: the model does not describe this motion"
            ));
        }
        if let Some(astray) = simulation.astray() {
            return Some(astray.to_string());
        }
        let leaving = simulation.diverges.as_ref().filter(|leaving| !leaving.unstable)?;
        Some(format!(
            "simulated from its inputs the motion leaves the log {:.6} s after the beginning of stretch {}, although nothing makes it \
             unstable: the model does not describe this motion",
            leaving.time,
            leaving.stretch + 1
        ))
    }
}

/// The predictions of the logs that an identification comes from with what it found, for its report: nothing is fitted again, and what was
/// known beforehand is part of the result. Of a long log blocks are simulated, so that a report costs little beside its identification;
/// [`validate`] simulates more.
///
/// # Errors
/// Those of [`validate`].
pub fn evidence(
    model: &impl Identifiable,
    logs: Vec<LogRequest>,
    found: &Identification,
) -> Result<Vec<Validation>, SessionError> {
    let of_log = |mut request: LogRequest| {
        let known = &mut request.estimation;
        known.prior.clear();
        known.frozen.clear();
        known.bounds.clear();
        predicted(model, request, found.into(), Extent::Evidence)
    };
    logs.into_iter().map(of_log).collect()
}

/// Predicts the inputs of a log from its motion, and simulates its motion from the inputs, with what an identification knows of the
/// parameters in which the model is linear. Of a model that lacks something it takes the values that are nearest to the forces of its log:
/// those that hold beside what is missing predict worse without it. Inputs act as late as they were found to act there, unless something is
/// stated of them.
///
/// # Errors
/// [`SessionError::NotIdentified`] where nothing is known of a parameter; another [`SessionError`] when the log cannot be read
/// or analysed.
pub fn validate(
    model: &impl Identifiable,
    log: impl Into<LogRequest>,
    known: impl Into<Identified>,
) -> Result<Validation, SessionError> {
    let (mut request, known) = (log.into(), known.into());
    let Some(nearest) = known.nearest_to_forces() else { return predicted(model, request, known, Extent::Whole) };
    // What is stated of an input goes before what was found of it.
    let stated = &mut request.estimation.actuators;
    let delays: BTreeMap<String, f64> =
        known.delays.into_iter().filter(|(input, _)| !stated.contains_key(input)).collect();
    let late = |(input, &delay): (&String, &f64)| (input.clone(), Dynamics { delay, ..Dynamics::default() });
    stated.extend(delays.iter().map(late));
    let found = predicted(model, request, nearest, Extent::Whole)?;
    Ok(Validation { nearest_values: true, delays, ..found })
}

/// [`validate`], of which so much is simulated.
fn predicted(
    model: &impl Identifiable,
    request: LogRequest,
    known: Identified,
    extent: Extent,
) -> Result<Validation, SessionError> {
    with_rates_alone(model, std::slice::from_ref(&request), &|model| of_request(model, &request, &known, extent))
}

/// [`predicted`] of a log that has all signals of the model.
fn of_request(
    model: &dyn Identifiable,
    request: &LogRequest,
    known: &Identified,
    extent: Extent,
) -> Result<Validation, SessionError> {
    let declared = model.declaration()?;
    let rows = match declared.as_deref().filter(|declared| declared.is_only_simulated()) {
        Some(declared) => Rows::new(declared, Some(declared)),
        None => Rows::new(model, declared.as_deref()),
    };
    let evaluated = rows.model();
    let unknown = |name: &str| SessionError::NotIdentified { name: name.to_string() };
    let settled = known.settled().map_err(|error| match error {
        IdentifiedError::Missing(name) => unknown(&name),
        other => SessionError::File { path: "the identified values".into(), message: other.to_string() },
    })?;
    let value = |j: usize| {
        let name = evaluated.parameter(j).name;
        settled.value(name).ok_or_else(|| unknown(name))
    };
    let parameters: Vec<f64> = (0..evaluated.dims().parameters).map(value).collect::<Result<_, _>>()?;
    let options = request.options(evaluated, &[])?;
    if recorded_log::is_for(declared.as_deref(), evaluated, &options.reading.columns) {
        let (run, reading) = follow(evaluated, request.source(), &options, (&parameters, &settled.open))?;
        let (between_stamps, not_simulated) = match run {
            Ok(run) => (Some(run), None),
            Err(why) => (None, Some(why)),
        };
        let log = request.path.display().to_string();
        return Ok(Validation {
            reading,
            between_stamps,
            not_simulated,
            ..Validation::begun(evaluated, log, &options)
        });
    }
    let mut recording = Recording::open(request.source(), evaluated, &options.reading.columns)?;
    if options.domain == Some(Domain::Harmonics) {
        recording = alone(recording, evaluated.dims().coordinates, &options);
    }
    let segments: Vec<&Log> = recording.segments.iter().collect();
    let fault =
        |error: EvalError| LogFault::Estimate { path: request.path.display().to_string(), source: error.into() };
    let rows = rows.about(&parameters).map_err(fault)?;
    let machine = rows.machine();
    let derivatives = machine.map(|machine| machine.derivatives);
    let found = validate_segments(rows.model(), derivatives, &segments, &options, &parameters, &settled.open)?;
    let (simulation, not_simulated) = match simulate(machine, &segments, &options, &parameters, &settled.open, extent)?
    {
        Ok(simulation) => (Some(simulation), None),
        Err(why) => (None, Some(why)),
    };
    Ok(Validation { reading: recording.report, simulation, not_simulated, ..found })
}

/// Predicts the inputs of a log from its motion with given parameters, one value per parameter of the model. Rows that change along
/// one of the `open` directions are left out. Harmonic by harmonic where the log repeats, otherwise in the time domain. The motion is
/// not simulated: [`validate`] does that with a declared model.
///
/// # Errors
/// [`LogFault`] when the log is too short, or the rows cannot be evaluated on its motion.
pub fn validate_log(
    model: &dyn Model<f64>,
    log: &Log,
    options: &LogOptions,
    parameters: &[f64],
    open: &[Weights],
) -> Result<Validation, LogFault> {
    validate_segments(model, None, &[log], options, parameters, open)
}

/// Predicts and simulates the measured part of a run with what its campaign identified. `derivatives` are those of the plant's rows; the
/// motion is simulated where they are given. `parameters` has one value per parameter of the plant, `open` the directions not determined.
///
/// # Errors
/// [`LogFault`].
pub(super) fn validate_run(
    machine: (&dyn Model<f64>, Option<&dyn RowDerivatives<f64>>),
    log: &Log,
    options: &LogOptions,
    parameters: &[f64],
    open: &[Weights],
) -> Result<Validation, LogFault> {
    let (model, derivatives) = machine;
    let found = validate_segments(model, derivatives, &[log], options, parameters, open)?;
    let differentiable = derivatives.map(|derivatives| Differentiable { model, derivatives });
    let (simulation, not_simulated) =
        match (&differentiable, simulate(differentiable, &[log], options, parameters, open, Extent::Evidence)?) {
            (None, _) => {
                (None, Some("the derivatives of a model with eliminated coordinates are not known".to_string()))
            }
            (_, Ok(simulation)) => (Some(simulation), None),
            (_, Err(why)) => (None, Some(why)),
        };
    Ok(Validation { simulation, not_simulated, ..found })
}

fn validate_segments(
    model: &dyn Model<f64>,
    derivatives: Option<&dyn RowDerivatives<f64>>,
    segments: &[&Log],
    options: &LogOptions,
    parameters: &[f64],
    open: &[Weights],
) -> Result<Validation, LogFault> {
    let dims = model.dims();
    let path = segments.first().map(|log| log.path.clone()).unwrap_or_default();
    let fault = |source| LogFault::Estimate { path: path.clone(), source };
    require_len(Buffer::Parameters, parameters.len(), dims.parameters).map_err(|error| fault(error.into()))?;
    let along = |direction: &Weights| -> Vec<f64> {
        let weight = |j: usize| direction.get(model.parameter(j).name).copied().unwrap_or(0.0);
        (0..dims.parameters).map(weight).collect()
    };
    let directions: Vec<Vec<f64>> = open.iter().map(along).collect();
    let periodic = match (segments, options.domain) {
        ([log], None) => repeating(log, dims.coordinates, options)?,
        ([log], Some(Domain::Harmonics)) => Some(spectra(log, dims.coordinates, options)?),
        _ => None,
    };
    let friction: Vec<Option<OwnFriction<'_>>> = (0..dims.rows)
        .map(|row| OwnFriction::of(model, &options.constants, row, parameters, &directions))
        .collect::<Result<_, EvalError>>()
        .map_err(|error| fault(error.into()))?;
    let mut found = Validation::begun(model, path.clone(), options);
    let rows: Vec<(Missed, Option<Vec<_>>)> = match (&periodic, segments.first()) {
        (Some((periodic, spectra)), Some(log)) => {
            // Harmonics of readings that repeat, or of digits that are cut off, stand out of the noise between them and are no motion.
            let compared = |signal: &Vec<f64>| Spectrum::of(&[signal], log.sample_time).compared();
            let band = log.channels[..dims.coordinates].iter().map(compared).fold(0.0, f64::max);
            let highest = (band * log.sample_time * periodic.samples_per_period).max(1.0) as usize;
            let settings =
                Settings { harmonics: options.estimation.harmonics.or(Some(highest)), ..options.estimation.clone() };
            let record = MeasuredMotion::new(model, &options.constants, spectra, options.reading.hold, &settings)
                .map_err(fault)?;
            found.from_sample = periodic.from;
            found.period = Some(periodic.samples_per_period * log.sample_time);
            found.periods = periodic.periods;
            found.harmonics = record.harmonics();
            let row = |r: usize| {
                let (missed, force) = record.row_power(r, parameters);
                let changes = directions.iter().map(|direction| {
                    let (change, terms) = record.row_change(r, direction);
                    if terms > 0.0 { change / terms } else { 0.0 }
                });
                let course = friction[r].as_ref().map_or_else(ForceCourse::default, |own| {
                    let parts = [&own.rate, &own.values].map(|weights| over_period(&record.row_part(r, weights)));
                    ForceCourse { parts: parts.to_vec(), ..ForceCourse::default() }
                });
                let missed = Missed { force, missed, changes: changes.collect(), course };
                (missed, Some(record.row_lines(r, parameters)))
            };
            (0..dims.rows).map(row).collect()
        }
        _ => {
            let stretches = stretches(segments, dims.coordinates, &options.reading)?;
            let record = record(segments.first().map_or(0.0, |log| log.sample_time), options, stretches);
            let parts: Vec<Vec<Vec<f64>>> = (friction.iter())
                .map(|own| own.iter().flat_map(|own| [own.rate.clone(), own.values.clone()]).collect())
                .collect();
            let predicted =
                predict_in_band(model, derivatives, &options.constants, &record, parameters, &directions, &parts)
                    .map_err(fault)?;
            found.cut_off = Some(predicted.cut_off);
            predicted.rows.into_iter().map(|row| (row, None)).collect()
        }
    };
    for (r, (Missed { force, missed, changes, course }, lines)) in rows.into_iter().enumerate() {
        let label = model.row(r);
        match open.iter().zip(changes).find(|(_, change)| *change > CANCELLED) {
            Some((direction, _)) => found.unpredicted.push(RowUnpredicted {
                name: label.name.into(),
                direction: display(direction),
                parameters: direction.keys().cloned().collect(),
            }),
            None => {
                let share = if force > 0.0 { missed / force } else { 0.0 };
                let (name, unit) = (label.name.into(), label.unit.map(String::from));
                let left: Vec<f64> = match &lines {
                    Some(lines) => {
                        let left: Vec<(usize, Complex<f64>)> =
                            lines.iter().map(|line| (line.0, line.1 - line.2)).collect();
                        over_period(&left)
                    }
                    None => course.applied.iter().zip(&course.predicted).map(|(a, b)| a - b).collect(),
                };
                let friction = match (&friction[r], course.parts.as_slice()) {
                    (Some(own), [rate, made]) => {
                        Some(own.course(rate, &left, made).map_err(|error| fault(error.into()))?)
                    }
                    _ => None,
                };
                let course = lines.map_or(RowCourse::Time(course), RowCourse::Harmonics);
                found.rows.push(RowPrediction { name, unit, force, missed, share, course, friction });
            }
        }
    }
    found.prediction_error = found.rows.iter().map(|row| row.share).reduce(f64::max);
    Ok(found)
}
