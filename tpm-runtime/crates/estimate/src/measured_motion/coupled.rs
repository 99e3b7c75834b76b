//! Noise that harmonic equations of one record have in common.
//!
//! With `d(row)/d(slot) = sum_m g_m e^{j m w t}` along the motion, the equation of harmonic k holds the sensors' noise of all
//! lines k - m, each of which stands in other equations too. Invariant: the noise of the real equations is `F(theta) n`, where
//! n are real and imaginary parts of the coordinates' white noise, line by line and independent; F is linear in theta, so
//! that its parts are formed once. The variance of an equation's noise was measured; F gives the correlations between
//! equations (`DESIGN.md`, "Why are the equations of a record weighed together?").

use crate::measured_motion::path::NoisePath;
use num_complex::Complex;
use tpm_numerics::fourier::coefficient;
use tpm_numerics::{Cholesky, DMatrix, Dyn};

/// Most entries in the parts of one record; beyond it every equation is weighed for itself.
const MOST_ENTRIES: usize = 8_000_000;
/// Factor on the correlations that the model gives, so that no combination of equations is free of noise.
const CORRELATION_FACTOR: f64 = 0.9999;

/// The noise of one record's real equations, in the order of [`Equations::weighted`](crate::equations::Equations::weighted).
#[derive(Clone, Debug)]
pub(super) struct Coupled {
    /// Equations x sources, per parameter and, last, of the known term.
    parts: Vec<DMatrix<f64>>,
    /// First real equation of every complex one, and its harmonic.
    places: Vec<(usize, usize)>,
}

/// Weights of one record's equations at a parameter vector.
pub(super) struct Weighed {
    factor: Cholesky<f64, Dyn>,
    /// Correction of the right of the normal equations for noise in the regressors, per parameter.
    pub(super) gradient: Vec<f64>,
}

impl Weighed {
    /// Makes equations that were divided by their standard deviations uncorrelated.
    pub(super) fn whiten(&self, rows: &mut DMatrix<f64>) {
        let regular = self.factor.l_dirty().solve_lower_triangular_mut(rows);
        assert!(regular, "invariant: a Cholesky factor has no zero on its diagonal");
    }

    /// Rows `L' rows` with the Cholesky factor L of the correlations: where `rows' n` has correlated noise n of unit variance,
    /// the result stands for independent noise.
    pub(super) fn decouple(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        self.factor.l_dirty().lower_triangle().tr_mul(rows)
    }
}

impl Coupled {
    /// Of the equations `used`, harmonics per row, where the coordinates' noise is white with these relative levels; nothing
    /// where there is no equation, or the parts would be too large.
    pub(super) fn new(path: &NoisePath, white: &[f64], used: &[Vec<usize>]) -> Option<Self> {
        let (p, c) = (path.dims.parameters, path.dims.coordinates);
        // Every line of noise from which a used equation gets some. A jump of a term is no linear function of noise, and the harmonics
        // of its derivative only say so: noise beyond the motion is then left out.
        let last = used.iter().flatten().copied().max().unwrap_or(0);
        let highest = path.jacobian.reach().map_or(path.motion_harmonics, |reach| last + reach);
        let width = 2 * highest + 1;
        let mut places = Vec::new();
        let mut count = 0;
        for lines in used {
            for &k in lines {
                places.push((count, k));
                count += if k == 0 { 1 } else { 2 };
            }
        }
        if count * width * c * (p + 1) > MOST_ENTRIES || count == 0 {
            return None;
        }
        let mut parts = vec![DMatrix::zeros(count, width * c); p + 1];
        for (j, part) in parts.iter_mut().enumerate() {
            let mut place = places.iter();
            for (row, lines) in used.iter().enumerate() {
                let column = row * (p + 1) + j;
                let gains = path.jacobian.lines.iter().map(|columns| columns[column].as_slice());
                let gains: Vec<&[Complex<f64>]> = gains.collect();
                for &k in lines {
                    let Some(&(first, _)) = place.next() else { break };
                    for (&(coordinate, derivative), gain) in path.jacobian.slots.iter().zip(&gains) {
                        let deviation = white[coordinate].sqrt();
                        let turn =
                            |line: isize| Complex::new(0.0, line as f64 * path.fundamental).powu(derivative as u32);
                        let through = |line: isize| coefficient(gain, k as isize - line) * turn(line) * deviation;
                        for line in 0..=highest {
                            let (plus, minus) = (through(line as isize), through(-(line as isize)));
                            // A one-sided phasor is twice the coefficient; either part of a line has half of its variance.
                            let twice = if k == 0 { 1.0 } else { 2.0 };
                            let (re, im) = if line == 0 {
                                (plus * twice, Complex::new(0.0, 0.0))
                            } else {
                                let half = twice * std::f64::consts::FRAC_1_SQRT_2;
                                ((plus + minus) * half, (plus - minus) * Complex::new(0.0, half))
                            };
                            let source = coordinate * width + line;
                            part[(first, source)] += re.re;
                            if k > 0 {
                                part[(first + 1, source)] += re.im;
                            }
                            if line > 0 {
                                part[(first, source + highest)] += im.re;
                                if k > 0 {
                                    part[(first + 1, source + highest)] += im.im;
                                }
                            }
                        }
                    }
                }
            }
        }
        Some(Coupled { parts, places })
    }

    /// Weights at theta, given every complex equation's variance by noise and, with the model's own error, as a whole.
    pub(super) fn weigh(&self, theta: &[f64], noise: &[f64], whole: &[f64]) -> Option<Weighed> {
        let known = self.parts.last()?;
        let mut factor = known.clone();
        for (part, &value) in self.parts.iter().zip(theta) {
            factor.zip_apply(part, |sum, entry| *sum += entry * value);
        }
        // An equation is scaled so that its variance is the measured one; noise and model error keep their ratio.
        let count = factor.nrows();
        let mut scale = vec![0.0; count];
        let mut apart = vec![0.0; count];
        for (&(at, k), (noise, whole)) in self.places.iter().zip(noise.iter().zip(whole)) {
            let real = if k == 0 { 1 } else { 2 };
            let own: f64 = (at..at + real).map(|i| factor.row(i).norm_squared()).sum();
            let own_scale = if own > 0.0 { (real as f64 * noise / (own * whole)).sqrt() } else { 0.0 };
            let own_part = if own > 0.0 { (1.0 - noise / whole).max(0.0) } else { 1.0 };
            scale[at..at + real].fill(own_scale);
            apart[at..at + real].fill(own_part);
        }
        for (mut row, s) in factor.row_iter_mut().zip(&scale) {
            row *= *s;
        }
        let mut covariance = &factor * factor.transpose();
        let own = covariance.diagonal();
        covariance *= CORRELATION_FACTOR;
        for (r, (own, apart)) in own.iter().zip(&apart).enumerate() {
            covariance[(r, r)] = own + apart;
        }
        if covariance.iter().any(|x| !x.is_finite()) {
            return None;
        }
        let cholesky = covariance.cholesky()?;
        let solved = cholesky.solve(&factor);
        let gradient = self
            .parts
            .iter()
            .take(theta.len())
            .map(|part| {
                solved.iter().zip(part).zip(scale.iter().cycle()).map(|((solved, part), s)| solved * part * s).sum()
            })
            .collect();
        Some(Weighed { factor: cholesky, gradient })
    }
}
