//! Equations separated by parameter monomials in their written form, without multiplying out the factors that depend on
//! the motion.
//!
//! Every node that contains a parameter or an input becomes a map from monomials of these to coefficients, which are
//! expressions of the motion and of constants. A sum adds maps, a product multiplies them, and a shared node is
//! separated once. So the work grows with the number of nodes times the number of parameters, whatever the number of
//! expanded terms would be.
//!
//! Invariant of [`Parts`]: the node equals the sum of its monomials times their coefficients; no coefficient holds a parameter or an
//! input, and none is the number zero.

use crate::algebra::monomial::{Factorisation, Monomial};
use crate::expr::graph::{ExprId, Graph, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind, SourceTerm};
use crate::number::rational::{self, Rational};
use crate::regressor::collect::{Applied, CollectedTerm, Gathered, RegressorError};
use num_traits::{One, Zero};
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

/// Most parameter monomials of a node. The bound is far above the number for any machine, and below the limits of
/// memory.
const MOST_MONOMIALS: usize = 100_000;

/// A node by its monomials of parameters and inputs.
type Parts = BTreeMap<Monomial<ExprId>, ExprId>;

/// Dependence of a node on parameters, inputs and the motion.
#[derive(Clone, Copy, Debug, Default)]
struct Dependence {
    parameter: Option<Symbol>,
    input: Option<Symbol>,
    moves: bool,
}

impl Dependence {
    fn is_unknown(self) -> bool {
        self.parameter.is_some() || self.input.is_some()
    }
}

/// The equations of a model, separated term by term. Constants of known value are replaced everywhere.
pub(crate) struct Gather<'m> {
    model: &'m mut ExactModel,
    /// Dependences of the nodes that existed when the separation began; later nodes are coefficients.
    dependence: Vec<Dependence>,
    values: HashMap<ExprId, ExprId>,
    memo: HashMap<ExprId, Rc<Parts>>,
}

/// Why a node cannot be separated.
enum Obstacle {
    /// A parameter inside an expression that depends on the motion or an input.
    Inside(Symbol, ExprId),
    /// Too many monomials.
    TooLarge,
}

impl<'m> Gather<'m> {
    pub(crate) fn new(model: &'m mut ExactModel) -> Self {
        let mut values = HashMap::new();
        for (index, quantity) in (0u32..).zip(&model.symbols) {
            if let Kind::Constant { value: Some(value) } = &quantity.kind {
                let symbol = model.graph.symbol(Symbol(index));
                let number = model.graph.number(value.clone());
                values.insert(symbol, number);
            }
        }
        Self { model, dependence: Vec::new(), values, memo: HashMap::new() }
    }

    /// The terms of an equation.
    ///
    /// # Errors
    /// When a parameter does not enter linearly; the source term is named.
    pub(crate) fn equation(&mut self, terms: &[SourceTerm]) -> Result<Gathered, RegressorError> {
        let mut gathered = Gathered::default();
        for &SourceTerm { id, expr } in terms {
            let expr = self.model.graph.substitute_beside(expr, &mut self.values);
            self.extend_dependence();
            let parts = self.parts(expr).map_err(|obstacle| match obstacle {
                Obstacle::Inside(parameter, inside) => RegressorError::InsideFunction {
                    term: id,
                    parameter: self.model.quantity(parameter).name.to_string(),
                    unit: self.model.bracketed_unit(parameter),
                    inside: self.model.display_short(inside),
                },
                Obstacle::TooLarge => RegressorError::TooLarge { term: id, most: MOST_MONOMIALS },
            })?;
            for (monomial, &coefficient) in parts.iter() {
                let (inputs, parameters) = monomial.partition(|&atom| self.of(atom).input.is_some());
                let single = match inputs.factors().next() {
                    Some((&atom, 1)) if inputs.factors().len() == 1 => self.input(atom).map(|symbol| (symbol, atom)),
                    _ => None,
                };
                let leaves = self.model.graph.leaves(coefficient);
                let moves = leaves.iter().any(|&leaf| matches!(self.model.graph.node(leaf), Node::Derivative(..)));
                if let (Some((symbol, atom)), false) = (single, moves) {
                    let factor = self.model.graph.polynomial(coefficient).mul_monomial(&parameters);
                    let slot = gathered.inputs.entry(symbol).or_insert_with(|| Applied::new(atom, id));
                    slot.factor.add_assign(&factor);
                    continue;
                }
                let (number, motion) = factors(&self.model.graph, coefficient);
                let motion = motion.mul(&inputs);
                gathered.terms.push(CollectedTerm { parameters, motion, coefficient: number, source: id });
            }
        }
        Ok(gathered)
    }

    /// The input that a node represents.
    fn input(&self, atom: ExprId) -> Option<Symbol> {
        match *self.model.graph.node(atom) {
            Node::Symbol(symbol) if self.model.quantity(symbol).kind == Kind::Input => Some(symbol),
            _ => None,
        }
    }

    /// Computes the dependences of nodes that were added meanwhile.
    fn extend_dependence(&mut self) {
        let graph = &self.model.graph;
        for id in graph.ids_from(self.dependence.len()) {
            let mut own = Dependence::default();
            match *graph.node(id) {
                Node::Derivative(..) => own.moves = true,
                Node::Symbol(symbol) => match self.model.quantity(symbol).kind {
                    Kind::Parameter => own.parameter = Some(symbol),
                    Kind::Input => own.input = Some(symbol),
                    _ => {}
                },
                _ => {}
            }
            for operand in graph.operands(id) {
                let of = self.dependence[operand.index()];
                own.parameter = own.parameter.or(of.parameter);
                own.input = own.input.or(of.input);
                own.moves |= of.moves;
            }
            self.dependence.push(own);
        }
    }

    fn of(&self, id: ExprId) -> Dependence {
        // Later nodes are coefficients, which are never separated.
        self.dependence[id.index()]
    }

    fn parts(&mut self, root: ExprId) -> Result<Rc<Parts>, Obstacle> {
        if !self.of(root).is_unknown() {
            return Ok(Rc::new(if self.is_zero(root) { Parts::new() } else { Parts::from([(Monomial::one(), root)]) }));
        }
        let mut stack = vec![root];
        while let Some(&id) = stack.last() {
            if self.memo.contains_key(&id) {
                stack.pop();
                continue;
            }
            let before = stack.len();
            if matches!(self.model.graph.node(id), Node::Sum(_) | Node::Product(_) | Node::Power(..)) {
                let operands = self.model.graph.operands(id);
                stack.extend(operands.filter(|&part| self.of(part).is_unknown() && !self.memo.contains_key(&part)));
            }
            if stack.len() == before {
                stack.pop();
                let parts = self.node(id)?;
                self.memo.insert(id, Rc::new(parts));
            }
        }
        Ok(Rc::clone(&self.memo[&root]))
    }

    /// The separated form of a node that contains a parameter or an input, from those of its operands.
    fn node(&mut self, id: ExprId) -> Result<Parts, Obstacle> {
        let one = self.model.graph.integer(1);
        match self.model.graph.node(id).clone() {
            Node::Sum(terms) => {
                let mut lists: BTreeMap<Monomial<ExprId>, Vec<ExprId>> = BTreeMap::new();
                for term in terms {
                    if self.of(term).is_unknown() {
                        for (monomial, &coefficient) in self.memo[&term].iter() {
                            lists.entry(monomial.clone()).or_default().push(coefficient);
                        }
                    } else {
                        lists.entry(Monomial::one()).or_default().push(term);
                    }
                }
                Ok(self.summed(lists))
            }
            Node::Product(factors) => {
                let (unknown, known): (Vec<ExprId>, Vec<ExprId>) =
                    factors.into_iter().partition(|&factor| self.of(factor).is_unknown());
                // A single factor may be a product of products, and keeps its structure.
                let known = match known.as_slice() {
                    [single] => *single,
                    _ => self.model.graph.product(&known),
                };
                let mut product = Parts::from([(Monomial::one(), known)]);
                for factor in unknown {
                    let parts = Rc::clone(&self.memo[&factor]);
                    product = self.multiplied(&product, &parts)?;
                }
                Ok(product)
            }
            Node::Power(base, exponent) => {
                let parts = Rc::clone(&self.memo[&base]);
                match parts.iter().next() {
                    Some((monomial, &coefficient)) if parts.len() == 1 => {
                        let coefficient = self.model.graph.pow(coefficient, exponent);
                        Ok(Parts::from([(monomial.pow(exponent), coefficient)]))
                    }
                    _ if exponent > 0 => {
                        let mut power = Parts::from([(Monomial::one(), one)]);
                        for _ in 0..exponent {
                            power = self.multiplied(&power, &parts)?;
                        }
                        Ok(power)
                    }
                    _ => self.atom(base, exponent, one),
                }
            }
            _ => self.atom(id, 1, one),
        }
    }

    /// A leaf, a function of parameters or inputs, or a negative power of a sum of such.
    fn atom(&self, id: ExprId, exponent: i32, one: ExprId) -> Result<Parts, Obstacle> {
        let of = self.of(id);
        match of.parameter {
            Some(parameter) if of.moves || of.input.is_some() => Err(Obstacle::Inside(parameter, id)),
            _ => Ok(Parts::from([(Monomial::power_of(id, exponent), one)])),
        }
    }

    fn multiplied(&mut self, left: &Parts, right: &Parts) -> Result<Parts, Obstacle> {
        if left.len().saturating_mul(right.len()) > MOST_MONOMIALS {
            return Err(Obstacle::TooLarge);
        }
        let mut lists: BTreeMap<Monomial<ExprId>, Vec<ExprId>> = BTreeMap::new();
        for (a, &of_a) in left {
            for (b, &of_b) in right {
                lists.entry(a.mul(b)).or_default().push(self.model.graph.mul(of_a, of_b));
            }
        }
        Ok(self.summed(lists))
    }

    fn summed(&mut self, lists: BTreeMap<Monomial<ExprId>, Vec<ExprId>>) -> Parts {
        let mut parts = Parts::new();
        for (monomial, list) in lists {
            let sum = match list.as_slice() {
                [single] => *single,
                _ => self.model.graph.sum(&list),
            };
            if !self.is_zero(sum) {
                parts.insert(monomial, sum);
            }
        }
        parts
    }

    fn is_zero(&self, id: ExprId) -> bool {
        self.model.graph.as_number(id).is_some_and(Zero::is_zero)
    }
}

/// An expression as a number times a product of powers; sums among the bases keep their structure.
fn factors(graph: &Graph, expr: ExprId) -> (Rational, Monomial<ExprId>) {
    let mut number = Rational::one();
    let mut powers = Factorisation::new();
    let mut open = vec![(expr, 1)];
    while let Some((part, exponent)) = open.pop() {
        match graph.node(part) {
            Node::Number(value) => number *= rational::power(value, exponent),
            Node::Power(base, own) => open.push((*base, own * exponent)),
            Node::Product(parts) => open.extend(parts.iter().rev().map(|&part| (part, exponent))),
            _ => powers.push((part, exponent)),
        }
    }
    (number, powers.into_iter().collect())
}
