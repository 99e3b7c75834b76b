//! Several logs of one machine together.

use crate::identification::Identification;
use crate::log_report::{PoolReport, PooledLog};
use crate::meaning::About;
use crate::options::LogOptions;
use crate::summary;
use crate::warning::{Data, Warning};
use tpm_core::model::Model;
use tpm_estimate::named::EstimateReport;
use tpm_estimate::{Estimate, EstimateError, pool};
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
    let estimates: Vec<&Estimate> = parts.iter().filter_map(|part| part.estimate.as_ref()).collect();
    let found = pool(&estimates, &options.estimation)?;
    let ratio = found.chi_squared / found.freedom.max(1) as f64;
    let chance = chi_squared_upper(found.chi_squared, found.freedom);
    let inflation = if found.freedom > 0 && chance < alarm::LOGS_SCATTER_RATE { ratio.max(1.0) } else { 1.0 };
    let estimate = widened(found.estimate, inflation);
    let name = |j: usize| model.parameter(j).name.to_string();
    let mut warnings = Vec::new();
    for (part, contribution) in parts.iter().zip(&found.contributions) {
        let farthest = contribution.deviations.iter().enumerate().filter_map(|(j, of)| Some((j, (*of)?.abs())));
        if let Some((j, deviations)) = farthest.max_by(|a, b| a.1.total_cmp(&b.1))
            && deviations > alarm::LOGS_CONTRADICT
            && let Some(log) = &part.log
        {
            warnings.push(Warning::LogsDisagree { path: log.path.clone(), parameter: name(j), deviations });
        }
    }
    let mut logs = Vec::with_capacity(parts.len());
    for (part, contribution) in parts.iter_mut().zip(found.contributions) {
        let Some(log) = part.log.take() else { continue };
        let own = std::mem::take(&mut part.warnings)
            .into_iter()
            .filter(|warning| warning.meaning().about != About::Parameters);
        warnings.extend(own.map(|warning| Warning::InLog { path: log.path.clone(), warning: Box::new(warning) }));
        logs.push(PooledLog {
            share: contribution.share,
            residual: part.residual,
            alone: part.parameters.iter().map(|p| (p.name.clone(), p.value.zip(p.std))).collect(),
            deviations: (0..parameters).map(name).zip(contribution.deviations).collect(),
            log,
        });
    }
    warnings.extend(summary::doubts(model, &estimate, Data::Logs));
    let EstimateReport { parameters, unobservable, combinations, covariance, combination_covariance } =
        EstimateReport::new(model, &options.stated_prior(), Some(&estimate));
    let first = parts.into_iter().next().ok_or(EstimateError::NoSignal)?;
    let result = Identification {
        parameters,
        unobservable,
        combinations,
        covariance,
        combination_covariance,
        rank: estimate.rank,
        condition: Some(estimate.condition).filter(|condition| condition.is_finite()),
        residual: estimate.residual,
        residual_of: estimate.residual_of,
        log: None,
        pool: Some(PoolReport { logs, chi_squared: found.chi_squared, freedom: found.freedom, inflation }),
        warnings,
        current: estimate.values.clone(),
        estimate: Some(estimate),
        ..first
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
