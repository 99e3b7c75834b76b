//! A log of any motion, identified in the time domain.

use crate::estimate::{
    Course, Differentiable, EstimateError, Settings, Stretch, TimeDomain, TimeRecord, estimate_time_domain,
};
use crate::log::{Log, LogError, LogOptions};
use crate::session::excerpt::Excerpt;
use crate::session::found::Found;
use crate::session::log_report::{HoldResiduals, Way};
use crate::session::refine::{Start, refined};
use crate::session::summary;
use crate::session::warning::{Data, Warning};
use std::vec;
use std::vec::Vec;
use tpm_core::harmonics::Hold;
use tpm_core::model::Model;

/// A measured rate that differs from the rate of the measured position by more than this share is flagged.
const RATE_DIFFERS: f64 = 0.05;

/// Identifies a model from all samples of a log, whatever its motion is.
///
/// # Errors
/// [`LogError`].
pub(super) fn identify(
    model: &dyn Model<f64>,
    machine: Option<Differentiable<'_>>,
    log: &Log,
    options: &LogOptions,
    settings: &Settings,
) -> Result<Found, LogError> {
    let dims = model.dims();
    let from = options.from_sample.unwrap_or(0).min(log.len());
    let channels: Vec<&[f64]> = log.channels.iter().map(|channel| &channel[from..]).collect();
    let (coordinates, inputs) = channels.split_at(dims.coordinates);
    let stretches = vec![Stretch {
        coordinates: coordinates.to_vec(),
        rates: vec![None; dims.coordinates],
        inputs: inputs.to_vec(),
    }];
    let record = |hold: Hold| TimeRecord {
        sample_time: log.sample_time,
        hold,
        actuators: &options.actuators,
        stretches: stretches.clone(),
    };
    let derivatives = machine.map(|machine| machine.derivatives);
    let run = |hold: Hold| -> Result<TimeDomain, EstimateError> {
        estimate_time_domain(model, derivatives, &options.constants, &record(hold), settings)
    };
    let found = run(options.hold).map_err(|source| LogError::Estimate { path: log.path.clone(), source })?;
    let other = run(options.hold.other()).ok().map(|other| other.estimate.residual);
    let report = &found.report;
    let (typical_period, reach, highest) = (found.typical_period, found.reach, report.highest.clone());
    let start = Start {
        estimate: &found.estimate,
        excerpt: Excerpt::of_stretches(&stretches),
        course: Course::Any { typical_period, reach, highest },
        steps: found.steps.clone(),
        samples: log.len() - from,
        sample_time: log.sample_time,
    };
    let restate = |values, covariance| found.restated(values, covariance, settings);
    let refined = refined(machine, start, options, settings, &restate);
    let mut warnings = summary::doubts(model, &refined.estimate, Data::Log);
    for (c, gain) in report.rate_gains.iter().enumerate() {
        if let Some(gain) = gain.filter(|gain| (gain - 1.0).abs() > RATE_DIFFERS) {
            warnings.push(Warning::RateDiffers { coordinate: model.coordinate(c).name.into(), gain });
        }
    }
    warnings.extend(refined.warnings);
    Ok(Found {
        harmonics: 0,
        row_residuals: report.row_residuals.clone(),
        hold_residuals: HoldResiduals::of(options.hold, found.estimate.residual, other),
        way: Way::Time(report.clone()),
        estimate: refined.estimate,
        refinement: refined.report,
        warnings,
    })
}
