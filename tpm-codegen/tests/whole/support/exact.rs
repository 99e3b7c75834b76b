//! Exact values of a model's terms at a point, with the sum of their magnitudes.

use tpm_codegen::emit::estimator::EstimatorSource;
use tpm_symbolic::algebra::fourier::Trig;
use tpm_symbolic::algebra::fraction::Fraction;
use tpm_symbolic::algebra::polynomial::{Monomial, Polynomial};
use tpm_symbolic::expr::graph::{ExprId, Node, Symbol};
use tpm_symbolic::mechanics::model::{ExactModel, Kind};
use tpm_symbolic::number::rational;
use tpm_symbolic::number::rational::Rational;
use tpm_symbolic::regressor::form::{Column, Row};
use tpm_symbolic::regressor::inverse::{Inverse, Variable};

/// The rational number that a double is.
pub(crate) fn exact(value: f64) -> Rational {
    rational::from_f64(value).unwrap_or_else(|| panic!("{value} is no number"))
}

/// pi to a power, to more digits than any scalar has.
pub(crate) fn pi_power(exponent: i32) -> Rational {
    let digits: num_bigint::BigInt = "31415926535897932384626433832795028842".parse().expect("digits");
    let pi = Rational::new(digits, num_bigint::BigInt::from(10).pow(37));
    rational::power(&pi, exponent)
}

/// An exact sum and the sum of the magnitudes of its terms.
#[derive(Clone, Debug)]
pub(crate) struct Sum {
    pub(crate) value: Rational,
    pub(crate) magnitude: Rational,
}

impl Default for Sum {
    fn default() -> Self {
        Self { value: rational::integer(0), magnitude: rational::integer(0) }
    }
}

impl Sum {
    /// A sum of exact terms.
    pub(crate) fn of(terms: impl IntoIterator<Item = Rational>) -> Self {
        Self::total(terms.into_iter().map(|term| Self { magnitude: rational::abs(&term), value: term }))
    }

    /// A sum of sums.
    fn total(terms: impl IntoIterator<Item = Self>) -> Self {
        let mut sum = Self::default();
        for term in terms {
            sum.magnitude += term.magnitude;
            sum.value += term.value;
        }
        sum
    }

    /// Adds a multiple of another sum.
    pub(crate) fn add_scaled(&mut self, other: &Self, factor: &Rational) {
        self.value += &other.value * factor;
        self.magnitude += &other.magnitude * rational::abs(factor);
    }
}

/// The real or imaginary part of (c + j s)^k, expanded; magnitudes add up to (|c| + |s|)^k at most.
pub(crate) fn harmonic_power(cosine: f64, sine: f64, harmonic: usize, function: Trig) -> Sum {
    let (c, s) = (exact(cosine), exact(sine));
    let (mut re, mut im) = (rational::integer(1), rational::integer(0));
    for _ in 0..harmonic {
        (re, im) = (&re * &c - &im * &s, &re * &s + &im * &c);
    }
    let size = rational::power(&(rational::abs(&c) + rational::abs(&s)), i32::try_from(harmonic).expect("small"));
    Sum { value: if function == Trig::Cos { re } else { im }, magnitude: size }
}

/// The physical parameters that belong to columns, by the fractions of the inverse rather than by its plan; magnitudes bound
/// the rounding errors of numerators and denominators, and to first order what those of intermediates come to. `None` where a
/// denominator is zero.
pub(crate) fn unlumped(
    model: &ExactModel,
    inverse: &Inverse,
    columns: &[Rational],
    constants: impl FnMut(Symbol) -> Rational,
) -> Option<Vec<Sum>> {
    let given = columns.iter().cloned().chain(inverse.constants.iter().copied().map(constants));
    let mut known: Vec<(Rational, Rational)> = given.map(|value| (value, rational::integer(0))).collect();
    let at = |known: &[(Rational, Rational)], fraction: &Fraction<Variable>| {
        let value = fraction.evaluate(|&variable| known[variable].0.clone())?;
        let size = |polynomial: &Polynomial<Variable>| -> Option<(Rational, Rational)> {
            let exact = polynomial.evaluate(|&variable| known[variable].0.clone())?;
            let terms = polynomial.terms().map(|(monomial, c)| Polynomial::term(monomial.clone(), c.clone()));
            let terms = terms.map(|term| Some(rational::abs(&term.evaluate(|&variable| known[variable].0.clone())?)));
            Some((exact, terms.sum::<Option<Rational>>()?))
        };
        let mut error = size(fraction.numerator())?.1;
        for (factor, exponent) in fraction.denominator() {
            let exponent = i32::try_from(exponent).expect("small");
            error /= rational::power(&rational::abs(&size(factor)?.0), exponent);
        }
        for (factor, exponent) in fraction.denominator() {
            let (exact, magnitude) = size(factor)?;
            error += rational::abs(&value) * magnitude / rational::abs(&exact) * rational::integer(i64::from(exponent));
        }
        for (variable, (_, own)) in known.iter().enumerate().filter(|(_, (_, own))| *own != rational::integer(0)) {
            let rate = fraction.derivative(&variable).evaluate(|&variable| known[variable].0.clone())?;
            error += rational::abs(&rate) * own;
        }
        Some((value, error))
    };
    for intermediate in &inverse.intermediates {
        let value = at(&known, &intermediate.value)?;
        known.push(value);
    }
    let parameters = model.parameters().map(|parameter| {
        let (_, value) = inverse.solved.iter().find(|(solved, _)| *solved == parameter).expect("solved");
        let (value, magnitude) = at(&known, value)?;
        Some(Sum { value, magnitude })
    });
    parameters.collect()
}

/// Where a model is evaluated.
pub(crate) struct Point<'a> {
    pub(crate) estimator: &'a EstimatorSource,
    /// One coordinate after the other, each with its derivatives.
    pub(crate) motion: &'a [f64],
    pub(crate) constants: &'a [f64],
    /// The parameters of the model, where they are lumped.
    pub(crate) physical: &'a [f64],
}

impl Point<'_> {
    fn leaf(&self, node: &Node) -> Option<Rational> {
        let evaluation = &self.estimator.plan.evaluation;
        match node {
            Node::Derivative(coordinate, order) => {
                let mut at = 0;
                for (present, highest) in &evaluation.coordinates {
                    if present == coordinate {
                        return Some(exact(self.motion[at + *order as usize]));
                    }
                    at += *highest as usize + 1;
                }
                None
            }
            Node::Symbol(symbol) => {
                let constant = evaluation.constants.iter().position(|present| present == symbol);
                let physical = self.estimator.model.parameters().position(|present| present == *symbol);
                match (&self.estimator.model.quantity(*symbol).kind, constant, physical) {
                    (Kind::Constant { value: Some(value) }, ..) => Some(value.clone()),
                    (_, Some(constant), _) => Some(exact(self.constants[constant])),
                    (_, _, Some(physical)) => self.physical.get(physical).copied().map(exact),
                    _ => None,
                }
            }
            _ => None,
        }
    }

    /// A product of powers, times a factor. A function without a rational value is taken in double precision; its argument
    /// was rounded, by as much as a few times the precision, so that its magnitude is no less than 4.
    fn term(&self, atoms: &Monomial<ExprId>, factor: &Rational) -> Sum {
        let graph = &self.estimator.model.graph;
        let mut sum = Sum { value: factor.clone(), magnitude: rational::abs(factor) };
        for (&atom, exponent) in atoms.factors() {
            let found = graph.evaluate_exact(atom, |node| self.leaf(node));
            let least = if found.is_some() { 0 } else { 4 };
            let value = found.unwrap_or_else(|| {
                let leaf = |node: &Node| rational::to_f64(&self.leaf(node).expect("a leaf of the model"));
                exact(graph.evaluate(atom, leaf))
            });
            sum.magnitude *= rational::power(&rational::abs(&value).max(rational::integer(least)), exponent);
            sum.value *= rational::power(&value, exponent);
        }
        sum
    }

    /// The regressor's entry in a row and column, or the known terms.
    pub(crate) fn entry(&self, row: &Row, column: Option<usize>) -> Sum {
        let terms = row.terms.iter().filter(|term| term.column == column);
        Sum::total(terms.map(|term| self.term(&term.atoms, &term.coefficient)))
    }

    /// The factor of an input in a row.
    pub(crate) fn input_factor(&self, row: &Row, input: Symbol) -> Sum {
        let factor = row.inputs.iter().find(|(symbol, _)| *symbol == input);
        Sum::total(factor.iter().flat_map(|(_, factor)| factor.terms()).map(|(atoms, c)| self.term(atoms, c)))
    }

    /// Phi theta + known in a row.
    pub(crate) fn force(&self, row: &Row, theta: &[f64]) -> Sum {
        Sum::total(row.terms.iter().map(|term| {
            let theta = term.column.map_or_else(|| rational::integer(1), |column| exact(theta[column]));
            self.term(&term.atoms, &(&term.coefficient * theta))
        }))
    }

    /// A column from the physical parameters.
    pub(crate) fn lumped(&self, column: &Column) -> Sum {
        Sum::total(column.definition.terms().map(|(atoms, c)| self.term(atoms, c)))
    }
}
