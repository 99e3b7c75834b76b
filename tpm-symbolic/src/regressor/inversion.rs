//! The search for the inverse of a parameter map.
//!
//! Values of products of parameters that are known in terms of the columns c form a multiplicative lattice of exponent
//! vectors: with k2 and k2 m2/k3 also m2/k3 is known, and its powers. Modulo this lattice every definition is a linear equation
//! in the products that are not known yet. Gauss elimination isolates products, whose values join the lattice, until it
//! contains every parameter or nothing is found any more. Two carts: k1 = c6, k2 = c7, m2/k3 = c3/(3 c7), m1 = c1 k3/m2,
//! m2 = c2 - m1 - k1 m2/k3. A definition that reduces to nothing is a constraint among the columns (c4 = c3^2/(3 c7),
//! c5 = c3^3/(27 c7^2)). Sums that divide several definitions, such as m2/g1 + m3/g1 + m3/g2 in three carts, count as
//! quantities of their own, so that relations between their powers come out as short as they are. A value that is more than
//! a single product becomes an intermediate quantity with a name of its own, so that expressions do not grow from step to
//! step. Constants are known from the beginning.

use crate::algebra::fraction::{Fraction, exact_quotient, primitive_part};
use crate::algebra::generic_point;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{ExprId, Graph, Node, Symbol};
use crate::mechanics::model::Kind;
use crate::number::rational::Rational;
use crate::regressor::inverse::{Constraint, Intermediate, Inverse, MAX_TERMS, Variable};
use crate::regressor::lattice::{Exponents, Lattice};
use crate::regressor::parameter_map::{ParameterMap, atoms_of};
use num_traits::Zero;
use std::collections::BTreeMap;

impl ParameterMap {
    /// The inverse in closed form, as far as the method of this module finds one.
    #[must_use]
    pub fn inverse(&self) -> Inverse {
        Inversion::new(self).run()
    }
}

/// Sum of the magnitudes of all exponents.
fn weight(polynomial: &Polynomial<ExprId>) -> u32 {
    let exponents = polynomial.terms().flat_map(|(monomial, _)| monomial.factors().map(|(_, e)| e));
    exponents.map(i32::unsigned_abs).sum()
}

/// A polynomial times powers of shared factors, by index.
type Factored = (Polynomial<ExprId>, Vec<(usize, i32)>);

/// The definitions, in which every sum that divides two of them, or one of them twice, is an atom.
fn with_shared_factors(graph: &mut Graph, definitions: &[Polynomial<ExprId>]) -> Vec<Polynomial<ExprId>> {
    let mut bases: Vec<(Polynomial<ExprId>, usize)> = Vec::new();
    // Short sums come first, so that longer ones are divided by them.
    let mut order: Vec<usize> = (0..definitions.len()).collect();
    order.sort_by_key(|&i| (definitions[i].len(), weight(&definitions[i])));
    let mut factored: Vec<Factored> = vec![(Polynomial::zero(), Vec::new()); order.len()];
    for i in order {
        let mut rest = definitions[i].clone();
        let mut factors = Vec::new();
        for (b, (base, uses)) in bases.iter_mut().enumerate() {
            let mut exponent = 0;
            while let Some(quotient) = exact_quotient(&rest, base) {
                rest = quotient;
                exponent += 1;
                *uses += 1;
            }
            if exponent > 0 {
                factors.push((b, exponent));
            }
        }
        if let Some((content, coefficient, sum)) = primitive_part(&rest)
            && sum.len() > 1
        {
            // The denominator remains part of the sum: m2/g1 + m3/g1 + m3/g2 is known when k2 and its product with k2
            // are known.
            let below: Monomial<ExprId> = content.factors().filter(|(_, e)| *e < 0).map(|(&v, e)| (v, e)).collect();
            factors.push((bases.len(), 1));
            bases.push((sum.mul_monomial(&below), 1));
            rest = Polynomial::term(content.mul(&below.pow(-1)), coefficient);
        }
        factored[i] = (rest, factors);
    }
    let atoms: Vec<Option<ExprId>> =
        bases.iter().map(|(base, uses)| (*uses > 1).then(|| graph.from_polynomial(base))).collect();
    let definition = |(rest, factors): Factored| {
        factors.into_iter().fold(rest, |product, (b, exponent)| match atoms[b] {
            Some(atom) => product.mul_monomial(&Monomial::power_of(atom, exponent)),
            None => product.mul(&bases[b].0.pow(exponent.unsigned_abs())),
        })
    };
    factored.into_iter().map(definition).collect()
}

/// The linear equation: sum over unknown products of (known coefficient) * product = right-hand side.
#[derive(Clone)]
struct LinearEquation {
    /// Index into the equations of the inversion.
    origin: usize,
    terms: BTreeMap<Exponents, Fraction<Variable>>,
    right: Fraction<Variable>,
}

/// Origin of an equation.
#[derive(Clone, Copy)]
enum Origin {
    /// The definition of a column.
    Column(usize),
    /// The definition of a shared sum: sum - atom = 0, which may be multiplied by any product.
    Sum(ExprId),
}

/// The equation: polynomial in the parameters = known value.
struct Equation {
    polynomial: Polynomial<ExprId>,
    origin: Origin,
    /// Sum of the magnitudes of all exponents: short definitions are used before long ones.
    weight: u32,
    used: bool,
}

struct Inversion<'a> {
    map: &'a ParameterMap,
    /// The map's graph with the shared factors.
    graph: Graph,
    atoms: Vec<ExprId>,
    equations: Vec<Equation>,
    /// The constants that are known at run time only.
    constants: Vec<Symbol>,
    lattice: Lattice,
    intermediates: Vec<Intermediate>,
    constraints: Vec<Constraint>,
    /// Values of the variables at a generic physical system. They show which expressions vanish on every physical
    /// system; such an expression need not be zero as a function of independent columns.
    witness: Option<Vec<Rational>>,
}

impl<'a> Inversion<'a> {
    fn new(map: &'a ParameterMap) -> Self {
        let mut graph = map.graph.clone();
        let definitions = with_shared_factors(&mut graph, map.definitions());
        let mut atoms = atoms_of(&definitions);
        let columns = definitions.into_iter().enumerate();
        let mut equations: Vec<(Polynomial<ExprId>, Origin)> =
            columns.map(|(column, definition)| (definition, Origin::Column(column))).collect();
        let mut pending: Vec<ExprId> = atoms.iter().copied().collect();
        while let Some(atom) = pending.pop() {
            if matches!(graph.node(atom), Node::Sum(_)) {
                let sum = graph.polynomial(atom);
                for inner in atoms_of(std::slice::from_ref(&sum)) {
                    if atoms.insert(inner) {
                        pending.push(inner);
                    }
                }
                equations.push((sum.sub(&Polynomial::variable(atom)), Origin::Sum(atom)));
            }
        }
        let atoms: Vec<ExprId> = atoms.into_iter().collect();
        let equations = equations.into_iter().map(|(polynomial, origin)| {
            let weight = weight(&polynomial);
            Equation { polynomial, origin, weight, used: false }
        });
        let mut equations: Vec<Equation> = equations.collect();
        equations.sort_by_key(|equation| equation.weight);
        let mut lattice = Lattice::default();
        let mut constants = Vec::new();
        for (position, &atom) in atoms.iter().enumerate() {
            let Node::Symbol(symbol) = *graph.node(atom) else { continue };
            let Kind::Constant { value } = &map.quantities[symbol.0 as usize].kind else { continue };
            let known = match value {
                // A constant with the value zero cannot join the lattice, since its products are used as divisors.
                Some(value) if value.is_zero() => continue,
                Some(value) => Fraction::constant(value.clone()),
                None => {
                    constants.push(symbol);
                    Fraction::variable(map.definitions().len() + constants.len() - 1)
                }
            };
            lattice.insert((0..atoms.len()).map(|other| i32::from(other == position)).collect(), known);
        }
        let mut witness = map.evaluate_exact(|symbol| generic_point::value(0, symbol.0 as usize));
        if let Some(point) = &mut witness {
            point.extend(constants.iter().map(|constant| generic_point::value(0, constant.0 as usize)));
        }
        let (intermediates, constraints) = (Vec::new(), Vec::new());
        Self { map, graph, atoms, equations, constants, lattice, intermediates, constraints, witness }
    }

    fn exponents(&self, monomial: &Monomial<ExprId>) -> Exponents {
        self.atoms.iter().map(|atom| monomial.exponent(atom)).collect()
    }

    /// Whether an expression vanishes, or has no value, on every physical system.
    fn vanishes(&self, value: &Fraction<Variable>) -> bool {
        match &self.witness {
            Some(point) => value.evaluate(|&j| point[j].clone()).is_none_or(|value| value.is_zero()),
            None => value.is_zero(),
        }
    }

    /// A product that, multiplied by `atom`, gives a known value. Any other such product differs from it by a known
    /// factor.
    fn scale_of(&self, atom: ExprId) -> Monomial<ExprId> {
        let Some(position) = self.atoms.iter().position(|own| *own == atom) else { return Monomial::one() };
        let known = self.lattice.basis.iter().find(|(vector, _)| vector[position].abs() == 1);
        known.map_or_else(Monomial::one, |(vector, _)| {
            let sign = vector[position];
            let others = self.atoms.iter().zip(vector).filter(|(own, _)| **own != atom);
            others.map(|(&own, &exponent)| (own, sign * exponent)).collect()
        })
    }

    fn linear(&self, origin: usize) -> LinearEquation {
        let Equation { polynomial, origin: kind, .. } = &self.equations[origin];
        let (right, shift) = match *kind {
            Origin::Column(column) => (Fraction::variable(column), Monomial::one()),
            Origin::Sum(atom) => (Fraction::zero(), self.scale_of(atom)),
        };
        let mut equation = LinearEquation { origin, terms: BTreeMap::new(), right };
        for (monomial, coefficient) in polynomial.terms() {
            let (rest, factor) = self.lattice.reduce(self.exponents(&monomial.mul(&shift)));
            let factor = factor.scale(coefficient);
            if rest.iter().all(|e| *e == 0) {
                equation.right = equation.right.sub(&factor);
            } else {
                let slot = equation.terms.entry(rest).or_insert_with(Fraction::zero);
                *slot = slot.add(&factor);
            }
        }
        equation.terms.retain(|_, coefficient| !self.vanishes(coefficient));
        equation
    }

    fn run(mut self) -> Inverse {
        loop {
            let open = (0..self.equations.len()).filter(|&i| !self.equations[i].used);
            let equations: Vec<LinearEquation> = open.map(|i| self.linear(i)).collect();
            if !self.advance(equations) {
                break;
            }
        }
        let (mut solved, mut unsolved) = (Vec::new(), Vec::new());
        for &parameter in self.map.parameters() {
            let is_parameter = |atom: &ExprId| *self.graph.node(*atom) == Node::Symbol(parameter);
            let value = self.atoms.iter().find(|atom| is_parameter(atom)).and_then(|&atom| {
                let (rest, factor) = self.lattice.reduce(self.exponents(&Monomial::power_of(atom, 1)));
                rest.iter().all(|e| *e == 0).then_some(factor)
            });
            match value {
                Some(value) => solved.push((parameter, value)),
                None => unsolved.push(parameter),
            }
        }
        self.constraints.sort_by_key(|constraint| (constraint.column.is_none(), constraint.column));
        let columns = self.map.definitions().len();
        Inverse {
            graph: self.graph,
            columns,
            constants: self.constants,
            intermediates: self.intermediates,
            solved,
            unsolved,
            constraints: self.constraints,
        }
    }

    /// One round: equations that reduce to zero are recorded as constraints, and isolated products are added to the
    /// lattice.
    fn advance(&mut self, equations: Vec<LinearEquation>) -> bool {
        let mut progress = false;
        let mut singles = Vec::new();
        for equation in self.reduced(equations) {
            let mut terms = equation.terms.iter();
            match (terms.next(), terms.next()) {
                (None, _) => {
                    let Equation { origin, used, .. } = &mut self.equations[equation.origin];
                    *used = true;
                    self.constraints.push(match *origin {
                        Origin::Column(column) => {
                            let value = Fraction::variable(column).sub(&equation.right);
                            Constraint { column: Some(column), value }
                        }
                        Origin::Sum(_) => Constraint { column: None, value: equation.right },
                    });
                    progress = true;
                }
                (Some((product, coefficient)), None) => {
                    if let Some(value) = equation.right.div(coefficient) {
                        singles.push((equation.origin, product.clone(), value));
                    }
                }
                _ => {}
            }
        }
        // The simplest products come first; equations that follow from them become constraints in the next round.
        let size = |product: &Exponents| product.iter().map(|e| e.unsigned_abs()).sum::<u32>();
        singles.sort_by_key(|(_, product, value)| (value.numerator().len(), size(product)));
        for (origin, product, value) in singles {
            let (rest, _) = self.lattice.reduce(product.clone());
            if rest.iter().all(|e| *e == 0) || value.numerator().len() > MAX_TERMS || self.vanishes(&value) {
                continue;
            }
            self.equations[origin].used = true;
            let value = self.named(&product, value);
            self.lattice.insert(product, value);
            progress = true;
        }
        progress
    }

    /// Makes a value of more than one term a new intermediate.
    fn named(&mut self, product: &Exponents, value: Fraction<Variable>) -> Fraction<Variable> {
        if value.as_polynomial().is_some_and(|polynomial| polynomial.len() == 1) {
            return value;
        }
        if let Some(point) = &mut self.witness {
            let exact = value.evaluate(|&j| point[j].clone()).expect("invariant: the value exists at the witness");
            point.push(exact);
        }
        let factors = self.atoms.iter().zip(product).map(|(&atom, &exponent)| (atom, exponent));
        self.intermediates.push(Intermediate { product: factors.collect(), value });
        Fraction::variable(self.map.definitions().len() + self.constants.len() + self.intermediates.len() - 1)
    }

    /// Gauss-Jordan elimination of the unknown products; an equation that reduces to zero keeps its own right-hand side
    /// with factor 1.
    fn reduced(&self, mut equations: Vec<LinearEquation>) -> Vec<LinearEquation> {
        let mut done: Vec<LinearEquation> = Vec::new();
        while !equations.is_empty() {
            // Equations with few unknowns and short definitions come first, so that long ones become the redundant ones.
            let next = (0..equations.len())
                .min_by_key(|&i| (equations[i].terms.len(), self.equations[equations[i].origin].weight))
                .expect("invariant: an equation is left");
            let mut pivot = equations.swap_remove(next);
            let size = |value: &Fraction<Variable>| (value.denominator().len(), value.numerator().len());
            let lead = pivot.terms.iter().min_by_key(|(_, c)| size(c)).map(|(product, _)| product.clone());
            let Some(product) = lead else {
                done.push(pivot);
                continue;
            };
            let coefficient = pivot.terms[&product].inverse().expect("invariant: coefficients do not vanish");
            for value in pivot.terms.values_mut() {
                *value = value.mul(&coefficient);
            }
            pivot.right = pivot.right.mul(&coefficient);
            for equation in equations.iter_mut().chain(&mut done) {
                let Some(factor) = equation.terms.get(&product).cloned() else { continue };
                for (other, value) in &pivot.terms {
                    let slot = equation.terms.entry(other.clone()).or_insert_with(Fraction::zero);
                    *slot = slot.sub(&value.mul(&factor));
                }
                equation.right = equation.right.sub(&pivot.right.mul(&factor));
                equation.terms.retain(|_, value| !self.vanishes(value));
            }
            // An equation that becomes too long is dropped; a later round may find its product in another way.
            let grown = |value: &Fraction<Variable>| value.numerator().len() > MAX_TERMS;
            equations.retain(|equation| !grown(&equation.right) && !equation.terms.values().any(grown));
            done.push(pivot);
        }
        done
    }
}
