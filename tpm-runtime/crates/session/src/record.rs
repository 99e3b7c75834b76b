//! The samples of a record as the estimators take them.

use crate::excerpt::at_most;
use crate::log_fault::LogFault;
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::warning::Warning;
use tpm_controller::model::Model;
use tpm_estimate::{EstimateError, Stretch, TimeRecord};
use tpm_log::Log;
use tpm_report::Remedy;

/// A measured rate that differs from the rate of the measured position by more than this share is flagged.
const RATE_DIFFERS: f64 = 0.05;
/// Most samples that are low-passed; of a longer record it is blocks, evenly spread over it.
pub(super) const MOST_SAMPLES: usize = 1 << 20;
/// Number of such blocks.
pub(super) const BLOCKS: usize = 16;

/// The error of a record without samples.
pub(super) fn nothing() -> LogFault {
    LogFault::Estimate { path: String::new(), source: EstimateError::NoSignal }
}

/// Stretches of samples so far apart, s, with what the options say of their inputs.
pub(super) fn record<'a>(sample_time: f64, options: &'a LogOptions, stretches: Vec<Stretch<'a>>) -> TimeRecord<'a> {
    TimeRecord {
        sample_time,
        hold: options.reading.hold,
        actuators: &options.actuators,
        following: &options.following,
        stretches,
    }
}

/// The segments of a record as they are estimated from: in blocks where they are long together.
///
/// # Errors
/// As of [`stretches`].
pub(super) fn estimated<'a>(
    segments: &[&'a Log],
    coordinates: usize,
    options: &'a LogOptions,
) -> Result<TimeRecord<'a>, LogFault> {
    let all = stretches(segments, coordinates, &options.reading)?;
    let sample_time = segments.first().ok_or_else(nothing)?.sample_time;
    Ok(record(sample_time, options, at_most(all, MOST_SAMPLES, BLOCKS)))
}

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

/// One warning for every measured rate that is not that of the measured position.
pub(super) fn differing_rates(model: &dyn Model<f64>, gains: &[Option<f64>]) -> impl Iterator<Item = Warning> {
    let differs = |(c, gain): (usize, &Option<f64>)| {
        let gain = gain.filter(|gain| (gain - 1.0).abs() > RATE_DIFFERS)?;
        Some(Warning::RateDiffers { coordinate: model.coordinate(c).name.into(), gain })
    };
    gains.iter().enumerate().filter_map(differs)
}

/// Says that a stated period is not used, where nothing of a record is taken to repeat.
pub(super) fn period_not_used(segments: &[&Log], reading: &RecordSettings) -> Option<Warning> {
    reading.period.map(|period| Warning::PeriodNotUsed { period, stretches: segments.len() })
}
