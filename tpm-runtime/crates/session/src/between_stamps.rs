//! A log followed between its stamps with given parameters: the free run of a model that only a simulation compares with a log.
//!
//! Invariant: no parameter is fitted. The state at the beginning of every stretch is the one that leaves least, as sensors do not tell it.

use crate::error::SessionError;
use crate::log_fault::LogFault;
use crate::options::LogOptions;
use crate::recorded_log::{may_be, signal_name, signals};
use crate::simulation::Fit;
use crate::simulation_figure::drawn;
use serde::Serialize;
use tpm_codegen::identified::{Weights, display, remedy};
use tpm_controller::model::Model;
use tpm_estimate::{Followed, FollowedSensor, follow_recorded};
use tpm_log::{AsRecorded, LogSource, ReadingReport};
use tpm_plot::{Axis, Curve, Figure, Panel, Trace};

/// The free run does not change along a direction that a result leaves open when it moves by less than this share of the motion.
const UNMOVED: f64 = 1e-3;

/// What one sensor read beside the free run.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SensorFollowed {
    /// What is read, `x` or `dot(x)`.
    pub signal: String,
    /// Its unit.
    pub unit: Option<String>,
    /// Readings that are compared.
    pub readings: usize,
    /// How well the free run agrees with them.
    pub free_run: Fit,
    /// Stamps, s, for figures and records.
    #[serde(skip)]
    pub time: Vec<f64>,
    /// Readings, for figures and records.
    #[serde(skip)]
    pub measured: Vec<f64>,
    /// The free run at the stamps, for figures and records.
    #[serde(skip)]
    pub simulated: Vec<f64>,
}

/// A log followed between its stamps.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BetweenStamps {
    /// Stretches, each simulated whole from a state of its own.
    pub stretches: usize,
    /// Stretches in which the simulated motion leaves all bounds.
    pub left: usize,
    /// Duration of the longest one, s.
    pub duration: f64,
    /// The sensors.
    pub sensors: Vec<SensorFollowed>,
}

impl BetweenStamps {
    /// Why the log is not followed; nothing where it is.
    pub(super) fn shortfall(&self) -> Option<String> {
        if self.left > 0 {
            let (left, all) = (self.left, self.stretches);
            return Some(format!(
                "simulated from its inputs the motion leaves all bounds in {left} of {all} stretches: the model does not describe this motion, \
                 or needs its loop"
            ));
        }
        let astray = self.sensors.iter().find(|own| own.free_run.fit.is_some_and(|fit| fit <= 0.0))?;
        Some(format!(
            "simulated from its inputs {} is further from the log than its mean: the model does not describe this motion, or needs its loop",
            astray.signal
        ))
    }

    /// Readings and free run of every sensor, and the difference.
    #[must_use]
    pub fn figure(&self, title: &str) -> Figure {
        let mut panels = Vec::new();
        for own in &self.sensors {
            let label = own.unit.as_ref().map_or_else(|| own.signal.clone(), |unit| format!("{} [{unit}]", own.signal));
            let points = |signal: &[f64]| drawn(signal, &[], &|k| own.time[k]);
            let x = || Axis::linear("time [s]").from_to(own.time[0], own.time[own.time.len() - 1]);
            if own.time.len() < 2 {
                continue;
            }
            let measured = Trace::new("measured", 0, Curve::Line(points(&own.measured)));
            let free = Trace::new("free run", 1, Curve::Dashed(points(&own.simulated)));
            let missed: Vec<f64> =
                own.measured.iter().zip(&own.simulated).map(|(y, simulated)| y - simulated).collect();
            let missed = Trace::new("measured less free run", 1, Curve::Line(points(&missed)));
            panels.push(Panel { x: x(), y: Axis::linear(&label), traces: vec![measured, free] });
            panels.push(Panel { x: x(), y: Axis::linear(&label), traces: vec![missed] });
        }
        Figure::new(title, panels)
    }
}

/// Follows a log with parameters of which `open` directions are not determined: the free run, or why there is none, and how the log was
/// read.
///
/// # Errors
/// [`SessionError`] when the log cannot be read, or holds too little for a simulation.
pub(super) fn follow(
    model: &dyn Model<f64>,
    source: LogSource<'_>,
    options: &LogOptions,
    (parameters, open): (&[f64], &[Weights]),
) -> Result<(Result<BetweenStamps, String>, ReadingReport), SessionError> {
    let mut recorded = AsRecorded::open(source, model, &options.reading.columns).map_err(LogFault::from)?;
    let reading = std::mem::take(&mut recorded.report);
    if !may_be(options) {
        return Err(LogFault::OnlySimulated { path: recorded.path }.into());
    }
    let signals = signals(&recorded, options);
    let run = |parameters: &[f64]| {
        follow_recorded(model, &options.constants, &signals, parameters)
            .map_err(|source| LogFault::Recorded { path: recorded.path.clone(), source })
    };
    let followed = run(parameters)?;
    for direction in open {
        let moved = moved(model, parameters, direction);
        if parts(&followed, &run(&moved)?) {
            let names: Vec<String> = direction.keys().cloned().collect();
            let why = format!(
                "the result leaves {} open, and the simulated motion changes along it; {}",
                display(direction),
                remedy(&names)
            );
            return Ok((Err(why), reading));
        }
    }
    let sensor = |own: FollowedSensor| {
        let pairs = own.measured.iter().zip(&own.simulated).map(|(y, simulated)| (*y, *simulated));
        let unit = model.coordinate(own.coordinate).unit;
        SensorFollowed {
            signal: signal_name(model, own.coordinate, own.derivative),
            unit: unit.map(|unit| if own.derivative == 0 { unit.to_owned() } else { format!("{unit}/s") }),
            readings: own.time.len(),
            free_run: Fit::of(pairs),
            time: own.time,
            measured: own.measured,
            simulated: own.simulated,
        }
    };
    let Followed { sensors, stretches, left, duration, .. } = followed;
    let sensors = sensors.into_iter().map(sensor).collect();
    Ok((Ok(BetweenStamps { stretches, left, duration, sensors }), reading))
}

/// Parameters moved along a direction, by a tenth of the largest that takes part in it.
fn moved(model: &dyn Model<f64>, parameters: &[f64], direction: &Weights) -> Vec<f64> {
    let weight = |j: usize| direction.get(model.parameter(j).name).copied().unwrap_or(0.0);
    let all = || (0..parameters.len()).map(|j| (parameters[j], weight(j))).filter(|(_, weight)| weight.abs() > 0.0);
    let size = all().map(|(value, weight)| (value / weight).abs()).fold(0.0, f64::max);
    let by = 0.1 * if size > 0.0 { size } else { 1.0 };
    parameters.iter().enumerate().map(|(j, value)| value + by * weight(j)).collect()
}

/// Whether two free runs differ.
fn parts(one: &Followed, other: &Followed) -> bool {
    one.left != other.left
        || one.sensors.iter().zip(&other.sensors).any(|(a, b)| {
            let moved = Fit::of(a.simulated.iter().zip(&b.simulated).map(|(x, y)| (*x, *y)));
            moved.fit.is_some_and(|fit| 100.0 - fit > 100.0 * UNMOVED)
        })
}
