//! The motion of a log simulated from its inputs with given parameters, and what that misses.
//!
//! Fits are those of MATLAB's `compare`: `100 (1 - |y - y'| / |y - mean(y)|)` %, over all samples that are simulated.
//!
//! - One sample ahead: the Kalman filter's prediction with the noise of sensors and inputs with which the log is most likely. The
//!   first samples of a stretch, which determine its state, do not count. Its errors are tested where nothing but that noise makes them:
//!   not around stops of a machine with dry friction, whose force then is anything between its two.
//! - Free run: every stretch begins with the smoothed state at its first sample and follows the recorded inputs, whatever loop made
//!   them. Where it leaves the log, it has no fit: the time is told.

use crate::excerpt::{Excerpt, accelerated, at_most};
use crate::lines_log::{MOST_SIMULATED, is_told_by_lines};
use crate::log_fault::LogFault;
use crate::options::LogOptions;
use crate::record::{record, stretches};
use crate::warning::Warning;
use crate::whiteness::{CorrelationTest, FALSE_ALARM, independence, whiteness};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use tpm_codegen::identified::{Weights, display, remedy};
use tpm_controller::model::{Model, moving};
use tpm_estimate::{Course, Differentiable, Divergence, EstimateError, Pace, Refine, Simulated, Stretch};
use tpm_log::Log;
use tpm_numerics::root_mean_square;

/// Most samples that are simulated; of a longer log it is blocks, evenly spread over it.
const MOST_SAMPLES: usize = 150_000;
/// Most numbers of the transitions from sample to sample, which many coordinates have more of.
const MOST_NUMBERS: usize = 1 << 24;
/// Number of such blocks.
const BLOCKS: usize = 8;
/// Most states at all samples that are evidence, but for [`LEAST_OF_EVIDENCE`] samples.
const STATES_OF_EVIDENCE: usize = 8_000;
/// Samples that are evidence whatever they cost.
const LEAST_OF_EVIDENCE: usize = 1_000;
/// Samples of a block of evidence; two blocks at least, since a machine may stand still at the beginning.
const BLOCK_OF_EVIDENCE: usize = 500;
/// Motions at which it is tested whether the rows change along a direction.
const MOTIONS: usize = 32;
/// Rows do not change along a direction when its terms cancel to this share of themselves at every motion.
const CANCELLED: f64 = 1e-3;

/// How much of a log is simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Extent {
    /// All of it, as far as memory and minutes reach.
    Whole,
    /// As much as costs little beside an identification: for its report, or to see whether a model follows a log at all.
    Evidence,
}

/// How well something simulated agrees with a channel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Fit {
    /// Root mean square of measured less simulated values, unit of the channel.
    pub rms: f64,
    /// Normalised root mean square fit, `100 (1 - |y - y'| / |y - mean(y)|)` %; nothing where the channel is constant.
    pub fit: Option<f64>,
}

impl Fit {
    pub(super) fn of(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> Self {
        let count = pairs.clone().count().max(1) as f64;
        let mean = pairs.clone().map(|(y, _)| y).sum::<f64>() / count;
        let rms = root_mean_square(pairs.clone().map(|(y, simulated)| y - simulated));
        let spread = root_mean_square(pairs.map(|(y, _)| y - mean));
        Fit { rms, fit: (spread > 0.0).then(|| 100.0 * (1.0 - rms / spread)) }
    }
}

/// Whether one-step prediction errors are independent of an input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InputTest {
    /// Name of the input.
    pub input: String,
    /// The cross-correlations with its past values.
    #[serde(flatten)]
    pub test: CorrelationTest,
}

/// What is simulated of one measured channel.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelSimulation {
    /// Name of the coordinate.
    pub name: String,
    /// Unit of the coordinate.
    pub unit: Option<String>,
    /// Standard deviation of the sensor's noise as it was found.
    pub noise: f64,
    /// One sample ahead.
    pub one_step: Fit,
    /// Root mean square of a reading less the one before it, over the samples of `one_step`, unit of the coordinate: what a prediction misses
    /// that takes every reading for the next one and needs no model.
    pub last_reading: f64,
    /// The free run; nothing where it leaves the log.
    pub free_run: Option<Fit>,
    /// Whether the one-step prediction errors are white; nothing where there are too few.
    pub whiteness: Option<CorrelationTest>,
    /// Whether they are independent of the inputs before them.
    pub independence: Vec<InputTest>,
    /// Measured values, for figures.
    #[serde(skip)]
    pub measured: Vec<f64>,
    /// Values predicted one sample ahead, for figures.
    #[serde(skip)]
    pub predicted: Vec<f64>,
    /// Values of the free run, for figures; not a number where it has left all bounds.
    #[serde(skip)]
    pub simulated: Vec<f64>,
}

impl ChannelSimulation {
    /// Whether one sample ahead the last reading says more than the model.
    pub(super) fn is_worse_than_no_model(&self) -> bool {
        self.one_step.rms > self.last_reading
    }
}

/// Noise of an input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InputNoise {
    /// Name of the input.
    pub name: String,
    /// Unit of the input.
    pub unit: Option<String>,
    /// Standard deviation of its noise as it was found; zero where the record is taken as exact.
    pub noise: f64,
}

/// Where a free run leaves the log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Leaving {
    /// Number of the stretch, from 0.
    pub stretch: usize,
    /// Time since its first sample, s.
    pub time: f64,
    /// Whether an error of the starting state as small as its deviation grows to the size of the motion: no model follows such a motion
    /// from its inputs alone. Otherwise it is the motion simulated with these parameters that leaves the measured one.
    pub unstable: bool,
}

/// The motion of a log simulated from its inputs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Simulation {
    /// Samples that were simulated.
    pub samples: usize,
    /// Samples of the log.
    pub of: usize,
    /// Samples whose one-step prediction errors are tested: not those around stops of a machine with dry friction.
    pub tested: usize,
    /// Stretches that were simulated, each with a start of its own.
    pub stretches: usize,
    /// How a free run begins: `smoothed state`.
    pub start: &'static str,
    /// What drives it: `recorded input`.
    pub driven_by: &'static str,
    /// The coordinates.
    pub channels: Vec<ChannelSimulation>,
    /// The inputs.
    pub inputs: Vec<InputNoise>,
    /// Where the free run leaves the log; nothing where it does not.
    pub diverges: Option<Leaving>,
    /// Chance that a test of the prediction errors fails although the model is right.
    pub false_alarm: f64,
    /// Time between samples, s.
    #[serde(skip)]
    pub sample_time: f64,
    /// First samples of the stretches behind the first one.
    #[serde(skip)]
    pub joins: Vec<usize>,
    /// Of every sample, whether its one-step prediction errors are tested.
    #[serde(skip)]
    pub regular: Vec<bool>,
}

impl Simulation {
    /// The coordinate of which the last reading says more, one sample ahead, than the model.
    pub(super) fn astray(&self) -> Option<Warning> {
        let astray = self.channels.iter().find(|channel| channel.is_worse_than_no_model())?;
        Some(Warning::Astray {
            coordinate: astray.name.clone(),
            unit: astray.unit.clone(),
            missed: astray.one_step.rms,
            last_reading: astray.last_reading,
        })
    }
}

/// Simulates the segments of a log from its inputs, or says why not; of a log that is longer than `extent`, blocks. `open` are directions of
/// the parameters that are not determined.
///
/// # Errors
/// [`LogFault`] when the first sample to use lies behind the end.
pub(super) fn simulate(
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
    parameters: &[f64],
    open: &[Weights],
    extent: Extent,
) -> Result<Result<Simulation, String>, LogFault> {
    let Some(machine) = machine else {
        return Ok(Err(
            "the derivatives of the model's rows are not known: declare it in a model file or with the macro".into(),
        ));
    };
    let model = machine.model;
    let dims = model.dims();
    if moving(model) < dims.coordinates {
        return Ok(Err("friction that builds up after reversals is predicted by its rows alone".into()));
    }
    let is_long = dims.coordinates > MOST_SIMULATED && is_told_by_lines(dims);
    if is_long && options.refine != Refine::OutputError {
        return Ok(Err(format!("of {} coordinates, all with an input, only when it is asked for", dims.coordinates)));
    }
    let stretches = stretches(segments, dims.coordinates, &options.reading)?;
    if let Some(direction) = open.iter().find(|direction| changes(model, &options.constants, direction)) {
        let parameters: Vec<String> = direction.keys().cloned().collect();
        return Ok(Err(format!(
            "the result leaves {} open, and the simulated motion changes along it; {}",
            display(direction),
            remedy(&parameters)
        )));
    }
    let of: usize = stretches.iter().map(Stretch::samples).sum();
    let states: usize = (0..dims.coordinates).map(|c| model.coordinate_order(c)).sum();
    let (most, blocks) = match extent {
        Extent::Whole => (MOST_SAMPLES.min(MOST_NUMBERS / (states * (states + dims.inputs)).max(1)), BLOCKS),
        Extent::Evidence => {
            let most = (STATES_OF_EVIDENCE / states.max(1)).max(LEAST_OF_EVIDENCE);
            (most, (most / BLOCK_OF_EVIDENCE).min(BLOCKS))
        }
    };
    let parts = at_most(stretches, most, blocks);
    let sample_time = segments.first().map_or(0.0, |log| log.sample_time);
    match of_parts(machine, &parts, sample_time, options, parameters) {
        Ok(simulation) => Ok(Ok(Simulation { of, ..simulation })),
        Err(why) => Ok(Err(why)),
    }
}

fn of_parts(
    machine: Differentiable<'_>,
    parts: &[Stretch<'_>],
    sample_time: f64,
    options: &LogOptions,
    parameters: &[f64],
) -> Result<Simulation, String> {
    let model = machine.model;
    let dims = model.dims();
    let record = record(sample_time, options, parts.to_vec());
    let pace = Pace::of(&record).map_err(|fault: EstimateError| format!("{fault}"))?;
    let Pace { typical_period, reach, highest, steps, .. } = pace;
    let rate = (sample_time, options.reading.hold, accelerated(model));
    let excerpt = Excerpt::joined(parts).behind(&options.actuators, dims.coordinates, rate, None);
    let course = Course::Any { typical_period, reach, highest, copies: 1.0 };
    let signals = excerpt.signals(dims.coordinates, sample_time, options.reading.hold, (course, &steps));
    let found = Simulated::of(machine, &options.constants, &signals, parameters).map_err(|fault| format!("{fault}"))?;
    let count = found.counts.len();
    // Regular samples in a row, of which correlations are taken.
    let starts = |k: usize| k == 0 || signals.joins.binary_search(&k).is_ok();
    let mut rows: Vec<std::ops::Range<usize>> = Vec::new();
    for k in (0..count).filter(|&k| found.regular[k]) {
        match rows.last_mut() {
            Some(row) if row.end == k && !starts(k) => row.end = k + 1,
            _ => rows.push(k..k + 1),
        }
    }
    let cut = |signal: &'_ [f64]| -> Vec<Vec<f64>> { rows.iter().map(|row| signal[row.clone()].to_vec()).collect() };
    let channel = |c: usize| {
        let measured = signals.coordinates[c];
        let (predicted, simulated) = (&found.one_step[c], &found.free_run[c]);
        let ahead = measured.iter().zip(predicted).zip(&found.counts).filter(|(_, counts)| **counts);
        let free = measured.iter().zip(simulated).map(|(y, run)| (*y, *run));
        let steps = measured.windows(2).zip(found.counts.iter().skip(1)).filter(|(_, counts)| **counts);
        let errors = cut(&found.normalised[c]);
        let errors: Vec<&[f64]> = errors.iter().map(Vec::as_slice).collect();
        let white = whiteness(&errors);
        let independent = |i: usize| {
            let inputs = cut(signals.inputs[i]);
            let inputs: Vec<&[f64]> = inputs.iter().map(Vec::as_slice).collect();
            let test = independence(&errors, &inputs, white.as_ref()?)?;
            Some(InputTest { input: model.input(i).name.into(), test })
        };
        let label = model.coordinate(c);
        ChannelSimulation {
            name: label.name.into(),
            unit: label.unit.map(Into::into),
            noise: found.sensor_noise[c],
            one_step: Fit::of(ahead.map(|((y, predicted), _)| (*y, *predicted))),
            last_reading: root_mean_square(steps.map(|(pair, _)| pair[1] - pair[0])),
            free_run: found.divergence.is_none().then(|| Fit::of(free)),
            independence: (0..dims.inputs).filter_map(independent).collect(),
            whiteness: white,
            measured: measured.to_vec(),
            predicted: predicted.clone(),
            simulated: simulated.clone(),
        }
    };
    let input = |i: usize| {
        let label = model.input(i);
        InputNoise { name: label.name.into(), unit: label.unit.map(Into::into), noise: found.input_noise[i] }
    };
    let leaving = |Divergence { stretch, time, unstable }| Leaving { stretch, time, unstable };
    Ok(Simulation {
        samples: count,
        of: count,
        tested: found.regular.iter().filter(|regular| **regular).count(),
        stretches: signals.joins.len() + 1,
        start: "smoothed state",
        driven_by: "recorded input",
        channels: (0..dims.coordinates).map(channel).collect(),
        inputs: (0..dims.inputs).map(input).collect(),
        diverges: found.divergence.map(leaving),
        false_alarm: FALSE_ALARM,
        sample_time,
        joins: signals.joins.clone(),
        regular: found.regular,
    })
}

/// Whether the rows change along a direction of the parameters at motions drawn at will, rather than along the log alone.
fn changes(model: &dyn Model<f64>, constants: &[f64], direction: &Weights) -> bool {
    let dims = model.dims();
    let weights: Vec<f64> =
        (0..dims.parameters).map(|j| direction.get(model.parameter(j).name).copied().unwrap_or(0.0)).collect();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut motion = vec![0.0; dims.motion_len()];
    let mut phi = vec![0.0; dims.regressor_len()];
    let mut scratch = vec![0.0; model.workspace_len()];
    (0..MOTIONS).any(|_| {
        motion.iter_mut().for_each(|slot| *slot = rng.random_range(-2.0..2.0));
        model.regressor(&motion, constants, &mut scratch, &mut phi).is_ok()
            && phi.chunks_exact(dims.parameters.max(1)).any(|row| {
                let terms = || row.iter().zip(&weights).map(|(phi, weight)| phi * weight);
                let size: f64 = terms().map(f64::abs).sum();
                size.is_finite() && terms().sum::<f64>().abs() > CANCELLED * size
            })
    })
}
