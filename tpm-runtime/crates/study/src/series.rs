//! Fourier series of expressions along a periodic motion, as numbers with error bounds.
//!
//! ```text
//! e^{j a cos theta} = sum_n j^n J_n(a) e^{j n theta} ,     e^{j b sin theta} = sum_n J_n(b) e^{j n theta}
//! ```
//!
//! An expression is computed node by node in its written form, so that the recursion of an arm is never multiplied out; sines and cosines
//! are Jacobi-Anger series. Every value is a finite Fourier series c with a bound of its error in the norm sum |c_n|. The bound includes the
//! tails of the series, |J_n(a)| <= |a/2|^n / n!, truncated harmonics, and rounding. The norm of a product is at most the product of the
//! norms, so that the bound of a product follows from those of its factors:
//!
//! ```text
//! |ab - a'b'| <= |a'| db + da (|b'| + db) ,        |e^{j(p + d)} - e^{jp}| <= |e^{jp}| (e^{|d|} - 1)
//! ```

mod bessel;

use crate::series::bessel::{MAX_ARGUMENT, bessel_j};
use std::collections::HashMap;
use tpm_codegen::language::AtTerm;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::budget;
use tpm_symbolic::expr::graph::{Coordinate, ExprId, Function, Node, Symbol};
use tpm_symbolic::mechanics::model::{ExactModel, Kind, TermId};
use tpm_symbolic::mechanics::pattern::Motion;
use tpm_symbolic::number::rational;
use tpm_symbolic::regressor::form::Term;

/// Harmonics whose magnitudes add up to less than this share of the norm are truncated.
const CUT: f64 = 1e-16;
/// Highest harmonic of a value.
const HIGHEST: usize = 4096;
/// Bound of the rounding error of one complex operation, as a share of its result: twice its actual bound of four
/// half-ulps.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// Why an expression has no series in numbers along a motion.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NoSeries {
    /// It contains a function other than sine and cosine, or a divisor that varies with time.
    #[error(
        "`{atom}` is no polynomial of the motion and of constants; besides polynomials, only sin and cos of the motion have a Jacobi-Anger series"
    )]
    Function {
        /// The source term at fault.
        term: TermId,
        /// The function or divisor.
        atom: String,
    },
    /// An amplitude or a harmonic is too large.
    #[error(
        "the motion of `{atom}` is no number, or its amplitude is beyond {MAX_ARGUMENT} rad or its harmonics beyond {HIGHEST}"
    )]
    Large {
        /// The source term at fault.
        term: TermId,
        /// The function or product.
        atom: String,
    },
    /// A coordinate has no motion.
    #[error("the coordinate `{coordinate}` has no motion in the pattern; give it one, or eliminate it")]
    Still {
        /// The source term at fault.
        term: TermId,
        /// The coordinate.
        coordinate: String,
    },
}

impl AtTerm for NoSeries {
    fn at_term(&self) -> Option<TermId> {
        match self {
            Self::Function { term, .. } | Self::Large { term, .. } | Self::Still { term, .. } => Some(*term),
        }
    }
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
    /// A motion with numbers for its symbols.
    pub(super) fn of(motion: &Motion, value: impl Fn(Symbol) -> f64) -> Self {
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

    fn spectrum(&self) -> Spectrum {
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

/// A periodic motion.
pub(super) struct PeriodicMotion {
    /// Fundamental angular frequency, rad/s.
    pub(super) frequency: f64,
    /// The motion of every coordinate of the model over a period, by its index; `None` where it is not known.
    pub(super) coordinates: Vec<Option<Wave>>,
}

/// A Fourier series and a bound of its error, in the norm sum |c_n|.
#[derive(Clone)]
pub(super) struct Series {
    spectrum: Spectrum,
    pub(super) error: f64,
    /// Whether the exact series has no harmonics beyond those of the spectrum.
    is_finite: bool,
}

impl Series {
    pub(super) fn number(value: f64) -> Self {
        Self { spectrum: Spectrum(vec![(value, 0.0)]), error: 0.0, is_finite: true }
    }

    /// A number that was rounded to the nearest double.
    fn rounded(value: f64) -> Self {
        Self { error: ROUNDING * value.abs(), ..Self::number(value) }
    }

    /// The norm, rounded up.
    fn norm(&self) -> f64 {
        self.spectrum.norm() * (1.0 + 1e-12)
    }

    pub(super) fn wave(&self) -> Wave {
        self.spectrum.wave()
    }

    /// The harmonics up to one, and a bound of the magnitude of all others together; 0 where there are none.
    pub(super) fn up_to(&self, harmonic: usize) -> (Wave, f64) {
        let mut wave = self.wave();
        let mut left_out = if self.is_finite { 0.0 } else { self.error };
        for list in [&mut wave.cos, &mut wave.sin] {
            left_out += list.iter().skip(harmonic + 1).map(|value| value.abs()).sum::<f64>();
            list.truncate(harmonic + 1);
        }
        (wave, left_out)
    }

    /// The series times a number.
    pub(super) fn scaled(mut self, factor: f64) -> Self {
        self.spectrum.0.iter_mut().for_each(|(re, im)| (*re, *im) = (factor * *re, factor * *im));
        self.error = factor.abs() * self.error + ROUNDING * self.spectrum.norm();
        self
    }

    pub(super) fn plus(&self, other: &Self) -> Self {
        let (long, short) = if self.spectrum.top() < other.spectrum.top() { (other, self) } else { (self, other) };
        let mut sum = long.spectrum.clone();
        let from = long.spectrum.top() - short.spectrum.top();
        for (to, part) in sum.0[from..].iter_mut().zip(&short.spectrum.0) {
            to.0 += part.0;
            to.1 += part.1;
        }
        let is_finite = self.is_finite && other.is_finite;
        let sum = Self { spectrum: sum, error: self.error + other.error, is_finite };
        Self { error: sum.error + ROUNDING * sum.norm(), ..sum }.trimmed()
    }

    fn times(&self, other: &Self) -> Option<Self> {
        let (a, b) = (self.norm(), other.norm());
        budget::charge((self.spectrum.0.len() * other.spectrum.0.len()) as u64);
        let additions = self.spectrum.0.len().min(other.spectrum.0.len()) as f64 + 2.0;
        let error = a * other.error + self.error * (b + other.error) + additions * ROUNDING * a * b;
        let is_finite = self.is_finite && other.is_finite;
        let product = Self { spectrum: self.spectrum.times(&other.spectrum), error, is_finite }.trimmed();
        (product.spectrum.top() <= HIGHEST).then_some(product)
    }

    /// The series without its highest negligible harmonics, which are added to the error bound.
    fn trimmed(mut self) -> Self {
        let most = CUT * self.norm();
        let values = &self.spectrum.0;
        let magnitude = |(re, im): (f64, f64)| re.hypot(im);
        let (mut cut, mut left_out) = (0, 0.0);
        while 2 * cut + 1 < values.len() {
            let pair = magnitude(values[cut]) + magnitude(values[values.len() - 1 - cut]);
            if left_out + pair > most {
                break;
            }
            left_out += pair;
            cut += 1;
        }
        self.spectrum = Spectrum(values[cut..values.len() - cut].to_vec());
        self.error += left_out * (1.0 + 1e-12);
        self
    }

    /// Cosine and sine of the series, from the Jacobi-Anger series of its harmonics; `None` when an amplitude is too
    /// large.
    fn cosine_and_sine(&self) -> Option<(Self, Self)> {
        let phase = self.spectrum.wave();
        let offset = phase.cos.first().copied().unwrap_or(0.0);
        let turn = Spectrum(vec![(offset.cos(), offset.sin())]);
        let is_finite = phase.cos.len() == 1;
        let mut product = Self { spectrum: turn, error: ROUNDING, is_finite };
        for k in 1..phase.cos.len() {
            for (cosine, amplitude) in [(true, phase.cos[k]), (false, phase.sin[k])] {
                if amplitude != 0.0 {
                    let (spectrum, tail) = factor(k, cosine, amplitude)?;
                    let norm = spectrum.norm();
                    product = product.times(&Self { spectrum, error: tail + ROUNDING * norm, is_finite })?;
                }
            }
        }
        product.error += (product.norm() + product.error) * self.error.exp_m1();
        let (cosine, sine) = product.spectrum.real_and_imaginary();
        let error = product.error + ROUNDING * product.norm();
        Some((Self { spectrum: cosine, error, is_finite }, Self { spectrum: sine, error, is_finite }))
    }
}

/// Why a node has no series.
#[derive(Clone, Copy)]
enum Obstacle {
    Function(ExprId),
    Large(ExprId),
    Still(Coordinate),
}

/// The series of a graph's nodes along a motion.
pub(super) struct Nodes<'a, F> {
    model: &'a ExactModel,
    motion: &'a PeriodicMotion,
    /// Values of run-time constants.
    value: F,
    /// The series of every visited node.
    known: HashMap<ExprId, Result<Series, Obstacle>>,
}

impl<'a, F: Fn(Symbol) -> f64> Nodes<'a, F> {
    pub(super) fn new(model: &'a ExactModel, motion: &'a PeriodicMotion, value: F) -> Self {
        Self { model, motion, value, known: HashMap::new() }
    }

    /// The sum of these terms of a form, without their parameters.
    ///
    /// # Errors
    /// [`NoSeries`] with the source term.
    pub(super) fn sum(&mut self, terms: &[Term]) -> Result<Series, NoSeries> {
        terms.iter().try_fold(Series::number(0.0), |sum, term| {
            let product = self.product(term).map_err(|obstacle| self.fault(term.source, obstacle))?;
            Ok(sum.plus(&product))
        })
    }

    fn product(&mut self, term: &Term) -> Result<Series, Obstacle> {
        term.atoms
            .factors()
            .try_fold(Series::rounded(rational::to_f64(&term.coefficient)), |product, (&atom, exponent)| {
                product.times(&self.power(atom, exponent)?).ok_or(Obstacle::Large(atom))
            })
    }

    fn fault(&self, term: TermId, obstacle: Obstacle) -> NoSeries {
        match obstacle {
            Obstacle::Function(atom) => NoSeries::Function { term, atom: self.model.display_brief(atom) },
            Obstacle::Large(atom) => NoSeries::Large { term, atom: self.model.display_brief(atom) },
            Obstacle::Still(coordinate) => {
                NoSeries::Still { term, coordinate: self.model.coordinates[coordinate.0 as usize].name.clone() }
            }
        }
    }

    fn power(&mut self, id: ExprId, exponent: i32) -> Result<Series, Obstacle> {
        let base = self.of(id)?;
        if exponent < 0 {
            // A divisor that varies with time has no finite series.
            let [(divisor, _)] = base.spectrum.0[..] else { return Err(Obstacle::Function(id)) };
            let least = divisor.abs() - base.error;
            let power = divisor.powi(exponent);
            let slope = f64::from(-exponent) * least.powi(exponent - 1) * base.error;
            let rounding = f64::from(2 - exponent) * ROUNDING * power.abs();
            let quotient = Series { error: slope + rounding, ..Series::number(power) };
            return if least > 0.0 { Ok(quotient) } else { Err(Obstacle::Function(id)) };
        }
        (0..exponent).try_fold(Series::number(1.0), |product, _| product.times(&base).ok_or(Obstacle::Large(id)))
    }

    fn of(&mut self, root: ExprId) -> Result<Series, Obstacle> {
        for id in self.model.graph.used_by(&[root], |id| self.known.contains_key(&id)) {
            let series = self.node(id);
            self.known.insert(id, series);
        }
        self.known[&root].clone()
    }

    /// The series of a node whose operands are known.
    fn node(&mut self, id: ExprId) -> Result<Series, Obstacle> {
        let at = |id: &ExprId| self.known[id].as_ref().map_err(|obstacle| *obstacle);
        match self.model.graph.node(id) {
            Node::Number(number) => Ok(Series::rounded(rational::to_f64(number))),
            Node::Pi => Ok(Series::rounded(std::f64::consts::PI)),
            Node::Symbol(symbol) => match &self.model.quantity(*symbol).kind {
                Kind::Constant { value: Some(value) } => Ok(Series::rounded(rational::to_f64(value))),
                Kind::Constant { value: None } => Ok(Series::number((self.value)(*symbol))),
                _ => Err(Obstacle::Function(id)),
            },
            Node::Derivative(coordinate, order) => {
                let wave = self.motion.coordinates.get(coordinate.0 as usize).and_then(Option::as_ref);
                let spectrum = wave.ok_or(Obstacle::Still(*coordinate))?.spectrum();
                let spectrum = spectrum.derivative(self.motion.frequency, *order);
                let error = f64::from(2 * *order) * ROUNDING * spectrum.norm();
                Ok(Series { spectrum, error, is_finite: true })
            }
            Node::Sum(terms) => {
                let (first, rest) = terms.split_first().ok_or(Obstacle::Function(id))?;
                rest.iter().try_fold(at(first)?.clone(), |sum, term| Ok(sum.plus(at(term)?)))
            }
            Node::Product(factors) => {
                let (first, rest) = factors.split_first().ok_or(Obstacle::Function(id))?;
                let times = |product: Series, factor: &ExprId| product.times(at(factor)?).ok_or(Obstacle::Large(id));
                rest.iter().try_fold(at(first)?.clone(), times)
            }
            Node::Power(base, exponent) => {
                let (base, exponent) = (*base, *exponent);
                self.power(base, exponent)
            }
            Node::Function(function @ (Function::Sin | Function::Cos), argument) => {
                let (cosine, sine) = at(argument)?.cosine_and_sine().ok_or(Obstacle::Large(id))?;
                Ok(if *function == Function::Sin { sine } else { cosine })
            }
            Node::Function(..) | Node::Atan2(..) | Node::Placeholder(_) => Err(Obstacle::Function(id)),
        }
    }
}

/// Complex coefficients of e^{j n theta}, n = -top..=top.
#[derive(Clone)]
struct Spectrum(Vec<(f64, f64)>);

impl Spectrum {
    fn top(&self) -> usize {
        self.0.len() / 2
    }

    fn times(&self, other: &Self) -> Self {
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
    fn derivative(&self, frequency: f64, order: u32) -> Self {
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
    fn real_and_imaginary(&self) -> (Self, Self) {
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

    fn norm(&self) -> f64 {
        self.0.iter().map(|(re, im)| re.hypot(*im)).sum()
    }

    /// The real function whose spectrum this is.
    fn wave(&self) -> Wave {
        let top = self.top();
        let mut wave = Wave { cos: vec![0.0; top + 1], sin: vec![0.0; top + 1] };
        for k in 0..=top {
            let (re, im) = self.0[top + k];
            (wave.cos[k], wave.sin[k]) = if k == 0 { (re, 0.0) } else { (2.0 * re, -2.0 * im) };
        }
        wave
    }
}

/// e^{j a cos(k theta)}, or that of the sine, and a bound of its truncation error; `None` when the amplitude exceeds
/// [`MAX_ARGUMENT`] or is no number.
fn factor(k: usize, cosine: bool, amplitude: f64) -> Option<(Spectrum, f64)> {
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

#[cfg(test)]
mod tests;
