//! Linearisation about an equilibrium, state space and transfer functions.
//!
//! A second-order model r(q, q', q'', u) = 0 at rest at q0 under the inputs u0, with r(q0, 0, 0, u0) = 0 exactly,
//! moves near that point as
//!
//! ```text
//! M dq'' + D dq' + K dq = F du ,    M = dr/dq'',  D = dr/dq',  K = dr/dq,  F = -dr/du ,
//! x = (dq, dq'):   x' = A x + B du ,    A = [0, I; -M^-1 K, -M^-1 D],   B = [0; M^-1 F]
//! ```
//!
//! (Fong, Eqns 15, 23 and 27). The mass matrix is inverted as its adjugate over its determinant, so that every entry of
//! A and B is a polynomial over one common denominator. With dry friction the model is that of a machine that moves one way
//! (`branch`): its constant force is left out, and named.

use crate::algebra::characteristic::{self, Matrix, Rationals};
use crate::algebra::field::{Field as _, Residues};
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::budget;
use crate::expr::graph::{Coordinate, ExprId, Node, Symbol};
use crate::expr::normal_form::NormalForms;
use crate::expr::singularity::first_singularity;
use crate::expr::size::Sizes;
use crate::expr::trigonometric;
use crate::linear::branch::{Branches, Way};
use crate::mechanics::model::{Equation, ExactModel, Kind, TermId};
use crate::mechanics::pattern::Motion;
use crate::number::rational::{self, Rational};
use num_traits::{One, Zero};
use std::collections::{BTreeSet, HashMap};
use thiserror::Error;

/// A point at rest.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OperatingPoint {
    /// The value of every coordinate that is not 0, an expression of constants and parameters.
    pub coordinates: Vec<(Coordinate, ExprId)>,
    /// The value of every input that is not 0.
    pub inputs: Vec<(Symbol, ExprId)>,
}

/// Why a model cannot be linearised at a point.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum LinearizeError {
    /// The equations do not hold at the point.
    #[error(
        "the point is no equilibrium: equation {equation} leaves `{residual}` instead of 0; choose other coordinates, or the inputs that hold it there"
    )]
    NotEquilibrium {
        /// The equation.
        equation: String,
        /// The residual of the equation at the point.
        residual: String,
    },
    /// A term has no derivative at the point.
    #[error("`{atom}` has no derivative at the point, so equation {equation} has no linearisation there")]
    NotSmooth {
        /// The source term at fault.
        term: TermId,
        /// The equation.
        equation: String,
        /// The function or quotient.
        atom: String,
    },
    /// Dry friction whose derivatives are other ones forwards and backwards.
    #[error(
        "equation {equation} has another linear model forwards and backwards, since `{atom}` changes what its factor grows with; leave the term out, or hold what its factor depends on"
    )]
    TwoBranches {
        /// The source term at fault.
        term: TermId,
        /// The equation.
        equation: String,
        /// The sign or absolute value.
        atom: String,
    },
    /// The equations are not of second order.
    #[error(
        "equation {equation} contains `{found}`; only models of second order are linearised, so eliminate nothing first"
    )]
    Order {
        /// The source term at fault.
        term: TermId,
        /// The equation.
        equation: String,
        /// The derivative that was found.
        found: String,
    },
    /// The numbers of equations and coordinates differ.
    #[error("{equations} equations do not determine the motion of {coordinates} coordinates")]
    Shape {
        /// Number of equations.
        equations: usize,
        /// Number of coordinates.
        coordinates: usize,
    },
    /// The linear model is too long to be written in symbols.
    #[error(
        "the linear model would have up to {terms:.0e} terms in symbols, beyond {most:.0e}; hold joints that need not move, or state known inertias and other parameters as numbers"
    )]
    TooLong {
        /// An upper bound of the number of terms.
        terms: u64,
        /// The most terms that are written down.
        most: u64,
    },
    /// The mass matrix is singular.
    #[error(
        "the mass matrix at the point is singular (its determinant is 0), so the accelerations are not determined; a coordinate without inertia must be eliminated first"
    )]
    SingularMass,
    /// A value of the point depends on the motion or an input.
    #[error("the point's value `{found}` must consist of constants and parameters")]
    Value {
        /// The value.
        found: String,
    },
}

/// A linear model; matrices are lists of rows, rows of M, D, K, F are equations.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Linearization {
    /// The inputs, columns of F and of the last rows of B.
    pub inputs: Vec<Symbol>,
    /// The mass matrix M.
    pub mass: Matrix<ExprId>,
    /// The damping matrix D.
    pub damping: Matrix<ExprId>,
    /// The stiffness matrix K.
    pub stiffness: Matrix<ExprId>,
    /// The input matrix F.
    pub input: Matrix<ExprId>,
    /// det M, the common denominator of A and B.
    pub determinant: ExprId,
    /// Dry friction that the model leaves out: the equation, and the sign of a rate that stands in it. The matrices are those of a
    /// machine that moves one way, and hold either way.
    pub friction: Vec<(String, ExprId)>,
    /// A for the state (coordinates, velocities), in order of declaration.
    pub a: Matrix<ExprId>,
    /// B, the input matrix of the state space.
    pub b: Matrix<ExprId>,
}

/// Operations of a product of two residues, for the budget.
const RESIDUE: u64 = 8;

/// Operations for the derivative of a row at the point with respect to one leaf, for the budget.
const SLOPE: u64 = 3000;

/// Most terms of an equation at the point, and of the determinant of M s^2 + D s + K. For longer ones the symbolic
/// inverse takes minutes, or all memory.
const MOST_TERMS: u64 = 100_000;

/// An upper bound of the number of terms of a determinant: every term is a product of one monomial of each row.
fn size_of_determinant(matrices: [&Vec<Vec<Polynomial<ExprId>>>; 3]) -> f64 {
    let row = |r: usize| {
        let entries = matrices.iter().flat_map(|matrix| &matrix[r]).flat_map(Polynomial::terms);
        let monomials: BTreeSet<&Monomial<ExprId>> = entries.map(|(monomial, _)| monomial).collect();
        monomials.len().max(1) as f64
    };
    (0..matrices[0].len()).map(row).product()
}

/// Linearises a model about a point at rest.
///
/// # Errors
/// When the point is no equilibrium or the model is not smooth there, not of second order, too long, or has a singular mass
/// matrix; the equation is named.
pub fn linearize(model: &mut ExactModel, point: &OperatingPoint) -> Result<Linearization, LinearizeError> {
    let n = model.coordinates.len();
    if model.equations.len() != n {
        return Err(LinearizeError::Shape { equations: model.equations.len(), coordinates: n });
    }
    let inputs: Vec<Symbol> = model.inputs().collect();
    let replacement = replacements(model, point, &inputs)?;
    let equations = model.equations.clone();
    let mut rows = Vec::with_capacity(n);
    let mut sizes = Sizes::default();
    let mut friction: Vec<(String, ExprId)> = Vec::new();
    let mut backwards: Vec<(usize, ExprId)> = Vec::new();
    // The model must be of second order, smooth, and in equilibrium at the point.
    for equation in &equations {
        for source in &equation.terms {
            let leaves = model.graph.leaves(source.expr);
            let high = leaves.iter().find(|&&leaf| matches!(model.graph.node(leaf), Node::Derivative(_, 3..)));
            if let Some(&leaf) = high {
                let found = model.display_brief(leaf);
                return Err(LinearizeError::Order { term: source.id, equation: equation.name.clone(), found });
            }
            let branches = Branches::of(&mut model.graph, &[source.expr], &replacement);
            let moving = branches.taken(&mut model.graph, source.expr, Way::Forwards);
            if let Some(atom) = first_singularity(&mut model.graph, moving, &replacement) {
                let atom = model.display_brief(atom);
                return Err(LinearizeError::NotSmooth { term: source.id, equation: equation.name.clone(), atom });
            }
        }
        let terms: Vec<ExprId> = equation.terms.iter().map(|term| term.expr).collect();
        let row = model.graph.sum(&terms);
        let branches = Branches::of(&mut model.graph, &terms, &replacement);
        friction.extend(branches.signs().map(|sign| (equation.name.clone(), sign)));
        if !branches.is_empty() {
            backwards.push((rows.len(), branches.taken(&mut model.graph, row, Way::Backwards)));
        }
        let resting = branches.taken(&mut model.graph, row, Way::Between);
        let value = model.graph.substitute(resting, &replacement);
        let terms = sizes.of(&model.graph, value) as u64;
        if terms > MOST_TERMS {
            return Err(LinearizeError::TooLong { terms, most: MOST_TERMS });
        }
        if !trigonometric::is_zero(&mut model.graph, value) {
            let residual = trigonometric::simplify(&mut model.graph, value);
            let residual = model.display_brief(residual);
            return Err(LinearizeError::NotEquilibrium { equation: equation.name.clone(), residual });
        }
        rows.push(branches.taken(&mut model.graph, row, Way::Forwards));
    }
    // The derivatives of the rows at the point.
    budget::charge(SLOPE.saturating_mul(((n + backwards.len()) * (3 * n + inputs.len())) as u64));
    let mut at_point = replacement.clone();
    let mut jacobian =
        |model: &mut ExactModel, rows: &[ExprId], leaves: &[ExprId], sign: i64| -> Vec<Vec<Polynomial<ExprId>>> {
            let mut matrix = Vec::with_capacity(n);
            for &row in rows {
                // Of a long sum few terms have a leaf in them.
                let parts = match model.graph.node(row) {
                    Node::Sum(terms) => terms.clone(),
                    _ => vec![row],
                };
                let mut with: HashMap<ExprId, Vec<ExprId>> = HashMap::new();
                for part in parts {
                    for leaf in model.graph.leaves(part) {
                        with.entry(leaf).or_default().push(part);
                    }
                }
                let mut entries = Vec::with_capacity(leaves.len());
                for leaf in leaves {
                    let own = with.get(leaf).map_or(&[][..], Vec::as_slice);
                    let slopes: Vec<ExprId> = own.iter().map(|&part| model.graph.differentiate(part, *leaf)).collect();
                    let slope = model.graph.sum(&slopes);
                    let value = model.graph.substitute_beside(slope, &mut at_point);
                    entries.push(trigonometric::normal(&mut model.graph, value).scale(&rational::integer(sign)));
                }
                matrix.push(entries);
            }
            matrix
        };
    let mut leaves = |order: u32| -> Vec<ExprId> {
        (0u32..).take(n).map(|c| model.graph.derivative_of(Coordinate(c), order)).collect()
    };
    let (positions, velocities, accelerations) = (leaves(0), leaves(1), leaves(2));
    let drives: Vec<ExprId> = inputs.iter().map(|&symbol| model.graph.symbol(symbol)).collect();
    let mass = jacobian(model, &rows, &accelerations, 1);
    let damping = jacobian(model, &rows, &velocities, 1);
    let stiffness = jacobian(model, &rows, &positions, 1);
    let input = jacobian(model, &rows, &drives, -1);
    for (r, row) in backwards {
        let mut other = |model: &mut ExactModel, leaves: &[ExprId], sign| jacobian(model, &[row], leaves, sign);
        let same = other(model, &accelerations, 1)[0] == mass[r]
            && other(model, &velocities, 1)[0] == damping[r]
            && other(model, &positions, 1)[0] == stiffness[r]
            && other(model, &drives, -1)[0] == input[r];
        if !same {
            return Err(two_branches(model, &equations[r], &replacement));
        }
    }
    let terms = size_of_determinant([&mass, &damping, &stiffness]) as u64;
    if terms > MOST_TERMS {
        return Err(LinearizeError::TooLong { terms, most: MOST_TERMS });
    }
    let found = state_space(model, inputs, [mass, damping, stiffness, input])?;
    Ok(Linearization { friction, ..found })
}

/// The fault of an equation with other derivatives forwards and backwards, at its first term with a sign or an absolute value of a rate.
fn two_branches(model: &mut ExactModel, equation: &Equation, point: &HashMap<ExprId, ExprId>) -> LinearizeError {
    let mut at = (equation.terms[0].id, equation.terms[0].expr);
    for term in &equation.terms {
        let branches = Branches::of(&mut model.graph, &[term.expr], point);
        if let Some(sign) = branches.first() {
            at = (term.id, sign);
            break;
        }
    }
    let atom = model.display_brief(at.1);
    LinearizeError::TwoBranches { term: at.0, equation: equation.name.clone(), atom }
}

fn replacements(
    model: &mut ExactModel,
    point: &OperatingPoint,
    inputs: &[Symbol],
) -> Result<HashMap<ExprId, ExprId>, LinearizeError> {
    let order = model.order().max(2);
    let mut replacement = exact_constants(model);
    let values = point.coordinates.iter().map(|(_, value)| value).chain(point.inputs.iter().map(|(_, value)| value));
    for &value in values {
        let moves = model.graph.leaves(value).into_iter().any(|leaf| match model.graph.node(leaf) {
            Node::Symbol(symbol) => model.quantity(*symbol).kind == Kind::Input,
            _ => true,
        });
        if moves {
            return Err(LinearizeError::Value { found: model.display_brief(value) });
        }
    }
    let zero = model.graph.integer(0);
    for c in (0u32..).take(model.coordinates.len()).map(Coordinate) {
        let given = point.coordinates.iter().find(|(coordinate, _)| *coordinate == c);
        let value = given.map_or(zero, |(_, value)| *value);
        let value = model.graph.substitute(value, &replacement.clone());
        let position = model.graph.derivative_of(c, 0);
        replacement.insert(position, value);
        for order in 1..=order {
            let derivative = model.graph.derivative_of(c, order);
            replacement.insert(derivative, zero);
        }
    }
    for &symbol in inputs {
        let given = point.inputs.iter().find(|(input, _)| *input == symbol);
        let value = given.map_or(zero, |(_, value)| *value);
        let leaf = model.graph.symbol(symbol);
        replacement.insert(leaf, value);
    }
    Ok(replacement)
}

/// Every constant whose value is known exactly, with that value.
fn exact_constants(model: &mut ExactModel) -> HashMap<ExprId, ExprId> {
    let mut known = HashMap::new();
    for (index, quantity) in (0u32..).zip(&model.symbols) {
        if let Kind::Constant { value: Some(value) } = &quantity.kind {
            let value = value.clone();
            let leaf = model.graph.symbol(Symbol(index));
            let value = model.graph.number(value);
            known.insert(leaf, value);
        }
    }
    known
}

fn state_space(
    model: &mut ExactModel,
    inputs: Vec<Symbol>,
    [mass, damping, stiffness, input]: [Vec<Vec<Polynomial<ExprId>>>; 4],
) -> Result<Linearization, LinearizeError> {
    let n = mass.len();
    let graph = &mut model.graph;
    let (determinant, adjugate) = characteristic::adjugate(&mut NormalForms(graph), &mass);
    if trigonometric::numerator(graph, &determinant).is_zero() {
        return Err(LinearizeError::SingularMass);
    }
    let inverse = graph.from_polynomial(&determinant);
    let inverse = graph.pow(inverse, -1);
    let mut quotient = |matrix: &Vec<Vec<Polynomial<ExprId>>>, sign: i64| -> Matrix<ExprId> {
        let product = characteristic::multiply(&mut NormalForms(graph), &adjugate, matrix);
        let entry = |polynomial: &Polynomial<ExprId>| {
            let numerator = graph.from_polynomial(&polynomial.scale(&rational::integer(sign)));
            graph.mul(numerator, inverse)
        };
        let mut entry = entry;
        product.iter().map(|row| row.iter().map(&mut entry).collect()).collect()
    };
    let (lower_left, lower_right, lower_input) =
        (quotient(&stiffness, -1), quotient(&damping, -1), quotient(&input, 1));
    let (zero, one) = (graph.integer(0), graph.integer(1));
    let mut a: Matrix<ExprId> = Vec::with_capacity(2 * n);
    let mut b: Matrix<ExprId> = Vec::with_capacity(2 * n);
    for i in 0..n {
        a.push((0..2 * n).map(|j| if j == n + i { one } else { zero }).collect());
        b.push(vec![zero; inputs.len()]);
    }
    for (left, right) in lower_left.into_iter().zip(lower_right) {
        a.push(left.into_iter().chain(right).collect());
    }
    b.extend(lower_input);
    let mut exprs = |matrix: &Vec<Vec<Polynomial<ExprId>>>| -> Matrix<ExprId> {
        matrix.iter().map(|row| row.iter().map(|entry| graph.from_polynomial(entry)).collect()).collect()
    };
    let (mass, damping, stiffness, input) = (exprs(&mass), exprs(&damping), exprs(&stiffness), exprs(&input));
    let determinant = graph.from_polynomial(&determinant);
    Ok(Linearization { inputs, mass, damping, stiffness, input, determinant, friction: Vec::new(), a, b })
}

/// x' = A x + B u in numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct StateSpace<T> {
    /// A, square.
    pub a: Matrix<T>,
    /// B, one column per input.
    pub b: Matrix<T>,
}

impl Linearization {
    /// A and B in double precision, given the values of the remaining leaves (parameters and run-time constants).
    #[must_use]
    pub fn evaluate(&self, model: &ExactModel, mut leaf: impl FnMut(Symbol) -> f64) -> StateSpace<f64> {
        // Most entries are zero, and a value takes a pass over all that came before it.
        let mut known: HashMap<ExprId, f64> = HashMap::new();
        let mut value = |expr: ExprId| {
            *known.entry(expr).or_insert_with(|| {
                model.graph.evaluate(expr, |node| match node {
                    Node::Symbol(symbol) => match &model.quantity(*symbol).kind {
                        Kind::Constant { value: Some(value) } => rational::to_f64(value),
                        _ => leaf(*symbol),
                    },
                    _ => 0.0,
                })
            })
        };
        let mut map = |m: &Matrix<ExprId>| m.iter().map(|row| row.iter().map(|&e| value(e)).collect()).collect();
        StateSpace { a: map(&self.a), b: map(&self.b) }
    }

    /// A and B exactly; `None` when a value is missing or an entry is not rational, such as the cosine of an angle that
    /// is not a multiple of a quarter turn.
    #[must_use]
    pub fn evaluate_exact(
        &self,
        model: &ExactModel,
        mut leaf: impl FnMut(Symbol) -> Option<Rational>,
    ) -> Option<StateSpace<Rational>> {
        let mut known: HashMap<ExprId, Option<Rational>> = HashMap::new();
        let mut value = |expr: ExprId| {
            let of = || {
                model.graph.evaluate_exact(expr, |node| match node {
                    Node::Symbol(symbol) => match &model.quantity(*symbol).kind {
                        Kind::Constant { value: Some(value) } => Some(value.clone()),
                        _ => leaf(*symbol),
                    },
                    _ => None,
                })
            };
            known.entry(expr).or_insert_with(of).clone()
        };
        let mut map = |m: &Matrix<ExprId>| -> Option<Matrix<Rational>> {
            m.iter().map(|row| row.iter().map(|&e| value(e)).collect()).collect()
        };
        Some(StateSpace { a: map(&self.a)?, b: map(&self.b)? })
    }
}

/// A rational function of s in lowest terms: coefficients from s^0 upwards, the denominator's last one is 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TransferFunction {
    /// Numerator; empty when the function is 0.
    pub numerator: Vec<Rational>,
    /// Denominator.
    pub denominator: Vec<Rational>,
    /// The common factor that was removed, its last coefficient 1. Its roots are poles that are exactly cancelled by
    /// zeros, so they are not observable from the output or not controllable from the input.
    pub cancelled: Vec<Rational>,
}

impl StateSpace<Rational> {
    /// det(s I - A), coefficients from s^0 upwards.
    #[must_use]
    pub fn characteristic_polynomial(&self) -> Vec<Rational> {
        characteristic::characteristic(&mut Rationals, &self.a).coefficients
    }

    /// c (s I - A)^-1 b for the output c x and one input, with common factors of numerator and denominator removed. `None` when `output`
    /// has not one weight per state or there is no such input. For several of them, find the [`StateSpace::resolvent`] once.
    #[must_use]
    pub fn transfer_function(&self, output: &[Rational], input: usize) -> Option<TransferFunction> {
        self.resolvent().transfer_function(output, input)
    }

    /// (s I - A)^-1, which all transfer functions have in common.
    #[must_use]
    pub fn resolvent(&self) -> Resolvent<'_> {
        Resolvent { space: self, found: characteristic::characteristic(&mut Rationals, &self.a) }
    }
}

/// (s I - A)^-1 of a state space.
#[derive(Clone, Debug)]
pub struct Resolvent<'a> {
    space: &'a StateSpace<Rational>,
    found: characteristic::Characteristic<Rational>,
}

impl Resolvent<'_> {
    /// det(s I - A), coefficients from s^0 upwards.
    #[must_use]
    pub fn characteristic_polynomial(&self) -> &[Rational] {
        &self.found.coefficients
    }

    /// c (s I - A)^-1 b for the output c x and one input, with common factors of numerator and denominator removed.
    /// `None` when `output` has not one weight per state or there is no such input.
    #[must_use]
    pub fn transfer_function(&self, output: &[Rational], input: usize) -> Option<TransferFunction> {
        let StateSpace { a, b } = self.space;
        if output.len() != a.len() || b.first().is_none_or(|row| input >= row.len()) {
            return None;
        }
        let numerator: Vec<Rational> = self
            .found
            .adjugate
            .iter()
            .map(|matrix| {
                let row = |weights: &[Rational]| -> Rational {
                    let parts = weights.iter().zip(b).filter(|(w, b)| !w.is_zero() && !b[input].is_zero());
                    parts.map(|(w, b)| w * &b[input]).sum()
                };
                let rows = output.iter().zip(matrix).filter(|(c, _)| !c.is_zero());
                rows.map(|(c, weights)| c * row(weights)).sum()
            })
            .collect();
        Some(lowest_terms(numerator, self.found.coefficients.clone()))
    }
}

impl TransferFunction {
    /// The value at a real s; `None` at a pole.
    #[must_use]
    pub fn evaluate(&self, s: &Rational) -> Option<Rational> {
        let horner = |p: &[Rational]| p.iter().rev().fold(Rational::zero(), |value, c| value * s + c);
        let denominator = horner(&self.denominator);
        if denominator.is_zero() { None } else { Some(horner(&self.numerator) / denominator) }
    }
}

fn lowest_terms(numerator: Vec<Rational>, denominator: Vec<Rational>) -> TransferFunction {
    let numerator = trimmed(numerator);
    if numerator.is_empty() {
        return TransferFunction { numerator, denominator: vec![Rational::one()], cancelled: denominator };
    }
    let (mut a, mut b) = (denominator.clone(), numerator.clone());
    if are_coprime(&a, &b) {
        a = vec![Rational::one()];
        b.clear();
    }
    while !b.is_empty() {
        // Remainders that are not made monic have coefficients whose lengths double from one to the next.
        make_monic(&mut b);
        let rest = divide(a, &b).1;
        a = std::mem::replace(&mut b, rest);
    }
    make_monic(&mut a);
    let (mut numerator, mut denominator) = (divide(numerator, &a).0, divide(denominator, &a).0);
    let lead = make_monic(&mut denominator);
    numerator.iter_mut().for_each(|c| *c /= &lead);
    TransferFunction { numerator, denominator, cancelled: a }
}

/// Whether two polynomials have no common factor, as one prime shows: modulo a prime that divides neither leading coefficient, a common
/// factor stays one. False where this prime does not show it.
fn are_coprime(a: &[Rational], b: &[Rational]) -> bool {
    let field = Residues::new(Residues::PRIMES[0]);
    let modulo = |polynomial: &[Rational]| -> Option<Vec<u64>> {
        let values: Vec<u64> = polynomial.iter().map(|c| field.number(c)).collect::<Option<_>>()?;
        values.last().is_some_and(|lead| *lead != 0).then_some(values)
    };
    let (Some(mut a), Some(mut b)) = (modulo(a), modulo(b)) else { return false };
    while b.len() > 1 {
        let Some(inverse) = b.last().and_then(|lead| field.inverse(lead)) else { return false };
        budget::charge((b.len() * a.len().saturating_sub(b.len() - 1)) as u64 * RESIDUE);
        while a.len() >= b.len() {
            let shift = a.len() - b.len();
            let factor = field.mul(&a[a.len() - 1], &inverse);
            for (i, c) in b.iter().enumerate() {
                a[shift + i] = field.sub(&a[shift + i], &field.mul(c, &factor));
            }
            while a.last().is_some_and(|lead| *lead == 0) {
                a.pop();
            }
        }
        std::mem::swap(&mut a, &mut b);
    }
    // The last remainder is a number that is not zero, or nothing.
    b.len() == 1
}

/// Divides by the leading coefficient, which it returns; 1 for the zero polynomial.
fn make_monic(polynomial: &mut [Rational]) -> Rational {
    let lead = polynomial.last().cloned().unwrap_or_else(Rational::one);
    polynomial.iter_mut().for_each(|c| *c /= &lead);
    lead
}

fn trimmed(mut polynomial: Vec<Rational>) -> Vec<Rational> {
    while polynomial.last().is_some_and(Zero::is_zero) {
        polynomial.pop();
    }
    polynomial
}

/// Quotient and remainder of polynomials; the divisor has a non-zero leading coefficient.
fn divide(dividend: Vec<Rational>, divisor: &[Rational]) -> (Vec<Rational>, Vec<Rational>) {
    let mut rest = trimmed(dividend);
    let mut quotient = vec![Rational::zero(); (rest.len() + 1).saturating_sub(divisor.len())];
    let Some(lead) = divisor.last() else { return (quotient, rest) };
    while rest.len() >= divisor.len() {
        let shift = rest.len() - divisor.len();
        let factor = &rest[rest.len() - 1] / lead;
        for (i, c) in divisor.iter().enumerate() {
            rest[shift + i] -= c * &factor;
        }
        quotient[shift] = factor;
        rest = trimmed(rest);
    }
    (quotient, rest)
}

/// Why a coordinate cannot be substituted.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SubstituteError {
    /// The new coordinate is 0 times the old one.
    #[error("the coordinate `{coordinate}` cannot be replaced by 0 times another")]
    ZeroScale {
        /// The old coordinate.
        coordinate: String,
    },
    /// The offset is not constant.
    #[error("the offset `{offset}` of the coordinate `{coordinate}` must consist of constants and parameters")]
    Offset {
        /// The old coordinate.
        coordinate: String,
        /// The offset.
        offset: String,
    },
    /// The pattern's motion of the old coordinate cannot be expressed in the new one.
    #[error(
        "the motion of `{coordinate}` under a pattern cannot be moved by `{offset}`, which is not a polynomial of constants; give the pattern in the new coordinate"
    )]
    Pattern {
        /// The old coordinate.
        coordinate: String,
        /// The offset.
        offset: String,
    },
}

/// Replaces a coordinate q by scale * new + offset in every equation and pattern, such as theta2 = alpha2 - pi (above
/// Fong, Eqn 25); trigonometric functions are brought to their normal form, so that quarter turns disappear.
///
/// # Errors
/// When the scale is zero, the offset is not constant, or a pattern's motion cannot be expressed in the new coordinate.
pub fn substitute_coordinate(
    model: &mut ExactModel,
    coordinate: Coordinate,
    new_name: &str,
    scale: &Rational,
    offset: ExprId,
) -> Result<(), SubstituteError> {
    let old = model.coordinates[coordinate.0 as usize].name.clone();
    if scale.is_zero() {
        return Err(SubstituteError::ZeroScale { coordinate: old });
    }
    let constant = model.graph.leaves(offset).into_iter().all(|leaf| match model.graph.node(leaf) {
        Node::Symbol(symbol) => model.quantity(*symbol).kind != Kind::Input,
        _ => false,
    });
    if !constant {
        return Err(SubstituteError::Offset { coordinate: old, offset: model.display_brief(offset) });
    }
    let shift = offset_motion(model, offset);
    let mut patterns = model.patterns.clone();
    for pattern in &mut patterns {
        if let Some(Some(motion)) = pattern.motions.get_mut(coordinate.0 as usize) {
            let Some(shift) = &shift else {
                return Err(SubstituteError::Pattern { coordinate: old, offset: model.display_brief(offset) });
            };
            let one =
                |value: Rational| Motion::term(Monomial::one(), crate::algebra::fourier::Fourier::constant(value));
            let moved = motion.add(&shift.mul(&one(rational::integer(-1))));
            *motion = moved.mul(&one(scale.recip()));
        }
    }
    let mut replacement = HashMap::new();
    for order in 0..=model.order() {
        let leaf = model.graph.derivative_of(coordinate, order);
        let scaled = model.graph.scale(leaf, scale.clone());
        let new = if order == 0 { model.graph.add(scaled, offset) } else { scaled };
        replacement.insert(leaf, new);
    }
    for equation in 0..model.equations.len() {
        for term in 0..model.equations[equation].terms.len() {
            let expr = model.equations[equation].terms[term].expr;
            if !model.graph.leaves(expr).iter().any(|leaf| replacement.contains_key(leaf)) {
                continue;
            }
            let moved = model.graph.substitute(expr, &replacement);
            model.equations[equation].terms[term].expr = trigonometric::simplify(&mut model.graph, moved);
        }
    }
    model.patterns = patterns;
    new_name.clone_into(&mut model.coordinates[coordinate.0 as usize].name);
    Ok(())
}

/// The offset as a constant motion, which is a polynomial of symbols.
fn offset_motion(model: &ExactModel, offset: ExprId) -> Option<Motion> {
    let mut motion = Motion::zero();
    for (monomial, coefficient) in model.graph.polynomial(offset).terms() {
        let mut symbols = Monomial::one();
        for (&atom, exponent) in monomial.factors() {
            let Node::Symbol(symbol) = model.graph.node(atom) else { return None };
            symbols = symbols.mul(&Monomial::power_of(*symbol, exponent));
        }
        motion = motion.add(&Motion::term(symbols, crate::algebra::fourier::Fourier::constant(coefficient.clone())));
    }
    Some(motion)
}
