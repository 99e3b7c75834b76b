//! A log that is used sample by sample: that of a static map, which is a regression, and one that is too short for the lines of its rows, which
//! is simulated.

use crate::excerpt::{Excerpt, at_most};
use crate::found::Found;
use crate::log_fault::LogFault;
use crate::log_report::{HoldResiduals, SamplesReport, Way};
use crate::options::LogOptions;
use crate::record::{BLOCKS, MOST_SAMPLES, differing_rates, nothing, period_not_used, record, stretches};
use crate::refine::{Conditions, Refined, Start, refined};
use crate::summary;
use crate::warning::{Data, Warning};
use tpm_controller::model::Model;
use tpm_estimate::{Course, Differentiable, EstimateError, Pace, Sampled, Stretch, estimate_sampled, is_static};
use tpm_log::Log;

/// Widths of the polynomials along which a simulation may begin, in units of the one that follows the motion: noise asks for more, what
/// jumps for less.
const REACHES: [f64; 3] = [1.0, 2.0, 0.5];

/// Identifies a model from the samples of a record one by one; nothing where a model with derivatives is not followed by any simulation.
///
/// # Errors
/// [`LogFault`].
pub(super) fn identify(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    segments: &[&Log],
    options: &LogOptions,
) -> Result<Option<Found>, LogFault> {
    let first = segments.first().ok_or_else(nothing)?;
    let fault = |source| LogFault::Estimate { path: first.path.clone(), source };
    let all = stretches(segments, model.dims().coordinates, &options.reading)?;
    let record = record(first.sample_time, options, at_most(all.clone(), MOST_SAMPLES, BLOCKS));
    if is_static(model) {
        let found = estimate_sampled(model, &options.constants, &record, 0, &options.estimation).map_err(fault)?;
        let mut warnings = summary::doubts(model, &found.estimate, Data::Log);
        warnings.extend(period_not_used(segments, &options.reading));
        let own = Refined { warnings, ..Refined::none(found.estimate.clone()) };
        return Ok(Some(as_found(found, own, options)));
    }
    let pace = Pace::of(&record).map_err(fault)?;
    let rates = differing_rates(model, &pace.rate_gains).collect::<Vec<Warning>>();
    let mut best: Option<(Sampled, Refined)> = None;
    for share in REACHES {
        let reach = (share * pace.reach as f64).ceil() as usize;
        let found = match estimate_sampled(model, &options.constants, &record, reach, &options.estimation) {
            Ok(found) => found,
            Err(EstimateError::NoSignal) => continue,
            Err(source) => return Err(fault(source)),
        };
        let own = simulated(machine, (&all, first.sample_time), (&pace, &found), options);
        let left = |own: &Refined| own.estimate.residual;
        if own.report.as_ref().is_some_and(|report| report.used)
            && best.as_ref().is_none_or(|(_, other)| left(&own) < left(other))
        {
            best = Some((found, own));
        }
    }
    Ok(best.map(|(found, mut own)| {
        let mut warnings = summary::doubts(model, &own.estimate, Data::Log);
        warnings.extend(rates);
        warnings.extend(period_not_used(segments, &options.reading));
        warnings.append(&mut own.warnings);
        own.warnings = warnings;
        as_found(found, own, options)
    }))
}

/// What a simulation makes of an estimate along polynomials.
fn simulated(
    machine: Option<Differentiable<'_>>,
    (all, sample_time): (&[Stretch<'_>], f64),
    (pace, found): (&Pace, &Sampled),
    options: &LogOptions,
) -> Refined {
    let Pace { typical_period, reach, highest, .. } = pace.clone();
    let start = Start {
        estimate: &found.estimate,
        excerpt: Excerpt::of_stretches(all),
        course: Course::Any { typical_period, reach, highest, copies: 1.0 },
        steps: pace.steps.clone(),
        samples: all.iter().map(Stretch::samples).sum(),
        sample_time,
    };
    let settings = &options.estimation;
    let restate = |values, covariance| found.restated(values, covariance, settings);
    refined(machine, start, Conditions::of_log(options), settings, &restate)
}

fn as_found(found: Sampled, refined: Refined, options: &LogOptions) -> Found {
    Found {
        harmonics: 0,
        hold_residuals: HoldResiduals::of(options.reading.hold, found.estimate.residual, None),
        way: Way::Samples(SamplesReport { samples: found.samples }),
        row_residuals: found.row_residuals,
        estimate: refined.estimate,
        refinement: refined.report,
        warnings: refined.warnings,
        tells_hold: refined.tells_hold,
        delays: Vec::new(),
        calibration: Vec::new(),
        unseen_gain: None,
    }
}
