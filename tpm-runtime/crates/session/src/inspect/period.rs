//! The part of a record that repeats, and what changes from period to period.

use crate::inspect::signal::Signal;
use crate::log_fault::LogFault;
use crate::periodic_log::repeating_part;
use crate::reading::RecordSettings;
use rayon::prelude::*;
use serde::Serialize;
use tpm_log::{Log, Periodic, Role};

/// Largest difference of two periods that are one, as a share: noise moves the period of a channel by itself.
const SAME: f64 = 0.01;
/// Share of noise in a channel's deviation up to which its period counts among others.
const CLEAR: f64 = 0.01;
/// Fewest periods from which drift is told from noise.
const DRIFT_PERIODS: usize = 6;
/// Least multiple of the mean square difference of neighbouring periods that the first and the last period differ by when a channel
/// drifts: noise makes both alike.
const DRIFTS: f64 = 4.0;
/// The same of the middle and the last period.
const MIDDLE: f64 = 2.0;
/// Largest mean square difference of neighbouring periods, as a share of the variance, of a channel that repeats.
const ALIKE: f64 = 0.02;
/// Least drift, as a share of the channel's deviation, that is reported.
const LEAST_DRIFT: f64 = 0.002;

/// The part of a record that repeats.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Repeats {
    /// Shortest period with which all these channels repeat, s.
    pub period: f64,
    /// Period in samples.
    pub samples_per_period: f64,
    /// Whole periods.
    pub periods: usize,
    /// First sample of the part that repeats, from 0, in its stretch of the record.
    pub from_sample: usize,
    /// Line of that sample.
    pub from_line: u64,
    /// Time of that sample, counted from the first one of the record, s.
    pub from: f64,
    /// Root mean square difference between the last two periods, as a share of the motion.
    pub mismatch: f64,
    /// The channels that repeat with this period.
    pub channels: Vec<String>,
    /// The stretch of the record in which they do, from 0.
    pub segment: usize,
}

/// What repeats in a record.
pub(super) struct Found {
    /// The part with the period of all channels that repeat.
    pub(super) repeats: Option<Repeats>,
    /// Period of every channel by itself, s.
    pub(super) periods: Vec<Option<f64>>,
    /// Drift of every channel, as a share of its deviation.
    pub(super) drifts: Vec<Option<f64>>,
}

/// Looks for what repeats in the longest stretch of a record. The first `coordinates` signals are those whose common period counts; without
/// any, it is that of all signals that repeat by themselves, those with little noise where there are such. `noise` is every signal's share
/// of noise.
///
/// # Errors
/// [`LogFault`] when a setting does not fit the record.
pub(super) fn find(
    signals: &[Signal<'_>],
    noise: &[f64],
    coordinates: usize,
    sample_time: f64,
    reading: &RecordSettings,
) -> Result<Found, LogFault> {
    let nothing = || Found { repeats: None, periods: vec![None; signals.len()], drifts: vec![None; signals.len()] };
    let longest = signals.iter().flat_map(|signal| &signal.parts).max_by_key(|part| part.values.len());
    let Some(segment) = longest.map(|part| part.segment) else { return Ok(nothing()) };
    let values = |signal: &Signal<'_>| -> Option<Vec<f64>> {
        let values = signal.part(segment)?.values;
        let moves = values.iter().any(|value| *value != values[0]);
        moves.then(|| values.to_vec())
    };
    let part = |channels: Vec<Vec<f64>>, count: usize| -> Result<Option<Periodic>, LogFault> {
        let log = Log::from_samples("", sample_time, channels)?;
        match repeating_part(&log, count, reading) {
            // A setting that does not fit is a fault; noise that hides the period is none.
            Err(error @ LogFault::BadRange { .. }) => Err(error),
            found => Ok(found.ok().flatten()),
        }
    };
    let alone = |signal: &Signal<'_>| values(signal).map_or(Ok(None), |values| part(vec![values], 1));
    let alone: Vec<Option<Periodic>> = signals.par_iter().map(alone).collect::<Result<_, _>>()?;
    // Identification takes the inputs of a model for what must have settled, too.
    let group: Vec<usize> = if coordinates > 0 {
        (0..signals.len()).filter(|&c| signals[c].role != Role::Rate).collect()
    } else {
        let repeat = |most: f64| (0..signals.len()).filter(|&c| alone[c].is_some() && noise[c] <= most).collect();
        let clear: Vec<usize> = repeat(CLEAR);
        if clear.is_empty() { repeat(f64::INFINITY) } else { clear }
    };
    let together: Vec<Vec<f64>> = group.iter().filter_map(|&c| values(&signals[c])).collect();
    let periods = alone.iter().map(|own| own.map(|own| own.samples_per_period * sample_time)).collect();
    let common = match group.as_slice() {
        [] => None,
        [one] => alone[*one],
        _ if together.len() == group.len() => part(together, if coordinates > 0 { coordinates } else { group.len() })?,
        _ => None,
    };
    let Some(common) = common else { return Ok(Found { periods, ..nothing() }) };
    let divides = |own: &Periodic| {
        let times = common.samples_per_period / own.samples_per_period;
        (times - times.round()).abs() < SAME * times && times > 0.5
    };
    let channels = signals.iter().zip(&alone).filter(|(_, own)| own.as_ref().is_some_and(divides));
    let whole = signals.iter().find_map(|signal| signal.part(segment));
    let repeats = Repeats {
        period: common.samples_per_period * sample_time,
        samples_per_period: common.samples_per_period,
        periods: common.periods,
        from_sample: common.steady_from,
        from_line: whole.and_then(|part| part.lines.get(common.steady_from)).copied().unwrap_or(0),
        from: whole.map_or(0.0, |part| part.start) + common.steady_from as f64 * sample_time,
        mismatch: common.mismatch,
        channels: channels.map(|(signal, _)| signal.name.into()).collect(),
        segment,
    };
    let drifts = signals.iter().map(|signal| drift(signal.part(segment)?.values, &common)).collect();
    Ok(Found { repeats: Some(repeats), periods, drifts })
}

/// How much a signal changes from the first period of the record to the last one beyond what neighbouring periods differ by, as a share of
/// its deviation.
///
/// Periods are counted back from the end of the part that repeats: a drift keeps the first ones out of that part. A transient at the
/// beginning is over in the middle of the record.
fn drift(signal: &[f64], periodic: &Periodic) -> Option<f64> {
    let length = periodic.samples_per_period;
    let samples = length as usize;
    let end = periodic.from as f64 + periodic.periods as f64 * length;
    let count = (end / length + 1e-9) as usize;
    if count < DRIFT_PERIODS {
        return None;
    }
    let period = |back: usize| -> Option<&[f64]> {
        let begin = (end - back as f64 * length).max(0.0).round() as usize;
        signal.get(begin..begin + samples)
    };
    let square = |a: usize, b: usize| -> Option<f64> {
        let pairs = period(a)?.iter().zip(period(b)?);
        Some(pairs.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / samples as f64)
    };
    let near: Vec<f64> = (2..=count).filter_map(|back| square(back, back - 1)).collect();
    let near = near.iter().sum::<f64>() / near.len().max(1) as f64;
    let (far, middle) = (square(count, 1)?, square(count.div_ceil(2), 1)?);
    let mean = signal.iter().sum::<f64>() / signal.len() as f64;
    let variance = signal.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / signal.len() as f64;
    let drift = ((far - near).max(0.0) / variance.max(f64::MIN_POSITIVE)).sqrt();
    let repeats = near <= ALIKE * variance;
    (repeats && far > DRIFTS * near && middle > MIDDLE * near && drift > LEAST_DRIFT).then_some(drift)
}
