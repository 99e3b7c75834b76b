//! A log that repeats, identified by its harmonics.

use crate::excerpt::{Excerpt, MOST_WHOLE_SAMPLES};
use crate::found::Found;
use crate::log_fault::LogFault;
use crate::log_report::{HoldResiduals, PeriodicReport, UntestedReport, Way};
use crate::options::LogOptions;
use crate::reading::RecordSettings;
use crate::refine::{Conditions, Start, refined};
use crate::summary;
use crate::warning::{Data, Warning};
use num_complex::Complex;
use std::f64::consts::PI;
use std::ops::Range;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Label, Model};
use tpm_estimate::{
    ASKED_ABOUT, Course, Differentiable, Estimate, EstimateError, MeasuredMotion, Settings, Untested,
    estimate_measured_motion,
};
use tpm_log::{Log, Periodic, PeriodicFault, differs, find_periodic};
use tpm_motion::{Spectra, correct_actuators};
use tpm_report::{Remedy, number};

/// A difference of successive periods above this share of the motion is flagged.
const UNSTEADY: f64 = 0.02;
/// A difference of successive periods of an input above this share of it, beyond noise, is a force that does not repeat.
const UNLIKE: f64 = 0.1;
/// Fewest periods of which the differences tell the noise of every harmonic: fewer must agree to be averaged.
const MANY: usize = 4;
/// A line belongs to the motion from which a simulation starts when its power is this many times that of its noise.
const CERTAIN: f64 = 9.0;
/// Largest steps from sample to sample by which the end of a single period may miss its beginning.
const CLOSED: f64 = 3.0;
/// Samples at the end of a long log in which it must repeat to be searched for its period, so that one of more than half as many samples
/// is stated by the user.
const LONGEST: usize = 1 << 20;
/// Share of a record that is noise of single samples above which nothing else is looked for in it.
const DROWNED: f64 = 0.5;

/// Identifies a model from the part of a log that repeats.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    log: &Log,
    (periodic, spectra): (&Periodic, &Spectra),
    options: &LogOptions,
) -> Result<Found, LogFault> {
    let settings = &options.estimation;
    let dims = model.dims();
    let run = |hold: Hold, settings: &Settings| -> Result<(MeasuredMotion, Estimate), EstimateError> {
        let record = MeasuredMotion::new(model, &options.constants, spectra, hold, settings)?;
        let mut records = [record];
        let estimate = estimate_measured_motion(&mut records, settings)?;
        let [record] = records;
        Ok((record, estimate))
    };
    let (record, estimate) =
        run(options.reading.hold, settings).map_err(|source| LogFault::Estimate { path: log.path.clone(), source })?;
    // The other hold is judged on the same harmonics, otherwise it could leave out what it does not explain.
    let same = Settings { harmonics: Some(record.harmonics()), ..settings.clone() };
    let other = run(options.reading.hold.other(), &same).ok().map(|(_, estimate)| estimate.residual);
    let hold_residuals = HoldResiduals::of(options.reading.hold, estimate.residual, other);
    let rates: Vec<usize> = (0..dims.coordinates).filter(|&c| log.rates.get(c).is_some_and(Option::is_some)).collect();
    let channels = log.channels.iter().chain(log.rates.iter().flatten());
    let span = simulated(log, periodic, &options.reading);
    let used: Vec<&[f64]> = channels.map(|c| &c[span.clone()]).collect();
    // The phase of the harmonics is that of the first sample that is simulated.
    let before = (periodic.from - span.start) as f64 / periodic.samples_per_period;
    let from_there = |lines: Vec<Complex<f64>>| -> Vec<Complex<f64>> {
        let turn = |(k, line): (usize, Complex<f64>)| line * Complex::from_polar(1.0, -2.0 * PI * k as f64 * before);
        lines.into_iter().enumerate().map(turn).collect()
    };
    let start = Start {
        estimate: &estimate,
        excerpt: Excerpt::of_periods(&used, rates, &Periodic { from: span.start, ..*periodic }),
        course: Course::Periodic {
            samples_per_period: periodic.samples_per_period,
            lines: (0..dims.coordinates).map(|c| from_there(motion(spectra, c, record.motion_harmonics()))).collect(),
            input_lines: (0..dims.inputs)
                .map(|i| from_there(motion(spectra, dims.coordinates + i, spectra.highest())))
                .collect(),
        },
        steps: (0..dims.coordinates).map(|c| spectra.step(c)).collect(),
        samples: log.len(),
        sample_time: log.sample_time,
    };
    let restate = |values, covariance| record.restated(&estimate, values, covariance, settings);
    let refined = refined(machine, start, Conditions::of_log(options), settings, &restate);
    let untested = record
        .untested(&estimate, settings)
        .map_err(|source| LogFault::Estimate { path: log.path.clone(), source })?
        .into_iter()
        .map(|own| untested_report(model, &refined.estimate, own))
        .collect();
    let report = PeriodicReport {
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
        untested,
    };
    let row_residuals = (0..dims.rows)
        .map(|r| {
            let (residual, force) = record.row_power(r, &refined.estimate.values);
            if force > 0.0 { residual / force } else { 0.0 }
        })
        .collect();
    let mut warnings = warnings(model, &record, &refined.estimate, &options.reading, (&report, log.len()));
    warnings.extend(refined.warnings);
    Ok(Found {
        estimate: refined.estimate,
        harmonics: record.harmonics(),
        way: Way::Harmonics(report),
        row_residuals,
        hold_residuals,
        refinement: refined.report,
        warnings,
        tells_hold: refined.tells_hold,
        delays: Vec::new(),
        calibration: Vec::new(),
        unseen_gain: None,
    })
}

/// The samples of a record that repeats which are simulated: all of a short one, unless the user said where it begins. A simulation has a state
/// at its beginning and need not wait until the motion has settled.
fn simulated(log: &Log, periodic: &Periodic, reading: &RecordSettings) -> Range<usize> {
    if reading.from_sample.is_none() && log.len() <= MOST_WHOLE_SAMPLES {
        return 0..log.len();
    }
    let whole = (periodic.samples_per_period * periodic.periods as f64).round() as usize;
    periodic.from..(periodic.from + whole).min(log.len())
}

/// An untested parameter by its name.
fn untested_report(model: &dyn Model<f64>, estimate: &Estimate, own: Untested) -> UntestedReport {
    let Label { name, unit } = model.parameter(own.parameter);
    UntestedReport {
        parameter: name.to_string(),
        unit: unit.map(ToString::to_string),
        row: model.row(own.row).name.to_string(),
        harmonic: own.harmonic,
        share: ASKED_ABOUT,
        change: own.change,
        deviations: own.change / estimate.std[own.parameter],
    }
}

/// Harmonics of a coordinate that stand out of the noise.
fn motion(spectra: &Spectra, coordinate: usize, harmonics: usize) -> Vec<Complex<f64>> {
    let floor = spectra.floor(coordinate).unwrap_or(0.0);
    let certain = |(k, line): (usize, &Complex<f64>)| {
        let noise = spectra.variance(coordinate, k).max(floor);
        if k == 0 || line.norm_sqr() > CERTAIN * noise { *line } else { Complex::new(0.0, 0.0) }
    };
    spectra.lines[coordinate].iter().take(harmonics + 1).enumerate().map(certain).collect()
}

/// The part of a log that repeats, and its spectra.
///
/// # Errors
/// [`LogFault`] when nothing repeats, or a setting does not fit the log.
pub(super) fn spectra(log: &Log, coordinates: usize, options: &LogOptions) -> Result<(Periodic, Spectra), LogFault> {
    spectra_of(periodic_part(log, coordinates, &options.reading)?, log, coordinates, options)
}

/// The part of a log that repeats, and its spectra; nothing where [`repeating_part`] finds none.
///
/// # Errors
/// [`LogFault`] when a setting does not fit the log, or noise drowns the motion.
pub(super) fn repeating(
    log: &Log,
    coordinates: usize,
    options: &LogOptions,
) -> Result<Option<(Periodic, Spectra)>, LogFault> {
    let periodic = repeating_part(log, coordinates, &options.reading)?;
    periodic.map(|periodic| spectra_of(periodic, log, coordinates, options)).transpose()
}

/// The part of a log that repeats; nothing where it is less than half of the log, a single period that does not close, or a few
/// periods that differ by more than noise.
///
/// # Errors
/// [`LogFault`] when a setting does not fit the log, or noise drowns the motion.
pub(super) fn repeating_part(
    log: &Log,
    coordinates: usize,
    options: &RecordSettings,
) -> Result<Option<Periodic>, LogFault> {
    if options.from_sample.is_none() && options.period.is_none() && log.len() > 2 * LONGEST {
        // Nothing repeats before the end of a log that does not repeat at its end.
        let tail: Vec<Vec<f64>> = log.channels.iter().map(|channel| channel[log.len() - LONGEST..].to_vec()).collect();
        let repeats = find_periodic(&tail, coordinates, None, None).is_ok_and(|found| 2 * found.steady_from <= LONGEST);
        if !repeats {
            return Ok(None);
        }
    }
    let periodic = match periodic_part(log, coordinates, options) {
        Ok(periodic) => periodic,
        // Motion that noise drowns shows in no other way either.
        Err(error) => {
            let drowned = |noise: Option<f64>| noise.is_some_and(|share| share > DROWNED);
            return match error {
                LogFault::NoPeriod { .. } => Ok(None),
                LogFault::NotPeriodic { mismatch, .. } if !drowned(mismatch.noise) => Ok(None),
                error => Err(error),
            };
        }
    };
    let rest = options.from_sample.is_none() && options.period.is_none() && 2 * periodic.steady_from > log.len();
    let few = options.period.is_none() && (2..MANY).contains(&periodic.periods);
    let alike = match periodic.periods {
        1 => closes(log, coordinates, &periodic),
        _ => !few || agree(log, coordinates, &periodic),
    };
    Ok(Some(periodic).filter(|_| !rest && alike))
}

/// Whether a part of a log repeats.
pub(super) fn repeats(log: &Log, coordinates: usize, options: &RecordSettings) -> bool {
    periodic_part(log, coordinates, options).is_ok()
}

/// Whether a single period ends where it began, as far as it goes from one sample to the next.
fn closes(log: &Log, coordinates: usize, periodic: &Periodic) -> bool {
    let last = periodic.from + (periodic.samples_per_period.round() as usize).saturating_sub(1);
    log.channels.iter().take(coordinates).all(|channel| {
        let own = &channel[periodic.from..=last.min(channel.len() - 1)];
        let largest = own.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        let gap = own.first().zip(own.last()).map_or(0.0, |(first, last)| (first - last).abs());
        gap <= CLOSED * largest
    })
}

/// Whether the last two periods agree but for noise: in the motion, and in the inputs, since a loop may hold a motion against a force
/// that does not repeat.
fn agree(log: &Log, coordinates: usize, periodic: &Periodic) -> bool {
    let end = periodic.from + (periodic.samples_per_period * periodic.periods as f64).round() as usize;
    log.channels.iter().enumerate().all(|(c, channel)| {
        let share = if c < coordinates { UNSTEADY } else { UNLIKE };
        !differs(&channel[..end.min(channel.len())], periodic.samples_per_period, share)
    })
}

fn spectra_of(
    periodic: Periodic,
    log: &Log,
    coordinates: usize,
    options: &LogOptions,
) -> Result<(Periodic, Spectra), LogFault> {
    let used: Vec<&[f64]> = log.channels.iter().map(|c| &c[periodic.from..]).collect();
    let mut spectra = Spectra::analyse(&used, log.sample_time, periodic.samples_per_period, periodic.periods)
        .map_err(|source| LogFault::Spectrum { path: log.path.clone(), source })?;
    correct_actuators(&mut spectra, coordinates, &options.actuators);
    Ok((periodic, spectra))
}

fn periodic_part(log: &Log, coordinates: usize, options: &RecordSettings) -> Result<Periodic, LogFault> {
    let range = |what: String, remedy: Remedy| LogFault::BadRange {
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
        PeriodicFault::None => LogFault::NoPeriod { path: log.path.clone(), from, to },
        PeriodicFault::Mismatch { mismatch, .. } if options.period.is_some() && mismatch.noise.is_none() => {
            let own = number(options.period.unwrap_or(0.0));
            let what = format!(
                "the motion does not repeat with a period of {own} s: the last two differ by {:.1} %; leave the period out, or state another",
                100.0 * mismatch.share
            );
            range(what, Remedy::Period)
        }
        PeriodicFault::Mismatch { period, mismatch } => {
            LogFault::NotPeriodic { path: log.path.clone(), from, to, period: period * log.sample_time, mismatch }
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
    options: &RecordSettings,
    (log, samples): (&PeriodicReport, usize),
) -> Vec<Warning> {
    let mut warnings = Vec::new();
    if log.periods == 1 {
        warnings.push(Warning::OnePeriod);
    }
    if log.mismatch > UNSTEADY {
        warnings.push(Warning::Unsteady { mismatch: log.mismatch });
    }
    if options.from_sample.is_none() && 2 * log.steady_from_sample > samples {
        warnings.push(Warning::MostlyLeftOut { left_out: log.steady_from_sample, samples });
    }
    if let Some((from, to)) = record.left_out() {
        warnings.push(Warning::HarmonicsLeftOut { from, to });
    }
    warnings.extend(summary::doubts(model, estimate, Data::Log));
    warnings
}
