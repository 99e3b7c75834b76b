//! One run played by the program of a machine: as a whole, or sample by sample.

use crate::process::error::MachineFault;
use crate::process::protocol::{FromMachine, Signal, ToMachine};
use crate::process::talk::Talk;
use std::collections::BTreeMap;
use std::time::Duration;
use tpm_controller::model::{Dims, Label, Model};
use tpm_motion::{Controller, Record, RunFile, Trial, Velocity};

/// A record, and the machine's reason where it stopped the run.
pub(super) type Played = (Record, Option<String>);

/// The signals of a model, in its order.
pub(super) struct Signals {
    pub(super) coordinates: Vec<Signal>,
    pub(super) inputs: Vec<Signal>,
}

impl Signals {
    /// The signals of a model.
    pub(super) fn of(model: &dyn Model<f64>) -> Self {
        let signal =
            |label: Label<'_>| Signal { name: label.name.to_string(), unit: label.unit.map(ToString::to_string) };
        let dims = model.dims();
        Signals {
            coordinates: (0..dims.coordinates).map(|c| signal(model.coordinate(c))).collect(),
            inputs: (0..dims.inputs).map(|i| signal(model.input(i))).collect(),
        }
    }

    /// The message that asks for a run.
    pub(super) fn run(&self, model: &dyn Model<f64>, trial: &Trial, settle_periods: usize) -> ToMachine {
        let dims = model.dims();
        let every =
            |values: &[f64], first: usize, step: usize| values.iter().skip(first).step_by(step).copied().collect();
        let order = |c: usize, order: usize| every(&trial.reference, order * dims.coordinates + c, dims.motion_len());
        let coordinates = self.coordinates.iter().map(|signal| signal.name.clone()).enumerate();
        let inputs = self.inputs.iter().map(|signal| signal.name.clone()).enumerate();
        ToMachine::Run {
            terms: Box::new(RunFile::new(model, trial, settle_periods)),
            reference: coordinates.map(|(c, name)| (name, (0..=dims.order).map(|k| order(c, k)).collect())).collect(),
            feed_forward: inputs.map(|(i, name)| (name, every(&trial.feed_forward, i, dims.inputs))).collect(),
        }
    }
}

/// The values of signals in the order of the model.
///
/// # Errors
/// In words, when a signal is missing, or is none of the model's.
fn in_order<T>(mut values: BTreeMap<String, T>, signals: &[Signal], what: &str) -> Result<Vec<T>, String> {
    let take =
        |signal: &Signal| values.remove(&signal.name).ok_or_else(|| format!("{what} `{}` is missing", signal.name));
    let found = signals.iter().map(take).collect::<Result<Vec<T>, String>>()?;
    match values.keys().next() {
        Some(name) => Err(format!("`{name}` is no {what} of the model")),
        None => Ok(found),
    }
}

/// Values by coordinate in the order of the model, nothing for a coordinate without a sensor; empty where no coordinate
/// has one.
///
/// # Errors
/// In words, when a coordinate is none of the model's.
fn where_measured<T>(mut values: BTreeMap<String, T>, signals: &[Signal]) -> Result<Vec<Option<T>>, String> {
    if values.is_empty() {
        return Ok(Vec::new());
    }
    let found = signals.iter().map(|signal| values.remove(&signal.name)).collect();
    match values.keys().next() {
        Some(name) => Err(format!("`{name}`, whose rate is given, is no coordinate of the model")),
        None => Ok(found),
    }
}

/// A reading; a failed one becomes NaN.
fn reading(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

/// The samples of a run as they come in.
#[derive(Default)]
struct Columns {
    coordinates: Vec<Vec<f64>>,
    inputs: Vec<Vec<f64>>,
    rates: Vec<Option<Vec<f64>>>,
}

impl Columns {
    /// Number of samples.
    fn len(&self) -> usize {
        self.coordinates.first().map_or(0, Vec::len)
    }

    /// Adds samples, of which every signal has the same number.
    ///
    /// # Errors
    /// In words, when signals have different numbers of samples, or other rates are measured than before.
    fn add(&mut self, part: Columns) -> Result<(), String> {
        let length = part.len();
        let rates = || part.rates.iter().flatten();
        if let Some(other) = part.coordinates.iter().chain(&part.inputs).chain(rates()).find(|one| one.len() != length)
        {
            return Err(format!("one signal has {length} samples, another {}", other.len()));
        }
        if length == 0 {
            return Err("there are no samples".to_string());
        }
        if self.coordinates.is_empty() {
            *self = part;
            return Ok(());
        }
        let measured = |rates: &[Option<Vec<f64>>]| rates.iter().map(Option::is_some).collect::<Vec<bool>>();
        if measured(&self.rates) != measured(&part.rates) {
            return Err("the rates that are measured are not those of the samples before".to_string());
        }
        let own = self.coordinates.iter_mut().chain(&mut self.inputs).chain(self.rates.iter_mut().flatten());
        let new = part.coordinates.into_iter().chain(part.inputs).chain(part.rates.into_iter().flatten());
        own.zip(new).for_each(|(own, new)| own.extend(new));
        Ok(())
    }

    /// The record of a run that the machine ended: it has stated `said` recorded samples, and its reason where it
    /// stopped the run.
    fn record(
        self,
        talk: &Talk<'_>,
        trial: &Trial,
        said: usize,
        stopped: Option<String>,
    ) -> Result<Played, MachineFault> {
        let given = self.len();
        if said != given {
            return Err(talk.wrong(format!("it says that {said} samples were recorded, and {given} came")));
        }
        match stopped {
            Some(reason) if given == 0 => {
                Err(MachineFault::Said { message: format!("stopped before the first sample: {reason}") })
            }
            stopped => {
                let Columns { coordinates, inputs, rates } = self;
                let time = trial.control.sample_time;
                Ok((Record::of_samples(trial, time, coordinates, inputs, rates, stopped.is_some())?, stopped))
            }
        }
    }
}

/// Waits while a machine plays a run that was asked for, and gathers the record.
pub(super) fn play_run(talk: &mut Talk<'_>, signals: &Signals, trial: &Trial) -> Result<Played, MachineFault> {
    let awaited = "the record of the run";
    let duration = Duration::try_from_secs_f64(trial.samples() as f64 * trial.control.sample_time);
    let mut columns = Columns::default();
    loop {
        match talk.hear(awaited, duration.clone().unwrap_or(Duration::MAX))? {
            FromMachine::Samples { from, coordinates, inputs, rates } => {
                if from != columns.len() {
                    return Err(talk.wrong(format!("samples from {from} came where {} is next", columns.len())));
                }
                let part = || -> Result<Columns, String> {
                    let readings = |column: Vec<Option<f64>>| column.into_iter().map(reading).collect();
                    let coordinates = in_order(coordinates, &signals.coordinates, "coordinate")?;
                    let rates = where_measured(rates, &signals.coordinates)?;
                    Ok(Columns {
                        coordinates: coordinates.into_iter().map(readings).collect(),
                        inputs: in_order(inputs, &signals.inputs, "input")?,
                        rates: rates.into_iter().map(|rate| rate.map(readings)).collect(),
                    })
                };
                part().and_then(|part| columns.add(part)).map_err(|reason| talk.wrong(reason))?;
                if columns.len() > trial.samples() {
                    return Err(talk.wrong(format!("the run has {} samples, and more came", trial.samples())));
                }
            }
            FromMachine::End { samples, stopped, applied: None } => {
                return columns.record(talk, trial, samples, stopped);
            }
            other => return Err(talk.unexpected(&other, awaited)),
        }
    }
}

/// Plays a run sample by sample: the machine measures, the feedback is computed here, and the machine applies what is sent.
pub(super) fn play_samples(
    talk: &mut Talk<'_>,
    signals: &Signals,
    dims: Dims,
    trial: &Trial,
) -> Result<Played, MachineFault> {
    let mut controller = Controller::new(dims, trial);
    let mut wanted = vec![0.0; dims.inputs];
    let mut columns = Columns {
        coordinates: vec![Vec::with_capacity(trial.samples()); dims.coordinates],
        inputs: vec![Vec::with_capacity(trial.samples()); dims.inputs],
        rates: Vec::new(),
    };
    // 1. The machine's measurement, with the inputs that it applied before.
    while columns.len() < trial.samples() {
        let awaited = "a measured sample";
        let next = columns.len();
        let (coordinates, rates, applied) = match talk.hear(awaited, Duration::ZERO)? {
            FromMachine::Measured { sample, coordinates, rates, applied } if sample == next => {
                (coordinates, rates, applied)
            }
            FromMachine::Measured { sample, .. } => {
                return Err(talk.wrong(format!("sample {sample} came where {next} is next")));
            }
            FromMachine::End { samples, stopped, applied } => {
                correct(talk, signals, &mut columns, applied)?;
                return columns.record(talk, trial, samples, stopped);
            }
            other => return Err(talk.unexpected(&other, awaited)),
        };
        correct(talk, signals, &mut columns, applied)?;
        let measured: Vec<f64> = in_order(coordinates, &signals.coordinates, "coordinate")
            .map_err(|reason| talk.wrong(reason))?
            .into_iter()
            .map(reading)
            .collect();
        let rates: Vec<Option<f64>> = where_measured(rates, &signals.coordinates)
            .map_err(|reason| talk.wrong(reason))?
            .into_iter()
            .map(|rate| rate.map(reading))
            .collect();
        let rate = |c: usize| rates.get(c).copied().flatten();
        if let Some(c) = unmeasured(trial, rate) {
            let name = &signals.coordinates[c].name;
            return Err(talk.wrong(format!("the feedback needs the rate of `{name}`, which is missing")));
        }
        // 2. The feedback, with the inputs cut at their limits.
        controller.step(&measured, rate, &mut wanted)?;
        for (value, limit) in wanted.iter_mut().zip(&trial.input_limits) {
            *value = value.clamp(-limit, *limit);
        }
        // 3. The sample is recorded, and the inputs are sent unless the run ends here.
        let column = |value: &f64| vec![*value];
        let part = Columns {
            coordinates: measured.iter().map(column).collect(),
            inputs: wanted.iter().map(column).collect(),
            rates: rates.iter().map(|rate| rate.as_ref().map(column)).collect(),
        };
        if next == 0 {
            columns.rates = rates.iter().map(|rate| rate.map(|_| Vec::with_capacity(trial.samples()))).collect();
        }
        columns.add(part).map_err(|reason| talk.wrong(reason))?;
        if let Some(ending) = controller.ending(&measured, rate) {
            talk.stop(&ending.kind().to_string());
            break;
        }
        let names = signals.inputs.iter().map(|signal| signal.name.clone());
        talk.say(&ToMachine::Apply { sample: next, inputs: names.zip(wanted.iter().copied()).collect() });
    }
    let awaited = "the end of the run";
    match talk.hear(awaited, Duration::ZERO)? {
        FromMachine::End { samples, stopped, applied } => {
            correct(talk, signals, &mut columns, applied)?;
            columns.record(talk, trial, samples, stopped)
        }
        other => Err(talk.unexpected(&other, awaited)),
    }
}

/// Replaces the inputs of the last sample by those that the machine reports as applied, where they differ from the
/// commanded ones.
fn correct(
    talk: &Talk<'_>,
    signals: &Signals,
    columns: &mut Columns,
    applied: Option<BTreeMap<String, f64>>,
) -> Result<(), MachineFault> {
    let Some(applied) = applied else { return Ok(()) };
    let applied = in_order(applied, &signals.inputs, "input").map_err(|reason| talk.wrong(reason))?;
    for (column, value) in columns.inputs.iter_mut().zip(applied) {
        match column.last_mut() {
            Some(last) => *last = value,
            None => return Err(talk.wrong("nothing was applied before the first sample".to_string())),
        }
    }
    Ok(())
}

/// The first coordinate whose measured rate the feedback needs and that has no reading.
fn unmeasured(trial: &Trial, rate: impl Fn(usize) -> Option<f64>) -> Option<usize> {
    if trial.control.velocity != Velocity::Measured {
        return None;
    }
    let damped = trial.control.gains.iter().filter(|gain| gain.derivative != 0.0);
    damped.map(|gain| gain.coordinate).find(|&c| rate(c).is_none_or(f64::is_nan))
}
