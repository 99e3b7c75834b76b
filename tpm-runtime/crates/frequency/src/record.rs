//! Fit of a rational transfer function to the Fourier transform of a whole record.
//!
//! With U and Y the transforms of the whole record, without a window, a machine that was not at rest at both ends
//! satisfies
//!
//! ```text
//! a(s) Y = b(s) U + c(s) + a(s) V,   s = j W at the lines W = 2 pi k / (N T),
//! ```
//!
//! exactly; c, of lower degree than a, is the transient between the state at the end and that at the start (R. Pintelon,
//! J. Schoukens, System Identification, section 6.3). V, the noise on the output, is smooth in frequency: its power is that of
//! the residuals of neighbouring lines. The sum of `|Y - (b U + c)/a|^2 / power` is then minimal at the
//! maximum-likelihood b and a. Invariant: b and a are fitted to the points `(Y - c/a)/U`; c and the power of the noise
//! are estimated in turn with them until convergence. A transient far above the response can lead to wrong values: cut
//! off such a start of the record. Lines of bands without a usable averaged response are left out here too.

use crate::points::{Points, least_squares};
use crate::rational::{FitError, FitWarning, RationalFit, RationalSettings, fit_points, fit_rational};
use crate::response::{FrequencyResponse, ResponseError, Welch, hold_of};
use crate::transfer::polynomial;
use num_complex::Complex;
use std::f64::consts::PI;
use tpm_numerics::fourier::forward;
use tpm_numerics::{DMatrix, DVector, Iteration};

/// Rounds of estimating transient, coefficients and noise power in turn, until the median relative change of the response is small; they
/// converge within five.
const ROUNDS: Iteration = Iteration { most: 20, settled: 1e-7 };
/// Number of windows, side by side across the band, over each of which the power of the noise is averaged.
const NOISE_WINDOWS: usize = 14;
/// Least number of lines on either side over which the power of the noise is averaged.
const LEAST_LINES_PER_SIDE: usize = 20;
/// Input power, as a share of the mean, below which a line is left out as not excited.
const LEAST_INPUT_POWER: f64 = 1e-12;

/// Why a record was not fitted.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RecordFitError {
    /// The record has no frequency response.
    #[error(transparent)]
    Response(#[from] ResponseError),
    /// Nothing was fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Fits a rational transfer function to a whole record: smaller errors than by the averaged response where noise is strong.
///
/// The averaged response gives the first fit, the usable lines, and the misfit and errors that are reported. The model
/// assumes noise on the output alone.
///
/// # Errors
/// [`RecordFitError::Response`] when the record has no averaged response, [`RecordFitError::Fit`] when its lines do not
/// determine the unknowns.
pub fn fit_record(
    input: &[f64],
    output: &[f64],
    sample_time: f64,
    welch: &Welch,
    settings: &RationalSettings,
) -> Result<RationalFit, RecordFitError> {
    let response = FrequencyResponse::estimate(input, output, sample_time, welch)?;
    let averaged = fit_rational(&response, settings)?;
    let lines = Lines::new(input, output, &response, settings);
    let (low, high) = (settings.low, settings.high);
    if lines.frequency.len() <= 2 * settings.unknowns() {
        let (unknowns, lines) = (settings.unknowns(), lines.frequency.len());
        return Err(FitError::TooFewLines { unknowns, lines, low, high }.into());
    }
    let mut fit = averaged.clone();
    let mut model = lines.model(&fit);
    let mut settled = false;
    let mut power = lines.smoothed(&lines.residual(&model, &[]));
    for _ in 0..ROUNDS.most {
        let transient = lines.transient(&fit, &model, &power);
        power = lines.smoothed(&lines.residual(&model, &transient));
        fit = fit_points(&lines.points(&transient, &power), settings)?;
        let next = lines.model(&fit);
        let mut changes: Vec<f64> = next.iter().zip(&model).map(|(now, before)| (now / before - 1.0).norm()).collect();
        changes.sort_by(f64::total_cmp);
        model = next;
        if changes[changes.len() / 2] <= ROUNDS.settled {
            settled = true;
            break;
        }
    }
    // Weights from the residuals themselves make any misfit one, so that the misfit is that of the averaged response.
    fit.misfit = averaged.misfit;
    let points = Points::new(&response, settings.estimator, low, high);
    (fit.median_error, fit.largest_error) =
        points.relative_errors(points.frequency.iter().map(|&w| fit.function.response(w)));
    fit.warnings.retain(|warning| !matches!(warning, FitWarning::Misfit { .. } | FitWarning::NotConverged));
    if !settled {
        fit.warnings.push(FitWarning::NotConverged);
    }
    let of_response = |warning: &&FitWarning| matches!(warning, FitWarning::Misfit { .. } | FitWarning::Gap(_));
    fit.warnings.extend(averaged.warnings.iter().filter(of_response).cloned());
    Ok(fit)
}

/// Lines of the transforms of a whole record.
struct Lines {
    frequency: Vec<f64>,
    /// Transform of the input as the machine received it, the hold included.
    input: Vec<Complex<f64>>,
    output: Vec<Complex<f64>>,
    /// Number of terms of the transient's numerator c.
    terms: usize,
    scale: f64,
}

impl Lines {
    fn new(input: &[f64], output: &[f64], response: &FrequencyResponse, settings: &RationalSettings) -> Self {
        let (count, sample_time) = (input.len(), response.sample_time);
        let plan = forward(count);
        let transform = |samples: &[f64]| {
            let mut samples = samples.to_vec();
            let mut spectrum = plan.make_output_vec();
            plan.process(&mut samples, &mut spectrum).expect("invariant: buffers were made for this transform");
            spectrum
        };
        let (of_input, of_output) = (transform(input), transform(output));
        let spacing = 2.0 * PI / (count as f64 * sample_time);
        let averaged = response.lines.get(1).map_or(spacing, |line| line.frequency);
        let band = 2.0 * PI * settings.low..=2.0 * PI * settings.high;
        let mean = of_input.iter().map(Complex::norm_sqr).sum::<f64>() / of_input.len() as f64;
        let mut lines = Lines {
            frequency: Vec::new(),
            input: Vec::new(),
            output: Vec::new(),
            terms: settings.denominator.max(settings.numerator + 1),
            scale: 2.0 * PI * settings.high,
        };
        for (k, (u, y)) in of_input.iter().zip(&of_output).enumerate().skip(1) {
            let frequency = k as f64 * spacing;
            let nearest = response.lines.get((frequency / averaged).round() as usize);
            if band.contains(&frequency)
                && nearest.is_some_and(|line| line.usable)
                && u.norm_sqr() > LEAST_INPUT_POWER * mean
            {
                lines.frequency.push(frequency);
                lines.input.push(u * hold_of(frequency, sample_time, response.welch.hold));
                lines.output.push(*y);
            }
        }
        lines
    }

    fn model(&self, fit: &RationalFit) -> Vec<Complex<f64>> {
        self.frequency.iter().map(|&w| fit.function.response(w)).collect()
    }

    /// Residual of the output: the transform minus the model's response to the input and the transient.
    fn residual(&self, model: &[Complex<f64>], transient: &[Complex<f64>]) -> Vec<Complex<f64>> {
        let explained = self.input.iter().zip(model).map(|(u, g)| u * g);
        let mut residual: Vec<Complex<f64>> = self.output.iter().zip(explained).map(|(y, gu)| y - gu).collect();
        for (left, part) in residual.iter_mut().zip(transient) {
            *left -= part;
        }
        residual
    }

    /// Power of the residual at every line, averaged over neighbouring lines.
    fn smoothed(&self, residual: &[Complex<f64>]) -> Vec<f64> {
        let reach = (residual.len() / (2 * NOISE_WINDOWS)).max(LEAST_LINES_PER_SIDE);
        let mut sums = Vec::with_capacity(residual.len() + 1);
        let mut sum = 0.0;
        sums.push(sum);
        for value in residual {
            sum += value.norm_sqr();
            sums.push(sum);
        }
        (0..residual.len())
            .map(|k| {
                let (first, last) = (k.saturating_sub(reach), (k + reach + 1).min(residual.len()));
                ((sums[last] - sums[first]) / (last - first) as f64).max(f64::MIN_POSITIVE)
            })
            .collect()
    }

    /// The transient c/a at every line, with a from a fit and c by weighted least squares.
    fn transient(&self, fit: &RationalFit, model: &[Complex<f64>], power: &[f64]) -> Vec<Complex<f64>> {
        let n = self.frequency.len();
        let s: Vec<Complex<f64>> = self.frequency.iter().map(|w| Complex::new(0.0, *w)).collect();
        let over: Vec<Complex<f64>> = s.iter().map(|s| polynomial(&fit.function.denominator, *s).inv()).collect();
        let term = |k: usize, i: usize| over[k] * (s[k] / self.scale).powu(i as u32);
        let mut matrix = DMatrix::zeros(2 * n, self.terms);
        let mut right = DVector::zeros(2 * n);
        for (k, left) in self.residual(model, &[]).iter().enumerate() {
            let weight = 1.0 / power[k].sqrt();
            for i in 0..self.terms {
                let value = term(k, i) * weight;
                matrix[(k, i)] = value.re;
                matrix[(n + k, i)] = value.im;
            }
            right[k] = left.re * weight;
            right[n + k] = left.im * weight;
        }
        let found = least_squares(matrix, &right);
        (0..n).map(|k| (0..self.terms).map(|i| term(k, i) * found[i]).sum()).collect()
    }

    /// The response without the transient, weighted by its noise.
    fn points(&self, transient: &[Complex<f64>], power: &[f64]) -> Points {
        let of = |k: usize| (self.output[k] - transient[k]) / self.input[k];
        Points {
            frequency: self.frequency.clone(),
            response: (0..self.frequency.len()).map(of).collect(),
            weight: self.input.iter().zip(power).map(|(u, p)| (u.norm_sqr() / p).sqrt()).collect(),
            // Each weight is an average over many lines, and the lines of a whole record are uncorrelated.
            expected: 1.0,
            correlation: 1.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{RecordFitError, fit_record};
    use crate::excitation::Excitation;
    use crate::rational::{Delay, FitError, RationalSettings};
    use crate::response::Welch;
    use tpm_controller::harmonics::Hold;

    /// y' = -3 y + u from y(0), exact at the samples.
    fn lag(u: &[f64], start: f64) -> Vec<f64> {
        let keep = (-3e-3_f64).exp();
        let mut y = start;
        let step = |u: &f64| {
            let now = y;
            y = keep * y + (1.0 - keep) / 3.0 * u;
            now
        };
        u.iter().map(step).collect()
    }

    #[test]
    fn a_transient_is_no_noise() {
        let u = Excitation::Noise { std: 1.0, hold: 2e-3, seed: 4 }.samples(8192, 1e-3).expect("valid");
        let settings = RationalSettings::new(0, 1, 0.5, 20.0);
        // Its response to the input has a root mean square of 0.018.
        for start in [0.0, 0.05] {
            let y = lag(&u, start);
            let fit = fit_record(&u, &y, 1e-3, &Welch::new(1024, Hold::Zoh), &settings).expect("determined");
            let (b, a) = (fit.function.numerator[0], fit.function.denominator[0]);
            assert!((b - 1.0).abs() < 1e-3 && (a - 3.0).abs() < 1e-2, "{start}: {b} {a}");
        }
    }

    #[test]
    fn stated_deviations_are_those_of_white_noise() {
        let settings = RationalSettings::new(0, 1, 0.5, 20.0);
        let (mut squares, mut count) = (0.0, 0.0);
        for seed in 0..40 {
            let excite = |std, seed| Excitation::Noise { std, hold: 1e-3, seed }.samples(8192, 1e-3).expect("valid");
            let (u, noise) = (excite(1.0, seed), excite(0.005, 1000 + seed));
            let y: Vec<f64> = lag(&u, 0.05).iter().zip(&noise).map(|(y, n)| y + n).collect();
            let fit = fit_record(&u, &y, 1e-3, &Welch::new(1024, Hold::Zoh), &settings).expect("determined");
            squares += ((fit.function.numerator[0] - 1.0) / fit.numerator_std[0]).powi(2);
            squares += ((fit.function.denominator[0] - 3.0) / fit.denominator_std[0]).powi(2);
            count += 2.0;
        }
        let ratio = squares / count;
        assert!((0.5..2.0).contains(&ratio), "{ratio}");
    }

    #[test]
    fn faults_are_those_of_response_and_fit() {
        let u = Excitation::Noise { std: 1.0, hold: 1e-3, seed: 4 }.samples(4096, 1e-3).expect("valid");
        let y = lag(&u, 0.0);
        let settings = RationalSettings { delay: Delay::None, ..RationalSettings::new(0, 1, 0.5, 20.0) };
        let short = fit_record(&u[..1000], &y[..1000], 1e-3, &Welch::new(1024, Hold::Zoh), &settings);
        assert!(matches!(short, Err(RecordFitError::Response(_))), "{short:?}");
        let narrow = RationalSettings { low: 2.0, high: 2.1, ..settings };
        let few = fit_record(&u, &y, 1e-3, &Welch::new(1024, Hold::Zoh), &narrow);
        assert!(
            matches!(few, Err(RecordFitError::Fit(FitError::EmptyBand { .. } | FitError::TooFewLines { .. }))),
            "{few:?}"
        );
    }
}
