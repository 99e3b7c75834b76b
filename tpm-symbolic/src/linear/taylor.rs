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
use crate::linear::jet::{Analytic, Index, Jet, Jets, Singular, nodes_of};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::number::rational::Rational;
use num_traits::Zero;
use std::collections::hash_map::Entry;
use std::collections::{BTreeMap, BTreeSet, HashMap};
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
    let coefficients = jet.coefficients.into_iter().filter(|(index, _)| is_kept(index, expansions)).collect();
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
/// Series are cut at the degree while they are multiplied, so that equations are never multiplied out: a term that
/// would have millions of products takes as many steps as it has nodes.
///
/// # Errors
/// When a term is singular at the point; the model is then unchanged.
pub fn truncate(model: &mut ExactModel, expansions: &[Expansion]) -> Result<Vec<Truncation>, SeriesError> {
    check_points(model, expansions)?;
    let mut truncations = Vec::new();
    let mut known: HashMap<ExprId, TaylorSeries> = HashMap::new();
    let mut equations = model.equations.clone();
    for source in equations.iter_mut().flat_map(|equation| &mut equation.terms) {
        let parts = Parts::of(&nodes_of(&model.graph, source.expr), expansions);
        if parts.infinite.is_empty() {
            continue;
        }
        let mut memo: HashMap<ExprId, Jet<ExprId>> = HashMap::new();
        for &function in &parts.infinite {
            if let Entry::Vacant(slot) = known.entry(function) {
                let found = series(model, function, expansions).map_err(|error| match error {
                    SeriesError::Singular { atom, .. } => SeriesError::Singular { term: Some(source.id), atom },
                    other => other,
                })?;
                slot.insert(found);
            }
            let series = known[&function].clone();
            memo.insert(function, Jet { coefficients: series.coefficients.clone() });
            truncations.push(Truncation { term: source.id, series });
        }
        let none: Index = Index::from_elem(0, expansions.len());
        for &part in &parts.finite {
            memo.insert(part, Jet { coefficients: BTreeMap::from([(none.clone(), part)]) });
        }
        let degree = expansions.iter().map(|expansion| expansion.order).max().unwrap_or(0);
        // What remains are sums, products and powers of the parts, in which the coordinates themselves no longer vary.
        let variables = expansions.iter().map(|expansion| (None, expansion.point)).collect();
        let mut domain = Expressions(&mut model.graph);
        let jet = Jets { domain: &mut domain, degree, variables }.of_beside(&parts.combined, memo);
        let jet = jet.map_err(|Singular(atom)| SeriesError::Singular {
            term: Some(source.id),
            atom: model.display_brief(atom),
        })?;
        let coefficients = jet.coefficients.into_iter().filter(|(index, _)| is_kept(index, expansions)).collect();
        let whole = TaylorSeries { function: source.expr, expansions: expansions.to_vec(), coefficients };
        source.expr = whole.polynomial(&mut model.graph);
    }
    model.equations = equations;
    Ok(truncations)
}

/// Whether no exponent exceeds the order of its coordinate.
fn is_kept(index: &Index, expansions: &[Expansion]) -> bool {
    index.iter().zip(expansions).all(|(&exponent, expansion)| exponent <= expansion.order)
}

/// An expression as sums, products and powers of the parts that have a series and of those that stay.
#[derive(Default)]
struct Parts {
    /// Functions and divisors that depend on a coordinate of the expansion, in the order of the graph.
    infinite: Vec<ExprId>,
    /// The largest parts without such a function.
    finite: Vec<ExprId>,
    /// The nodes that combine the parts, operands first, the expression last; nothing where it is a part itself.
    combined: Vec<(ExprId, Node)>,
}

/// Properties of a node, found once.
#[derive(Clone, Copy)]
struct Content {
    /// Whether it depends on a coordinate of the expansion.
    varies: bool,
    /// Whether it is such a function, or holds one that is to be expanded.
    infinite: bool,
}

impl Parts {
    /// The parts of an expression; `nodes` are all nodes that it uses, operands first, the expression last.
    fn of(nodes: &[(ExprId, Node)], expansions: &[Expansion]) -> Self {
        let mut contents: HashMap<ExprId, Content> = HashMap::with_capacity(nodes.len());
        for (id, node) in nodes {
            let mut content = Content { varies: false, infinite: false };
            for operand in node.operands() {
                content.varies |= contents[&operand].varies;
                content.infinite |= contents[&operand].infinite;
            }
            if let Node::Derivative(coordinate, 0) = node {
                content.varies = expansions.iter().any(|expansion| expansion.coordinate == *coordinate);
            }
            content.infinite |= content.varies && is_infinite(node);
            contents.insert(*id, content);
        }
        let mut parts = Self::default();
        let Some(root) = nodes.last() else { return parts };
        let mut reached = BTreeSet::from([root.0]);
        for (id, node) in nodes.iter().rev() {
            if !reached.contains(id) {
                continue;
            }
            let content = contents[id];
            if content.varies && is_infinite(node) {
                parts.infinite.push(*id);
            } else if !content.infinite || !is_combination(node) {
                parts.finite.push(*id);
            } else {
                reached.extend(node.operands());
                parts.combined.push((*id, node.clone()));
            }
        }
        parts.infinite.reverse();
        parts.combined.reverse();
        parts
    }
}

/// Whether a node that depends on a coordinate of the expansion is no polynomial of its operands.
fn is_infinite(node: &Node) -> bool {
    match node {
        Node::Power(_, exponent) => *exponent < 0,
        Node::Function(Function::Sign | Function::Abs, _) => false,
        Node::Function(..) | Node::Atan2(..) => true,
        _ => false,
    }
}

/// Whether a node is a sum, a product or a power.
fn is_combination(node: &Node) -> bool {
    matches!(node, Node::Sum(_) | Node::Product(_) | Node::Power(..))
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
