//! The map c(p) from physical to lumped parameters: values, exact Jacobian, rank, inverse, constraints.
//!
//! Invariant of [`ParameterMap`]: every definition is a Laurent polynomial over atoms of the graph, which are parameters
//! and functions or sums of parameters; `jacobian[j][i]` is the exact derivative of definition j by parameter i.
//!
//! # How the inverse is found
//!
//! Values of products of parameters that are known in terms of the c form a multiplicative lattice of exponent vectors:
//! with k2 and k2 m2/k3 also m2/k3 is known, and its powers. Modulo this lattice every definition is a linear equation
//! in the products that are not known yet. Gauss elimination isolates products, whose values join the lattice, until it
//! contains every parameter or nothing is found any more. Two carts: k1 = c6, k2 = c7, m2/k3 = c3/(3 c7), m1 = c1 k3/m2,
//! m2 = c2 - m1 - k1 m2/k3. A definition that reduces to nothing is a constraint among the c (c4 = c3^2/(3 c7),
//! c5 = c3^3/(27 c7^2)). Sums that divide several definitions, such as m2/g1 + m3/g1 + m3/g2 in three carts, count as
//! quantities of their own, so that relations between their powers come out as short as they are. A value that is more than a single product becomes an intermediate quantity with a name of its
//! own, so that expressions do not grow from step to step. Constants are known from the beginning.

use crate::algebra::fraction::{Fraction, display_polynomial, exact_quotient, primitive_part};
use crate::algebra::generic_point;
use crate::algebra::linear;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{Coordinate, ExprId, Graph, Names, Node, Symbol};
use crate::mechanics::model::{Kind, Model, Quantity};
use crate::number::rational::{self, Rational};
use crate::regressor::form::RegressorForm;
use crate::regressor::prepare::Prepared;
use num_traits::{One, Zero};
use std::collections::{BTreeMap, BTreeSet};

/// The exact map from physical parameters to the columns of a regressor form.
#[derive(Clone, Debug)]
pub struct ParameterMap {
    graph: Graph,
    quantities: Vec<Quantity>,
    columns: Vec<String>,
    parameters: Vec<Symbol>,
    definitions: Vec<Polynomial<ExprId>>,
    jacobian: Vec<Vec<Polynomial<ExprId>>>,
}

/// The rank of the Jacobian where the parameters are in general position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LocalIdentifiability {
    /// Generic rank of the Jacobian; see [`generic`] for why it is right.
    pub rank: usize,
    /// For every physical parameter, whether the columns determine it locally.
    pub determined: Vec<bool>,
}

/// A variable of an inverse: `Variable(j)` is column j; beyond the columns come the constants that are known at run time,
/// and then the intermediate quantities.
pub type Variable = usize;

/// A product of parameters with a value of more than one term.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Intermediate {
    /// The product, over parameters, functions of them, and sums that several definitions share.
    pub product: Monomial<ExprId>,
    /// Its value in terms of the columns and earlier intermediates.
    pub value: Fraction<Variable>,
}

/// A relation among the columns that every physical system satisfies.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Constraint {
    /// The column that the others determine; `None` when the relation comes from a sum of parameters.
    pub column: Option<usize>,
    /// What the column equals, or what equals zero.
    pub value: Fraction<Variable>,
}

/// The physical parameters as functions of the columns, as far as a closed form was found.
#[derive(Clone, Debug)]
pub struct Inverse {
    graph: Graph,
    /// Number of columns.
    pub columns: usize,
    /// The constants that the definitions read and that have their values at run time only.
    pub constants: Vec<Symbol>,
    /// Intermediate quantities, each in terms of the columns and those before it.
    pub intermediates: Vec<Intermediate>,
    /// Parameters with a closed form, in order of declaration.
    pub solved: Vec<(Symbol, Fraction<Variable>)>,
    /// Parameters for which none was found.
    pub unsolved: Vec<Symbol>,
    /// Relations among the columns.
    pub constraints: Vec<Constraint>,
}

impl Inverse {
    /// Number of variables that are given, which is the index of the first intermediate.
    #[must_use]
    pub fn given(&self) -> usize {
        self.columns + self.constants.len()
    }

    /// An expression with the intermediates replaced, over columns and constants; `None` when it grows beyond use.
    #[must_use]
    pub fn over_columns(&self, value: &Fraction<Variable>) -> Option<Fraction<usize>> {
        let mut value = value.clone();
        for (i, intermediate) in self.intermediates.iter().enumerate().rev() {
            let index = self.given() + i;
            let occurs = |polynomial: &Polynomial<Variable>| {
                polynomial.terms().any(|(monomial, _)| monomial.exponent(&index) != 0)
            };
            if !occurs(value.numerator()) && !value.denominator().any(|(factor, _)| occurs(factor)) {
                continue;
            }
            value = value.substitute(|&variable| {
                if variable == index { intermediate.value.clone() } else { Fraction::variable(variable) }
            })?;
            if value.numerator().len() > MAX_TERMS {
                return None;
            }
        }
        Some(value)
    }

    /// The solved parameters in double precision, given the columns and the constants known at run time.
    #[must_use]
    pub fn evaluate(&self, columns: &[f64], constant: impl FnMut(Symbol) -> f64) -> Vec<(Symbol, f64)> {
        let mut values = columns.to_vec();
        values.extend(self.constants.iter().copied().map(constant));
        for intermediate in &self.intermediates {
            let value = intermediate.value.evaluate_f64(|&variable| values[variable]);
            values.push(value);
        }
        self.solved.iter().map(|(parameter, value)| (*parameter, value.evaluate_f64(|&v| values[v]))).collect()
    }

    /// Checks every intermediate, parameter and constraint as an identity in the physical parameters; `None` when
    /// functions of parameters other than sums stand in the way.
    #[must_use]
    pub fn holds(&self, map: &ParameterMap) -> Option<bool> {
        let mut known = map.rational_definitions()?;
        known.extend(self.constants.iter().map(|&constant| Fraction::variable(constant)));
        for intermediate in &self.intermediates {
            let product = Polynomial::term(intermediate.product.clone(), Rational::one());
            let product = map.rational_in(&self.graph, &product)?;
            let value = intermediate.value.substitute(|&variable| known[variable].clone())?;
            if !value.sub(&product).is_zero() {
                return Some(false);
            }
            known.push(product);
        }
        for (parameter, value) in &self.solved {
            let value = value.substitute(|&variable| known[variable].clone())?;
            if !value.sub(&Fraction::variable(*parameter)).is_zero() {
                return Some(false);
            }
        }
        for constraint in &self.constraints {
            let value = constraint.value.substitute(|&variable| known[variable].clone())?;
            let expected = constraint.column.map_or_else(Fraction::zero, |column| known[column].clone());
            if !value.sub(&expected).is_zero() {
                return Some(false);
            }
        }
        Some(true)
    }

    /// An expression in the model language; intermediates appear as the products they stand for.
    #[must_use]
    pub fn display(&self, map: &ParameterMap, value: &Fraction<Variable>) -> String {
        value.display(|&variable| match self.intermediates.get(variable.wrapping_sub(self.given())) {
            None => match self.constants.get(variable.wrapping_sub(self.columns)) {
                None => map.columns[variable].clone(),
                Some(&constant) => map.name(constant).to_owned(),
            },
            Some(intermediate) => {
                let product = self.display_product(map, intermediate);
                match intermediate.product.factors().next() {
                    // A parameter, or a sum in parentheses.
                    Some((_, 1)) if intermediate.product.factors().len() == 1 => product,
                    _ => format!("({product})"),
                }
            }
        })
    }

    /// The product that an intermediate stands for, in the model language.
    #[must_use]
    pub fn display_product(&self, map: &ParameterMap, intermediate: &Intermediate) -> String {
        let product = Polynomial::term(intermediate.product.clone(), Rational::one());
        display_polynomial(&product, |&atom| match self.graph.node(atom) {
            Node::Sum(_) => format!("({})", self.graph.display(atom, map)),
            _ => self.graph.display(atom, map),
        })
    }
}

impl ParameterMap {
    /// The map of a prepared model.
    #[must_use]
    pub fn new(prepared: &Prepared) -> Self {
        Self::of(&prepared.model, &prepared.form)
    }

    /// The map of a regressor form that belongs to `model`.
    #[must_use]
    pub fn of(model: &Model, form: &RegressorForm) -> Self {
        let mut graph = model.graph.clone();
        let definitions: Vec<Polynomial<ExprId>> =
            form.columns.iter().map(|column| column.definition.clone()).collect();
        let atoms = atoms_of(&definitions);
        let symbols: BTreeSet<Symbol> = atoms
            .iter()
            .flat_map(|&atom| graph.leaves(atom))
            .filter_map(|leaf| match graph.node(leaf) {
                Node::Symbol(symbol) if model.quantity(*symbol).kind == Kind::Parameter => Some(*symbol),
                _ => None,
            })
            .collect();
        let parameters: Vec<Symbol> = symbols.into_iter().collect();
        let mut rates: BTreeMap<(ExprId, usize), Polynomial<ExprId>> = BTreeMap::new();
        for &atom in &atoms {
            for (i, &parameter) in parameters.iter().enumerate() {
                let leaf = graph.symbol(parameter);
                let rate = graph.differentiate(atom, leaf);
                rates.insert((atom, i), graph.polynomial(rate));
            }
        }
        let jacobian = definitions.iter().map(|definition| {
            let row = (0..parameters.len()).map(|i| {
                atoms.iter().fold(Polynomial::zero(), |sum, atom| match &rates[&(*atom, i)] {
                    rate if rate.is_zero() => sum,
                    rate => sum.add(&definition.derivative(atom).mul(rate)),
                })
            });
            row.collect()
        });
        let jacobian = jacobian.collect();
        let columns = form.columns.iter().map(|column| column.name.to_string()).collect();
        Self { graph, quantities: model.symbols.clone(), columns, parameters, definitions, jacobian }
    }

    /// The physical parameters, in order of declaration.
    #[must_use]
    pub fn parameters(&self) -> &[Symbol] {
        &self.parameters
    }

    /// The names of the columns.
    #[must_use]
    pub fn columns(&self) -> &[String] {
        &self.columns
    }

    /// The name of a physical parameter.
    #[must_use]
    pub fn name(&self, parameter: Symbol) -> &str {
        &self.quantities[parameter.0 as usize].name
    }

    /// The columns' definitions.
    #[must_use]
    pub fn definitions(&self) -> &[Polynomial<ExprId>] {
        &self.definitions
    }

    /// The exact Jacobian: rows are columns of the regressor form, columns the physical parameters.
    #[must_use]
    pub fn jacobian(&self) -> &[Vec<Polynomial<ExprId>>] {
        &self.jacobian
    }

    /// The graph of the atoms.
    #[must_use]
    pub fn graph(&self) -> &Graph {
        &self.graph
    }

    /// The lumped parameters, in double precision, given the parameters and run-time constants.
    #[must_use]
    pub fn evaluate(&self, value: impl Fn(Symbol) -> f64) -> Vec<f64> {
        let atoms = self.atom_values(&value);
        self.definitions.iter().map(|definition| evaluate_f64(definition, &atoms)).collect()
    }

    /// The Jacobian in double precision.
    #[must_use]
    pub fn jacobian_at(&self, value: impl Fn(Symbol) -> f64) -> Vec<Vec<f64>> {
        let atoms = self.atom_values(&value);
        self.jacobian.iter().map(|row| row.iter().map(|entry| evaluate_f64(entry, &atoms)).collect()).collect()
    }

    /// The lumped parameters, exactly; `None` where a division by zero or a function without a rational value is met.
    #[must_use]
    pub fn evaluate_exact(&self, value: impl Fn(Symbol) -> Rational) -> Option<Vec<Rational>> {
        self.definitions.iter().map(|definition| self.exact(definition, &value)).collect()
    }

    /// The Jacobian, exactly; `None` as in [`Self::evaluate_exact`].
    #[must_use]
    pub fn jacobian_exact(&self, value: impl Fn(Symbol) -> Rational) -> Option<Vec<Vec<Rational>>> {
        let row = |row: &Vec<Polynomial<ExprId>>| row.iter().map(|entry| self.exact(entry, &value)).collect();
        self.jacobian.iter().map(row).collect()
    }

    /// The generic rank of the Jacobian and which parameters the columns determine; `None` when a function of
    /// parameters has no exact value at rational points.
    #[must_use]
    pub fn local_identifiability(&self) -> Option<LocalIdentifiability> {
        let mut best: Option<LocalIdentifiability> = None;
        for point in 0..generic_point::POINTS {
            let Some(jacobian) = self.jacobian_exact(|symbol| generic_point::value(point, symbol.0 as usize)) else {
                continue;
            };
            let null = linear::null_space(jacobian, self.parameters.len());
            let rank = self.parameters.len() - null.len();
            if best.as_ref().is_none_or(|best| rank > best.rank) {
                let determined = (0..self.parameters.len()).map(|i| null.iter().all(|vector| vector[i].is_zero()));
                best = Some(LocalIdentifiability { rank, determined: determined.collect() });
            }
        }
        best
    }

    /// The inverse in closed form, as far as the method of this module finds one.
    #[must_use]
    pub fn inverse(&self) -> Inverse {
        Inversion::new(self).run()
    }

    /// The definitions as rational functions of the parameters alone; `None` when functions other than sums occur.
    #[must_use]
    pub fn rational_definitions(&self) -> Option<Vec<Fraction<Symbol>>> {
        self.definitions.iter().map(|definition| self.rational_in(&self.graph, definition)).collect()
    }

    fn rational_in(&self, graph: &Graph, polynomial: &Polynomial<ExprId>) -> Option<Fraction<Symbol>> {
        let mut known: BTreeMap<ExprId, Fraction<Symbol>> = BTreeMap::new();
        for atom in atoms_of(std::slice::from_ref(polynomial)) {
            let value = match graph.node(atom) {
                Node::Symbol(symbol) => match &self.quantities[symbol.0 as usize].kind {
                    Kind::Constant { value: Some(value) } => Fraction::constant(value.clone()),
                    _ => Fraction::variable(*symbol),
                },
                Node::Sum(_) => self.rational_in(graph, &graph.polynomial(atom))?,
                _ => return None,
            };
            known.insert(atom, value);
        }
        Fraction::polynomial(polynomial.clone()).substitute(|atom| known[atom].clone())
    }

    fn atom_values(&self, value: &impl Fn(Symbol) -> f64) -> BTreeMap<ExprId, f64> {
        let leaf = |node: &Node| match node {
            Node::Symbol(symbol) => match &self.quantities[symbol.0 as usize].kind {
                Kind::Constant { value: Some(value) } => rational::to_f64(value),
                _ => value(*symbol),
            },
            _ => f64::NAN,
        };
        let entries = self.definitions.iter().chain(self.jacobian.iter().flatten());
        let atoms: BTreeSet<ExprId> = entries.flat_map(|entry| atoms_of(std::slice::from_ref(entry))).collect();
        atoms.into_iter().map(|atom| (atom, self.graph.evaluate(atom, leaf))).collect()
    }

    fn exact(&self, polynomial: &Polynomial<ExprId>, value: &impl Fn(Symbol) -> Rational) -> Option<Rational> {
        let mut known: BTreeMap<ExprId, Rational> = BTreeMap::new();
        for atom in atoms_of(std::slice::from_ref(polynomial)) {
            let exact = self.graph.evaluate_exact(atom, |node| match node {
                Node::Symbol(symbol) => Some(match &self.quantities[symbol.0 as usize].kind {
                    Kind::Constant { value: Some(value) } => value.clone(),
                    _ => value(*symbol),
                }),
                _ => None,
            })?;
            known.insert(atom, exact);
        }
        polynomial.evaluate(|atom| known[atom].clone())
    }
}

impl Names for ParameterMap {
    fn symbol_name(&self, symbol: Symbol) -> String {
        self.name(symbol).to_owned()
    }

    fn coordinate_name(&self, coordinate: Coordinate) -> String {
        // Parameters do not depend on coordinates, so that none is ever named.
        format!("q{}", coordinate.0)
    }
}

fn atoms_of(polynomials: &[Polynomial<ExprId>]) -> BTreeSet<ExprId> {
    let monomials = polynomials.iter().flat_map(Polynomial::terms).map(|(monomial, _)| monomial);
    monomials.flat_map(|monomial| monomial.factors().map(|(&atom, _)| atom)).collect()
}

fn evaluate_f64(polynomial: &Polynomial<ExprId>, atoms: &BTreeMap<ExprId, f64>) -> f64 {
    let term = |(monomial, coefficient): (&Monomial<ExprId>, &Rational)| {
        monomial.factors().fold(rational::to_f64(coefficient), |product, (atom, e)| product * atoms[atom].powi(e))
    };
    polynomial.terms().map(term).sum()
}

/// Total of all exponents.
fn weight(polynomial: &Polynomial<ExprId>) -> u32 {
    let exponents = polynomial.terms().flat_map(|(monomial, _)| monomial.factors().map(|(_, e)| e));
    exponents.map(i32::unsigned_abs).sum()
}

/// A polynomial times powers of shared factors, by index.
type Factored = (Polynomial<ExprId>, Vec<(usize, i32)>);

/// The definitions with every sum that divides two of them, or one of them twice, as an atom of its own.
fn with_shared_factors(graph: &mut Graph, definitions: &[Polynomial<ExprId>]) -> Vec<Polynomial<ExprId>> {
    let mut bases: Vec<(Polynomial<ExprId>, usize)> = Vec::new();
    // Short sums first: a longer one is then divided by them.
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
            // The denominator stays with the sum: m2/g1 + m3/g1 + m3/g2 is known once k2 and k2 times it are.
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

/// Exponents of the atoms.
type Exponents = Vec<i32>;

/// sum over unknown products of (known coefficient) * product = right-hand side.
#[derive(Clone)]
struct LinearEquation {
    /// Index into the equations of the inversion.
    origin: usize,
    terms: BTreeMap<Exponents, Fraction<Variable>>,
    right: Fraction<Variable>,
}

/// What an equation says.
#[derive(Clone, Copy)]
enum Origin {
    /// The definition of a column.
    Column(usize),
    /// Sum - atom = 0, which may be multiplied by any product.
    Sum(ExprId),
}

/// polynomial in the parameters = known value.
struct Equation {
    polynomial: Polynomial<ExprId>,
    origin: Origin,
    /// Total of all exponents: short definitions are used before long ones.
    weight: u32,
    used: bool,
}

struct Inversion<'a> {
    map: &'a ParameterMap,
    /// The map's graph with the shared factors.
    graph: Graph,
    atoms: Vec<ExprId>,
    equations: Vec<Equation>,
    /// Known at run time.
    constants: Vec<Symbol>,
    lattice: Lattice,
    intermediates: Vec<Intermediate>,
    constraints: Vec<Constraint>,
    /// Values of the variables at a generic physical system, by which what vanishes on every physical system is
    /// recognised: such an expression need not be zero as a function of independent columns.
    witness: Option<Vec<Rational>>,
}

/// Beyond this many terms a closed form would be of no use, and the search stops.
const MAX_TERMS: usize = 500;

impl<'a> Inversion<'a> {
    fn new(map: &'a ParameterMap) -> Self {
        let mut graph = map.graph.clone();
        let definitions = with_shared_factors(&mut graph, &map.definitions);
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
        let mut lattice = Lattice { basis: Vec::new() };
        let mut constants = Vec::new();
        for (position, &atom) in atoms.iter().enumerate() {
            let Node::Symbol(symbol) = *graph.node(atom) else { continue };
            let Kind::Constant { value } = &map.quantities[symbol.0 as usize].kind else { continue };
            let known = match value {
                // A product that is zero has no place among those that are divided by.
                Some(value) if value.is_zero() => continue,
                Some(value) => Fraction::constant(value.clone()),
                None => {
                    constants.push(symbol);
                    Fraction::variable(map.definitions.len() + constants.len() - 1)
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

    /// A product that makes a known one of `atom`. Any other such product differs from it by a known factor.
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
        for &parameter in &self.map.parameters {
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
        let columns = self.map.definitions.len();
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

    /// One round: records what reduces to nothing as constraints and adds what is isolated to the lattice.
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
        // The simplest first; what then follows from it is found to be a constraint in the next round.
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

    /// A value of more than one term as a new intermediate.
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
        Fraction::variable(self.map.definitions.len() + self.constants.len() + self.intermediates.len() - 1)
    }

    /// Gauss-Jordan elimination of the unknown products; an equation that reduces to nothing keeps its own right-hand
    /// side with factor 1.
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
            // What grows beyond use is given up; a later round may find it in another way.
            let grown = |value: &Fraction<Variable>| value.numerator().len() > MAX_TERMS;
            equations.retain(|equation| !grown(&equation.right) && !equation.terms.values().any(grown));
            done.push(pivot);
        }
        done
    }
}

/// Products whose values are known, as a basis in echelon form of the lattice of their exponents.
struct Lattice {
    basis: Vec<(Exponents, Fraction<Variable>)>,
}

fn pivot_of(exponents: &[i32]) -> Option<usize> {
    exponents.iter().position(|e| *e != 0)
}

impl Lattice {
    /// `exponents` modulo the lattice, and the value of what was taken off.
    fn reduce(&self, mut exponents: Exponents) -> (Exponents, Fraction<Variable>) {
        let mut factor = Fraction::one();
        for (vector, value) in &self.basis {
            let Some(pivot) = pivot_of(vector) else { continue };
            let times = exponents[pivot].div_euclid(vector[pivot]);
            if times != 0 {
                subtract(&mut exponents, vector, times);
                factor = factor.mul(&value.pow(times).expect("invariant: values of products are not zero"));
            }
        }
        (exponents, factor)
    }

    /// Adds a product; Euclid's algorithm on the pivots keeps the echelon form.
    fn insert(&mut self, mut exponents: Exponents, mut value: Fraction<Variable>) {
        let power =
            |value: &Fraction<Variable>, e: i32| value.pow(e).expect("invariant: values of products are not zero");
        for (vector, known) in &mut self.basis {
            let Some(pivot) = pivot_of(vector) else { continue };
            match pivot_of(&exponents) {
                None => return,
                Some(own) if own < pivot => break,
                Some(own) if own > pivot => continue,
                Some(_) => {}
            }
            while exponents[pivot] != 0 {
                let times = vector[pivot].div_euclid(exponents[pivot]);
                subtract(vector, &exponents, times);
                *known = known.mul(&power(&value, -times));
                std::mem::swap(vector, &mut exponents);
                std::mem::swap(known, &mut value);
            }
            if vector[pivot] < 0 {
                vector.iter_mut().for_each(|e| *e = -*e);
                *known = power(known, -1);
            }
        }
        let Some(pivot) = pivot_of(&exponents) else { return };
        if exponents[pivot] < 0 {
            exponents.iter_mut().for_each(|e| *e = -*e);
            value = power(&value, -1);
        }
        self.basis.push((exponents, value));
        self.basis.sort_by_key(|(vector, _)| pivot_of(vector));
    }
}

fn subtract(exponents: &mut [i32], vector: &[i32], times: i32) {
    for (e, v) in exponents.iter_mut().zip(vector) {
        *e -= times * v;
    }
}
