//! From a log to parameters, with everything that was found on the way.

use crate::estimate::named::{CombinationReport, EstimateReport, ParameterReport, doubts};
use crate::estimate::{Estimate, EstimateError, MeasuredMotion, Settings, Status, estimate_measured_motion, no_result};
use crate::log::{Log, LogError, LogOptions};
use crate::log::{Periodic, PeriodicFault, find_periodic};
use crate::run::Spectra;
use crate::run::correct_actuators;
use serde::Serialize;
use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::Model;

/// The other hold explains a log clearly better when it leaves less than this share of the residual.
const CLEARLY_BETTER: f64 = 0.7;
/// A difference of successive periods above this share of the motion is flagged.
const UNSTEADY: f64 = 0.02;

/// Residuals with either choice of hold, as shares of the force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct HoldResiduals {
    /// Inputs as recorded.
    pub none: Option<f64>,
    /// Inputs held between samples.
    pub zoh: Option<f64>,
}

/// What was found about a log.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LogReport {
    /// The file.
    pub path: String,
    /// Samples in the log.
    pub samples: usize,
    /// Time between samples, s.
    pub sample_time: f64,
    /// First sample of the part that repeats, from 0.
    pub steady_from_sample: usize,
    /// First sample used, from 0.
    pub from_sample: usize,
    /// Its line in the file.
    pub from_line: u64,
    /// Period, s.
    pub period: f64,
    /// Period in samples.
    pub samples_per_period: f64,
    /// Whole periods used.
    pub periods: usize,
    /// Difference between the last two periods as a share of the motion.
    pub mismatch: f64,
    /// Window on the samples.
    pub window: String,
    /// Harmonics used, per row of the model.
    pub lines: Vec<Vec<usize>>,
    /// Highest harmonic of the motion from which regressors were built.
    pub motion_harmonics: usize,
    /// Residual per row, as a share of its force.
    pub row_residuals: Vec<f64>,
    /// Known dynamics of the actuators, by input, that were corrected.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub actuators: BTreeMap<String, ActuatorReport>,
    /// Residual with either hold.
    pub hold_residuals: HoldResiduals,
}

/// What was known to lie between an input and its force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ActuatorReport {
    /// Delay, s.
    pub delay: f64,
    /// Natural frequency (rad/s) and quality factor of a low pass.
    pub low_pass: Option<(f64, f64)>,
    /// Bandwidth of the current loop, rad/s.
    pub bandwidth: Option<f64>,
}

/// Identified parameters; serialises as `tpm.identification/1`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Identification {
    /// `tpm.identification/1`.
    pub schema: &'static str,
    /// Name of the model.
    pub model: String,
    /// Hold of the inputs: none or zoh.
    pub hold: String,
    /// Highest harmonic used.
    pub harmonics: usize,
    /// Parameters in which the model is linear.
    pub parameters: Vec<ParameterReport>,
    /// Physical parameters, where parameters were lumped.
    pub physical: Vec<ParameterReport>,
    /// Directions that the data do not show: parameter to weight.
    pub unobservable: Vec<BTreeMap<String, String>>,
    /// What they do show of the unobservable parameters.
    pub combinations: Vec<CombinationReport>,
    /// Covariance of the parameters; nothing where unobservable.
    pub covariance: Vec<Vec<Option<f64>>>,
    /// Independent combinations that the data show.
    pub rank: usize,
    /// Condition number of the scaled equations.
    pub condition: f64,
    /// Residual as a share of the force.
    pub residual: f64,
    /// Runs of a campaign; none for a log.
    pub runs: Vec<serde_json::Value>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// What was found about the log.
    pub log: LogReport,
    /// The estimate itself, for further computation.
    #[serde(skip)]
    pub estimate: Estimate,
}

impl Identification {
    /// Why this is not all that was asked for, when it is not.
    #[must_use]
    pub fn shortfall(&self) -> Option<String> {
        if !self.estimate.is_explained() {
            return Some(no_result(self.residual));
        }
        let wanted = self.estimate.status.iter().filter(|status| **status != Status::Frozen).count();
        (self.rank < wanted).then(|| {
            format!("the data determine {} independent combinations of the parameters, not all of them", self.rank)
        })
    }
}

/// Identifies the parameters of a model from one log.
///
/// # Errors
/// [`LogError`].
pub fn identify_log(model: &dyn Model<f64>, log: &Log, options: &LogOptions) -> Result<Identification, LogError> {
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
        prior: options.prior.clone(),
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
    let log_report = LogReport {
        path: log.path.clone(),
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
    };
    let warnings = warnings(model, &record, &estimate, options, &log_report, other);
    Ok(report(model, options, &record, estimate, log_report, warnings))
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
    let range = |what: String| LogError::BadRange {
        path: log.path.clone(),
        what,
        samples: log.len(),
        sample_time: log.sample_time,
    };
    if let Some(from) = options.from_sample
        && from >= log.len()
    {
        return Err(range(format!("--from-sample {from} lies behind the end")));
    }
    if let Some(period) = options.period
        && !(period.is_finite() && period >= 3.0 * log.sample_time)
    {
        return Err(range(format!(
            "--period {period} s is not a period (it is given in seconds, and has three samples at least)"
        )));
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
        PeriodicFault::Range => range(match options.period {
            Some(period) => {
                format!("no whole period of {period} s lies behind sample {start} (--period is in seconds)")
            }
            None => format!("no whole period lies behind sample {start}"),
        }),
    })
}

fn warnings(
    model: &dyn Model<f64>,
    record: &MeasuredMotion,
    estimate: &Estimate,
    options: &LogOptions,
    log: &LogReport,
    other: Option<f64>,
) -> Vec<String> {
    let mut warnings = Vec::new();
    if let Some(other) = other
        && other < CLEARLY_BETTER * estimate.residual
    {
        warnings.push(format!(
            "--hold {} explains the log clearly better: it leaves {:.3} % of the force, --hold {} leaves {:.3} %",
            options.hold.other(),
            100.0 * other,
            options.hold,
            100.0 * estimate.residual
        ));
    }
    if log.periods == 1 {
        warnings.push(
            "one period only: it cannot be tested whether the motion had settled, and noise is read from the highest harmonics; record at least four"
                .into(),
        );
    }
    if log.mismatch > UNSTEADY {
        warnings.push(format!(
            "the last two periods differ by {:.1} % of the motion: noise, or a motion that has not settled",
            100.0 * log.mismatch
        ));
    }
    if options.from_sample.is_none() && 2 * log.steady_from_sample > log.samples {
        warnings.push(format!(
            "more than half of the log is left out: samples 0 to {} of {} do not repeat with the period of the last ones; \
             the end of a motion whose frequency changes passes for periodic, and its parameters are not to be trusted \
             (--from-sample says where a motion repeats)",
            log.steady_from_sample - 1,
            log.samples
        ));
    }
    if let Some((from, to)) = record.left_out() {
        warnings.push(format!(
            "harmonics {from} to {to} are excited but left out: the model does not explain them as it does the lower ones (--harmonics {to} takes them in)"
        ));
    }
    warnings.extend(estimate.unexplained());
    warnings.extend(doubts(model, estimate, "this log"));
    warnings
}

fn report(
    model: &dyn Model<f64>,
    options: &LogOptions,
    record: &MeasuredMotion,
    estimate: Estimate,
    log: LogReport,
    warnings: Vec<String>,
) -> Identification {
    let EstimateReport { parameters, unobservable, combinations, covariance } =
        EstimateReport::new(model, &options.prior, Some(&estimate));
    Identification {
        schema: "tpm.identification/1",
        model: model.name().into(),
        hold: options.hold.to_string(),
        harmonics: record.harmonics(),
        parameters,
        physical: Vec::new(),
        unobservable,
        combinations,
        covariance,
        rank: estimate.rank,
        condition: estimate.condition,
        residual: estimate.residual,
        runs: Vec::new(),
        warnings,
        log,
        estimate,
    }
}
