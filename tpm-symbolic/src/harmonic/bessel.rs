//! Sine and cosine of a motion by the Jacobi-Anger series.
//!
//! ```text
//! e^{j a cos theta} = sum_n j^n J_n(a) e^{j n theta} ,     e^{j b sin theta} = sum_n J_n(b) e^{j n theta}
//! ```
//!
//! The phase of sin(q) or cos(q) is a Fourier polynomial; the series of its harmonics are multiplied. Amplitudes must
//! be numbers here: Bessel functions of symbols have no table. The truncation error is bounded by
//! |J_n(a)| <= |a/2|^n / n!.
//!
//! Bessel functions are computed from their power series in integers of sufficient length, and rounded once.

use crate::algebra::fourier::Trig;
use crate::expr::graph::{Function, Node, Symbol};
use crate::harmonic::motion::{MotionError, motion_of, power_of};
use crate::mechanics::model::{ExactModel, TermId};
use crate::mechanics::pattern::{Motion, Pattern};
use crate::number::rational::{self, Rational};
use crate::regressor::form::{RegressorForm, Term};
use num_bigint::BigInt;
use num_traits::{One, Signed, Zero};
use std::collections::BTreeMap;
use thiserror::Error;

/// The largest magnitude of an argument of [`bessel_j`]; the power series takes about that many terms and bits.
pub const MAX_ARGUMENT: f64 = 4096.0;

/// J_n(x), rounded to the nearest double (but for ties closer than 2^-100); `None` when |x| exceeds [`MAX_ARGUMENT`] or x
/// is no number.
#[must_use]
pub fn bessel_j(n: u32, x: f64) -> Option<f64> {
    if x.is_nan() || x.abs() > MAX_ARGUMENT {
        return None;
    }
    let exact = rational::from_f64(x)?;
    if exact.is_zero() {
        return Some(if n == 0 { 1.0 } else { 0.0 });
    }
    // J_n(x) = (x/2)^n / n! * S, S = sum_k (-x^2/4)^k n! / (k! (n+k)!), S being computed in units of 2^-bits.
    let half = &exact / rational::integer(2);
    let square = &half * &half;
    let mut bits: u64 = 192 + (2.0 * x.abs()) as u64;
    loop {
        let (sum, terms) = scaled_sum(n, &square, bits);
        // Every division loses less than one unit, and later terms propagate the loss with a factor of x^2/4 at most. A
        // hundred bits beyond those of a double cover both, unless S itself is small.
        let lost = 64 - u64::from(terms.leading_zeros()) + (2.0 * x.abs()) as u64;
        if sum.bits() >= 160 + lost {
            let factorial: BigInt = (1..=n).map(BigInt::from).product();
            let above = sum * half.numer().pow(n);
            let below = (half.denom().pow(n) * factorial) << bits;
            // The quotient is not in lowest terms: a common divisor would take longer than the division that rounds.
            return Some(rational::quotient_to_f64(&above, &below));
        }
        bits *= 2;
    }
}

fn scaled_sum(n: u32, square: &Rational, bits: u64) -> (BigInt, u64) {
    let mut term: BigInt = BigInt::one() << bits;
    let mut sum = term.clone();
    let mut k = 0u64;
    while !term.is_zero() {
        k += 1;
        term = -(term * square.numer()) / (square.denom() * BigInt::from(k * (k + u64::from(n))));
        sum += &term;
    }
    (sum, k)
}

/// A real function of the phase with numbers as coefficients.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wave {
    /// Cosine coefficients of harmonics 0, 1, ...
    pub cos: Vec<f64>,
    /// Sine coefficients of harmonics 0, 1, ...; the first is 0.
    pub sin: Vec<f64>,
}

impl Wave {
    /// The value at a phase.
    #[must_use]
    pub fn evaluate(&self, theta: f64) -> f64 {
        let cos = self.cos.iter().enumerate().map(|(k, c)| c * (k as f64 * theta).cos());
        let sin = self.sin.iter().enumerate().map(|(k, s)| s * (k as f64 * theta).sin());
        cos.chain(sin).sum()
    }

    /// A motion with numbers for its symbols.
    #[must_use]
    pub fn of(motion: &Motion, mut value: impl FnMut(Symbol) -> f64) -> Self {
        let width = motion.highest_harmonic() + 1;
        let mut wave = Self { cos: vec![0.0; width], sin: vec![0.0; width] };
        for (monomial, fourier) in motion.terms() {
            let factor: f64 = monomial.factors().map(|(&symbol, exponent)| value(symbol).powi(exponent)).product();
            for (k, function, coefficient) in fourier.terms() {
                let slot = match function {
                    Trig::Cos => &mut wave.cos[k],
                    Trig::Sin => &mut wave.sin[k],
                };
                *slot += rational::to_f64(coefficient) * factor;
            }
        }
        wave
    }

    pub(super) fn spectrum(&self) -> Spectrum {
        let top = self.cos.len().max(self.sin.len()).saturating_sub(1);
        let mut values = vec![(0.0, 0.0); 2 * top + 1];
        for k in 0..=top {
            let at = |list: &Vec<f64>| list.get(k).copied().unwrap_or(0.0);
            let (c, s) = if k == 0 { (at(&self.cos), 0.0) } else { (at(&self.cos) / 2.0, at(&self.sin) / 2.0) };
            values[top + k] = (c, -s);
            values[top - k] = (c, s);
        }
        Spectrum(values)
    }
}

/// Complex coefficients of e^{j n theta}, n = -top..=top.
#[derive(Clone)]
pub(super) struct Spectrum(pub(super) Vec<(f64, f64)>);

impl Spectrum {
    pub(super) fn top(&self) -> usize {
        self.0.len() / 2
    }

    pub(super) fn times(&self, other: &Self) -> Self {
        let mut product = vec![(0.0, 0.0); self.0.len() + other.0.len() - 1];
        for (i, a) in self.0.iter().enumerate().filter(|(_, a)| **a != (0.0, 0.0)) {
            for (j, b) in other.0.iter().enumerate() {
                product[i + j].0 += a.0 * b.0 - a.1 * b.1;
                product[i + j].1 += a.0 * b.1 + a.1 * b.0;
            }
        }
        Self(product)
    }

    /// The derivative of an order with respect to time, at a fundamental frequency in rad/s.
    pub(super) fn derivative(&self, frequency: f64, order: u32) -> Self {
        let top = self.top();
        let turned = |(at, &(re, im)): (usize, &(f64, f64))| {
            let rate = ((at as f64 - top as f64) * frequency).powi(order as i32);
            // Every derivative multiplies by j.
            let (re, im) = [(re, im), (-im, re), (-re, -im), (im, -re)][order as usize % 4];
            (rate * re, rate * im)
        };
        Self(self.0.iter().enumerate().map(turned).collect())
    }

    /// Real and imaginary part of the function: (E + E*)/2 and (E - E*)/(2j), with E*_n = conj(E_-n).
    pub(super) fn real_and_imaginary(&self) -> (Self, Self) {
        let top = self.top();
        let pair = |i: usize| (self.0[i], self.0[2 * top - i]);
        let real = (0..=2 * top).map(|i| {
            let (a, b) = pair(i);
            ((a.0 + b.0) / 2.0, (a.1 - b.1) / 2.0)
        });
        let imaginary = (0..=2 * top).map(|i| {
            let (a, b) = pair(i);
            ((a.1 + b.1) / 2.0, (b.0 - a.0) / 2.0)
        });
        (Self(real.collect()), Self(imaginary.collect()))
    }

    pub(super) fn norm(&self) -> f64 {
        self.0.iter().map(|(re, im)| re.hypot(*im)).sum()
    }

    /// The real function whose spectrum this is.
    pub(super) fn wave(&self) -> Wave {
        let top = self.top();
        let mut wave = Wave { cos: vec![0.0; top + 1], sin: vec![0.0; top + 1] };
        for k in 0..=top {
            let (re, im) = self.0[top + k];
            (wave.cos[k], wave.sin[k]) = if k == 0 { (re, 0.0) } else { (2.0 * re, -2.0 * im) };
        }
        wave
    }
}

/// Sine and cosine of a phase, up to a highest harmonic.
#[derive(Clone, Debug, PartialEq)]
pub struct JacobiAnger {
    /// The cosine of the phase.
    pub cos: Wave,
    /// The sine of the phase.
    pub sin: Wave,
    /// An upper bound of the truncation error of either function.
    pub tail: f64,
}

/// The Jacobi-Anger series of the sine and cosine of a phase, up to a harmonic; `None` when a coefficient of the phase
/// exceeds [`MAX_ARGUMENT`] or is no number.
#[must_use]
pub fn jacobi_anger(phase: &Wave, harmonics: usize) -> Option<JacobiAnger> {
    let (spectrum, tail) = exponential(phase)?;
    let (cosine, sine) = spectrum.real_and_imaginary();
    let (mut cos, mut sin) = (cosine.wave(), sine.wave());
    let left_out = cut(&mut cos, harmonics).max(cut(&mut sin, harmonics));
    Some(JacobiAnger { cos, sin, tail: tail + left_out })
}

/// Removes the harmonics above the given one and returns a bound of their sum.
fn cut(wave: &mut Wave, harmonics: usize) -> f64 {
    let keep = |list: &mut Vec<f64>| -> f64 {
        let rest = if list.len() > harmonics + 1 { list.split_off(harmonics + 1) } else { Vec::new() };
        rest.iter().map(|value| value.abs()).sum()
    };
    keep(&mut wave.cos) + keep(&mut wave.sin)
}

/// e^{j phase} and a bound of its truncation error.
fn exponential(phase: &Wave) -> Option<(Spectrum, f64)> {
    let offset = phase.cos.first().copied().unwrap_or(0.0);
    let mut product = Spectrum(vec![(offset.cos(), offset.sin())]);
    let mut error = 0.0;
    let top = phase.cos.len().max(phase.sin.len());
    for k in 1..top {
        for (cosine, amplitude) in [(true, phase.cos.get(k)), (false, phase.sin.get(k))] {
            let Some(&amplitude) = amplitude.filter(|value| **value != 0.0) else { continue };
            let (factor, tail) = factor(k, cosine, amplitude)?;
            // |(p + dp)(f + df) - p f| <= |p| |df| + |dp| (|f| + |df|)
            error = product.norm() * tail + error * (factor.norm() + tail);
            product = product.times(&factor);
        }
    }
    Some((product, error))
}

/// e^{j a cos(k theta)}, or that of the sine, and a bound of its truncation error; `None` when the amplitude exceeds
/// [`MAX_ARGUMENT`] or is no number.
pub(super) fn factor(k: usize, cosine: bool, amplitude: f64) -> Option<(Spectrum, f64)> {
    if amplitude.is_nan() || amplitude.abs() > MAX_ARGUMENT {
        return None;
    }
    let (order, tail) = truncation(amplitude);
    let mut factor = vec![(0.0, 0.0); 2 * order * k + 1];
    for n in 0..=order {
        let value = bessel_j(u32::try_from(n).ok()?, amplitude)?;
        let odd = if n % 2 == 1 { -value } else { value };
        // j^n and j^-n J_-n = j^-n (-1)^n J_n = j^n J_n for the cosine.
        let (plus, minus) = if cosine {
            let turned = [(value, 0.0), (0.0, value), (-value, 0.0), (0.0, -value)][n % 4];
            (turned, turned)
        } else {
            ((value, 0.0), (odd, 0.0))
        };
        factor[(order + n) * k] = plus;
        factor[(order - n) * k] = minus;
    }
    Some((Spectrum(factor), tail))
}

/// The order at which the series for an amplitude is truncated, and a bound of the remainder: 2 sum_{n > order} |a/2|^n
/// / n!.
fn truncation(amplitude: f64) -> (usize, f64) {
    let half = amplitude.abs() / 2.0;
    // Logarithms of the terms do not overflow, although the terms rise to e^|a| before they fall.
    let (mut order, mut logarithm) = (0usize, 0.0f64);
    loop {
        let next = (order + 1) as f64;
        logarithm += (half / next).ln();
        // Beyond n = |a| each term is at most half the previous one, so the sum is at most twice the first.
        if next > 2.0 * half && logarithm < -50.0 {
            return (order, 4.0 * logarithm.exp() * (1.0 + 1e-9));
        }
        order += 1;
    }
}

/// Why a model has no numeric table.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum BesselError {
    /// A factor is neither a polynomial of the motion nor sine or cosine of one.
    #[error("{source}; besides polynomials, only sin and cos of polynomials of the motion have a Jacobi-Anger series")]
    Motion {
        /// The source term at fault.
        term: TermId,
        /// Why the factor has no finite Fourier series.
        source: MotionError,
    },
    /// An amplitude is too large.
    #[error("the amplitude of `{atom}` is beyond {MAX_ARGUMENT} rad or not a number")]
    Amplitude {
        /// The source term at fault.
        term: TermId,
        /// The function.
        atom: String,
    },
}

impl BesselError {
    /// The source term at fault.
    #[must_use]
    pub fn term(&self) -> TermId {
        match self {
            Self::Motion { term, .. } | Self::Amplitude { term, .. } => *term,
        }
    }
}

/// The factor of one parameter in one equation, in numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct NumericColumn {
    /// Index of the equation.
    pub equation: usize,
    /// Index of the parameter; `None` for the known terms.
    pub column: Option<usize>,
    /// The factor, up to the stated harmonic.
    pub wave: Wave,
    /// An upper bound of the truncation error.
    pub tail: f64,
}

/// The harmonic table of a model at given amplitudes, with sines and cosines of the motion by their Jacobi-Anger series
/// instead of a Taylor polynomial, up to a harmonic. `value` gives amplitudes, the frequency and run-time constants.
///
/// # Errors
/// When a term has factors other than polynomials of the motion and sines and cosines of such, or an amplitude is too
/// large; the source term is named.
pub fn numeric_table(
    model: &ExactModel,
    form: &RegressorForm,
    pattern: &Pattern,
    harmonics: usize,
    mut value: impl FnMut(Symbol) -> f64,
) -> Result<Vec<NumericColumn>, BesselError> {
    let form = form.expanded(&model.graph);
    let mut columns: BTreeMap<(usize, Option<usize>), (Wave, f64)> = BTreeMap::new();
    for (equation, row) in form.rows.iter().enumerate() {
        for term in &row.terms {
            let (mut wave, mut tail) = numeric_term(model, pattern, term, &mut value)?;
            tail += cut(&mut wave, harmonics);
            let slot = columns.entry((equation, term.column)).or_default();
            let add = |to: &mut Vec<f64>, from: &[f64]| {
                to.resize(to.len().max(from.len()), 0.0);
                to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
            };
            add(&mut slot.0.cos, &wave.cos);
            add(&mut slot.0.sin, &wave.sin);
            slot.1 += tail;
        }
    }
    let columns = columns.into_iter();
    Ok(columns.map(|((equation, column), (wave, tail))| NumericColumn { equation, column, wave, tail }).collect())
}

/// A term as a wave with all its harmonics, and a bound of the truncation error of its functions.
fn numeric_term(
    model: &ExactModel,
    pattern: &Pattern,
    term: &Term,
    value: &mut impl FnMut(Symbol) -> f64,
) -> Result<(Wave, f64), BesselError> {
    let failed = |source: MotionError| BesselError::Motion { term: term.source, source };
    let constant = Wave { cos: vec![rational::to_f64(&term.coefficient)], sin: vec![0.0] };
    let (mut product, mut error) = (constant.spectrum(), 0.0);
    for (&atom, exponent) in term.atoms.factors() {
        let (factor, tail, count) = match *model.graph.node(atom) {
            Node::Pi => {
                let constant = Wave { cos: vec![std::f64::consts::PI.powi(exponent)], sin: Vec::new() };
                (constant.spectrum(), 0.0, 1)
            }
            Node::Function(function @ (Function::Sin | Function::Cos), argument) if exponent > 0 => {
                let motion = motion_of(model, pattern, argument).map_err(failed)?;
                let phase = Wave::of(&motion, &mut *value);
                let amplitude = || BesselError::Amplitude { term: term.source, atom: model.display_brief(atom) };
                let series = jacobi_anger(&phase, usize::MAX - 1).ok_or_else(amplitude)?;
                let wave = if function == Function::Sin { series.sin } else { series.cos };
                (wave.spectrum(), series.tail, exponent)
            }
            _ => {
                let motion = power_of(model, pattern, atom, exponent).map_err(failed)?;
                (Wave::of(&motion, &mut *value).spectrum(), 0.0, 1)
            }
        };
        for _ in 0..count {
            error = product.norm() * tail + error * (factor.norm() + tail);
            product = product.times(&factor);
        }
    }
    Ok((product.wave(), error))
}

#[cfg(test)]
mod tests {
    use super::{MAX_ARGUMENT, Wave, bessel_j, jacobi_anger};
    use crate::number::rational::{self, Rational, integer};
    use num_traits::{One, Zero};
    use proptest::prelude::{prop, prop_assert, proptest};

    /// The power series, summed as one exact fraction with a remainder below 10^-60 of the first term.
    fn exact(n: u32, x: f64) -> Rational {
        let half = rational::from_f64(x).expect("finite") / integer(2);
        let mut term = (1..=n).fold(Rational::one(), |term, k| term * &half / integer(k.into()));
        let first = term.clone();
        let mut sum = Rational::zero();
        let mut k = 0i64;
        while !first.is_zero() && (k < 2 * x.abs() as i64 || rational::to_f64(&(&term / &first)).abs() > 1e-60) {
            sum += &term;
            k += 1;
            term = -term * &half * &half / integer(k * (k + i64::from(n)));
        }
        sum
    }

    #[test]
    fn values_are_the_nearest_doubles() {
        for n in [0u32, 1, 2, 3, 7, 20, 40] {
            for x in [1e-9, 0.1, 0.5, 1.0, -1.5, 2.404_825_557_695_773, 3.0, 5.520_078_110_286_311, 10.0, 25.0] {
                let (found, exact) = (bessel_j(n, x).expect("in range"), exact(n, x));
                assert_eq!(found, rational::to_f64(&exact), "J_{n}({x})");
            }
        }
        // Abramowitz and Stegun, table 9.1: J_0(1), J_1(1), J_0(10).
        assert_eq!(bessel_j(0, 1.0), Some(0.765_197_686_557_966_6));
        assert_eq!(bessel_j(1, 1.0), Some(0.440_050_585_744_933_5));
        assert_eq!(bessel_j(0, 10.0), "-0.24593576445134833520".parse().ok());
        assert_eq!(bessel_j(3, 0.0), Some(0.0));
        assert_eq!(bessel_j(0, f64::NAN), None);
        assert_eq!(bessel_j(0, 2.0 * MAX_ARGUMENT), None);
    }

    #[test]
    fn large_arguments_obey_the_sum_of_squares() {
        // J_0^2 + 2 sum J_n^2 = 1
        let x = 300.0;
        let square = |n: u32| bessel_j(n, x).expect("in range").powi(2);
        let sum = square(0) + 2.0 * (1..400).map(square).sum::<f64>();
        assert!((sum - 1.0).abs() < 1e-13, "{sum}");
    }

    proptest! {
        #[test]
        fn recurrence(n in 1u32..30, x in 0.1f64..40.0) {
            let j = |n| bessel_j(n, x).expect("in range");
            let sum = j(n - 1) + j(n + 1);
            let other = 2.0 * f64::from(n) / x * j(n);
            prop_assert!((sum - other).abs() <= 4.0 * f64::EPSILON * (j(n - 1).abs() + j(n + 1).abs() + other.abs()));
        }

        #[test]
        fn series_agree_with_values_and_tails_hold(
            cos in prop::collection::vec(-2.0f64..2.0, 1..4),
            sin in prop::collection::vec(-2.0f64..2.0, 1..4),
            theta in -3.0f64..3.0,
            harmonics in 3usize..40,
        ) {
            let mut phase = Wave { cos, sin };
            phase.sin[0] = 0.0;
            let angle = phase.evaluate(theta);
            let full = jacobi_anger(&phase, 500).expect("small");
            prop_assert!(full.tail < 1e-15);
            prop_assert!((full.cos.evaluate(theta) - angle.cos()).abs() < 1e-13);
            prop_assert!((full.sin.evaluate(theta) - angle.sin()).abs() < 1e-13);
            let short = jacobi_anger(&phase, harmonics).expect("small");
            prop_assert!(short.cos.cos.len() <= harmonics + 1);
            prop_assert!((short.cos.evaluate(theta) - angle.cos()).abs() <= short.tail + 1e-13);
            prop_assert!((short.sin.evaluate(theta) - angle.sin()).abs() <= short.tail + 1e-13);
        }
    }
}
