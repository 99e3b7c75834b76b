//! The map c(p) from physical to lumped parameters: values, exact Jacobian, rank.
//!
//! Invariant of [`ParameterMap`]: every definition is a Laurent polynomial over atoms of the graph, which are parameters
//! and functions or sums of parameters; `jacobian[j][i]` is the exact derivative of definition j by parameter i.

use crate::algebra::fraction::Fraction;
use crate::algebra::generic_point;
use crate::algebra::linear;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{Coordinate, ExprId, Graph, Names, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind, Quantity};
use crate::number::rational::{self, Rational};
use crate::regressor::form::RegressorForm;
use crate::regressor::prepare::Prepared;
use num_traits::Zero;
use std::collections::{BTreeMap, BTreeSet};

/// The exact map from physical parameters to the columns of a regressor form.
#[derive(Clone, Debug)]
pub struct ParameterMap {
    pub(super) graph: Graph,
    pub(super) quantities: Vec<Quantity>,
    columns: Vec<String>,
    parameters: Vec<Symbol>,
    definitions: Vec<Polynomial<ExprId>>,
    jacobian: Vec<Vec<Polynomial<ExprId>>>,
}

/// The rank of the Jacobian where the parameters are in general position.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LocalIdentifiability {
    /// Generic rank of the Jacobian; see [`generic_point`] for why it is right.
    pub rank: usize,
    /// For every physical parameter, whether the columns determine it locally.
    pub determined: Vec<bool>,
}

impl ParameterMap {
    /// The map of a prepared model.
    #[must_use]
    pub fn new(prepared: &Prepared) -> Self {
        Self::of(&prepared.model, &prepared.form)
    }

    /// The map of a regressor form that belongs to `model`.
    #[must_use]
    pub fn of(model: &ExactModel, form: &RegressorForm) -> Self {
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
        let position: BTreeMap<Symbol, usize> = parameters.iter().enumerate().map(|(i, &symbol)| (symbol, i)).collect();
        // An atom depends on few parameters, whereas an arm has hundreds of atoms and parameters, so the derivatives
        // are stored sparsely.
        let mut rates: BTreeMap<ExprId, Vec<(usize, Polynomial<ExprId>)>> = BTreeMap::new();
        for &atom in &atoms {
            let mut of_atom = Vec::new();
            for leaf in graph.leaves(atom) {
                let Node::Symbol(symbol) = graph.node(leaf) else { continue };
                let Some(&i) = position.get(symbol) else { continue };
                let rate = graph.differentiate(atom, leaf);
                of_atom.push((i, graph.polynomial(rate)));
            }
            rates.insert(atom, of_atom);
        }
        let jacobian = definitions.iter().map(|definition| {
            let mut row = vec![Polynomial::zero(); parameters.len()];
            for atom in atoms_of(std::slice::from_ref(definition)) {
                let outer = definition.derivative(&atom);
                for (i, rate) in &rates[&atom] {
                    row[*i] = row[*i].add(&outer.mul(rate));
                }
            }
            row
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

    /// Whether every column is a sum of parameters times constants.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        let depends = |atom: &ExprId| {
            let leaves = self.graph.leaves(*atom);
            leaves
                .iter()
                .any(|leaf| matches!(self.graph.node(*leaf), Node::Symbol(symbol) if self.parameters.contains(symbol)))
        };
        !self.jacobian.iter().any(|row| atoms_of(row).iter().any(depends))
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

    /// The lumped parameters, exactly; `None` where a division by zero or a function without a rational value occurs.
    #[must_use]
    pub fn evaluate_exact(&self, value: impl Fn(Symbol) -> Rational) -> Option<Vec<Rational>> {
        self.definitions.iter().map(|definition| self.exact(definition, &value)).collect()
    }

    /// The Jacobian, exactly; `None` where a division by zero or a function without a rational value occurs.
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

    /// The definitions as rational functions of the parameters alone; `None` when functions other than sums occur.
    #[must_use]
    pub fn rational_definitions(&self) -> Option<Vec<Fraction<Symbol>>> {
        self.definitions.iter().map(|definition| self.rational_in(&self.graph, definition)).collect()
    }

    /// A polynomial over atoms of `graph` as a rational function of the parameters; `None` when functions other than sums occur.
    pub(super) fn rational_in(&self, graph: &Graph, polynomial: &Polynomial<ExprId>) -> Option<Fraction<Symbol>> {
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
        // Parameters do not depend on coordinates, so this name is never printed.
        format!("q{}", coordinate.0)
    }
}

/// The atoms that occur in the polynomials.
pub(super) fn atoms_of(polynomials: &[Polynomial<ExprId>]) -> BTreeSet<ExprId> {
    let monomials = polynomials.iter().flat_map(Polynomial::terms).map(|(monomial, _)| monomial);
    monomials.flat_map(|monomial| monomial.factors().map(|(&atom, _)| atom)).collect()
}

fn evaluate_f64(polynomial: &Polynomial<ExprId>, atoms: &BTreeMap<ExprId, f64>) -> f64 {
    let term = |(monomial, coefficient): (&Monomial<ExprId>, &Rational)| {
        monomial.factors().fold(rational::to_f64(coefficient), |product, (atom, e)| product * atoms[atom].powi(e))
    };
    polynomial.terms().map(term).sum()
}
