//! From a log to its result, whichever way the log is used.

use crate::found::Found;
use crate::identification::{Identification, Source};
use crate::log_fault::LogFault;
use crate::log_report::{ActuatorReport, LogReport, Way};
use crate::options::LogOptions;
use crate::record::nothing;
use crate::refinement_report::NotRefined;
use crate::simulation::{Extent, simulate};
use crate::warning::{Exchange, Warning};
use crate::{lines_log, periodic_log, recorded_log, samples_log, summary};
use std::collections::BTreeMap;
use tpm_codegen::identified::Identified;
use tpm_controller::harmonics::Hold;
use tpm_controller::model::{Dims, Model};
use tpm_estimate::named::EstimateReport;
use tpm_estimate::{
    Arrangement, Differentiable, Domain, Estimate, EstimateError, LARGE_RESIDUAL, Outcome, OutputErrorFault, Refine,
    ResidualOf, TermKind, gain_of_the_only_input, is_static,
};
use tpm_log::{AsRecorded, ChannelReadings, Log, Periodic, ReadingReport};
use tpm_motion::{Dynamics, Spectra};
use tpm_numerics::{patience, tolerance};

/// Share of the record that must be unexplained for exchanged columns to be looked for.
const NOTICED: f64 = 0.1;
/// Columns are exchanged when the model then leaves less than this share of the residual.
const FAR_BETTER: f64 = 0.1;
/// What a regression alone must leave of what it leaves without an exchange, for the exchange to be tried in full.
const LIKELY_BETTER: f64 = 0.5;

/// Identifies the parameters in which a model is linear from one log.
///
/// # Errors
/// [`LogFault`].
pub fn identify_log(model: &dyn Model<f64>, log: &Log, options: &LogOptions) -> Result<Identification, LogFault> {
    identify_segments(model, None, &[log], options).map(Identification::judged)
}

/// Identifies the parameters in which a model is linear from the segments of one record, of which there is one at least; refined by
/// simulating the model where the derivatives of its rows are known. Several segments are used in the time domain, all of them.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify_segments(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
) -> Result<Identification, LogFault> {
    let mut result = identify_from(model, machine, segments, options)?;
    if let Some(warning) = exchanged(model, segments, options, &result) {
        // Whatever else was noticed follows from the exchange.
        result.warnings.insert(0, warning);
    } else if let Some(warning) = astray(model, machine, segments, options, &result) {
        result.warnings.push(warning);
    }
    Ok(result)
}

/// Says that one sample ahead the last reading says more than the model. A result that comes from a simulation has followed the record
/// already, and one that is no result has its reason.
fn astray(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
    result: &Identification,
) -> Option<Warning> {
    let refinement = result.log.as_ref().and_then(|log| log.refinement.as_ref());
    let simulated = refinement.is_some_and(|report| report.used);
    let judged = !result.is_explained() || result.warnings.iter().any(Warning::is_distrust);
    if simulated
        || judged
        || patience::is_over()
        || is_static(model)
        || model.dims().coordinates > lines_log::MOST_SIMULATED
    {
        return None;
    }
    let known = Identified::from(result);
    let known = known.settled().ok()?;
    let parameters: Option<Vec<f64>> =
        (0..model.dims().parameters).map(|j| known.value(model.parameter(j).name)).collect();
    let options = with_found_delays(model, options, result);
    simulate(machine, segments, &options, &parameters?, &known.open, Extent::Evidence).ok()?.ok()?.astray()
}

/// Options in which delays that were found are known.
fn with_found_delays(model: &dyn Model<f64>, options: &LogOptions, result: &Identification) -> LogOptions {
    let mut known = options.clone();
    known.actuators.resize(model.dims().inputs, Dynamics::default());
    for input in std::mem::take(&mut known.estimation.fitted_delays) {
        let found = result.log.as_ref().and_then(|log| log.actuators.get(model.input(input).name));
        known.actuators[input].delay = found.map_or(0.0, |own| own.delay.max(0.0));
    }
    known
}

/// Says that the model explains a record far better when columns are exchanged, or with another sign, given the result without.
fn exchanged(
    model: &dyn Model<f64>,
    segments: &[&Log],
    options: &LogOptions,
    result: &Identification,
) -> Option<Warning> {
    if result.residual < NOTICED || patience::is_over() {
        return None;
    }
    // A refined residual is a share of the motion, which the exchanged record, that is not refined, cannot be compared with.
    let left = result.log.as_ref()?.hold_residuals.with(options.reading.hold)?;
    let found = lines_log::arrangement(model, segments, options)?;
    if found.left > LIKELY_BETTER * found.as_recorded {
        return None;
    }
    let logs: Vec<Log> =
        segments.iter().map(|log| rearranged(log, model.dims().coordinates, found.arrangement)).collect();
    let logs: Vec<&Log> = logs.iter().collect();
    let left_by_exchange = identify_from(model, None, &logs, options).ok()?.residual;
    let exchange = exchange(model, found.arrangement);
    (left_by_exchange < FAR_BETTER * left).then_some(Warning::Exchanged { exchange, left, left_by_exchange })
}

/// A log whose columns are arranged in another way; measured rates go with their coordinates.
fn rearranged(log: &Log, coordinates: usize, arrangement: Arrangement) -> Log {
    let mut log = log.clone();
    let rates = std::mem::take(&mut log.rates).into_iter().chain(std::iter::repeat(None));
    let mut own: Vec<(Vec<f64>, Option<Vec<f64>>)> = log.channels.drain(..coordinates).zip(rates).collect();
    let mut inputs: Vec<(Vec<f64>, Option<Vec<f64>>)> = log.channels.drain(..).map(|channel| (channel, None)).collect();
    arrangement.arrange(&mut own, &mut inputs, |(channel, rate)| {
        channel.iter_mut().chain(rate.iter_mut().flatten()).for_each(|x| *x = -*x);
    });
    (log.channels, log.rates) = own.into_iter().unzip();
    if log.rates.iter().all(Option::is_none) {
        log.rates.clear();
    }
    log.channels.extend(inputs.into_iter().map(|(channel, _)| channel));
    log
}

/// An arrangement by the names of the model.
fn exchange(model: &dyn Model<f64>, arrangement: Arrangement) -> Exchange {
    let coordinate = |c: usize| -> String { model.coordinate(c).name.into() };
    let input = |i: usize| -> String { model.input(i).name.into() };
    match arrangement {
        Arrangement::CoordinateAndInput(c, i) => Exchange::Columns { signals: vec![coordinate(c), input(i)] },
        Arrangement::Coordinates(a, b) => Exchange::Columns { signals: vec![coordinate(a), coordinate(b)] },
        Arrangement::Inputs(a, b) => Exchange::Columns { signals: vec![input(a), input(b)] },
        Arrangement::Both(a, b) => {
            Exchange::Joints { coordinates: [coordinate(a), coordinate(b)], inputs: [input(a), input(b)] }
        }
        Arrangement::CoordinateSign(c) => Exchange::Sign { signal: coordinate(c) },
        Arrangement::InputSign(i) => Exchange::Sign { signal: input(i) },
    }
}

/// [`identify_segments`] without a look for exchanged columns.
pub(super) fn identify_from(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
) -> Result<Identification, LogFault> {
    let dims = model.dims();
    check_constants(model, options)?;
    let whole = match segments {
        [log] => Some(*log),
        _ => None,
    };
    let not_told = |signal: String| LogFault::Calibration {
        path: segments.first().map(|log| log.path.clone()).unwrap_or_default(),
        signal,
    };
    if is_static(model)
        && let Some(mut found) = samples_log::identify(model, machine, segments, options)?
    {
        calibrated(model, &mut found, options).map_err(not_told)?;
        return result(model, segments, options, found).ok_or_else(nothing);
    }
    let periodic = match (options.domain, whole) {
        (Some(Domain::Time), _) | (None, None) => None,
        (Some(Domain::Harmonics), _) => {
            // Whoever wants harmonics of a record with gaps gives the segment that repeats.
            let log = segments.first().copied().ok_or_else(nothing)?;
            Some((log, periodic_log::spectra(log, dims.coordinates, options)?))
        }
        (None, Some(log)) => periodic_log::repeating(log, dims.coordinates, options)?.map(|found| (log, found)),
    };
    let mut found = found(model, machine, segments, options, periodic.as_ref())?;
    // What was tried in time stays in the report; that more was to be tried is said.
    let used = found.refinement.as_ref().is_some_and(|report| report.used);
    let said = found.warnings.iter().any(|own| matches!(own, Warning::NotRefined { .. }));
    if patience::is_over() && options.refine != Refine::None && !used && !said {
        found.warnings.push(Warning::NotRefined { reason: NotRefined::Fault(OutputErrorFault::Ended) });
    }
    // Harmonics and a simulation say nothing of sensors whose calibration is off.
    if matches!(found.way, Way::Harmonics(_)) && dims.coordinates > 1 {
        let repeating = periodic.as_ref().map(|(_, (periodic, _))| periodic);
        found.calibration = lines_log::calibration(model, segments, repeating, options);
    }
    calibrated(model, &mut found, options).map_err(not_told)?;
    result(model, segments, options, found).ok_or_else(nothing)
}

/// What is stated of the calibration of sensors enters the deviations; of the others it is said which faults the log would not show.
/// The name of a signal with a stated calibration is the error where nothing tells what that does to the parameters.
fn calibrated(model: &dyn Model<f64>, found: &mut Found, options: &LogOptions) -> Result<(), String> {
    let stated = |list: &[Option<f64>], of: usize| list.get(of).copied().flatten();
    let mut told = std::mem::take(&mut found.calibration);
    told.extend(gain_of_the_only_input(model, &options.constants, &found.estimate, &options.estimation));
    let is_told = |kind: TermKind, of: usize| told.iter().any(|own| own.term.of == of && own.term.kind == kind);
    let dims = model.dims();
    let zeros = (0..dims.coordinates)
        .filter(|&c| stated(&options.zero_deviations, c).is_some() && !is_told(TermKind::PositionOffset, c))
        .map(|c| model.coordinate(c).name.to_string());
    let gains = (0..dims.inputs)
        .filter(|&i| stated(&options.gain_deviations, i).is_some() && !is_told(TermKind::InputGain, i))
        .map(|i| model.input(i).name.to_string());
    if let Some(signal) = zeros.chain(gains).next() {
        return Err(signal);
    }
    let mut faults = Vec::new();
    for own in told {
        let known = match own.term.kind {
            TermKind::InputGain => stated(&options.gain_deviations, own.term.of),
            TermKind::PositionOffset => stated(&options.zero_deviations, own.term.of),
            _ => None,
        };
        match known {
            Some(deviation) => {
                let moved: Vec<f64> = own.change.iter().map(|change| deviation * change).collect();
                found.estimate = found.estimate.moving(&moved, &options.estimation);
            }
            None if own.std.is_none() => found.unseen_gain = lines_log::unseen(model, &own),
            None => faults.extend(lines_log::unseen(model, &own)),
        }
    }
    if !faults.is_empty() {
        found.warnings.push(Warning::UnseenFaults { faults });
    }
    Ok(())
}

/// Identifies a model from a log by simulating it between the stamps.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify_recorded(
    model: &dyn Model<f64>,
    recorded: &AsRecorded,
    unshown: Option<usize>,
    options: &LogOptions,
) -> Result<Identification, LogFault> {
    check_constants(model, options)?;
    let mut found = recorded_log::identify(model, recorded, unshown, options)?;
    calibrated(model, &mut found, options)
        .map_err(|signal| LogFault::Calibration { path: recorded.path.clone(), signal })?;
    let mean = |own: &Option<ChannelReadings>| {
        own.as_ref().map_or(0.0, |own| own.value.iter().sum::<f64>() / own.value.len().max(1) as f64)
    };
    let used = Used {
        path: &recorded.path,
        samples: recorded.report.rows,
        sample_time: recorded.usual_step,
        position: recorded.coordinates.iter().map(mean).collect(),
        speed: (recorded.coordinates.iter())
            .map(|own| own.as_ref().map_or(0.0, |own| fastest(&own.value, |k| own.time[k])))
            .collect(),
    };
    Ok(result_of(model, used, options, found))
}

/// Refuses options that give other constants than the model has.
fn check_constants(model: &dyn Model<f64>, options: &LogOptions) -> Result<(), LogFault> {
    let dims = model.dims();
    if options.constants.len() == dims.constants {
        return Ok(());
    }
    Err(LogFault::Constants {
        needed: dims.constants,
        given: options.constants.len(),
        names: (0..dims.constants).map(|i| model.constant(i).name.into()).collect(),
    })
}

/// What is found in a record, by the way that tells it best; `periodic` is the part that repeats.
fn found(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
    periodic: Option<&(&Log, (Periodic, Spectra))>,
) -> Result<Found, LogFault> {
    let dims = model.dims();
    let repeating = periodic.map(|(_, (periodic, _))| periodic);
    let by_lines = || lines_log::identify(model, machine, segments, repeating, options);
    let by_harmonics = || {
        let identify = |(log, (periodic, spectra)): &(&Log, (Periodic, Spectra))| {
            periodic_log::identify(model, machine, log, (periodic, spectra), options)
        };
        periodic.map(identify).transpose()
    };
    if !options.estimation.fitted_delays.is_empty() {
        // A delay is a parameter of the lines.
        return by_lines();
    }
    // Harmonics of a motion without noise are exact, and so many coordinates are simulated from them.
    let exact = periodic.is_some_and(|(log, _)| lines_log::has_exact_harmonics(log));
    let asked = options.domain == Some(Domain::Harmonics);
    if (asked || exact || dims.coordinates <= lines_log::MOST_SIMULATED)
        && let Some(found) = by_harmonics()?
    {
        let better = |other: &Found| {
            other.estimate.residual <= LARGE_RESIDUAL
                && !other.warnings.iter().any(|warning| matches!(warning, Warning::Unexplained { .. }))
                && (dims.coordinates > 1 || other.estimate.rank >= found.estimate.rank)
        };
        // Where neither explains the record, a simulation is far from it, and what it names is what would bring it nearer. The rows stay on
        // the measured motion.
        let says_more = |other: &Found| found.estimate.residual > LARGE_RESIDUAL && names_what_it_lacks(other);
        let enough = asked || exact || harmonics_tell(&found, dims, options.reading.hold);
        let other = if enough { None } else { by_lines().ok().filter(|other| better(other) || says_more(other)) };
        return Ok(other.unwrap_or(found));
    }
    match by_lines() {
        // A record that is too short for lines may still have harmonics, and may be simulated.
        Err(LogFault::Estimate { source: EstimateError::NoSignal, path }) => {
            if let Some(found) = by_harmonics()? {
                return Ok(found);
            }
            if let Some(found) = samples_log::identify(model, machine, segments, options)? {
                return Ok(found);
            }
            // What shows nothing either way is refused by what keeps it from repeating, which says more.
            if let (None, [log]) = (options.domain, segments) {
                periodic_log::spectra(log, dims.coordinates, options)?;
            }
            Err(LogFault::Estimate { source: EstimateError::NoSignal, path })
        }
        // Lines that explain nothing begin a simulation far from the truth, where regressions along polynomials may begin it near.
        Ok(found)
            if (found.estimate.residual > LARGE_RESIDUAL || (lacks(&found) && !names_what_it_lacks(&found)))
                && dims.coordinates <= lines_log::MOST_SIMULATED =>
        {
            let other = samples_log::identify(model, machine, segments, options)?;
            let follows = |other: &Found| other.refinement.as_ref().is_some_and(lines_log::follows);
            Ok(other.filter(follows).unwrap_or(found))
        }
        found => found,
    }
}

/// Whether a model is told by the terms that it lacks: its values are right beside these, and no other way knows them better.
fn names_what_it_lacks(found: &Found) -> bool {
    found.warnings.iter().any(|warning| matches!(warning, Warning::MissingTerm { .. }))
}

/// Whether one likelihood came to nothing but forces that the model lacks, or to much of the motion that nothing explains.
fn lacks(found: &Found) -> bool {
    found.refinement.as_ref().is_some_and(|report| report.outcome == Some(Outcome::Lacks))
}

/// Whether the harmonics of a motion, and its simulation, tell a record. What a simulation does not follow to the noise of the sensors is
/// told by the lines of the rows, which know what the model may lack, and which scales no row shows; but a simulation that settles finds the
/// ratios of a row without an input better. A single coordinate is told by the lines where nothing else explains it.
fn harmonics_tell(found: &Found, dims: Dims, hold: Hold) -> bool {
    match &found.refinement {
        _ if dims.coordinates == 1 => {
            found.estimate.residual <= LARGE_RESIDUAL
                || Warning::other_hold(hold, found.hold_residuals, ResidualOf::Force).is_some()
        }
        Some(report) if dims.inputs < dims.rows => report.used,
        Some(report) => lines_log::follows(report),
        None => false,
    }
}

/// The result of what was found in the segments of a record; nothing without a segment.
fn result(model: &dyn Model<f64>, segments: &[&Log], options: &LogOptions, found: Found) -> Option<Identification> {
    let log = segments.first()?;
    let mean = |channel: &Vec<f64>| channel.iter().sum::<f64>() / channel.len().max(1) as f64;
    let used = Used {
        path: &log.path,
        samples: segments.iter().map(|log| log.len()).sum(),
        sample_time: log.sample_time,
        position: log.channels[..model.dims().coordinates].iter().map(mean).collect(),
        speed: (log.channels[..model.dims().coordinates].iter())
            .map(|own| fastest(own, |k| k as f64 * log.sample_time))
            .collect(),
    };
    Some(result_of(model, used, options, found))
}

/// Says that a refinement was asked for and not made, which needs none where the model explains a log but for rounding.
fn in_vain(log: &LogReport, estimate: &Estimate, options: &LogOptions) -> Option<Warning> {
    let simulated = matches!(log.way, Way::Recorded(_)) || log.refinement.as_ref().is_some_and(|report| report.used);
    let exact = estimate.residual <= tolerance::EXPLAINED_FORCE;
    if options.refine != Refine::OutputError || simulated || exact {
        return None;
    }
    let note = log.refinement.as_ref().and_then(|report| report.note.clone());
    let reason = note.unwrap_or(NotRefined::Fault(OutputErrorFault::NotSimulable));
    Some(Warning::AskedInVain { reason })
}

/// Steps of a signal of which its speed is taken.
const STEPS: usize = 400;

/// The log that a result is about.
struct Used<'a> {
    path: &'a str,
    samples: usize,
    sample_time: f64,
    /// Mean of every coordinate.
    position: Vec<f64>,
    /// Largest speed of every coordinate, about.
    speed: Vec<f64>,
}

/// The speed that a signal exceeds in one of fifty of its steps, which are long enough for noise to make little of them.
fn fastest(values: &[f64], time: impl Fn(usize) -> f64) -> f64 {
    let step = (values.len() / STEPS).max(1);
    let last = values.len().saturating_sub(step);
    let speeds = (0..last).step_by(step).map(|k| ((values[k + step] - values[k]) / (time(k + step) - time(k))).abs());
    let mut speeds: Vec<f64> = speeds.filter(|speed| speed.is_finite()).collect();
    speeds.sort_by(f64::total_cmp);
    speeds.get(speeds.len() - speeds.len() / 50 - usize::from(!speeds.is_empty())).copied().unwrap_or(0.0)
}

/// The result of what was found in a log.
fn result_of(model: &dyn Model<f64>, used: Used<'_>, options: &LogOptions, found: Found) -> Identification {
    let dims = model.dims();
    let Found {
        estimate,
        harmonics,
        way,
        row_residuals,
        hold_residuals,
        refinement,
        warnings,
        tells_hold,
        delays,
        calibration: _,
        unseen_gain,
    } = found;
    let actuator = |(i, dynamics): (usize, &Dynamics)| {
        let low_pass = dynamics.filter.map(|filter| (filter.natural_frequency, filter.quality));
        let bandwidth = dynamics.bandwidth;
        let report = ActuatorReport { delay: dynamics.delay, low_pass, bandwidth, ..ActuatorReport::default() };
        (model.input(i).name.to_string(), report)
    };
    let known = (0..dims.inputs).map(|i| options.actuators.get(i).copied().unwrap_or_default()).collect::<Vec<_>>();
    let mut actuators: BTreeMap<String, ActuatorReport> =
        known.iter().enumerate().filter(|(_, dynamics)| !dynamics.is_ideal()).map(actuator).collect();
    for &input in &options.estimation.fitted_delays {
        let own = actuators.entry(model.input(input).name.to_string()).or_default();
        own.fitted = true;
        if let Some(found) = delays.iter().find(|found| found.input == input) {
            own.delay += found.value;
            own.delay_std = Some(found.std);
        }
    }
    let log_report = LogReport {
        path: used.path.to_owned(),
        reading: ReadingReport::default(),
        samples: used.samples,
        sample_time: used.sample_time,
        way,
        row_residuals,
        actuators,
        hold_residuals,
        refinement,
        unseen_gain,
    };
    let mut all = warnings;
    all.extend(in_vain(&log_report, &estimate, options));
    // A simulation that tells the holds apart has said so.
    if !tells_hold {
        all.splice(0..0, Warning::other_hold(options.reading.hold, hold_residuals, ResidualOf::Force));
    }
    let estimate = estimate.in_own_scales();
    let EstimateReport { parameters, unobservable, combinations, covariance, combination_covariance } =
        EstimateReport::new(model, &options.stated_prior(), Some(&estimate));
    let mut result = Identification {
        source: Source::Log,
        model: model.name().into(),
        estimator: Default::default(),
        frequency_name: Default::default(),
        outcome: None,
        stop: None,
        advice: None,
        seed: None,
        hold: options.reading.hold,
        harmonics,
        parameters,
        physical: Vec::new(),
        unobservable,
        combinations,
        covariance,
        combination_covariance,
        physical_covariance: Vec::new(),
        rank: estimate.rank,
        invisible: options.estimation.hidden.len(),
        condition: Some(estimate.condition).filter(|condition| condition.is_finite()),
        residual: estimate.residual,
        residual_of: estimate.residual_of,
        runs: Vec::new(),
        stability: None,
        refinement: None,
        method: None,
        log: Some(log_report),
        pool: None,
        warnings: all,
        provenance: summary::provenance(),
        current: estimate.values.clone(),
        estimate: Some(estimate),
        completed_model: None,
        shortfall: None,
    };
    summary::warn_of_impossible_values(&mut result, model, &options.constants, (&used.position, &used.speed));
    result
}
