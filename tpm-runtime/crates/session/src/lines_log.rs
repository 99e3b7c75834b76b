//! A log of any motion, identified by the lines of its rows.

use crate::excerpt::{Excerpt, at_most};
use crate::found::Found;
use crate::log_fault::LogFault;
use crate::log_report::{Calibration, HoldResiduals, SpectralReport, UnseenFaultReport, Way};
use crate::options::LogOptions;
use crate::prediction::Prediction;
use crate::reading::RecordSettings;
use crate::record::{BLOCKS, MOST_SAMPLES, differing_rates, estimated, nothing, period_not_used, record, stretches};
use crate::refine::{By, Conditions, HALF_A_SAMPLE, Refined, Start, refined};
use crate::refinement_report::{MissingTerm, NotRefined, RefinementReport};
use crate::summary;
use crate::term_words::lacking;
use crate::warning::{Data, Warning};
use tpm_controller::model::{Dims, Model};
use tpm_estimate::{
    Arranged, CalibrationFault, Course, Differentiable, Lacking, OfAnyMotion, Outcome, Refine, ResidualOf, Sensor,
    Stretch, Term, TermKind, TimeRecord, Weights, best_arrangement, estimate_any_motion,
};
use tpm_log::{Log, Periodic};
use tpm_motion::Dynamics;

/// Most coordinates of a machine that is simulated without being asked for: a simulation of more takes minutes.
pub(super) const MOST_SIMULATED: usize = 2;
/// Most samples that are simulated without being asked for where the lines name forces that the model lacks.
const MOST_BESIDE_TERMS: usize = 20_000;
/// Most coordinates of one that is simulated because inputs do not act on all of them.
const MOST_IN_A_CHAIN: usize = 4;
/// A simulation follows a record when it leaves no more than this many deviations of the sensors' noise.
const NOISE_FOLLOWED: f64 = 3.0;
/// Largest distance of a stated period from a whole number of samples, as a share of it.
const WHOLE: f64 = 1e-9;
/// Samples to either side of the period that was found among which the best one is looked for.
const NEAR_PERIODS: usize = 3;
/// Share of a period, one over this, that must be recorded again for its length to be told.
const LEAST_COMPARED: usize = 8;
/// Largest distance of the period from a whole number of samples: so many deviations, or so many samples.
const VERTEX_DEVIATIONS: f64 = 4.0;
const LEAST_VERTEX: f64 = 1e-3;

/// The arrangement of the columns of a record by which a model explains it best; nothing where none can be evaluated.
pub(super) fn arrangement(model: &dyn Model<f64>, segments: &[&Log], options: &LogOptions) -> Option<Arranged> {
    let record = estimated(segments, model.dims().coordinates, options).ok()?;
    best_arrangement(model, &options.constants, &record, &options.estimation).ok().flatten()
}

/// Identifies a model from all samples of the segments of a record, whatever the motion is; from whole periods where it repeats.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    periodic: Option<&Periodic>,
    options: &LogOptions,
) -> Result<Found, LogFault> {
    let dims = model.dims();
    let settings = &options.estimation;
    let first = segments.first().ok_or_else(nothing)?;
    let all = stretches(segments, dims.coordinates, &options.reading)?;
    let (used, whole) = used(first, &all, periodic, (dims.coordinates, &options.reading));
    let samples = used.iter().map(Stretch::samples).sum();
    let record = record(first.sample_time, options, used);
    let found = estimate_any_motion(model, &options.constants, &record, whole.is_some(), settings)
        .map_err(|source| LogFault::Estimate { path: first.path.clone(), source })?;
    let report = &found.report;
    let asked = options.refine == Refine::OutputError;
    // A simulation estimates the motion along with the parameters, and knows limits of the inputs.
    let simulated = || {
        let start = Start {
            estimate: &found.estimate,
            excerpt: Excerpt::of_stretches(&all),
            course: Course::Any {
                typical_period: found.typical_period,
                reach: found.reach,
                highest: report.followed.clone(),
                copies: 1.0,
            },
            steps: found.steps.clone(),
            samples,
            sample_time: first.sample_time,
        };
        let restate = |values, covariance| found.restated(values, covariance, settings);
        let by = By::Likelihood {
            // What the lines name is not asked again.
            forces: !found.lacking.iter().any(|own| own.term.kind.is_force()),
        };
        let conditions = Conditions { by, ..Conditions::of_log(options) };
        refined(machine, start, conditions, settings, &restate)
    };
    let errs = found.lacking.iter().any(|own| own.term.kind.is_of_reading());
    // Where every row has an input, the lines tell the parameters beside the forces that they name. A simulation of the model does not have these
    // forces. Nor does it give the values nearest to the forces, where these are asked for. A single coordinate is simulated all the same,
    // since a delay or a limit of its input may explain what looks like a force, but for a long record, which the lines tell well.
    let lacks = found.lacking.iter().any(|own| own.term.kind.is_force()) || settings.weights == Weights::Equal;
    let is_long = dims.inputs >= dims.rows && samples > MOST_BESIDE_TERMS;
    let lacks = lacks && (is_told_by_lines(dims) || is_long);
    let own = if !settings.fitted_delays.is_empty() || (errs && !asked) {
        // A delay or an error of a reading that is found is a parameter of the lines, which the simulation does not have.
        let why = || RefinementReport::left_out(&found.estimate.values, NotRefined::OfChannel);
        Refined { report: (options.refine != Refine::None).then(why), ..unrefined(&found) }
    } else if asked || (is_simulated(dims) && !lacks) {
        simulated()
    } else if is_simulated(dims) {
        unrefined(&found)
    } else {
        not_simulated(&found, options.refine)
    };
    // With the other hold than the one that is stated a record is another one.
    let explained = !own.tells_hold && own.report.as_ref().is_some_and(|report| explains(report, &found));
    let used = own.report.as_ref().is_some_and(|report| report.used);
    // What the lines say of predictions is said of their own values.
    let replaced = explained || (asked && used);
    let refined = if replaced {
        own
    } else {
        // Why a simulation is not used stays in the report, but where one that nobody asked for could not be made.
        let left_out = asked || errs || !is_simulated(dims) || !settings.fitted_delays.is_empty();
        let why = |report: RefinementReport| match report.used {
            true => Some(RefinementReport { used: false, note: Some(NotRefined::Lacks), ..report }),
            false => Some(report).filter(|report| left_out || report.was_ended()),
        };
        let of_hold = |warning: &Warning| matches!(warning, Warning::OtherHold { .. } | Warning::LateByHold { .. });
        let warnings = own.warnings.into_iter().filter(of_hold).collect();
        let report = own.report.and_then(why);
        Refined { report, warnings, tells_hold: own.tells_hold, ..unrefined(&found) }
    };
    let mut warnings = summary::doubts(model, &refined.estimate, Data::Log);
    warnings.extend(differing_rates(model, &report.rate_gains));
    if periodic.is_none() {
        warnings.extend(period_not_used(segments, &options.reading));
    }
    let missing: Vec<MissingTerm> = found.lacking.iter().map(|own| lacking(model, own)).collect();
    if !refined.tells_hold {
        warnings.extend(late_by_hold(model, &record, &found, whole.is_some(), options));
    }
    // What the lines name stays, but where the simulation explains the record.
    if !explained {
        warnings.extend(unexplained(model, &found, &missing));
    }
    warnings.extend(refined.warnings);
    warnings.extend(found.delays.iter().filter(|delay| !delay.settled).map(|delay| {
        let parameter = format!("the delay of {}", model.input(delay.input).name);
        Warning::Unsettled { reason: NotRefined::Moving { parameter } }
    }));
    Ok(Found {
        harmonics: 0,
        row_residuals: report.row_residuals.clone(),
        hold_residuals: HoldResiduals::of(options.reading.hold, found.estimate.residual, found.other_hold),
        way: Way::Spectral(SpectralReport {
            lines: report.clone(),
            period: whole.map(|period| period as f64 * first.sample_time),
            prediction: Prediction::of(model, &found).filter(|_| !replaced).map(Box::new),
            missing: if explained { Vec::new() } else { missing },
        }),
        estimate: refined.estimate,
        refinement: refined.report,
        warnings,
        tells_hold: refined.tells_hold,
        delays: found.delays,
        calibration: found.calibration,
        unseen_gain: None,
    })
}

/// What the lines say that the model leaves unexplained; `missing` are the terms that they name.
pub(super) fn unexplained<'a>(
    model: &'a dyn Model<f64>,
    found: &'a OfAnyMotion,
    missing: &'a [MissingTerm],
) -> impl Iterator<Item = Warning> + 'a {
    let of_row = found.report.free_row_left.map(|residual| Warning::Unexplained { residual, of: ResidualOf::Force });
    let terms = missing.iter().cloned().map(|term| Warning::MissingTerm { term });
    let inputs = || (0..model.dims().inputs).map(|i| model.input(i).name.to_string()).collect();
    let scale = found.scale_unknown.then(|| Warning::ScaleUnknown { inputs: inputs() });
    of_row.into_iter().chain(terms).chain(scale)
}

/// Whether every row of several has an input, so that the lines of the rows tell all parameters.
pub(super) const fn is_told_by_lines(dims: Dims) -> bool {
    dims.coordinates > 1 && dims.inputs >= dims.rows
}

/// Whether a machine is simulated without being asked for: one of few coordinates, or of a few more where some row has no input, of which the
/// lines tell ratios alone.
pub(super) const fn is_simulated(dims: Dims) -> bool {
    dims.coordinates <= MOST_SIMULATED || (!is_told_by_lines(dims) && dims.coordinates <= MOST_IN_A_CHAIN)
}

/// Whether a simulation explains a record, so that it replaces the lines from which it began. Where the model lacks forces the lines are as
/// near, and what they name of them stays; the simulation sees such forces where the lines see none.
fn explains(report: &RefinementReport, lines: &OfAnyMotion) -> bool {
    match report.outcome {
        Some(Outcome::Explained) => true,
        Some(Outcome::Forces) => lines.lacking.is_empty(),
        Some(_) | None => false,
    }
}

/// What is said of an input that seems late by about half a sample, where it is not with the other hold.
pub(super) fn late_by_hold(
    model: &dyn Model<f64>,
    record: &TimeRecord<'_>,
    found: &OfAnyMotion,
    whole: bool,
    options: &LogOptions,
) -> Option<Warning> {
    let is_late = |own: &&Lacking| {
        own.term.kind == TermKind::Delay && HALF_A_SAMPLE.contains(&(own.value.abs() / record.sample_time))
    };
    let late = found.lacking.iter().find(is_late).filter(|_| options.actuators.iter().all(Dynamics::is_ideal))?;
    let better = record.hold.other();
    let other = TimeRecord { hold: better, ..record.clone() };
    let other = estimate_any_motion(model, &options.constants, &other, whole, &options.estimation).ok()?;
    let still = other.lacking.iter().any(|own| own.term.kind == TermKind::Delay && own.term.of == late.term.of);
    let input = || model.input(late.term.of).name.to_string();
    (!still).then(|| Warning::LateByHold { input: input(), late: late.value, better })
}

/// The stretches of a record that are used: whole periods where it repeats, with their length in samples.
fn used<'a>(
    first: &'a Log,
    all: &[Stretch<'a>],
    periodic: Option<&Periodic>,
    (coordinates, reading): (usize, &RecordSettings),
) -> (Vec<Stretch<'a>>, Option<usize>) {
    let stated = reading.period.map(|period| period / first.sample_time);
    let whole = periodic.and_then(|periodic| whole_period(&first.channels[..coordinates], periodic, stated));
    match (whole, periodic) {
        (Some(period), Some(periodic)) => {
            (vec![whole_periods(first, coordinates, (periodic.from, period))], Some(period))
        }
        _ => (at_most(all.to_vec(), MOST_SAMPLES, BLOCKS), None),
    }
}

/// What faults of the sensors' calibration would do, asked of the lines of the rows, where another way tells the parameters; nothing where
/// there are no lines.
pub(super) fn calibration(
    model: &dyn Model<f64>,
    segments: &[&Log],
    periodic: Option<&Periodic>,
    options: &LogOptions,
) -> Vec<CalibrationFault> {
    let found = || -> Result<Vec<CalibrationFault>, LogFault> {
        let coordinates = model.dims().coordinates;
        let first = segments.first().ok_or_else(nothing)?;
        let all = stretches(segments, coordinates, &options.reading)?;
        let (used, whole) = used(first, &all, periodic, (coordinates, &options.reading));
        let record = record(first.sample_time, options, used);
        estimate_any_motion(model, &options.constants, &record, whole.is_some(), &options.estimation)
            .map(|found| found.calibration)
            .map_err(|source| LogFault::Estimate { path: first.path.clone(), source })
    };
    found().unwrap_or_default()
}

/// Whether a simulation of several coordinates follows a record to the noise of its sensors with a model that lacks nothing, but for a limit
/// of an input.
pub(super) fn follows(report: &RefinementReport) -> bool {
    let within = |(left, noise): (&f64, &f64)| *left <= NOISE_FOLLOWED * noise;
    report.used
        && report.missing.len() <= usize::from(report.is_limited())
        && report.residual.iter().zip(&report.sensor_noise).all(within)
}

/// Whether a record of a motion that repeats has no noise: then its harmonics are exact, while the smoothing of a motion and the window that
/// rounds off the ends of a record leave a little of them.
pub(super) fn has_exact_harmonics(log: &Log) -> bool {
    log.channels.iter().all(|channel| !Sensor::of(&[channel]).noisy)
}

/// The estimate of the lines of a machine that is not simulated without being asked for.
fn not_simulated(found: &OfAnyMotion, refine: Refine) -> Refined {
    let left_out = || RefinementReport::left_out(&found.estimate.values, NotRefined::NotAsked);
    Refined { report: (refine == Refine::Auto).then(left_out), ..unrefined(found) }
}

/// The estimate of the lines as it is.
fn unrefined(found: &OfAnyMotion) -> Refined {
    Refined::none(found.estimate.clone())
}

/// The whole periods of a record from a sample on: the end goes over into the beginning, so that no window costs what is measured near the
/// ends.
fn whole_periods(log: &Log, coordinates: usize, (from, period): (usize, usize)) -> Stretch<'_> {
    // The steady motion may begin a little earlier than a search for it tells.
    let early = from.min(period / LEAST_COMPARED);
    let periods = (log.len() - from + early) / period;
    let from = if periods * period > log.len() - from { log.len() - periods * period } else { from };
    let to = from + periods * period;
    let channels: Vec<&[f64]> = log.channels.iter().map(|channel| &channel[from..to]).collect();
    let (own, inputs) = channels.split_at(coordinates);
    let rate = |c: usize| log.rates.get(c).and_then(Option::as_ref).map(|rate| &rate[from..to]);
    Stretch { coordinates: own.to_vec(), rates: (0..coordinates).map(rate).collect(), inputs: inputs.to_vec() }
}

/// The period, samples, by which a motion repeats best, where no fraction of a sample repeats it better. `stated` is a period that
/// was given, samples.
///
/// The mean square difference of the motion to itself a period before is a parabola about the exact period, above twice the power of the
/// noise; noise moves its vertex by the root of `noise / (samples times mean square step)`.
fn whole_period(coordinates: &[Vec<f64>], periodic: &Periodic, stated: Option<f64>) -> Option<usize> {
    let near = periodic.samples_per_period.round() as usize;
    let longest = coordinates.first().map_or(0, Vec::len).checked_sub(periodic.from)?;
    let count = longest.saturating_sub(near + NEAR_PERIODS + 1);
    if near <= NEAR_PERIODS + 1 || count < near / LEAST_COMPARED {
        // A single period tells nothing of its own length, so that it is what was stated.
        let exact = stated?;
        return ((exact - near as f64).abs() <= WHOLE * exact && near > 0 && near <= longest).then_some(near);
    }
    // Sums of squared differences, every coordinate in units of its own steps.
    let steps: Vec<f64> = coordinates
        .iter()
        .map(|channel| channel[periodic.from..].windows(2).map(|pair| (pair[1] - pair[0]).powi(2)).sum::<f64>())
        .collect();
    let differs = |lag: usize| -> f64 {
        let of = |(channel, step): (&Vec<f64>, &f64)| {
            let own = &channel[periodic.from..];
            let sum: f64 = (0..count).map(|k| (own[k + lag] - own[k]).powi(2)).sum();
            if *step > 0.0 { sum / step } else { 0.0 }
        };
        coordinates.iter().zip(&steps).map(of).sum()
    };
    let best = (near - NEAR_PERIODS..=near + NEAR_PERIODS).min_by(|&a, &b| differs(a).total_cmp(&differs(b)))?;
    let (below, own, above) = (differs(best - 1), differs(best), differs(best + 1));
    let bend = below - 2.0 * own + above;
    let vertex = if bend > 0.0 { 0.5 * (below - above) / bend } else { 1.0 };
    let spread = (own / (bend.max(f64::MIN_POSITIVE) * count as f64)).sqrt();
    (vertex.abs() <= LEAST_VERTEX.max(VERTEX_DEVIATIONS * spread)).then_some(best)
}

/// A fault that a log would not show in the words of the model; nothing of one that it shows.
pub(super) fn unseen(model: &dyn Model<f64>, fault: &CalibrationFault) -> Option<UnseenFaultReport> {
    let found = fault.unseen?;
    let Term { kind, row, of, other } = fault.term;
    let coordinate = |c: usize| model.coordinate(c).name.to_string();
    let (signal, quantity, unit) = match kind {
        TermKind::InputGain => (model.input(of).name.into(), Calibration::Gain, None),
        TermKind::DeadZone if model.dims().inputs == 1 => (model.input(0).name.into(), Calibration::DeadZone, None),
        TermKind::DeadZone => (model.row(row.unwrap_or(of)).name.into(), Calibration::DeadZone, None),
        TermKind::RelativeInertia => {
            (format!("{} and {}", coordinate(of), coordinate(other.unwrap_or(of))), Calibration::Inertia, None)
        }
        _ => (coordinate(of), Calibration::Zero, model.coordinate(of).unit.map(Into::into)),
    };
    Some(UnseenFaultReport { signal, quantity, size: found.size, std: fault.std, unit, deviations: found.moves })
}
