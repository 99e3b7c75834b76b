//! Fit of a rational transfer function of chosen orders to a frequency response.
//!
//! Invariant: the cost is `sum |H - G|^2 / std^2` over the usable lines, at every stage the same; 1/std is
//! `sqrt(coherence/(1 - coherence))/|H|` up to a constant. First the residual is made linear,
//! `(a H e^{s delay} - b)/a_last` with the denominator of the round before (Sanathanan and Koerner, 1963), then the
//! cost itself is minimised (Levenberg-Marquardt). Polynomials are expressed in a basis that is orthonormal on the
//! frequencies; the denominator's leading coordinate is 1.

use crate::basis::Basis;
use crate::points::{Information, Points, information, least_squares};
use crate::response::{FrequencyResponse, Gap, ResponseEstimator};
use crate::transfer::{TransferFunction, derivative, polynomial, roots};
use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use num_complex::Complex;
use tpm_motion::Window;
use tpm_numerics::{DMatrix, DVector, Dyn, Iteration, Matrix, Owned, tolerance};

/// Rounds of the linear stage, until the cost changes by no more than a share of it; where it converges, it does so within ten.
const LINEAR_STAGE: Iteration = Iteration { most: 30, settled: 1e-10 };
/// The linear stage after which the costs of the delays that are tried are compared.
const LINEAR_TRIAL: Iteration = Iteration { most: 4, ..LINEAR_STAGE };
/// The minimisation of the cost: evaluations per unknown, and the relative change of cost or unknowns.
const MINIMISATION: Iteration = Iteration { most: 60, settled: 1e-12 };
/// Delays that are tried before one is fitted, in steps of [`DELAY_STEP`] from the start value.
const DELAY_STEPS_TRIED: std::ops::RangeInclusive<i32> = -4..=12;
/// Distance of the delays that are tried, as a phase at the highest frequency, rad: close enough for the minimisation to find the
/// right turn.
const DELAY_STEP: f64 = 0.5;
/// Least length of a segment, in time constants of a pole, at which the window widens the resonance by a few per cent at most.
const RESOLVED_LENGTH: f64 = 15.0;
/// Largest distance of a pole and a zero that cancel, in standard deviations.
const CANCELLING_DEVIATIONS: f64 = 3.0;
/// Largest distance of a pole and a zero, as a share of their magnitude, that cancel whatever their standard
/// deviations.
const CANCELLING_DISTANCE: f64 = 1e-2;
/// Standard deviation of a pole, as a share of its magnitude, beyond which the data do not determine the pole.
const MOST_RELATIVE_DEVIATION: f64 = 0.5;

/// The delay between input and output: none, known or fitted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Delay {
    /// No delay.
    #[default]
    None,
    /// A known delay, s.
    Fixed(f64),
    /// A delay that is fitted, from this start value, s.
    Free(f64),
}

/// Degrees, band and delay of the function that is fitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RationalSettings {
    /// Degree of the numerator.
    pub numerator: usize,
    /// Degree of the denominator.
    pub denominator: usize,
    /// Lowest frequency, Hz.
    pub low: f64,
    /// Highest frequency, Hz.
    pub high: f64,
    /// Delay.
    pub delay: Delay,
    /// Estimate of the response that is fitted.
    pub estimator: ResponseEstimator,
}

impl RationalSettings {
    /// Degrees and band, fitted to the estimate H1 without a delay.
    #[must_use]
    pub const fn new(numerator: usize, denominator: usize, low: f64, high: f64) -> Self {
        RationalSettings { numerator, denominator, low, high, delay: Delay::None, estimator: ResponseEstimator::H1 }
    }

    /// Number of real unknowns.
    #[must_use]
    pub const fn unknowns(&self) -> usize {
        self.numerator + 1 + self.denominator + if matches!(self.delay, Delay::Free(_)) { 1 } else { 0 }
    }
}

/// Why nothing was fitted.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FitError {
    /// The band holds no usable line.
    #[error(
        "no line from {low} to {high} Hz has a usable response: the band was not excited, or the output does not follow the input"
    )]
    EmptyBand {
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
    },
    /// More unknowns than the lines can determine.
    #[error(
        "{unknowns} numbers cannot be fitted to {lines} usable lines from {low} to {high} Hz; lower the order, widen the band or take longer segments"
    )]
    TooFewLines {
        /// Unknowns.
        unknowns: usize,
        /// Usable lines.
        lines: usize,
        /// Lowest frequency, Hz.
        low: f64,
        /// Highest frequency, Hz.
        high: f64,
    },
    /// The computation did not stay finite.
    #[error("the fit of order {numerator}/{denominator} did not stay finite; lower the order or narrow the band")]
    NotFinite {
        /// Degree of the numerator.
        numerator: usize,
        /// Degree of the denominator.
        denominator: usize,
    },
    /// A start value or a response of a structured model is no number.
    #[error(
        "parameter {parameter} starts at {value}, where the model has no finite response to fit; give other start values"
    )]
    Start {
        /// Index of the parameter.
        parameter: usize,
        /// Its value.
        value: f64,
    },
}

/// A number with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FittedValue {
    /// The number.
    pub value: f64,
    /// Standard deviation of the number; infinite when the data do not determine it.
    pub std: f64,
}

/// A pole or zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Root {
    /// The root in the complex plane, rad/s.
    pub value: Complex<f64>,
    /// Standard deviations of real and imaginary part, rad/s.
    pub std: Complex<f64>,
}

impl Root {
    /// Square root of the summed variances of both parts, rad/s.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.std.norm()
    }

    /// Distance from zero, rad/s.
    #[must_use]
    pub fn natural_frequency(&self) -> f64 {
        self.value.norm()
    }

    /// Damping ratio, negative when unstable.
    #[must_use]
    pub fn damping(&self) -> f64 {
        -self.value.re / self.value.norm()
    }
}

/// A warning about a fit.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum FitWarning {
    /// A pole lies in the right half plane.
    Unstable {
        /// The pole.
        pole: Root,
    },
    /// A pole and a zero lie on each other: the order is higher than the data support.
    Cancelling {
        /// The pole.
        pole: Root,
        /// The zero.
        zero: Root,
    },
    /// A pole is not determined: the order is higher than the data support.
    Undetermined {
        /// The pole.
        pole: Root,
    },
    /// Coefficients depend on each other on this data: the order is higher than the data support.
    RankDeficient {
        /// Number of unknowns that are determined.
        rank: usize,
        /// Unknowns.
        unknowns: usize,
    },
    /// The residual is more than noise.
    Misfit {
        /// Mean squared residual over that of noise alone.
        misfit: f64,
    },
    /// A resonance is narrow for the segments: the window widens it, and its damping comes out too high.
    Unresolved {
        /// The pole.
        pole: Root,
        /// Duration of a segment, s.
        segment: f64,
    },
    /// The minimisation ended without having converged.
    NotConverged,
    /// Part of the band was left out.
    Gap(Gap),
}

impl FitWarning {
    /// Whether the warning means that the order is higher than the data support.
    #[must_use]
    pub const fn order_too_high(&self) -> bool {
        matches!(
            self,
            FitWarning::Cancelling { .. } | FitWarning::Undetermined { .. } | FitWarning::RankDeficient { .. }
        )
    }
}

impl std::fmt::Display for Root {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Root { value, std } = self;
        let known = std.re.is_finite() && std.im.is_finite();
        match (value.im == 0.0, known) {
            (true, true) => write!(f, "{:.4} +- {:.2e} rad/s", value.re, std.re),
            (true, false) => write!(f, "about {:.3e} rad/s, of unknown deviation", value.re),
            (false, true) => {
                write!(f, "{:.4} {:+.4}j rad/s (+- {:.2e}, {:.2e})", value.re, value.im, std.re, std.im)
            }
            (false, false) => write!(f, "about {:.3e} {:+.3e}j rad/s, of unknown deviation", value.re, value.im),
        }
    }
}

impl std::fmt::Display for FitWarning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            FitWarning::Unstable { pole } => write!(
                f,
                "the fit is unstable: pole at {pole}; when the machine was measured in open loop, lower the order, widen the band or fit \
                 a delay"
            ),
            FitWarning::Cancelling { pole, zero } => write!(
                f,
                "pole at {pole} and zero at {zero} cancel: the order is higher than the data support, lower both degrees by one"
            ),
            FitWarning::Undetermined { pole } => {
                write!(f, "the pole at {pole} is not determined: the order is higher than the data support")
            }
            FitWarning::RankDeficient { rank, unknowns } => write!(
                f,
                "only {rank} of {unknowns} coefficients are determined: the order is higher than the data support"
            ),
            FitWarning::Misfit { misfit } => write!(
                f,
                "the residual has {misfit:.1} times the power that noise explains: the order is too low, the machine not linear, \
                 or the segments too short"
            ),
            FitWarning::Unresolved { pole, segment } => write!(
                f,
                "segments of {segment:.3} s resolve the pole at {pole} poorly, its damping comes out too high: take segments of {:.3} s",
                RESOLVED_LENGTH / pole.value.re.abs()
            ),
            FitWarning::NotConverged => f.write_str("the minimisation ended before it converged"),
            FitWarning::Gap(gap) => gap.fmt(f),
        }
    }
}

/// A fitted transfer function.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct RationalFit {
    /// The function.
    pub function: TransferFunction,
    /// Standard deviations of the numerator's coefficients, from s^0 upwards.
    pub numerator_std: Vec<f64>,
    /// Standard deviations of the denominator's coefficients, from s^0 upwards; zero for the leading one, which is 1.
    pub denominator_std: Vec<f64>,
    /// Standard deviation of the delay, s; zero when it was not fitted.
    pub delay_std: f64,
    /// Covariance of numerator, denominator without the leading 1, and delay if fitted.
    pub covariance: Matrix,
    /// Poles, rad/s.
    pub poles: Vec<Root>,
    /// Zeros, rad/s.
    pub zeros: Vec<Root>,
    /// The value at s = 0.
    pub static_gain: FittedValue,
    /// Lines that were fitted.
    pub lines: usize,
    /// Mean squared residual over that of noise alone: about 1 when the model is right.
    pub misfit: f64,
    /// Median of |G/H - 1| over the lines.
    pub median_error: f64,
    /// Largest of |G/H - 1|.
    pub largest_error: f64,
    /// Condition number of the column-scaled Jacobian.
    pub condition: f64,
    /// Warnings about the fit.
    pub warnings: Vec<FitWarning>,
}

/// Fits a rational transfer function.
///
/// Standard deviations account for the noise that the coherence shows and for the correlation of neighbouring lines.
/// They are enlarged by the root of the misfit where that is more than 1.
///
/// # Errors
/// [`FitError`] when the lines cannot determine the unknowns.
pub fn fit_rational(response: &FrequencyResponse, settings: &RationalSettings) -> Result<RationalFit, FitError> {
    let points = Points::new(response, settings.estimator, settings.low, settings.high);
    let mut fit = fit_points(&points, settings)?;
    fit.warnings.extend(response.gaps(settings.low, settings.high).into_iter().map(FitWarning::Gap));
    if response.welch.window == Window::Hann {
        let segment = response.welch.segment as f64 * response.sample_time;
        let narrow = |pole: &&Root| {
            let resonance = pole.value.im > pole.value.re.abs();
            resonance
                && pole.value.re.abs() * segment < RESOLVED_LENGTH
                && pole.radius() < MOST_RELATIVE_DEVIATION * pole.value.norm()
        };
        fit.warnings.extend(fit.poles.iter().filter(narrow).map(|&pole| FitWarning::Unresolved { pole, segment }));
    }
    Ok(fit)
}

pub(super) fn fit_points(points: &Points, settings: &RationalSettings) -> Result<RationalFit, FitError> {
    let RationalSettings { low, high, numerator, denominator, .. } = *settings;
    let (lines, unknowns) = (points.len(), settings.unknowns());
    if lines == 0 {
        return Err(FitError::EmptyBand { low, high });
    }
    // With fewer lines the residual would not show whether the model is right.
    if lines <= unknowns {
        return Err(FitError::TooFewLines { unknowns, lines, low, high });
    }
    let basis = Basis::new(&points.frequency, numerator.max(denominator)).ok_or(FitError::TooFewLines {
        unknowns,
        lines,
        low,
        high,
    })?;
    let diverged = FitError::NotFinite { numerator, denominator };
    let start = Problem::start(points, &basis, settings).ok_or(diverged)?;
    let (problem, report) = minimiser(MINIMISATION).minimize(start);
    let squares = problem.residuals().map(|r| r.norm_squared()).filter(|s| s.is_finite()).ok_or(diverged)?;
    let misfit = points.misfit(squares, unknowns);
    let jacobian = problem.jacobian().ok_or(diverged)?;
    let information = information(&jacobian, points.variance(misfit), tolerance::RANK);
    // A sum of squares at the level of rounding cannot be reduced further, which is reported as a failure.
    let converged = report.termination.was_successful() || misfit < 1e-12;
    problem.finish(misfit, &information, converged)
}

/// The minimisation of a sum of squares by Levenberg and Marquardt.
pub(super) fn minimiser(bounds: Iteration) -> LevenbergMarquardt<f64> {
    LevenbergMarquardt::new().with_ftol(bounds.settled).with_xtol(bounds.settled).with_patience(bounds.most)
}

/// The unknowns: coordinates of the numerator, of the denominator without its leading one, the delay times the scale.
struct Problem<'a> {
    points: &'a Points,
    basis: &'a Basis,
    settings: &'a RationalSettings,
    unknowns: DVector<f64>,
}

impl<'a> Problem<'a> {
    /// The result of the linear stage; where the delay is fitted, at the best of several delays.
    fn start(points: &'a Points, basis: &'a Basis, settings: &'a RationalSettings) -> Option<Self> {
        let delay = match settings.delay {
            Delay::None => 0.0,
            Delay::Fixed(delay) => delay,
            Delay::Free(start) => DELAY_STEPS_TRIED
                .map(|i| start + f64::from(i) * DELAY_STEP / basis.scale)
                .filter_map(|delay| Some((Self::linear(points, basis, settings, delay, LINEAR_TRIAL)?.0, delay)))
                .min_by(|a, b| a.0.total_cmp(&b.0))
                .map_or(start, |(_, delay)| delay),
        };
        Self::linear(points, basis, settings, delay, LINEAR_STAGE).map(|(_, problem)| problem)
    }

    /// Rounds of linear fits at one delay; the round with the least cost and that cost. `None` when no round stayed
    /// finite.
    fn linear(
        points: &'a Points,
        basis: &'a Basis,
        settings: &'a RationalSettings,
        delay: f64,
        rounds: Iteration,
    ) -> Option<(f64, Self)> {
        let linear = settings.numerator + 1 + settings.denominator;
        let n = points.len();
        let mut last: Vec<f64> = vec![1.0; n];
        let mut best: Option<(f64, Self)> = None;
        let mut cost = f64::INFINITY;
        for _ in 0..rounds.most {
            let mut matrix = DMatrix::zeros(2 * n, linear);
            let mut right = DVector::zeros(2 * n);
            for k in 0..n {
                let weight = points.weight[k] / last[k];
                let advance = Complex::from_polar(1.0, points.frequency[k] * delay);
                let h = points.response[k] * advance;
                let mut put = |column: usize, value: Complex<f64>| {
                    matrix[(k, column)] = value.re * weight;
                    matrix[(n + k, column)] = value.im * weight;
                };
                for i in 0..=settings.numerator {
                    put(i, basis.values[i][k]);
                }
                for i in 0..settings.denominator {
                    put(settings.numerator + 1 + i, -(h * basis.values[i][k]));
                }
                let known = h * basis.values[settings.denominator][k] * weight;
                right[k] = known.re;
                right[n + k] = known.im;
            }
            let mut unknowns = least_squares(matrix, &right);
            if matches!(settings.delay, Delay::Free(_)) {
                unknowns = unknowns.push(delay * basis.scale);
            }
            let problem = Problem { points, basis, settings, unknowns };
            for (k, value) in last.iter_mut().enumerate() {
                *value = problem.denominator(k).norm();
            }
            let now = problem.residuals().map_or(f64::INFINITY, |r| r.norm_squared());
            if !now.is_finite() {
                break;
            }
            let settled = (cost - now).abs() <= rounds.settled * now;
            cost = now;
            if best.as_ref().is_none_or(|(least, _)| now < *least) {
                best = Some((now, problem));
            }
            if settled {
                break;
            }
        }
        best
    }

    fn split(&self) -> (&[f64], &[f64]) {
        let all = self.unknowns.as_slice();
        let (numerator, rest) = all.split_at(self.settings.numerator + 1);
        (numerator, &rest[..self.settings.denominator])
    }

    fn denominator(&self, k: usize) -> Complex<f64> {
        self.basis.value(self.split().1, k) + self.basis.values[self.settings.denominator][k]
    }

    fn numerator(&self, k: usize) -> Complex<f64> {
        self.basis.value(self.split().0, k)
    }

    fn delay(&self) -> f64 {
        match self.settings.delay {
            Delay::None => 0.0,
            Delay::Fixed(delay) => delay,
            Delay::Free(_) => self.unknowns[self.settings.unknowns() - 1] / self.basis.scale,
        }
    }

    fn model(&self, k: usize) -> Complex<f64> {
        let delayed = Complex::from_polar(1.0, -self.points.frequency[k] * self.delay());
        delayed * self.numerator(k) / self.denominator(k)
    }

    fn finish(&self, misfit: f64, information: &Information, converged: bool) -> Result<RationalFit, FitError> {
        let RationalSettings { numerator: m, denominator: n, .. } = *self.settings;
        // 1. Coefficients in powers of s; they are linear in the coordinates, and the denominator's leading one is a
        // constant.
        let (b, a) = self.split();
        let full: Vec<f64> = a.iter().copied().chain([1.0]).collect();
        let leading = self.basis.coefficients[(n, n)] / self.basis.scale.powi(n as i32);
        // Maps from coordinates in the basis to coefficients, with the denominator made monic.
        let of_numerator = self.basis.to_powers(m) / leading;
        let of_denominator = self.basis.to_powers(n) / leading;
        let mut function = TransferFunction {
            numerator: (&of_numerator * DVector::from_column_slice(b)).as_slice().to_vec(),
            denominator: (&of_denominator * DVector::from_vec(full)).as_slice().to_vec(),
            delay: self.delay(),
        };
        function.denominator[n] = 1.0;
        if function.numerator.iter().chain(&function.denominator).any(|c| !c.is_finite()) {
            return Err(FitError::NotFinite { numerator: m, denominator: n });
        }
        // 2. Covariance of these coefficients.
        let size = self.settings.unknowns();
        let mut map = DMatrix::zeros(size, size);
        map.view_mut((0, 0), (m + 1, m + 1)).copy_from(&of_numerator);
        map.view_mut((m + 1, m + 1), (n, n)).copy_from(&of_denominator.view((0, 0), (n, n)));
        if size > m + 1 + n {
            map[(size - 1, size - 1)] = 1.0 / self.basis.scale;
        }
        let covariance = &map * &information.covariance * map.transpose();
        let deficient = information.rank < size;
        let std = |i: usize| if deficient { f64::INFINITY } else { covariance[(i, i)].max(0.0).sqrt() };
        // 3. Errors, poles, zeros and static gain, with their standard deviations.
        let errors = self.points.relative_errors(self.points.frequency.iter().map(|&w| function.response(w)));
        let lowest = self.points.frequency.first().copied().unwrap_or(0.0);
        let gradient = gain_gradient(&function, size);
        let gain_variance = (gradient.transpose() * &covariance * &gradient)[(0, 0)];
        let mut fit = RationalFit {
            numerator_std: (0..=m).map(std).collect(),
            denominator_std: (0..n).map(|i| std(m + 1 + i)).chain([0.0]).collect(),
            delay_std: if size > m + 1 + n { std(size - 1) } else { 0.0 },
            poles: spread(&function.denominator, &covariance, m + 1, n, deficient),
            zeros: spread(&function.numerator, &covariance, 0, m + 1, deficient),
            static_gain: FittedValue {
                value: function.static_gain(),
                std: if deficient { f64::INFINITY } else { gain_variance.max(0.0).sqrt() },
            },
            covariance: Matrix::of(covariance),
            lines: self.points.len(),
            misfit,
            median_error: errors.0,
            largest_error: errors.1,
            condition: information.condition,
            warnings: Vec::new(),
            function,
        };
        fit.warnings = warnings(&fit, lowest, information.rank, size, converged);
        Ok(fit)
    }
}

/// Derivative of b0/a0 by all unknowns.
fn gain_gradient(function: &TransferFunction, size: usize) -> DVector<f64> {
    let mut gradient = DVector::zeros(size);
    let (b, a) = (function.numerator[0], function.denominator[0]);
    gradient[0] = 1.0 / a;
    if function.denominator.len() > 1 {
        gradient[function.numerator.len()] = -b / (a * a);
    }
    gradient
}

/// Roots with standard deviations propagated to first order from the coefficients, `dp = -sum p^i dc_i / c'(p)`.
fn spread(coefficients: &[f64], covariance: &DMatrix<f64>, first: usize, count: usize, deficient: bool) -> Vec<Root> {
    let slope = derivative(coefficients);
    roots(coefficients)
        .into_iter()
        .map(|value| {
            let by = Complex::from(-1.0) / polynomial(&slope, value);
            let mut power = by;
            let (mut re, mut im) = (DVector::zeros(count), DVector::zeros(count));
            for i in 0..count {
                re[i] = power.re;
                im[i] = power.im;
                power *= value;
            }
            let block = covariance.view((first, first), (count, count));
            let of = |direction: &DVector<f64>| {
                let variance = (direction.transpose() * block * direction)[(0, 0)];
                if deficient || !variance.is_finite() { f64::INFINITY } else { variance.max(0.0).sqrt() }
            };
            // To first order the imaginary part of a real root does not vary.
            let std = Complex::new(of(&re), if value.im == 0.0 { 0.0 } else { of(&im) });
            Root { value, std }
        })
        .collect()
}

fn warnings(fit: &RationalFit, lowest: f64, rank: usize, unknowns: usize, converged: bool) -> Vec<FitWarning> {
    let mut warnings = Vec::new();
    if !converged {
        warnings.push(FitWarning::NotConverged);
    }
    if rank < unknowns {
        warnings.push(FitWarning::RankDeficient { rank, unknowns });
    }
    for pole in fit.poles.iter().filter(|pole| pole.value.im >= 0.0) {
        if pole.value.re > 0.0 {
            warnings.push(FitWarning::Unstable { pole: *pole });
        }
        // The standard deviation of a pole near zero is compared with the lowest frequency that was fitted.
        if pole.radius() > MOST_RELATIVE_DEVIATION * pole.value.norm().max(lowest) {
            warnings.push(FitWarning::Undetermined { pole: *pole });
            continue;
        }
        let cancelled = fit
            .zeros
            .iter()
            .min_by(|a, b| (a.value - pole.value).norm().total_cmp(&(b.value - pole.value).norm()))
            .filter(|zero| {
                let distance = (zero.value - pole.value).norm();
                let size = pole.value.norm().max(zero.value.norm());
                // A zero with a large standard deviation does not count as lying on a pole.
                let known = zero.radius() <= MOST_RELATIVE_DEVIATION * pole.value.norm().max(lowest);
                distance <= CANCELLING_DISTANCE * size
                    || (known && distance <= CANCELLING_DEVIATIONS * zero.radius().hypot(pole.radius()))
            });
        if let Some(zero) = cancelled {
            warnings.push(FitWarning::Cancelling { pole: *pole, zero: *zero });
        }
    }
    // Twice the power of noise is far outside the scatter of a mean over the lines of a fit.
    if fit.misfit > 2.0 {
        warnings.push(FitWarning::Misfit { misfit: fit.misfit });
    }
    warnings
}

impl LeastSquaresProblem<f64, Dyn, Dyn> for Problem<'_> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, x: &DVector<f64>) {
        self.unknowns.copy_from(x);
    }

    fn params(&self) -> DVector<f64> {
        self.unknowns.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        self.points.residuals((0..self.points.len()).map(|k| self.model(k)))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let n = self.points.len();
        let (m, d) = (self.settings.numerator, self.settings.denominator);
        let mut jacobian = DMatrix::zeros(2 * n, self.settings.unknowns());
        for k in 0..n {
            let model = self.model(k);
            let denominator = self.denominator(k);
            let delayed = Complex::from_polar(1.0, -self.points.frequency[k] * self.delay());
            let mut put = |column: usize, value: Complex<f64>| {
                let value = -(value * self.points.weight[k]);
                jacobian[(k, column)] = value.re;
                jacobian[(n + k, column)] = value.im;
            };
            for i in 0..=m {
                put(i, delayed * self.basis.values[i][k] / denominator);
            }
            for i in 0..d {
                put(m + 1 + i, -(model * self.basis.values[i][k] / denominator));
            }
            if matches!(self.settings.delay, Delay::Free(_)) {
                put(m + 1 + d, -(model * Complex::new(0.0, self.points.frequency[k] / self.basis.scale)));
            }
        }
        Some(jacobian)
    }
}
