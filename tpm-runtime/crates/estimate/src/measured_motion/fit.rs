//! Weighted least squares over the harmonic equations of one or several records.
//!
//! Invariant: the noise at the present estimate and a flat error of the model are found anew until the estimate stands still.
//! They are the weights, unless all equations count alike, and deviations follow from them either way. The bias that noise in
//! the regressors gives the normal equations is subtracted.

use crate::equations::Equations;
use crate::error::EstimateError;
use crate::information::Information;
use crate::measured_motion::coupled::Weighed;
use crate::measured_motion::model_error::excess;
use crate::measured_motion::record::MeasuredMotion;
use crate::measured_motion::repeats::{Repeats, repeated};
use crate::result::Estimate;
use crate::settings::{Settings, Weights};
use crate::verdict::{ResidualOf, Verdict};
use tpm_controller::model::Dims;
use tpm_numerics::{DMatrix, Matrix};

/// Relations among the parameters that are known beforehand.
pub trait Structure {
    /// The parameters of this structure that explain the pooled equations best, or nothing when there is none; `gradient`
    /// is added to the right of the normal equations.
    fn explain(&mut self, information: &Information, gradient: &[f64]) -> Option<Vec<f64>>;
}

/// No relations: every parameter is free of the others.
struct Unstructured;

impl Structure for Unstructured {
    fn explain(&mut self, _: &Information, _: &[f64]) -> Option<Vec<f64>> {
        None
    }
}

/// An estimate, and the parameters at which its equations were weighed.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The parameters without any structure.
    pub estimate: Estimate,
    /// The parameters at which weights and bias were worked out: those of the structure, when there is one.
    pub theta: Vec<f64>,
}

/// Estimates the parameters from the pooled equations of one or several records of the same model.
///
/// The records' line selections are refined in place (a tail that the model does not explain is left out when the number
/// of harmonics was not given).
///
/// # Errors
/// [`EstimateError::NoSignal`] without a record, [`EstimateError::Frozen`] and [`EstimateError::AllFrozen`] when parameters are
/// held that do not exist, or all.
pub fn estimate_measured_motion(
    records: &mut [MeasuredMotion],
    settings: &Settings,
) -> Result<Estimate, EstimateError> {
    Ok(estimate_structured(records, settings, &mut Unstructured)?.estimate)
}

/// [`estimate_measured_motion`] with weights and bias worked out at the parameters that a structure explains.
///
/// # Errors
/// The conditions of [`estimate_measured_motion`].
pub fn estimate_structured(
    records: &mut [MeasuredMotion],
    settings: &Settings,
    structure: &mut dyn Structure,
) -> Result<Fitted, EstimateError> {
    let Some(dims) = records.first().map(|r| r.dims) else {
        return Err(EstimateError::NoSignal);
    };
    let mut fitted = solve_records(records, dims, settings, structure)?;
    if settings.harmonics.is_none() {
        // Each cut lowers the median of what remains, so the loop is short; it ends at half of the lines at the latest.
        for _ in 0..8 {
            let mut cut = false;
            for record in records.iter_mut() {
                let variance = record.row_noise(&fitted.theta);
                cut |= record.cut_tail(&fitted.theta, &variance);
            }
            if !cut {
                break;
            }
            fitted = solve_records(records, dims, settings, structure)?;
        }
    }
    Ok(fitted)
}

fn solve_records(
    records: &[MeasuredMotion],
    dims: Dims,
    settings: &Settings,
    structure: &mut dyn Structure,
) -> Result<Fitted, EstimateError> {
    let p = dims.parameters;
    let free = settings.free(p)?;
    let start = settings.start(p);
    let prior_free = free.of(&start);
    let hidden: Vec<Vec<f64>> = settings.hidden.iter().map(|direction| free.of(direction)).collect();

    let mut theta = start.clone();
    let mut model_error = vec![vec![0.0; dims.rows]; records.len()];
    let mut equations: Vec<Equations> = records
        .iter()
        .map(|record| {
            record.equations(|row| {
                // The first pass weighs all lines of a row alike, rows by the size of their force.
                let (_, force) = record.row_power(row, &vec![1.0; p]);
                if force > 0.0 { force * force } else { 1.0 }
            })
        })
        .collect();
    let equations_total: usize = equations.iter().map(Equations::real_len).sum();
    let mut noise: Vec<Option<Noise>> = records.iter().map(|_| None).collect();
    let mut levels: Vec<Vec<Option<f64>>> = records.iter().map(|_| vec![None; dims.rows]).collect();
    let mut gradient = vec![0.0; free.indices.len()];
    let mut information = Information::empty(free.indices.len());
    let mut solution = information.scaled().solve(&prior_free, None, &hidden);
    for pass in 0..12 {
        for (i, (equations, noise)) in equations.iter().zip(&noise).enumerate() {
            let mut rows = equations.weighted(&free.indices, &settings.frozen);
            if let Some(weighed) = noise.as_ref().and_then(|noise| noise.whitening(settings)) {
                weighed.whiten(&mut rows);
            }
            let own = Information::of(rows).forget(settings.memory(records.len() - 1 - i));
            information = if i > 0 { information.pool(&own) } else { own };
        }
        let correction = (pass > 0).then_some(gradient.as_slice());
        solution = information.scaled().solve(&prior_free, correction, &hidden);
        let before = theta.clone();
        free.put(&solution.values, &mut theta);
        if free.indices.len() == p
            && let Some(explained) = structure.explain(&information, &gradient)
        {
            theta = explained;
        }
        let moved = free
            .indices
            .iter()
            .map(|&j| (theta[j] - before[j]).abs() - 1e-9 * theta[j].abs())
            .fold(f64::NEG_INFINITY, f64::max);
        if pass > 2 && moved <= 0.0 {
            break;
        }
        gradient.fill(0.0);
        let share = 1.0 - (solution.rank as f64 / equations_total.max(1) as f64).min(1.0);
        for (i, (record, equations)) in records.iter().zip(&mut equations).enumerate() {
            let mut variance = record.row_noise(&theta);
            for (row, (variance, level)) in variance.iter_mut().zip(&mut levels[i]).enumerate() {
                if !record.driven[row] {
                    hold_level(variance, level);
                }
            }
            let memory = settings.memory(records.len() - 1 - i);
            let sensors = record.used.iter().zip(&variance).enumerate().flat_map(|(row, (used, variance))| {
                used.iter().zip(variance).map(move |(&k, v)| v - record.error_apart(row, k))
            });
            let sensors: Vec<f64> = sensors.collect();
            for row in 0..dims.rows {
                let residual = record.residuals(row, &theta);
                let error = excess(&residual, &variance[row], &record.used[row], share);
                model_error[i][row] = error;
                for (v, &k) in variance[row].iter_mut().zip(&record.used[row]) {
                    *v += if k == 0 { error / 4.0 } else { error };
                }
            }
            let whole: Vec<f64> = variance.into_iter().flatten().collect();
            let weighed = record.coupled.as_ref().and_then(|coupled| coupled.weigh(&theta, &sensors, &whole));
            equations.variance = match settings.weights {
                Weights::Noise => whole.clone(),
                Weights::Equal => record.alike(&theta),
            };
            let now = noise[i].insert(Noise { variance: whole, weighed });
            if let Some(weighed) = now.whitening(settings) {
                for (g, &j) in gradient.iter_mut().zip(&free.indices) {
                    *g += memory * weighed.gradient[j];
                }
            } else {
                for (e, parts) in record.row_bias(&theta).iter().flatten().enumerate() {
                    for (g, &j) in gradient.iter_mut().zip(&free.indices) {
                        *g -= memory * equations.weight(e) * parts[j];
                    }
                }
            }
        }
    }

    let freedom = equations_total.saturating_sub(solution.rank);
    let (remainder, covariance) = match settings.weights {
        Weights::Noise => (solution.remainder, free.spread_square(&solution.covariance)),
        Weights::Equal => {
            let mut remainder = 0.0;
            let mut spread = DMatrix::zeros(free.indices.len(), free.indices.len());
            for (i, (equations, noise)) in equations.iter().zip(&noise).enumerate() {
                let Some(noise) = noise else { continue };
                remainder += noise.remainder(equations, &theta);
                let rows = noise.rows(&equations.weighted(&free.indices, &settings.frozen), equations);
                spread += rows.tr_mul(&rows) * settings.memory(records.len() - 1 - i).powi(2);
            }
            (remainder, free.spread_square(&(&solution.covariance * spread * &solution.covariance)))
        }
    };
    let chi_squared = if freedom > 0 { remainder / freedom as f64 } else { 0.0 };
    // Errors that repeat in every period do not show between the lines; the residuals show them.
    let inflation = chi_squared.max(1.0);
    // Rounding that several records share is no reason to weigh them otherwise: the model's own error, which they share as well, is larger
    // where a machine does not obey it.
    let mut shared = DMatrix::zeros(free.indices.len(), free.indices.len());
    let repeats: Vec<Option<&Repeats>> = records.iter().map(|record| record.repeats.as_ref()).collect();
    for (i, (equations, repeated)) in equations.iter().zip(repeated(&repeats, dims.rows)).enumerate() {
        if repeated.iter().all(Vec::is_empty) {
            continue;
        }
        let rows = scaled_rows(&equations.weighted(&free.indices, &settings.frozen), equations, |e| {
            let variance = repeated[equations.row[e]].get(equations.harmonic[e]).copied().unwrap_or(0.0);
            (variance / equations.variance[e]).sqrt()
        });
        shared += rows.tr_mul(&rows) * settings.memory(records.len() - 1 - i).powi(2);
    }
    let shared = free.spread_square(&(&solution.covariance * shared * &solution.covariance));
    let covariance = covariance * inflation + shared;
    let unobservable = solution.unobservable.iter().map(|direction| free.spread(direction)).collect();
    let scaled = information.scaled();
    let touched = scaled.touched(&solution.unobservable);
    let (residual, _) = pooled_residual(records, &theta);
    let mut values = start;
    free.put(&solution.values, &mut values);
    let felt = |j: usize, std: f64| records.iter().map(|record| record.force_share(j, std)).fold(0.0, f64::max);
    let Verdict { std, status } = Verdict::new(&free, &touched, &values, &covariance, felt);
    let estimate = Estimate {
        values,
        std,
        covariance: Matrix::of(covariance),
        status,
        rank: solution.rank,
        unobservable,
        scales: Vec::new(),
        condition: scaled.condition(&hidden),
        residual,
        residual_of: ResidualOf::Force,
        chi_squared,
        model_error: (0..dims.rows).map(|r| model_error.iter().map(|e| e[r].sqrt()).fold(0.0, f64::max)).collect(),
    };
    Ok(Fitted { estimate, theta })
}

/// Keeps the sum of the variances of a row without an input at what it was at first.
///
/// All terms of such a row carry parameters, so that its noise shrinks with them: weights that followed it would reward small
/// parameters, and the row would collapse to zero.
fn hold_level(variance: &mut [f64], level: &mut Option<f64>) {
    let sum: f64 = variance.iter().sum();
    let first = *level.get_or_insert(sum);
    if sum > 0.0 {
        variance.iter_mut().for_each(|v| *v *= first / sum);
    }
}

/// The noise of one record's equations with the model's own error.
struct Noise {
    /// E|n|^2 of every equation.
    variance: Vec<f64>,
    /// Correlations of the equations, where they are known.
    weighed: Option<Weighed>,
}

impl Noise {
    /// The correlations to take out of equations that were divided by their standard deviations; nothing when all count alike.
    fn whitening(&self, settings: &Settings) -> Option<&Weighed> {
        self.weighed.as_ref().filter(|_| settings.weights == Weights::Noise)
    }

    /// Squares of the residuals at theta over their variances.
    fn remainder(&self, equations: &Equations, theta: &[f64]) -> f64 {
        let of = |(e, variance): (usize, &f64)| {
            equations.weight(e) * equations.variance[e] / variance * equations.residual(e, theta).norm_sqr()
        };
        self.variance.iter().enumerate().map(of).sum()
    }

    /// Rows B with `B' B` the covariance of `A' W n`, from the real equations `W^1/2 [A b]` as they were weighted.
    fn rows(&self, weighted: &DMatrix<f64>, equations: &Equations) -> DMatrix<f64> {
        let rows = scaled_rows(weighted, equations, |e| (self.variance[e] / equations.variance[e]).sqrt());
        match &self.weighed {
            Some(weighed) => weighed.decouple(&rows),
            None => rows,
        }
    }
}

/// The regressors of real equations `[A b]`, times a factor of the equation.
fn scaled_rows(weighted: &DMatrix<f64>, equations: &Equations, ratio: impl Fn(usize) -> f64) -> DMatrix<f64> {
    let mut rows = weighted.columns(0, weighted.ncols() - 1).into_owned();
    let of_real = (0..equations.len()).flat_map(|e| {
        let real = if equations.harmonic[e] == 0 { 1 } else { 2 };
        std::iter::repeat_n(ratio(e), real)
    });
    for (mut row, ratio) in rows.row_iter_mut().zip(of_real) {
        row *= ratio;
    }
    rows
}

/// Residual of all records as a share of the force: root mean square over rows and records of each one's share.
fn pooled_residual(records: &[MeasuredMotion], theta: &[f64]) -> (f64, usize) {
    let (mut sum, mut rows) = (0.0, 0);
    for record in records {
        for row in 0..record.dims.rows {
            let (residual, force) = record.row_power(row, theta);
            if force > 0.0 {
                sum += (residual / force).powi(2);
                rows += 1;
            }
        }
    }
    ((sum / f64::from(rows.max(1))).sqrt(), rows as usize)
}

impl MeasuredMotion {
    /// An estimate from this record with values and covariance that were found in another way.
    #[must_use]
    pub fn restated(&self, estimate: &Estimate, values: Vec<f64>, covariance: Matrix, settings: &Settings) -> Estimate {
        let (residual, _) = pooled_residual(std::slice::from_ref(self), &values);
        let felt = |j: usize, std: f64| self.force_share(j, std);
        Estimate { residual, ..estimate.with_values(values, covariance, settings, felt) }
    }

    /// Largest share of a row's force that a change of one parameter makes.
    fn force_share(&self, parameter: usize, change: f64) -> f64 {
        let p = self.dims.parameters;
        (0..self.dims.rows)
            .map(|row| {
                let (mut part, mut force) = (0.0, 0.0);
                for &k in &self.used[row] {
                    let share = if k == 0 { 1.0 } else { 0.5 };
                    part += share * (self.phi[row * p + parameter][k] * change).norm_sqr();
                    force += share
                        * if self.driven[row] {
                            self.drive[row][k].norm_sqr()
                        } else {
                            self.phi[row * p + parameter][k].norm_sqr()
                        };
                }
                if force > 0.0 { (part / force).sqrt() } else { 0.0 }
            })
            .fold(0.0, f64::max)
    }
}
