//! Choice of the orders of a transfer function by cross-validation.
//!
//! Invariant: an order is judged on data that it was not fitted to. Each half of the record is fitted in turn and the
//! other one predicted. The residual on the data of the fit is not used, since it falls with every coefficient. Among
//! orders whose predictions do not differ significantly the smallest is recommended, provided that the fit to the whole
//! record is stable and has neither cancelling nor undetermined poles.

use crate::points::Points;
use crate::rational::{FitError, FitWarning, RationalFit, RationalSettings, fit_points, fit_rational};
use crate::response::{FrequencyResponse, ResponseError, Welch};
use tpm_numerics::alarm;

/// Why orders cannot be compared.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum OrderError {
    /// The record has no frequency response.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// A half of the record has no frequency response.
    #[error("half of the record is too short to validate on: {0}")]
    Half(ResponseError),
}

/// One pair of degrees.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct OrderTrial {
    /// Degree of the numerator.
    pub numerator: usize,
    /// Degree of the denominator.
    pub denominator: usize,
    /// The fit to the whole record.
    pub fit: Result<RationalFit, FitError>,
    /// Mean squared error of predicting the other half over that of noise alone; about 1 when the model is right.
    pub validation: Option<f64>,
    /// Difference of its validation from the best one, in standard errors of the difference.
    pub worse_by: Option<f64>,
}

impl OrderTrial {
    /// Whether the fit failed, or its warnings mean that the order is too high or the model unstable.
    #[must_use]
    pub fn doubtful(&self) -> bool {
        self.fit.as_ref().map_or(true, |fit| {
            fit.warnings.iter().any(|w| w.order_too_high() || matches!(w, FitWarning::Unstable { .. }))
        })
    }
}

/// All orders that were tried.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct OrderComparison {
    /// The response of the whole record.
    pub response: FrequencyResponse,
    /// The trials, in the order of the degrees given.
    pub trials: Vec<OrderTrial>,
    /// Index of the recommended one; `None` when every one is doubtful.
    pub recommended: Option<usize>,
}

/// Fits each pair of degrees (numerator, denominator) and compares the predictions.
///
/// `settings` gives band, delay and estimator; its degrees are not used.
///
/// # Errors
/// [`OrderError`] when the record, or half of it, is too short for the segments.
pub fn compare_orders(
    input: &[f64],
    output: &[f64],
    sample_time: f64,
    welch: &Welch,
    settings: &RationalSettings,
    orders: &[(usize, usize)],
) -> Result<OrderComparison, OrderError> {
    let response = FrequencyResponse::estimate(input, output, sample_time, welch)?;
    let middle = input.len() / 2;
    let half = |u: &[f64], y: &[f64]| FrequencyResponse::estimate(u, y, sample_time, welch).map_err(OrderError::Half);
    let halves = [half(&input[..middle], &output[..middle])?, half(&input[middle..], &output[middle..])?];
    let points = halves.each_ref().map(|half| on_lines_of(&response, half, settings));
    let mut scores: Vec<Option<Vec<f64>>> = Vec::new();
    let mut trials = Vec::new();
    for &(numerator, denominator) in orders {
        let settings = RationalSettings { numerator, denominator, ..*settings };
        let score = predict(&points, &settings);
        trials.push(OrderTrial {
            numerator,
            denominator,
            fit: fit_rational(&response, &settings),
            validation: score.as_deref().map(mean),
            worse_by: None,
        });
        scores.push(score);
    }
    let best = (0..trials.len())
        .filter(|&i| trials[i].validation.is_some())
        .min_by(|&a, &b| trials[a].validation.unwrap_or(f64::MAX).total_cmp(&trials[b].validation.unwrap_or(f64::MAX)));
    if let Some(least) = best.and_then(|best| scores[best].clone()) {
        for (trial, score) in trials.iter_mut().zip(&scores) {
            trial.worse_by = score.as_ref().map(|score| standard_errors(score, &least, welch.line_correlation()));
        }
    }
    let recommended = (0..trials.len())
        .filter(|&i| !trials[i].doubtful() && trials[i].worse_by.is_some_and(|by| by <= alarm::MODELS_DIFFER))
        .min_by_key(|&i| trials[i].numerator + trials[i].denominator);
    Ok(OrderComparison { response, trials, recommended })
}

/// The response of one half at the usable lines and with the weights of the whole record. Weights from the few segments
/// of a half would scatter, and both halves must be judged by the same weights.
fn on_lines_of(whole: &FrequencyResponse, half: &FrequencyResponse, settings: &RationalSettings) -> Points {
    let mut lines = whole.clone();
    for (line, of_half) in lines.lines.iter_mut().zip(&half.lines) {
        line.h1 = of_half.h1;
        line.h2 = of_half.h2;
        line.std *= (whole.averages / half.averages).sqrt();
    }
    Points::new(&lines, settings.estimator, settings.low, settings.high)
}

/// Squared error per line of predicting each half from the other, relative to that of noise; nothing where a fit fails.
fn predict(points: &[Points; 2], settings: &RationalSettings) -> Option<Vec<f64>> {
    let mut sum: Vec<f64> = vec![0.0; points[0].len()];
    for (fitted, judged) in [(&points[0], &points[1]), (&points[1], &points[0])] {
        let function = fit_points(fitted, settings).ok()?.function;
        let residuals = judged.residuals(judged.frequency.iter().map(|&w| function.response(w)))?;
        let n = judged.len();
        for (k, value) in sum.iter_mut().enumerate() {
            *value += 0.5 * (residuals[k].powi(2) + residuals[n + k].powi(2)) / judged.expected;
        }
    }
    Some(sum)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Mean difference of two scores over its standard error.
fn standard_errors(score: &[f64], least: &[f64], correlation: f64) -> f64 {
    let differences: Vec<f64> = score.iter().zip(least).map(|(a, b)| a - b).collect();
    let (count, centre) = (differences.len() as f64, mean(&differences));
    let variance = differences.iter().map(|d| (d - centre).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    if variance > 0.0 { centre / (variance * correlation / count).sqrt() } else { 0.0 }
}
