//! Several logs of one machine together.

use crate::identification::Identification;
use crate::log_report::{PoolReport, PooledLog};
use crate::meaning::{About, Severity};
use crate::options::LogOptions;
use crate::summary;
use crate::warning::{Data, Warning};
use std::collections::BTreeMap;
use tpm_controller::model::Model;
use tpm_estimate::named::EstimateReport;
use tpm_estimate::{Contribution, Estimate, EstimateError, common_factor, pool, pool_majority};
use tpm_numerics::tail::chi_squared_upper;
use tpm_numerics::{Matrix, alarm};

/// The result of several logs, given that of each; of a single one, that result.
///
/// # Errors
/// [`EstimateError`] without a result that has an estimate.
pub(super) fn pooled(
    model: &dyn Model<f64>,
    mut parts: Vec<Identification>,
    options: &LogOptions,
) -> Result<Identification, EstimateError> {
    let parameters = model.dims().parameters;
    if parts.len() == 1
        && let Some(part) = parts.pop()
    {
        return Ok(part);
    }
    let settings = &options.estimation;
    // A log without an estimate has no part in the pool.
    let told: Vec<usize> = (0..parts.len()).filter(|&i| parts[i].estimate.is_some()).collect();
    let estimates: Vec<&Estimate> = told.iter().filter_map(|&i| parts[i].estimate.as_ref()).collect();
    let (found, odd) = pool_majority(&estimates, settings)?;
    let agreeing: Vec<usize> = (0..estimates.len()).filter(|i| !odd.contains(i)).collect();
    let mut contributions: BTreeMap<usize, Contribution> =
        agreeing.iter().map(|&i| told[i]).zip(found.contributions).collect();
    let mut factors = BTreeMap::new();
    for &i in &odd {
        let beside: Vec<&Estimate> = agreeing.iter().copied().chain([i]).map(|i| estimates[i]).collect();
        if let Some(own) = pool(&beside, settings)?.contributions.pop() {
            contributions.insert(told[i], Contribution { share: 0.0, ..own });
        }
        factors.insert(told[i], common_factor(estimates[i], &found.estimate));
    }
    let ratio = found.chi_squared / found.freedom.max(1) as f64;
    let chance = chi_squared_upper(found.chi_squared, found.freedom);
    let inflation = if found.freedom > 0 && chance < alarm::LOGS_SCATTER_RATE { ratio.max(1.0) } else { 1.0 };
    let estimate = widened(found.estimate, inflation);
    let name = |j: usize| model.parameter(j).name.to_string();
    let mut warnings = Vec::new();
    for (i, part) in parts.iter().enumerate() {
        let Some((contribution, log)) = contributions.get(&i).zip(part.log.as_ref()) else { continue };
        let farthest = contribution.deviations.iter().enumerate().filter_map(|(j, of)| Some((j, (*of)?.abs())));
        let Some((j, deviations)) = farthest.max_by(|a, b| a.1.total_cmp(&b.1)) else { continue };
        let (path, parameter) = (log.path.clone(), name(j));
        if let Some(factor) = factors.get(&i) {
            warnings.push(Warning::OddLog { path, parameter, deviations, factor: *factor });
        } else if deviations > alarm::LOGS_CONTRADICT {
            warnings.push(Warning::LogsDisagree { path, parameter, deviations });
        }
    }
    let mut logs = Vec::with_capacity(parts.len());
    for (i, part) in parts.iter_mut().enumerate() {
        let Some(log) = part.log.take() else { continue };
        let own = std::mem::take(&mut part.warnings)
            .into_iter()
            .filter(|warning| warning.meaning().about != About::Parameters)
            // What a log says of itself that has no part in the result is no doubt about the result.
            .filter(|warning| !factors.contains_key(&i) || warning.meaning().severity == Severity::Remark);
        warnings.extend(own.map(|warning| Warning::InLog { path: log.path.clone(), warning: Box::new(warning) }));
        let contribution = contributions.remove(&i);
        let deviations = contribution.as_ref().map_or_else(|| vec![None; parameters], |own| own.deviations.clone());
        logs.push(PooledLog {
            share: contribution.map_or(0.0, |own| own.share),
            left_out: factors.contains_key(&i),
            residual: part.residual,
            alone: part.parameters.iter().map(|p| (p.name.clone(), p.value.zip(p.std))).collect(),
            deviations: (0..parameters).map(name).zip(deviations).collect(),
            log,
        });
    }
    warnings.extend(summary::doubts(model, &estimate, Data::Logs));
    let told = EstimateReport::new(model, &options.stated_prior(), Some(&estimate));
    let first = parts.into_iter().next().ok_or(EstimateError::NoSignal)?;
    let result = Identification {
        rank: estimate.rank,
        condition: Some(estimate.condition).filter(|condition| condition.is_finite()),
        residual: estimate.residual,
        residual_of: estimate.residual_of,
        log: None,
        pool: Some(PoolReport { logs, chi_squared: found.chi_squared, freedom: found.freedom, inflation }),
        warnings,
        current: estimate.values.clone(),
        estimate: Some(estimate),
        ..first.telling(told)
    };
    Ok(result)
}

/// The estimate with larger variances.
fn widened(mut estimate: Estimate, factor: f64) -> Estimate {
    let rows = estimate.covariance.to_rows();
    let rows: Vec<Vec<f64>> = rows.iter().map(|row| row.iter().map(|value| factor * value).collect()).collect();
    if let Some(covariance) = Matrix::from_rows(&rows) {
        estimate.covariance = covariance;
    }
    estimate.std.iter_mut().filter(|std| std.is_finite()).for_each(|std| *std *= factor.sqrt());
    estimate
}
