//! Delays of inputs that are found together with the parameters.
//!
//! Whatever identifies a log names an input that acts later than it is recorded, with the delay and its deviation. A delay that is asked for
//! is applied as a known one, and the log identified again, until none is named. What the deviation of a delay moves of the parameters is
//! seen where it is applied once more with the deviation on top, and is in their covariance.

use crate::identification::Identification;
use crate::log_fault::LogFault;
use crate::log_report::LogReport;
use crate::options::LogOptions;
use std::collections::BTreeMap;
use tpm_controller::model::Model;
use tpm_estimate::TermKind;
use tpm_estimate::named::EstimateReport;
use tpm_numerics::Matrix;

/// Most times that a delay is applied.
const MOST_PASSES: usize = 6;
/// A delay is settled when it moves by less than this share of its deviation.
const SETTLED: f64 = 0.1;

/// A log identified with the delays that are asked for; `identify` does it with known ones.
///
/// # Errors
/// As of `identify`.
pub(super) fn with_delays(
    model: &dyn Model<f64>,
    options: &LogOptions,
    identify: &dyn Fn(&LogOptions) -> Result<Identification, LogFault>,
) -> Result<Identification, LogFault> {
    let mut found = identify(options)?;
    if options.fitted_delays.is_empty() {
        return Ok(found);
    }
    let mut applied = options.clone();
    applied.actuators.resize(model.dims().inputs, Default::default());
    let mut deviations: BTreeMap<usize, f64> = BTreeMap::new();
    for _ in 0..MOST_PASSES {
        let mut moved = false;
        for &input in &options.fitted_delays {
            let Some((delay, std)) = named(found.log.as_ref(), input) else { continue };
            let before = applied.actuators[input].delay;
            // An input cannot act before it is commanded; what says so is left in the result.
            let next = (before + delay).max(0.0);
            moved |= (next - before).abs() > SETTLED * std;
            applied.actuators[input].delay = next;
            deviations.insert(input, std);
        }
        if !moved {
            break;
        }
        found = identify(&applied)?;
    }
    for (&input, &std) in &deviations {
        let mut later = applied.clone();
        later.actuators[input].delay += std;
        let moved = identify(&later)?;
        if let (Some(own), Some(moved)) = (found.estimate.as_mut(), moved.estimate) {
            let by: Vec<f64> = moved.values.iter().zip(&own.values).map(|(there, here)| there - here).collect();
            let mut rows = own.covariance.to_rows();
            for (row, a) in rows.iter_mut().zip(&by) {
                row.iter_mut().zip(&by).for_each(|(entry, b)| *entry += a * b);
            }
            if let Some(covariance) = Matrix::from_rows(&rows) {
                own.covariance = covariance;
            }
            let known = own.std.iter_mut().zip(&by).filter(|(std, _)| std.is_finite());
            known.for_each(|(std, by)| *std = std.hypot(*by));
        }
    }
    let told = EstimateReport::new(model, &options.stated_prior(), found.estimate.as_ref());
    let mut found = found.telling(told);
    if let Some(log) = &mut found.log {
        for &input in &options.fitted_delays {
            let own = log.actuators.entry(model.input(input).name.to_string()).or_default();
            own.fitted = true;
            own.delay_std = deviations.get(&input).copied();
        }
    }
    Ok(found)
}

/// By how much an input acts later than it is recorded, beyond what is known, with its deviation, s.
fn named(log: Option<&LogReport>, input: usize) -> Option<(f64, f64)> {
    let own = log?.missing().iter().find(|missing| missing.is(TermKind::Delay, input))?;
    Some((own.value, own.std))
}
