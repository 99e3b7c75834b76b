//! Fit of the parameters of a model, such as physical parameters, directly to a frequency response.
//!
//! Invariant: the cost is that of the rational fit, `sum |H - G(theta)|^2 / std^2` over the usable lines. Parameters are
//! fitted as multiples of their start values, so that small masses and large stiffnesses are scaled alike. Parameters
//! that the data do not determine have an infinite standard deviation, and the unobservable directions are returned.

use crate::points::{Points, information};
use crate::rational::{FitError, FittedValue, minimiser};
use crate::response::{FrequencyResponse, Gap, ResponseEstimator};
use levenberg_marquardt::LeastSquaresProblem;
use num_complex::Complex;
use tpm_numerics::{DMatrix, DVector, Dyn, Iteration, Matrix, Owned, tolerance};

/// Relative step of the central differences, the cube root of the rounding error.
const DIFFERENCE_STEP: f64 = 6e-6;
/// The minimisation of the cost: evaluations per unknown, and the relative change of cost or unknowns; the error of the differences
/// allows no smaller one.
const MINIMISATION: Iteration = Iteration { most: 60, settled: 1e-10 };
/// Largest share of a parameter in an unobservable direction with which the parameter still counts as observable.
const MOST_HIDDEN_SHARE: f64 = 1e-4;

/// A model whose response depends on parameters.
pub trait ResponseModel {
    /// The response at all angular frequencies W (rad/s), G(j W), for one set of parameters.
    ///
    /// Numbers that are not finite reject the parameters.
    fn responses(&self, parameters: &[f64], frequencies: &[f64], out: &mut [Complex<f64>]);
}

/// A function of parameters and s.
impl<F: Fn(&[f64], Complex<f64>) -> Complex<f64>> ResponseModel for F {
    fn responses(&self, parameters: &[f64], frequencies: &[f64], out: &mut [Complex<f64>]) {
        for (value, &frequency) in out.iter_mut().zip(frequencies) {
            *value = self(parameters, Complex::new(0.0, frequency));
        }
    }
}

/// Start values, frozen parameters and band of a fit.
#[derive(Clone, Debug, PartialEq)]
pub struct StructuredSettings {
    /// Start values, one per parameter.
    pub start: Vec<f64>,
    /// Parameters that keep their start values; missing entries are free.
    pub frozen: Vec<bool>,
    /// Lowest frequency, Hz.
    pub low: f64,
    /// Highest frequency, Hz.
    pub high: f64,
    /// Estimate of the response that is fitted.
    pub estimator: ResponseEstimator,
}

impl StructuredSettings {
    /// All parameters free, fitted to the estimate H1.
    #[must_use]
    pub fn new(start: &[f64], low: f64, high: f64) -> Self {
        StructuredSettings { start: start.to_vec(), frozen: Vec::new(), low, high, estimator: ResponseEstimator::H1 }
    }
}

/// Fitted parameters.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct StructuredFit {
    /// One per parameter; standard deviation zero for a frozen one, infinite for one that the data do not determine.
    pub parameters: Vec<FittedValue>,
    /// Covariance in the parameters' units, without the part along unobservable directions.
    pub covariance: Matrix,
    /// Directions in which the response does not change, in multiples of the start values.
    pub unobservable: Vec<Vec<f64>>,
    /// Number of free parameters that are determined.
    pub rank: usize,
    /// Condition number of the column-scaled Jacobian; infinite with unobservable directions.
    pub condition: f64,
    /// Lines that were fitted.
    pub lines: usize,
    /// Mean squared residual over that of noise alone: about 1 when the model is right.
    pub misfit: f64,
    /// Median of |G/H - 1| over the lines.
    pub median_error: f64,
    /// Largest of |G/H - 1|.
    pub largest_error: f64,
    /// Whether the minimisation converged.
    pub converged: bool,
    /// Parts of the band that were left out.
    pub gaps: Vec<Gap>,
}

/// Fits the parameters of a model.
///
/// # Errors
/// [`FitError`] when the band has fewer lines than free parameters or the start values have no finite response.
pub fn fit_structured(
    response: &FrequencyResponse,
    model: &dyn ResponseModel,
    settings: &StructuredSettings,
) -> Result<StructuredFit, FitError> {
    let (low, high) = (settings.low, settings.high);
    let points = Points::new(response, settings.estimator, low, high);
    let free: Vec<usize> =
        (0..settings.start.len()).filter(|&i| !settings.frozen.get(i).copied().unwrap_or(false)).collect();
    if points.len() == 0 {
        return Err(FitError::EmptyBand { low, high });
    }
    if points.len() <= free.len() {
        return Err(FitError::TooFewLines { unknowns: free.len(), lines: points.len(), low, high });
    }
    if let Some((parameter, &value)) = settings.start.iter().enumerate().find(|(_, value)| !value.is_finite()) {
        return Err(FitError::Start { parameter, value });
    }
    let scale: Vec<f64> = settings.start.iter().map(|v| if *v == 0.0 { 1.0 } else { v.abs() }).collect();
    let unknowns = DVector::from_iterator(free.len(), free.iter().map(|&i| settings.start[i] / scale[i]));
    let problem = Problem { points: &points, model, parameters: settings.start.clone(), scale, free, unknowns };
    if problem.residuals().is_none() {
        let value = settings.start.first().copied().unwrap_or(0.0);
        return Err(FitError::Start { parameter: 0, value });
    }
    let (problem, report) = if problem.free.is_empty() {
        (problem, None)
    } else {
        let (problem, report) = minimiser(MINIMISATION).minimize(problem);
        (problem, Some(report))
    };
    let squares = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
    let misfit = points.misfit(squares, problem.free.len());
    let converged = report.is_none_or(|report| report.termination.was_successful()) || misfit < 1e-12;
    Ok(problem.finish(misfit, converged, response.gaps(low, high)))
}

struct Problem<'a> {
    points: &'a Points,
    model: &'a dyn ResponseModel,
    parameters: Vec<f64>,
    scale: Vec<f64>,
    free: Vec<usize>,
    /// Free parameters over their scales.
    unknowns: DVector<f64>,
}

impl Problem<'_> {
    fn responses(&self, parameters: &[f64]) -> Vec<Complex<f64>> {
        let mut out = vec![Complex::from(0.0); self.points.len()];
        self.model.responses(parameters, &self.points.frequency, &mut out);
        out
    }

    fn finish(&self, misfit: f64, converged: bool, gaps: Vec<Gap>) -> StructuredFit {
        let size = self.parameters.len();
        let mut fit = StructuredFit {
            parameters: self.parameters.iter().map(|&value| FittedValue { value, std: 0.0 }).collect(),
            covariance: Matrix::of(DMatrix::zeros(size, size)),
            unobservable: Vec::new(),
            rank: 0,
            condition: 1.0,
            lines: self.points.len(),
            misfit,
            median_error: 0.0,
            largest_error: 0.0,
            converged,
            gaps,
        };
        (fit.median_error, fit.largest_error) = self.points.relative_errors(self.responses(&self.parameters));
        let Some(jacobian) = self.jacobian().filter(|j| j.ncols() > 0) else { return fit };
        let found = information(&jacobian, self.points.variance(misfit), tolerance::DIFFERENCED_RANK);
        let mut covariance = DMatrix::zeros(size, size);
        fit.rank = found.rank;
        fit.condition = found.condition;
        for (a, &i) in self.free.iter().enumerate() {
            for (b, &j) in self.free.iter().enumerate() {
                covariance[(i, j)] = found.covariance[(a, b)] * self.scale[i] * self.scale[j];
            }
            let lost = found.null.iter().any(|direction| direction[a].abs() > MOST_HIDDEN_SHARE);
            fit.parameters[i].std = if lost { f64::INFINITY } else { covariance[(i, i)].max(0.0).sqrt() };
        }
        fit.covariance = Matrix::of(covariance);
        for direction in &found.null {
            let mut whole = vec![0.0; size];
            for (a, &i) in self.free.iter().enumerate() {
                whole[i] = direction[a];
            }
            fit.unobservable.push(whole);
        }
        fit
    }
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.unknowns.copy_from(x);
        for (a, &i) in self.free.iter().enumerate() {
            self.parameters[i] = x[a] * self.scale[i];
        }
    }

    fn params(&self) -> DVector<f64> {
        self.unknowns.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.points.residuals(self.responses(&self.parameters))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let n = self.points.len();
        let mut jacobian = DMatrix::zeros(2 * n, self.free.len());
        let mut moved = self.parameters.clone();
        for (a, &i) in self.free.iter().enumerate() {
            let step = DIFFERENCE_STEP * self.unknowns[a].abs().max(1e-3) * self.scale[i];
            moved[i] = self.parameters[i] + step;
            let above = self.responses(&moved);
            moved[i] = self.parameters[i] - step;
            let below = self.responses(&moved);
            moved[i] = self.parameters[i];
            for k in 0..n {
                let slope = (above[k] - below[k]) * (self.points.weight[k] * self.scale[i] / (2.0 * step));
                jacobian[(k, a)] = -slope.re;
                jacobian[(n + k, a)] = -slope.im;
            }
        }
        jacobian.iter().all(|value| value.is_finite()).then_some(jacobian)
    }
}
