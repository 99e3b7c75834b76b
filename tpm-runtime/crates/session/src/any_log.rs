//! A log of any motion, identified in the time domain.

use crate::excerpt::{Excerpt, at_most};
use crate::found::Found;
use crate::log_fault::LogFault;
use crate::log_report::{HoldResiduals, Way};
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::refine::{Conditions, Start, refined};
use crate::summary;
use crate::warning::{Data, Warning};
use tpm_core::model::Model;
use tpm_estimate::{Course, Differentiable, EstimateError, Stretch, TimeRecord, estimate_time_domain};
use tpm_log::Log;
use tpm_report::Remedy;

/// A measured rate that differs from the rate of the measured position by more than this share is flagged.
const RATE_DIFFERS: f64 = 0.05;

/// The stretches of a record from the first sample on that is used; there is one at least.
///
/// # Errors
/// [`LogFault::BadRange`] when that sample lies behind the end.
pub(super) fn stretches<'a>(
    segments: &[&'a Log],
    coordinates: usize,
    reading: &RecordSettings,
) -> Result<Vec<Stretch<'a>>, LogFault> {
    let mut left_out = reading.from_sample.unwrap_or(0);
    let mut stretches = Vec::with_capacity(segments.len());
    for log in segments {
        let from = left_out.min(log.len());
        left_out -= from;
        if from < log.len() {
            let channels: Vec<&[f64]> = log.channels.iter().map(|channel| &channel[from..]).collect();
            let (own, inputs) = channels.split_at(coordinates);
            let rate = |c: usize| log.rates.get(c).and_then(Option::as_ref).map(|rate| &rate[from..]);
            let rates = (0..coordinates).map(rate).collect();
            stretches.push(Stretch { coordinates: own.to_vec(), rates, inputs: inputs.to_vec() });
        }
    }
    if stretches.is_empty() {
        return Err(LogFault::BadRange {
            path: segments.first().map(|log| log.path.clone()).unwrap_or_default(),
            what: format!("the first sample {} lies behind the end", reading.from_sample.unwrap_or(0)),
            remedy: Remedy::FromSample,
            samples: segments.iter().map(|log| log.len()).sum(),
            sample_time: segments.first().map_or(0.0, |log| log.sample_time),
        });
    }
    Ok(stretches)
}

/// Most samples that are low-passed; of a longer record it is blocks, evenly spread over it.
pub(super) const MOST_SAMPLES: usize = 1 << 20;
/// Number of such blocks.
pub(super) const BLOCKS: usize = 16;

/// One warning for every measured rate that is not that of the measured position.
pub(super) fn differing_rates(model: &dyn Model<f64>, gains: &[Option<f64>]) -> impl Iterator<Item = Warning> {
    let differs = |(c, gain): (usize, &Option<f64>)| {
        let gain = gain.filter(|gain| (gain - 1.0).abs() > RATE_DIFFERS)?;
        Some(Warning::RateDiffers { coordinate: model.coordinate(c).name.into(), gain })
    };
    gains.iter().enumerate().filter_map(differs)
}

/// Identifies a model from all samples of the segments of a record, whatever the motion is.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
) -> Result<Found, LogFault> {
    let settings = &options.estimation;
    let dims = model.dims();
    let stretches = stretches(segments, dims.coordinates, &options.reading)?;
    let nothing = LogFault::Estimate { path: String::new(), source: EstimateError::NoSignal };
    let first = segments.first().ok_or(nothing)?;
    let samples = stretches.iter().map(Stretch::samples).sum();
    let record = TimeRecord {
        sample_time: first.sample_time,
        hold: options.reading.hold,
        actuators: &options.actuators,
        stretches: at_most(stretches.clone(), MOST_SAMPLES, BLOCKS),
    };
    let derivatives = machine.map(|machine| machine.derivatives);
    let found = estimate_time_domain(model, derivatives, &options.constants, &record, settings)
        .map_err(|source| LogFault::Estimate { path: first.path.clone(), source })?;
    let report = &found.report;
    let (typical_period, reach, highest) = (found.typical_period, found.reach, report.highest.clone());
    let start = Start {
        estimate: &found.estimate,
        excerpt: Excerpt::of_stretches(&stretches),
        course: Course::Any { typical_period, reach, highest, copies: 1.0 },
        steps: found.steps.clone(),
        samples,
        sample_time: first.sample_time,
    };
    let restate = |values, covariance| found.restated(values, covariance, settings);
    let refined = refined(machine, start, Conditions::of_log(options), settings, &restate);
    let mut warnings = summary::doubts(model, &refined.estimate, Data::Log);
    warnings.extend(differing_rates(model, &report.rate_gains));
    let period = options.reading.period.map(|period| Warning::PeriodNotUsed { period, stretches: segments.len() });
    warnings.extend(period);
    warnings.extend(refined.warnings);
    Ok(Found {
        harmonics: 0,
        row_residuals: report.row_residuals.clone(),
        hold_residuals: HoldResiduals::of(options.reading.hold, found.estimate.residual, found.other_hold),
        way: Way::Time(report.clone()),
        estimate: refined.estimate,
        refinement: refined.report,
        warnings,
    })
}
