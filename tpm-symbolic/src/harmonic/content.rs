//! Harmonics of the regressor along a periodic motion, as numbers with error bounds. They show which harmonics depend
//! on which parameter.
//!
//! Sines and cosines of the motion are Jacobi-Anger series. An entry is computed node by node in its written form, so
//! that the recursion of an arm is never multiplied out. Every value is a finite Fourier series c with a bound of its
//! error in the norm sum |c_n|. The bound includes the tails of the series, truncated harmonics, and rounding. The norm
//! of a product is at most the product of the norms, so that the bound of a product follows from those of its factors:
//!
//! ```text
//! |ab - a'b'| <= |a'| db + da (|b'| + db) ,        |e^{j(p + d)} - e^{jp}| <= |e^{jp}| (e^{|d|} - 1)
//! ```

use crate::budget;
use crate::expr::graph::{ExprId, Function, Node, Symbol};
use crate::harmonic::bessel::{Spectrum, Wave, factor};
use crate::mechanics::model::{ExactModel, Kind};
use crate::number::rational;
use crate::regressor::form::RegressorForm;
use std::collections::HashMap;

/// Harmonics whose magnitudes add up to less than this share of the norm are truncated.
const CUT: f64 = 1e-16;
/// Highest harmonic of a value.
const HIGHEST: usize = 4096;
/// Bound of the rounding error of one complex operation, as a share of its result: twice its actual bound of four
/// half-ulps.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

/// The harmonics of one entry of the regressor.
#[derive(Clone, Debug, PartialEq)]
pub struct EntryContent {
    /// Index of the row.
    pub row: usize,
    /// Index of the column.
    pub column: usize,
    /// Cosine and sine coefficients, unit of the entry.
    pub wave: Wave,
    /// A bound of the error of every coefficient, and of every harmonic's amplitude.
    pub error: f64,
}

impl EntryContent {
    /// The amplitude of a harmonic, unit of the entry.
    #[must_use]
    pub fn amplitude(&self, harmonic: usize) -> f64 {
        let at = |list: &[f64]| list.get(harmonic).copied().unwrap_or(0.0);
        at(&self.wave.cos).hypot(at(&self.wave.sin))
    }

    /// Harmonics at which the entry is certainly not zero, in ascending order.
    pub fn certain(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.wave.cos.len()).filter(|&harmonic| self.amplitude(harmonic) > self.error)
    }
}

/// A periodic motion.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PeriodicMotion {
    /// Fundamental angular frequency, rad/s.
    pub frequency: f64,
    /// The motion of every coordinate of the model over a period, by its index; `None` where it is not known.
    pub coordinates: Vec<Option<Wave>>,
}

/// The harmonics of the entries of a regressor along a motion, by row and column, without zero entries. `value` gives
/// run-time constants. Entries are omitted that contain a function other than sine and cosine, a divisor that varies
/// with time, or a coordinate whose motion is unknown.
pub fn content(
    model: &ExactModel,
    form: &RegressorForm,
    motion: &PeriodicMotion,
    value: impl Fn(Symbol) -> f64,
) -> Vec<EntryContent> {
    let mut nodes = Nodes { model, motion, value: &value, known: HashMap::new() };
    let mut found = Vec::new();
    for (row, own) in form.rows.iter().enumerate() {
        for terms in own.terms.chunk_by(|a, b| a.column == b.column) {
            let Some(column) = terms.first().and_then(|term| term.column) else { continue };
            let entry = terms.iter().try_fold(Series::number(0.0), |sum, term| {
                let mut product = Series::rounded(rational::to_f64(&term.coefficient));
                for (&atom, exponent) in term.atoms.factors() {
                    product = product.times(&nodes.power(atom, exponent)?)?;
                }
                Some(sum.plus(&product))
            });
            if let Some(Series { spectrum, error }) = entry {
                found.push(EntryContent { row, column, wave: spectrum.wave(), error });
            }
        }
    }
    found
}

/// A Fourier series and a bound of its error, in the norm sum |c_n|.
#[derive(Clone)]
struct Series {
    spectrum: Spectrum,
    error: f64,
}

impl Series {
    fn number(value: f64) -> Self {
        Self { spectrum: Spectrum(vec![(value, 0.0)]), error: 0.0 }
    }

    /// A number that was rounded to the nearest double.
    fn rounded(value: f64) -> Self {
        Self { error: ROUNDING * value.abs(), ..Self::number(value) }
    }

    /// The norm, rounded up.
    fn norm(&self) -> f64 {
        self.spectrum.norm() * (1.0 + 1e-12)
    }

    fn plus(&self, other: &Self) -> Self {
        let (long, short) = if self.spectrum.top() < other.spectrum.top() { (other, self) } else { (self, other) };
        let mut sum = long.spectrum.clone();
        let from = long.spectrum.top() - short.spectrum.top();
        for (to, part) in sum.0[from..].iter_mut().zip(&short.spectrum.0) {
            to.0 += part.0;
            to.1 += part.1;
        }
        let sum = Self { spectrum: sum, error: self.error + other.error };
        Self { error: sum.error + ROUNDING * sum.norm(), ..sum }.trimmed()
    }

    fn times(&self, other: &Self) -> Option<Self> {
        let (a, b) = (self.norm(), other.norm());
        budget::charge((self.spectrum.0.len() * other.spectrum.0.len()) as u64);
        let additions = self.spectrum.0.len().min(other.spectrum.0.len()) as f64 + 2.0;
        let error = a * other.error + self.error * (b + other.error) + additions * ROUNDING * a * b;
        let product = Self { spectrum: self.spectrum.times(&other.spectrum), error }.trimmed();
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
        let mut product = Self { spectrum: turn, error: ROUNDING };
        for k in 1..phase.cos.len() {
            for (cosine, amplitude) in [(true, phase.cos[k]), (false, phase.sin[k])] {
                if amplitude != 0.0 {
                    let (spectrum, tail) = factor(k, cosine, amplitude)?;
                    let norm = spectrum.norm();
                    product = product.times(&Self { spectrum, error: tail + ROUNDING * norm })?;
                }
            }
        }
        product.error += (product.norm() + product.error) * self.error.exp_m1();
        let (cosine, sine) = product.spectrum.real_and_imaginary();
        let error = product.error + ROUNDING * product.norm();
        Some((Self { spectrum: cosine, error }, Self { spectrum: sine, error }))
    }
}

/// The series of a graph's nodes along a motion.
struct Nodes<'a, F> {
    model: &'a ExactModel,
    motion: &'a PeriodicMotion,
    value: &'a F,
    /// The series of every visited node; `None` for a node without one.
    known: HashMap<ExprId, Option<Series>>,
}

impl<F: Fn(Symbol) -> f64> Nodes<'_, F> {
    fn power(&mut self, base: ExprId, exponent: i32) -> Option<Series> {
        let base = self.of(base)?;
        if exponent < 0 {
            // A divisor that varies with time has no finite series.
            let [(divisor, _)] = base.spectrum.0[..] else { return None };
            let least = divisor.abs() - base.error;
            let power = divisor.powi(exponent);
            let slope = f64::from(-exponent) * least.powi(exponent - 1) * base.error;
            let rounding = f64::from(2 - exponent) * ROUNDING * power.abs();
            return (least > 0.0).then(|| Series { error: slope + rounding, ..Series::number(power) });
        }
        (0..exponent).try_fold(Series::number(1.0), |product, _| product.times(&base))
    }

    fn of(&mut self, root: ExprId) -> Option<Series> {
        let mut stack = vec![root];
        while let Some(&id) = stack.last() {
            let missing: Vec<ExprId> =
                self.model.graph.operands(id).filter(|operand| !self.known.contains_key(operand)).collect();
            if self.known.contains_key(&id) || missing.is_empty() {
                stack.pop();
                if !self.known.contains_key(&id) {
                    let series = self.node(id);
                    self.known.insert(id, series);
                }
            } else {
                stack.extend(missing);
            }
        }
        self.known.get(&root).cloned().flatten()
    }

    fn at(&self, id: ExprId) -> Option<&Series> {
        self.known.get(&id).and_then(Option::as_ref)
    }

    fn node(&mut self, id: ExprId) -> Option<Series> {
        match self.model.graph.node(id) {
            Node::Number(number) => Some(Series::rounded(rational::to_f64(number))),
            Node::Pi => Some(Series::rounded(std::f64::consts::PI)),
            Node::Symbol(symbol) => match &self.model.quantity(*symbol).kind {
                Kind::Constant { value: Some(value) } => Some(Series::rounded(rational::to_f64(value))),
                Kind::Constant { value: None } => Some(Series::number((self.value)(*symbol))),
                _ => None,
            },
            Node::Derivative(coordinate, order) => {
                let wave = self.motion.coordinates.get(coordinate.0 as usize)?.as_ref()?;
                let spectrum = wave.spectrum().derivative(self.motion.frequency, *order);
                let error = f64::from(2 * *order) * ROUNDING * spectrum.norm();
                Some(Series { spectrum, error })
            }
            Node::Sum(terms) => {
                let (&first, rest) = terms.split_first()?;
                rest.iter().try_fold(self.at(first)?.clone(), |sum, &term| Some(sum.plus(self.at(term)?)))
            }
            Node::Product(factors) => {
                let (&first, rest) = factors.split_first()?;
                rest.iter().try_fold(self.at(first)?.clone(), |product, &factor| product.times(self.at(factor)?))
            }
            Node::Power(base, exponent) => {
                let (base, exponent) = (*base, *exponent);
                self.power(base, exponent)
            }
            Node::Function(function @ (Function::Sin | Function::Cos), argument) => {
                let (cosine, sine) = self.at(*argument)?.cosine_and_sine()?;
                Some(if *function == Function::Sin { sine } else { cosine })
            }
            Node::Function(..) | Node::Atan2(..) | Node::Placeholder(_) => None,
        }
    }
}
