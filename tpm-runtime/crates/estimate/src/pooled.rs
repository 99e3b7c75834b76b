//! Estimates of one machine from several records, put together by what each of them shows.
//!
//! An estimate with covariance C that does not show some directions tells the combinations `S' theta`, S spanning what is orthogonal to
//! these directions, with covariance `S' C S`. That is information like any other: the pool weighs every record by it, shows what any of
//! them shows, and what remains, a sum of squares, is chi-squared with as many degrees of freedom as there are combinations told more
//! than once, when the records agree.

use crate::error::EstimateError;
use crate::information::Information;
use crate::result::Estimate;
use crate::scale::Scale;
use crate::settings::Settings;
use crate::verdict::{Evidence, POOR_DEVIATION, ResidualOf, Status, Verdict};
use tpm_numerics::singular::{complement, largest_one, unit_columns};
use tpm_numerics::{DMatrix, DVector, Matrix};

/// What one record has to do with the pool.
#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    /// Share of the information about all parameters that comes from this record.
    pub share: f64,
    /// Difference of every parameter from the pool of the other records, in deviations of that difference; nothing where either does not
    /// show it.
    pub deviations: Vec<Option<f64>>,
}

/// Several records of one machine together.
#[derive(Clone, Debug, PartialEq)]
pub struct Pooled {
    /// The estimate; its covariance is that of the records' own deviations, whether they agree or not.
    pub estimate: Estimate,
    /// What every record has to do with it.
    pub contributions: Vec<Contribution>,
    /// Weighted sum of the squares of all differences.
    pub chi_squared: f64,
    /// Its degrees of freedom: combinations that more than one record tells.
    pub freedom: usize,
}

/// Equations of unit variance that say what an estimate says of the free parameters.
fn equations(estimate: &Estimate, free: &[usize], scale: &[f64]) -> DMatrix<f64> {
    let n = free.len();
    let covariance = DMatrix::from_fn(n, n, |r, c| estimate.covariance[(free[r], free[c])] / (scale[r] * scale[c]));
    let hidden: Vec<&Vec<f64>> = estimate.unobservable.iter().collect();
    let shown = if hidden.is_empty() {
        DMatrix::identity(n, n)
    } else {
        let directions = DMatrix::from_fn(n, hidden.len(), |r, c| hidden[c][free[r]] / scale[r]);
        complement(&unit_columns(directions).0)
    };
    let values = DVector::from_fn(n, |r, _| estimate.values[free[r]] / scale[r]);
    let told = shown.tr_mul(&covariance) * &shown;
    // A combination without a deviation is one that rounding alone limits.
    let least = told.diagonal().iter().copied().fold(0.0, f64::max).max(f64::MIN_POSITIVE) * f64::EPSILON;
    let told = told + DMatrix::identity(shown.ncols(), shown.ncols()) * least;
    let Some(cholesky) = told.cholesky() else { return DMatrix::zeros(0, n + 1) };
    let rows = cholesky.l().solve_lower_triangular(&shown.transpose()).unwrap_or_else(|| DMatrix::zeros(0, n));
    let right = &rows * values;
    let mut whole = rows.insert_column(n, 0.0);
    whole.column_mut(n).copy_from(&right);
    whole
}

/// Puts estimates of one machine together; `settings` say which parameters are held, and what directions keep that none shows.
///
/// # Errors
/// [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when parameters are held that do not exist, or all;
/// [`EstimateError::NoSignal`] without an estimate.
pub fn pool(estimates: &[&Estimate], settings: &Settings) -> Result<Pooled, EstimateError> {
    let most = estimates.iter().max_by_key(|estimate| estimate.scales.len()).ok_or(EstimateError::NoSignal)?;
    let own = |scale: &Scale| Some((scale.own(&most.values)?, scale.clone()));
    let scales: Vec<(usize, Scale)> = most.scales.iter().filter_map(own).collect();
    if scales.is_empty() {
        return pool_shown(estimates, settings, &[]);
    }
    // Of parameters with a common scale one is the same in all records, and the others are products with its powers.
    let gauged: Vec<Estimate> = (estimates.iter())
        .map(|&estimate| scales.iter().fold(estimate.clone(), |estimate, (own, _)| estimate.hiding(*own)))
        .collect();
    let owns: Vec<usize> = scales.iter().map(|(own, _)| *own).collect();
    let mut pooled = pool_shown(&gauged.iter().collect::<Vec<_>>(), settings, &owns)?;
    pooled.estimate = scales.iter().fold(pooled.estimate, |estimate, (own, scale)| estimate.showing(*own, scale));
    Ok(pooled)
}

/// [`pool`] of estimates none of which has parameters with a common scale but in the gauge in which the parameters `ones` are one.
fn pool_shown(estimates: &[&Estimate], settings: &Settings, ones: &[usize]) -> Result<Pooled, EstimateError> {
    let first = estimates.first().ok_or(EstimateError::NoSignal)?;
    let parameters = first.values.len();
    let free = settings.free(parameters)?;
    let n = free.indices.len();
    // Parameters in units of the smallest deviation that any record gives them.
    let scale: Vec<f64> = (free.indices.iter())
        .map(|&j| {
            let deviations = estimates.iter().map(|estimate| estimate.covariance[(j, j)].max(0.0).sqrt());
            let least = deviations.filter(|std| *std > 0.0).fold(f64::INFINITY, f64::min);
            if least.is_finite() { least } else { 1.0 }
        })
        .collect();
    let parts: Vec<Information> =
        estimates.iter().map(|estimate| Information::of(equations(estimate, &free.indices, &scale))).collect();
    let mut prior = settings.start(parameters);
    ones.iter().for_each(|&own| prior[own] = 1.0);
    let start: Vec<f64> = free.of(&prior).iter().zip(&scale).map(|(value, scale)| value / scale).collect();
    let together = |parts: &mut dyn Iterator<Item = &Information>| {
        parts.fold(Information::empty(n), |pooled, part| pooled.pool(part))
    };
    let whole = together(&mut parts.iter());
    let scaled = whole.scaled();
    let stated: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();
    let hidden: Vec<Vec<f64>> =
        stated.iter().map(|direction| direction.iter().zip(&scale).map(|(d, scale)| d / scale).collect()).collect();
    let solution = scaled.solve(&start, None, &hidden);
    let touched = scaled.touched(&solution.unobservable);
    let mut values = prior;
    let own: Vec<f64> = solution.values.iter().zip(&scale).map(|(value, scale)| value * scale).collect();
    free.put(&own, &mut values);
    let covariance = DMatrix::from_fn(n, n, |r, c| solution.covariance[(r, c)] * scale[r] * scale[c]);
    let covariance = free.spread_square(&covariance);
    // Where a record says that a small value is known well enough, more records do not know it less.
    let known = |j: usize| estimates.iter().any(|estimate| estimate.status[j] == Status::Identified);
    let mut verdict = Verdict::new(&free, &touched, &values, &covariance, |_, _| f64::INFINITY);
    for (j, status) in verdict.status.iter_mut().enumerate() {
        if *status == Status::PoorlyDetermined && known(j) {
            *status = Status::of(Evidence::Shown { value: values[j], std: verdict.std[j], felt: 0.0 }, POOR_DEVIATION);
        }
    }
    // Known directions stay as they were stated.
    let found = solution.unobservable.iter().enumerate();
    let unobservable: Vec<Vec<f64>> = found
        .map(|(index, direction)| {
            if let Some(stated) = stated.get(index) {
                return free.spread(stated);
            }
            let raw: Vec<f64> = direction.iter().zip(&scale).map(|(d, scale)| d * scale).collect();
            free.spread(&largest_one(&raw))
        })
        .collect();
    let condition = scaled.condition(&hidden);
    let contributions = (0..parts.len())
        .map(|i| {
            let others = together(&mut parts.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, part)| part));
            let share = (solution.covariance.clone() * parts[i].factor().tr_mul(&parts[i].factor())).trace()
                / solution.rank.max(1) as f64;
            let own = parts[i].scaled();
            let rest = others.scaled();
            let (one, other) = (own.solve(&start, None, &hidden), rest.solve(&start, None, &hidden));
            let (untold, missing) = (own.touched(&one.unobservable), rest.touched(&other.unobservable));
            let mut deviations = vec![None; parameters];
            for (at, &j) in free.indices.iter().enumerate() {
                let variance = one.covariance[(at, at)] + other.covariance[(at, at)];
                let told = estimates.len() > 1 && !untold[at] && !missing[at] && variance > 0.0;
                deviations[j] = told.then(|| (one.values[at] - other.values[at]) / variance.sqrt());
            }
            Contribution { share, deviations }
        })
        .collect();
    let ranks: usize = estimates.iter().map(|estimate| estimate.rank).sum();
    let worst = |of: &dyn Fn(&Estimate) -> f64| estimates.iter().map(|estimate| of(estimate)).fold(0.0, f64::max);
    let most = estimates.iter().max_by(|a, b| a.residual.total_cmp(&b.residual));
    let residual_of = most.map_or(ResidualOf::Force, |estimate| estimate.residual_of);
    Ok(Pooled {
        estimate: Estimate {
            values,
            std: verdict.std,
            covariance: Matrix::of(covariance),
            status: verdict.status,
            rank: solution.rank,
            unobservable,
            scales: Vec::new(),
            condition,
            residual: worst(&|estimate| estimate.residual),
            residual_of,
            chi_squared: worst(&|estimate| estimate.chi_squared),
            model_error: first.model_error.clone(),
        },
        contributions,
        chi_squared: solution.remainder,
        freedom: ranks.saturating_sub(solution.rank),
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::pool;
    use crate::result::Estimate;
    use crate::settings::Settings;
    use crate::verdict::ResidualOf;
    use crate::verdict::Status;
    use tpm_numerics::Matrix;

    pub(crate) fn estimate(values: &[f64], covariance: &[Vec<f64>], unobservable: Vec<Vec<f64>>) -> Estimate {
        let n = values.len();
        Estimate {
            values: values.to_vec(),
            std: (0..n).map(|j| covariance[j][j].sqrt()).collect(),
            covariance: Matrix::from_rows(covariance).expect("square"),
            status: vec![Status::Identified; n],
            rank: n - unobservable.len(),
            unobservable,
            scales: Vec::new(),
            condition: 1.0,
            residual: 0.01,
            residual_of: ResidualOf::Force,
            chi_squared: 1.0,
            model_error: vec![0.0],
        }
    }

    #[test]
    fn two_values_pool_to_their_weighted_mean() {
        let a = estimate(&[1.0, 5.0], &[vec![0.04, 0.0], vec![0.0, 1.0]], vec![]);
        let b = estimate(&[1.3, 5.0], &[vec![0.01, 0.0], vec![0.0, 1.0]], vec![]);
        let pooled = pool(&[&a, &b], &Settings::default()).expect("pools");
        assert!((pooled.estimate.values[0] - (1.0 / 0.04 + 1.3 / 0.01) / 125.0).abs() < 1e-12);
        assert!((pooled.estimate.covariance[(0, 0)] - 1.0 / 125.0).abs() < 1e-12);
        assert_eq!(pooled.freedom, 2);
        assert!((pooled.chi_squared - 0.09 / 0.05).abs() < 1e-9);
        let shares: Vec<f64> = pooled.contributions.iter().map(|part| part.share).collect();
        assert!((shares[0] - 0.35).abs() < 1e-9 && (shares[1] - 0.65).abs() < 1e-9, "{shares:?}");
        let deviation = pooled.contributions[0].deviations[0].expect("both show it");
        assert!((deviation + 0.3 / 0.05_f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn records_that_show_one_combination_each_show_both_parameters_together() {
        // a + 2 b = 7 and a - b = 1 from two records that hide a direction each: a = 3, b = 2.
        let first =
            estimate(&[7.0 / 5.0, 14.0 / 5.0], &[vec![0.0004, 0.0008], vec![0.0008, 0.0016]], vec![vec![1.0, -0.5]]);
        let second = estimate(&[0.5, -0.5], &[vec![0.0025, -0.0025], vec![-0.0025, 0.0025]], vec![vec![1.0, 1.0]]);
        let pooled = pool(&[&first, &second], &Settings::default()).expect("pools");
        let found = &pooled.estimate;
        assert!((found.values[0] - 3.0).abs() < 1e-9 && (found.values[1] - 2.0).abs() < 1e-9, "{found:?}");
        assert_eq!((found.rank, found.unobservable.len(), pooled.freedom), (2, 0, 0));
        assert_eq!(found.status, [Status::Identified; 2]);
        let alone = pool(&[&first], &Settings::default()).expect("pools");
        assert_eq!((alone.estimate.rank, alone.estimate.unobservable.len()), (1, 1));
        assert_eq!(alone.estimate.status, [Status::Unobservable; 2]);
    }
}
