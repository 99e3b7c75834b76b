//! Harmonic equations `phi theta = right + noise`, one complex row per equation of motion and harmonic.

use crate::settings::Frozen;
use num_complex::Complex;
use tpm_numerics::DMatrix;
use tpm_numerics::singular::unit_columns;

/// Weighted harmonic equations.
///
/// Invariant: a row of harmonic k >= 1 stands for two real equations of noise variance `variance / 2` each, a row of
/// harmonic 0 for one real equation of noise variance `variance`.
#[derive(Clone, Debug, Default)]
pub(super) struct Equations {
    /// Number of parameters.
    pub(super) parameters: usize,
    /// Regressor phasors, equations x parameters, row-major.
    pub(super) regressors: Vec<Complex<f64>>,
    /// Right-hand side phasors.
    pub(super) right: Vec<Complex<f64>>,
    /// E|n|^2 of each row.
    pub(super) variance: Vec<f64>,
    /// Row of the model that each equation belongs to.
    pub(super) row: Vec<usize>,
    /// Harmonic of each equation.
    pub(super) harmonic: Vec<usize>,
}

impl Equations {
    /// No equations yet.
    #[must_use]
    pub(super) fn new(parameters: usize) -> Self {
        Equations { parameters, ..Equations::default() }
    }

    /// Adds one equation.
    pub(super) fn push(
        &mut self,
        row: usize,
        harmonic: usize,
        regressors: &[Complex<f64>],
        right: Complex<f64>,
        variance: f64,
    ) {
        self.regressors.extend_from_slice(regressors);
        self.right.push(right);
        self.variance.push(variance);
        self.row.push(row);
        self.harmonic.push(harmonic);
    }

    /// Adds further equations.
    pub(super) fn append(&mut self, mut others: Self) {
        self.regressors.append(&mut others.regressors);
        self.right.append(&mut others.right);
        self.variance.append(&mut others.variance);
        self.row.append(&mut others.row);
        self.harmonic.append(&mut others.harmonic);
    }

    /// Sets the variance of the first `count` equations, by row and harmonic.
    pub(super) fn set_variance(&mut self, count: usize, variance: &[Vec<f64>]) {
        for ((slot, &row), &harmonic) in self.variance.iter_mut().zip(&self.row).zip(&self.harmonic).take(count) {
            if let Some(value) = variance.get(row).and_then(|of_row| of_row.get(harmonic)) {
                *slot = value.max(f64::MIN_POSITIVE);
            }
        }
    }

    /// Shifts the regressors of a mean as noise does: `shift` has one number for every parameter and, last, for the known term,
    /// whose shift is returned. `uncertainty` is the standard deviation of the whole shift at the parameters theta, as a
    /// share of it.
    pub(super) fn shift_mean(&mut self, equation: usize, shift: &[f64], theta: &[f64], uncertainty: f64) -> f64 {
        let (own, known) = shift.split_at(self.parameters.min(shift.len()));
        let regressors = &mut self.regressors[equation * self.parameters..(equation + 1) * self.parameters];
        for (regressor, value) in regressors.iter_mut().zip(own) {
            *regressor += *value;
        }
        let known: f64 = known.iter().sum();
        let whole = known + own.iter().zip(theta).map(|(shift, value)| shift * value).sum::<f64>();
        self.variance[equation] += (uncertainty * whole).powi(2);
        known
    }

    /// Number of complex rows.
    #[must_use]
    pub(super) fn len(&self) -> usize {
        self.right.len()
    }

    /// Number of real equations.
    #[must_use]
    pub(super) fn real_len(&self) -> usize {
        self.harmonic.iter().map(|&k| if k == 0 { 1 } else { 2 }).sum()
    }

    /// Regressor phasors of one equation.
    #[must_use]
    pub(super) fn regressor(&self, equation: usize) -> &[Complex<f64>] {
        &self.regressors[equation * self.parameters..(equation + 1) * self.parameters]
    }

    /// `right - phi theta` of one equation.
    #[must_use]
    pub(super) fn residual(&self, equation: usize, theta: &[f64]) -> Complex<f64> {
        self.regressor(equation).iter().zip(theta).fold(self.right[equation], |sum, (phi, value)| sum - phi * *value)
    }

    /// Weight of the real equations that a row stands for.
    #[must_use]
    pub(super) fn weight(&self, equation: usize) -> f64 {
        let variance = self.variance[equation];
        if self.harmonic[equation] == 0 { 1.0 / variance } else { 2.0 / variance }
    }

    /// The `count` real equations that determine the parameters best: real or imaginary parts of rows, each as a row of
    /// harmonic 0.
    ///
    /// A QR decomposition of the weighted, scaled and transposed matrix picks them by its pivots (after Feng, Eqn 3.29).
    #[must_use]
    pub(crate) fn reduced(&self, count: usize) -> Self {
        let all: Vec<usize> = (0..self.parameters).collect();
        let (matrix, _) = unit_columns(self.weighted(&all, &[]).remove_column(self.parameters));
        // The complex row of every real equation, and whether it is the imaginary part.
        let parts = (0..self.len()).flat_map(|e| {
            let imaginary: &[bool] = if self.harmonic[e] == 0 { &[false] } else { &[false, true] };
            imaginary.iter().map(move |part| (e, *part))
        });
        let mut order: DMatrix<usize> = DMatrix::from_fn(1, matrix.nrows(), |_, c| c);
        matrix.transpose().col_piv_qr().p().permute_columns(&mut order);
        let parts: Vec<(usize, bool)> = parts.collect();
        let mut reduced = Equations::new(self.parameters);
        for &at in order.iter().take(count) {
            let (e, imaginary) = parts[at];
            let part = |z: &Complex<f64>| Complex::new(if imaginary { z.im } else { z.re }, 0.0);
            let regressor: Vec<Complex<f64>> = self.regressor(e).iter().map(part).collect();
            reduced.push(self.row[e], 0, &regressor, part(&self.right[e]), 1.0 / self.weight(e));
        }
        reduced
    }

    /// The real equations `[A b]`, each divided by its standard deviation, with the columns `free` only; those of the frozen
    /// parameters, at their values, are taken from the right.
    #[must_use]
    pub(super) fn weighted(&self, free: &[usize], frozen: &[Frozen]) -> DMatrix<f64> {
        let mut whole = self.right.clone();
        for frozen in frozen {
            for (right, phi) in whole.iter_mut().zip(self.column(frozen.parameter)) {
                *right -= phi * frozen.value;
            }
        }
        let weights: Vec<f64> = (0..self.len()).map(|e| self.weight(e).sqrt()).collect();
        let count = self.real_len();
        let mut entries = Vec::with_capacity(count * (free.len() + 1));
        for &j in free {
            self.append_real(&weights, self.column(j), &mut entries);
        }
        self.append_real(&weights, whole.iter(), &mut entries);
        DMatrix::from_vec(count, free.len() + 1, entries)
    }

    /// Regressor phasors of one parameter.
    fn column(&self, parameter: usize) -> impl Iterator<Item = &Complex<f64>> {
        self.regressors.iter().skip(parameter).step_by(self.parameters)
    }

    /// Appends the real equations' entries from those of the complex ones.
    fn append_real<'c>(&self, weights: &[f64], column: impl Iterator<Item = &'c Complex<f64>>, entries: &mut Vec<f64>) {
        for ((entry, weight), harmonic) in column.zip(weights).zip(&self.harmonic) {
            entries.push(entry.re * weight);
            if *harmonic > 0 {
                entries.push(entry.im * weight);
            }
        }
    }
}
