//! Taylor series of expressions about a symbolic point (Feng, Eqns 5.5-5.7).
//!
//! ```text
//! f(q0 + d) = sum_{|a| <= N} c_a d^a + R_N(d) ,      c_a = D^a f(q0) / a!
//! ```
//!
//! The coefficients are exact expressions of parameters and constants.
//!
//! Where no series exists (a quotient at a zero of its denominator, a root at 0) the error names the term.

use crate::algebra::characteristic::Ring;
use crate::expr::graph::{Coordinate, ExprId, Function, Graph, Node};
use crate::expr::trigonometric;
use crate::linear::jet::{Analytic, Index, Jets, Singular, nodes_of};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::number::rational::Rational;
use num_traits::Zero;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, HashMap};
use thiserror::Error;

/// A coordinate to expand in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Expansion {
    /// The coordinate.
    pub coordinate: Coordinate,
    /// The point q0, an expression of constants and parameters.
    pub point: ExprId,
    /// The highest power of q - q0 that is kept. In several coordinates the highest total degree is the largest of
    /// their orders.
    pub order: u32,
}

/// A Taylor polynomial.
#[derive(Clone, Debug, PartialEq)]
pub struct TaylorSeries {
    /// The function that was expanded.
    pub function: ExprId,
    /// The coordinates of the expansion and the point about which it is made.
    pub expansions: Vec<Expansion>,
    /// c_a by the exponents of the coordinates, in the order of `expansions`; missing coefficients are 0.
    pub coefficients: BTreeMap<Index, ExprId>,
}

/// Why there is no Taylor series.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum SeriesError {
    /// A function is not analytic at the point.
    #[error("`{atom}` is singular at the point of expansion, so there is no Taylor series; choose another point")]
    Singular {
        /// The source term, when there is one.
        term: Option<TermId>,
        /// The function or quotient.
        atom: String,
    },
    /// The point depends on the motion or an input.
    #[error("the point of expansion `{point}` of `{coordinate}` must consist of constants and parameters")]
    Point {
        /// The coordinate.
        coordinate: String,
        /// The point.
        point: String,
    },
    /// A coordinate was given twice.
    #[error("the coordinate `{coordinate}` has two points of expansion")]
    Twice {
        /// The coordinate.
        coordinate: String,
    },
}

/// The Taylor series of an expression of a model's graph.
///
/// # Errors
/// When the expression is singular at the point, the point is not constant, or a coordinate is given twice.
pub fn series(model: &mut ExactModel, function: ExprId, expansions: &[Expansion]) -> Result<TaylorSeries, SeriesError> {
    check_points(model, expansions)?;
    let degree = expansions.iter().map(|expansion| expansion.order).max().unwrap_or(0);
    let nodes = nodes_of(&model.graph, function);
    let variables: Vec<(Option<ExprId>, ExprId)> = expansions
        .iter()
        .map(|expansion| (Some(model.graph.derivative_of(expansion.coordinate, 0)), expansion.point))
        .collect();
    let mut domain = Expressions(&mut model.graph);
    let jet = Jets { domain: &mut domain, degree, variables }.of(&nodes);
    let jet = jet.map_err(|Singular(atom)| SeriesError::Singular { term: None, atom: model.display_brief(atom) })?;
    let kept = |index: &Index| index.iter().zip(expansions).all(|(&exponent, e)| exponent <= e.order);
    let coefficients = jet.coefficients.into_iter().filter(|(index, _)| kept(index)).collect();
    Ok(TaylorSeries { function, expansions: expansions.to_vec(), coefficients })
}

fn check_points(model: &ExactModel, expansions: &[Expansion]) -> Result<(), SeriesError> {
    for (i, expansion) in expansions.iter().enumerate() {
        let coordinate = || model.coordinates[expansion.coordinate.0 as usize].name.clone();
        if expansions[..i].iter().any(|other| other.coordinate == expansion.coordinate) {
            return Err(SeriesError::Twice { coordinate: coordinate() });
        }
        let constant = model.graph.leaves(expansion.point).into_iter().all(|leaf| match model.graph.node(leaf) {
            Node::Symbol(symbol) => model.quantity(*symbol).kind != Kind::Input,
            _ => false,
        });
        if !constant {
            let point = model.display(expansion.point);
            return Err(SeriesError::Point { coordinate: coordinate(), point });
        }
    }
    Ok(())
}

impl TaylorSeries {
    /// sum c_a (q - q0)^a as an expression.
    pub fn polynomial(&self, graph: &mut Graph) -> ExprId {
        let coefficients = self.coefficients.clone();
        self.combine(graph, &coefficients)
    }

    fn combine(&self, graph: &mut Graph, coefficients: &BTreeMap<Index, ExprId>) -> ExprId {
        let distances: Vec<ExprId> = self
            .expansions
            .iter()
            .map(|expansion| {
                let coordinate = graph.derivative_of(expansion.coordinate, 0);
                graph.sub(coordinate, expansion.point)
            })
            .collect();
        let mut terms = Vec::with_capacity(coefficients.len());
        for (index, &coefficient) in coefficients {
            let mut factors = vec![coefficient];
            for (&distance, &exponent) in distances.iter().zip(index) {
                factors.push(graph.pow(distance, i32::try_from(exponent).expect("invariant: orders are small")));
            }
            terms.push(graph.product(&factors));
        }
        graph.sum(&terms)
    }

    /// The polynomial with a new parameter for every coefficient, and the coefficient that each parameter replaces.
    /// Names are `prefix` with the exponents: `a0`, `a1` in one coordinate, `a0_1` in several.
    pub fn with_parameters(
        &self,
        model: &mut ExactModel,
        prefix: &str,
    ) -> (ExprId, Vec<(crate::expr::graph::Symbol, ExprId)>) {
        let mut definitions = Vec::with_capacity(self.coefficients.len());
        let mut replaced = BTreeMap::new();
        for (index, &coefficient) in &self.coefficients {
            let exponents: Vec<String> = index.iter().map(ToString::to_string).collect();
            let symbol = model.declare(&format!("{prefix}{}", exponents.join("_")), None, Kind::Parameter);
            definitions.push((symbol, coefficient));
            replaced.insert(index.clone(), model.graph.symbol(symbol));
        }
        (self.combine(&mut model.graph, &replaced), definitions)
    }
}

/// A part of a term that was replaced by its Taylor polynomial.
#[derive(Clone, Debug, PartialEq)]
pub struct Truncation {
    /// The source term.
    pub term: TermId,
    /// The Taylor polynomial of the part that does not expand finitely.
    pub series: TaylorSeries,
}

/// Replaces, in every equation, factors that do not expand finitely in the given coordinates (sin q, 1/(1 + q), ...) by
/// their Taylor polynomials; all other factors are unchanged. In a product such as sin(q) cos(q) x' the factors that
/// are not polynomials are expanded together, to the given total degree. Signs and absolute values without other such
/// functions are unchanged, since they have exact series under a pattern.
///
/// # Errors
/// When a term is singular at the point; the model is then unchanged.
pub fn truncate(model: &mut ExactModel, expansions: &[Expansion]) -> Result<Vec<Truncation>, SeriesError> {
    check_points(model, expansions)?;
    let mut truncations = Vec::new();
    let mut known: HashMap<ExprId, (ExprId, TaylorSeries)> = HashMap::new();
    let mut equations = model.equations.clone();
    for source in equations.iter_mut().flat_map(|equation| &mut equation.terms) {
        let polynomial = model.graph.polynomial(source.expr);
        let mut terms = Vec::with_capacity(polynomial.len());
        let mut changed = false;
        for (monomial, coefficient) in polynomial.terms() {
            let (infinite, rest) =
                monomial.partition(|&atom| is_infinite(model, atom, monomial.exponent(&atom), expansions));
            let mut factors = vec![model.graph.number(coefficient.clone())];
            for (&atom, exponent) in rest.factors() {
                factors.push(model.graph.pow(atom, exponent));
            }
            if !infinite.is_one() {
                changed = true;
                let powers: Vec<ExprId> =
                    infinite.factors().map(|(&atom, exponent)| model.graph.pow(atom, exponent)).collect();
                let function = model.graph.product(&powers);
                if let Entry::Vacant(slot) = known.entry(function) {
                    let found = series(model, function, expansions).map_err(|error| match error {
                        SeriesError::Singular { atom, .. } => SeriesError::Singular { term: Some(source.id), atom },
                        other => other,
                    })?;
                    let expr = found.polynomial(&mut model.graph);
                    slot.insert((expr, found));
                }
                let (expr, series) = &known[&function];
                factors.push(*expr);
                truncations.push(Truncation { term: source.id, series: series.clone() });
            }
            terms.push(model.graph.product(&factors));
        }
        if changed {
            source.expr = model.graph.sum(&terms);
        }
    }
    model.equations = equations;
    Ok(truncations)
}

/// Whether a power of an atom depends on one of the coordinates and is not a polynomial.
fn is_infinite(model: &ExactModel, atom: ExprId, exponent: i32, expansions: &[Expansion]) -> bool {
    match model.graph.node(atom) {
        Node::Number(_) | Node::Pi | Node::Symbol(_) | Node::Placeholder(_) => false,
        Node::Derivative(coordinate, order) => {
            exponent < 0 && *order == 0 && expansions.iter().any(|e| e.coordinate == *coordinate)
        }
        Node::Function(Function::Sign | Function::Abs, _) if exponent > 0 => false,
        _ => model.graph.leaves(atom).into_iter().any(|leaf| match model.graph.node(leaf) {
            Node::Derivative(coordinate, 0) => expansions.iter().any(|e| e.coordinate == *coordinate),
            _ => false,
        }),
    }
}

/// Expressions as coefficients; values at the point are brought to their normal form where they contain pi.
struct Expressions<'a>(&'a mut Graph);

impl Expressions<'_> {
    fn vanishes(&mut self, expr: ExprId) -> bool {
        trigonometric::is_zero(self.0, expr)
    }
}

impl Ring for Expressions<'_> {
    type Element = ExprId;

    fn number(&mut self, value: &Rational) -> ExprId {
        self.0.number(value.clone())
    }

    fn add(&mut self, a: &ExprId, b: &ExprId) -> ExprId {
        self.0.add(*a, *b)
    }

    fn mul(&mut self, a: &ExprId, b: &ExprId) -> ExprId {
        self.0.mul(*a, *b)
    }

    fn scale(&mut self, a: &ExprId, factor: &Rational) -> ExprId {
        self.0.scale(*a, factor.clone())
    }

    fn is_zero(&self, a: &ExprId) -> bool {
        self.0.as_number(*a).is_some_and(Zero::is_zero)
    }
}

impl Analytic for Expressions<'_> {
    fn leaf(&mut self, _: &Node, id: ExprId) -> Option<ExprId> {
        Some(id)
    }

    fn power(&mut self, base: &ExprId, exponent: i32) -> Option<ExprId> {
        if exponent < 0 && self.vanishes(*base) { None } else { Some(self.0.pow(*base, exponent)) }
    }

    fn function(&mut self, function: Function, argument: &ExprId, smooth: bool) -> Option<ExprId> {
        let singular = match function {
            Function::Sin | Function::Cos | Function::Atan | Function::Tanh | Function::Exp => false,
            Function::Sqrt | Function::Log | Function::Abs | Function::Sign => self.vanishes(*argument),
            Function::Tan => {
                let cosine = self.0.function(Function::Cos, *argument);
                self.vanishes(cosine)
            }
            Function::Asin | Function::Acos => {
                let square = self.0.pow(*argument, 2);
                let one = self.0.integer(1);
                let difference = self.0.sub(one, square);
                self.vanishes(difference)
            }
        };
        if singular && smooth {
            return None;
        }
        let value = self.0.function(function, *argument);
        let turns = nodes_of(self.0, *argument).iter().any(|(_, node)| *node == Node::Pi);
        Some(if turns { trigonometric::simplify(self.0, value) } else { value })
    }

    fn atan2(&mut self, y: &ExprId, x: &ExprId) -> Option<ExprId> {
        if self.vanishes(*y) && self.vanishes(*x) { None } else { Some(self.0.atan2(*y, *x)) }
    }

    fn is_zero(&mut self, a: &ExprId) -> bool {
        self.0.as_number(*a).is_some_and(Zero::is_zero)
    }
}
