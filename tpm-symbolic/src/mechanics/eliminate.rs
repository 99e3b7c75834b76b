//! Elimination of free coordinates (Feng, Eqns 4.2-4.12 and 4.31-4.34).
//!
//! A row without input in which a coordinate x stands without derivatives, linearly, and with a factor a free of motion,
//! a x + r = 0, gives x = -r/a; this and its time derivatives are put into every other row. The factors a are
//! polynomials in the physical parameters: division by a single product only lowers exponents of Laurent polynomials,
//! division by a sum keeps that sum as an explicit denominator ([`Fraction`]). No matrix is ever inverted.
//!
//! Invariants: a row is kept source term by source term, so that everything substituted into a term keeps the term's
//! [`TermId`]; after a step no row and no solution contains the eliminated coordinate, in any derivative.

use crate::algebra::fraction::Fraction;
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::mechanics::model::{ExactModel, Kind, TermId};
use crate::number::rational::{self, Rational};
use num_traits::{One, Signed};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fmt;
use thiserror::Error;

/// Why one equation cannot be solved for a coordinate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Obstacle {
    /// The equation's name.
    pub equation: String,
    /// The term at fault.
    pub term: TermId,
    /// Why the term stands in the way.
    pub reason: Reason,
}

/// What keeps an equation from being solved for a coordinate.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reason {
    /// The equation has an input, which would enter the other equations with its derivatives.
    Input(String),
    /// A time derivative of the coordinate occurs in the equation, so that solving for the coordinate would require an
    /// integration.
    Derivative(String),
    /// The coordinate does not enter linearly.
    NonLinear(String),
    /// The coordinate's factor depends on the motion and may vanish during it.
    MovingFactor(String),
    /// The coordinate's factor is identically zero.
    ZeroFactor,
    /// The equation is already solved for another coordinate.
    Taken(String),
}

impl fmt::Display for Obstacle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let equation = &self.equation;
        match &self.reason {
            Reason::Input(input) => write!(f, "equation {equation} has the input `{input}`"),
            Reason::Derivative(found) => {
                write!(f, "equation {equation} contains its derivative in `{found}`, so that solving would integrate")
            }
            Reason::NonLinear(found) => write!(f, "it is not linear in `{found}` of equation {equation}"),
            Reason::MovingFactor(factor) => {
                write!(f, "its factor `{factor}` in equation {equation} depends on the motion and may vanish")
            }
            Reason::ZeroFactor => {
                write!(f, "its factor in equation {equation} is identically zero, so that solving would divide by zero")
            }
            Reason::Taken(other) => write!(f, "equation {equation} is needed for `{other}`"),
        }
    }
}

/// Why a coordinate cannot be eliminated.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum EliminateError {
    /// No equation can be solved for the coordinate.
    #[error("the coordinate `{coordinate}` cannot be eliminated: {}; keep it, or eliminate another coordinate", list(.obstacles))]
    Impossible {
        /// The coordinate.
        coordinate: String,
        /// One obstacle for every equation that contains the coordinate.
        obstacles: Vec<Obstacle>,
    },
    /// The coordinate occurs in no equation.
    #[error("the coordinate `{coordinate}` is to be eliminated but stands in no equation")]
    Absent {
        /// The coordinate.
        coordinate: String,
    },
    /// Every equation was solved for a coordinate, so that none is left.
    #[error("after elimination no equation is left")]
    NothingLeft,
    /// The search over the order of elimination reached its limit.
    #[error(
        "no order of elimination was found among the {tried} that were tried; eliminate fewer coordinates, `{coordinate}` for one stays"
    )]
    TooManyOrders {
        /// A coordinate that was not eliminated.
        coordinate: String,
        /// How many steps were tried.
        tried: usize,
    },
}

fn list(obstacles: &[Obstacle]) -> String {
    obstacles.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
}

impl EliminateError {
    /// The source term at fault, when there is one.
    #[must_use]
    pub fn term(&self) -> Option<TermId> {
        match self {
            Self::Impossible { obstacles, .. } => obstacles.first().map(|obstacle| obstacle.term),
            Self::Absent { .. } | Self::NothingLeft | Self::TooManyOrders { .. } => None,
        }
    }
}

/// A term of an equation with the eliminated coordinates replaced.
#[derive(Clone, Debug)]
pub(crate) struct Substituted {
    pub(crate) id: TermId,
    /// The term as it was written.
    pub(crate) source: ExprId,
    pub(crate) value: Fraction<ExprId>,
}

/// A remaining equation.
#[derive(Clone, Debug)]
pub(crate) struct RemainingRow {
    pub(crate) name: String,
    pub(crate) terms: Vec<Substituted>,
    input: Option<Symbol>,
}

/// An eliminated coordinate as a function of the remaining ones.
#[derive(Clone, Debug)]
pub(crate) struct Solution {
    pub(crate) coordinate: Coordinate,
    pub(crate) value: Fraction<ExprId>,
    /// The equation that was solved.
    pub(crate) equation: String,
    /// The divisor, which is the coordinate's factor in the equation.
    pub(crate) divisor: Fraction<ExprId>,
}

/// Most elimination steps in the search over orders; a chain of n masses takes n.
const MAX_STEPS: usize = 500;

/// Eliminates `targets` from the equations of `model`, whose graph receives the new atoms.
///
/// # Errors
/// When no order of elimination works; the coordinate and the terms at fault are named.
pub(crate) fn eliminate(
    model: &mut ExactModel,
    targets: &[Coordinate],
) -> Result<(Vec<RemainingRow>, Vec<Solution>), EliminateError> {
    let targets: BTreeSet<Coordinate> = targets.iter().copied().collect();
    let rows: Vec<RemainingRow> = (0..model.equations.len()).map(|i| row_of(model, i)).collect();
    for &target in &targets {
        let occurs = |term: &Substituted| involves(&model.graph, term.source, target);
        if !rows.iter().any(|row| row.terms.iter().any(occurs)) {
            return Err(EliminateError::Absent { coordinate: coordinate_name(model, target) });
        }
    }
    let state = State { rows, solutions: Vec::new(), remaining: targets };
    let mut search = Search { steps: 0, deepest: None };
    match search.run(model, state) {
        Some(done) if done.rows.is_empty() => Err(EliminateError::NothingLeft),
        Some(done) => Ok((done.rows, done.solutions)),
        None => {
            let stuck = search.deepest.expect("invariant: a failed search has visited its first state");
            let target = *stuck.remaining.first().expect("invariant: a stuck state has a coordinate left");
            if search.steps >= MAX_STEPS {
                let coordinate = coordinate_name(model, target);
                return Err(EliminateError::TooManyOrders { coordinate, tried: search.steps });
            }
            Err(explain(model, &stuck, target))
        }
    }
}

fn coordinate_name(model: &ExactModel, coordinate: Coordinate) -> String {
    model.coordinates[coordinate.0 as usize].name.clone()
}

fn row_of(model: &ExactModel, index: usize) -> RemainingRow {
    let equation = &model.equations[index];
    let mut input = None;
    let terms = equation.terms.iter().map(|term| {
        let polynomial = with_known_values(model, &model.graph.polynomial(term.expr));
        for leaf in model.graph.leaves(term.expr) {
            if let Node::Symbol(symbol) = model.graph.node(leaf)
                && model.quantity(*symbol).kind == Kind::Input
            {
                input = input.or(Some(*symbol));
            }
        }
        Substituted { id: term.id, source: term.expr, value: Fraction::polynomial(polynomial) }
    });
    RemainingRow { terms: terms.collect(), name: equation.name.clone(), input }
}

/// Replaces constants of known value by numbers, so that terms which cancel do cancel.
fn with_known_values(model: &ExactModel, polynomial: &Polynomial<ExprId>) -> Polynomial<ExprId> {
    let known = |atom: &ExprId| match model.graph.node(*atom) {
        Node::Symbol(symbol) => match &model.quantity(*symbol).kind {
            Kind::Constant { value: Some(value) } => Some(value),
            _ => None,
        },
        _ => None,
    };
    if !polynomial.terms().any(|(m, _)| m.factors().any(|(atom, _)| known(atom).is_some())) {
        return polynomial.clone();
    }
    let replaced = polynomial.terms().map(|(monomial, coefficient)| {
        let (numbers, rest) =
            monomial.partition(|atom| known(atom).is_some_and(|value| *value != rational::integer(0)));
        let factor = numbers.factors().fold(coefficient.clone(), |product, (atom, exponent)| {
            known(atom).map_or_else(|| product.clone(), |value| &product * rational::power(value, exponent))
        });
        // A constant of value 0 with a positive exponent makes the term vanish; a division by it is kept, so that it is
        // reported.
        let vanishes = rest.factors().any(|(atom, exponent)| exponent > 0 && known(atom).is_some());
        (rest, if vanishes { rational::integer(0) } else { factor })
    });
    replaced.collect()
}

/// Whether an atom contains a coordinate in any derivative.
fn involves(graph: &Graph, atom: ExprId, coordinate: Coordinate) -> bool {
    match graph.node(atom) {
        Node::Derivative(found, _) => *found == coordinate,
        Node::Symbol(_) | Node::Number(_) | Node::Pi => false,
        _ => graph
            .leaves(atom)
            .into_iter()
            .any(|leaf| matches!(graph.node(leaf), Node::Derivative(found, _) if *found == coordinate)),
    }
}

/// Whether an atom depends on the motion.
pub(crate) fn moves(graph: &Graph, atom: ExprId) -> bool {
    match graph.node(atom) {
        Node::Derivative(..) => true,
        Node::Symbol(_) | Node::Number(_) | Node::Pi => false,
        _ => graph.leaves(atom).into_iter().any(|leaf| matches!(graph.node(leaf), Node::Derivative(..))),
    }
}

#[derive(Clone)]
struct State {
    rows: Vec<RemainingRow>,
    solutions: Vec<Solution>,
    remaining: BTreeSet<Coordinate>,
}

struct Search {
    steps: usize,
    /// The state with the fewest coordinates left to eliminate among those in which no row can be solved.
    deepest: Option<State>,
}

/// A row that can be solved for a coordinate: a x + r.
struct Candidate {
    row: usize,
    coordinate: Coordinate,
    factor: Fraction<ExprId>,
    rest: Fraction<ExprId>,
    /// Candidates of smaller cost are tried first.
    cost: (usize, usize, usize),
}

impl Search {
    fn run(&mut self, model: &mut ExactModel, state: State) -> Option<State> {
        if state.remaining.is_empty() {
            return Some(state);
        }
        let mut candidates = Vec::new();
        for row in 0..state.rows.len() {
            for &coordinate in &state.remaining {
                candidates.extend(candidate(&model.graph, &state, row, coordinate).ok());
            }
        }
        candidates.sort_by_key(|candidate| candidate.cost);
        if candidates.is_empty() {
            if self.deepest.as_ref().is_none_or(|best| state.remaining.len() < best.remaining.len()) {
                self.deepest = Some(state);
            }
            return None;
        }
        for candidate in candidates {
            if self.steps >= MAX_STEPS {
                break;
            }
            self.steps += 1;
            let next = step(model, &state, &candidate);
            if let Some(done) = self.run(model, next) {
                return Some(done);
            }
        }
        None
    }
}

fn total(row: &RemainingRow) -> Fraction<ExprId> {
    row.terms.iter().fold(Fraction::zero(), |sum, term| sum.add(&term.value))
}

/// The row as a x + r, or the reason why it cannot be solved for the coordinate.
fn candidate(graph: &Graph, state: &State, index: usize, coordinate: Coordinate) -> Result<Candidate, Reasons> {
    let row = &state.rows[index];
    if row.input.is_some() {
        return Err(Reasons::Input);
    }
    let sum = total(row);
    let (mut factor, mut rest) = (Polynomial::zero(), Polynomial::zero());
    let mut others: BTreeSet<Coordinate> = BTreeSet::new();
    for (monomial, coefficient) in sum.numerator().terms() {
        let (own, free) = monomial.partition(|&atom| involves(graph, atom, coordinate));
        for (&atom, _) in free.factors() {
            others.extend(state.remaining.iter().filter(|other| involves(graph, atom, **other)));
        }
        let mut parts = own.factors();
        match (parts.next(), parts.next()) {
            (None, _) => rest.add_term(free, coefficient.clone()),
            (Some((&atom, 1)), None) if matches!(graph.node(atom), Node::Derivative(_, 0)) => {
                if free.factors().any(|(&atom, _)| moves(graph, atom)) {
                    return Err(Reasons::At(monomial.clone(), What::MovingFactor));
                }
                factor.add_term(free, coefficient.clone());
            }
            (Some((&atom, _)), None) if matches!(graph.node(atom), Node::Derivative(_, 1..)) => {
                return Err(Reasons::At(monomial.clone(), What::Derivative));
            }
            _ => {
                let derivative = own.factors().any(|(&a, _)| matches!(graph.node(a), Node::Derivative(_, 1..)));
                let what = if derivative { What::Derivative } else { What::NonLinear };
                return Err(Reasons::At(monomial.clone(), what));
            }
        }
    }
    let factor = sum.with_numerator(factor);
    if factor.is_zero() {
        return Err(Reasons::Zero);
    }
    let shape = match factor.numerator().len() {
        1 => 0,
        _ if same_signs(factor.numerator()) => 1,
        _ => 2,
    };
    let cost = (shape, others.len(), sum.numerator().len());
    Ok(Candidate { row: index, coordinate, factor, rest: sum.with_numerator(rest), cost })
}

/// Whether all coefficients have one sign: then the sum cannot vanish while the parameters are positive.
fn same_signs(polynomial: &Polynomial<ExprId>) -> bool {
    let mut signs = polynomial.terms().map(|(_, coefficient)| coefficient.is_negative());
    let first = signs.next();
    signs.all(|sign| Some(sign) == first)
}

/// Why a row is no candidate, as data from which the message is made.
enum Reasons {
    Input,
    Zero,
    At(Monomial<ExprId>, What),
}

enum What {
    Derivative,
    NonLinear,
    MovingFactor,
}

fn explain(model: &mut ExactModel, state: &State, target: Coordinate) -> EliminateError {
    let coordinate = coordinate_name(model, target);
    let mut obstacles = Vec::new();
    for (index, row) in state.rows.iter().enumerate() {
        let contains = |term: &&Substituted| {
            involves(&model.graph, term.source, target)
                || term
                    .value
                    .numerator()
                    .terms()
                    .any(|(m, _)| m.factors().any(|(&atom, _)| involves(&model.graph, atom, target)))
        };
        let Some(first) = row.terms.iter().find(contains) else { continue };
        let (id, source) = (first.id, first.source);
        let Err(reasons) = candidate(&model.graph, state, index, target) else { continue };
        let (term, reason) = match reasons {
            Reasons::Input => {
                let name = row.input.map_or_else(String::new, |input| model.quantity(input).name.to_string());
                (id, Reason::Input(name))
            }
            Reasons::Zero => (id, Reason::ZeroFactor),
            Reasons::At(monomial, what) => {
                let holds = |term: &&Substituted| term.value.numerator().terms().any(|(m, _)| *m == monomial);
                let (id, source) = row.terms.iter().find(holds).map_or((id, source), |term| (term.id, term.source));
                let found = model.display_brief(source);
                let reason = match what {
                    What::Derivative => Reason::Derivative(found),
                    What::NonLinear => Reason::NonLinear(found),
                    What::MovingFactor => {
                        let (_, factor) = monomial.partition(|&atom| involves(&model.graph, atom, target));
                        let factor = model.graph.from_polynomial(&Polynomial::term(factor, Rational::one()));
                        Reason::MovingFactor(model.display_brief(factor))
                    }
                };
                (id, reason)
            }
        };
        obstacles.push(Obstacle { equation: row.name.clone(), term, reason });
    }
    for solution in &state.solutions {
        let equation = model.equations.iter().find(|equation| equation.name == solution.equation);
        let term = equation.and_then(|equation| {
            equation.terms.iter().find(|term| involves(&model.graph, term.expr, target)).map(|term| term.id)
        });
        if let Some(term) = term {
            let taken = Reason::Taken(coordinate_name(model, solution.coordinate));
            obstacles.push(Obstacle { equation: solution.equation.clone(), term, reason: taken });
        }
    }
    // Equations that only an input prevents from being solved come last.
    obstacles.sort_by_key(|obstacle| matches!(obstacle.reason, Reason::Input(_)));
    if obstacles.is_empty() {
        EliminateError::Absent { coordinate }
    } else {
        EliminateError::Impossible { coordinate, obstacles }
    }
}

/// Solves one row and substitutes into all others.
fn step(model: &mut ExactModel, state: &State, candidate: &Candidate) -> State {
    let value = candidate
        .rest
        .scale(&-Rational::one())
        .div(&candidate.factor)
        .expect("invariant: a candidate's factor is not zero");
    let mut substitution = Substitution::new(candidate.coordinate, value.clone());
    let mut rows = Vec::with_capacity(state.rows.len());
    for (index, row) in state.rows.iter().enumerate() {
        if index == candidate.row {
            continue;
        }
        let terms = row.terms.iter().map(|term| Substituted {
            value: substitution.apply(model, &term.value),
            id: term.id,
            source: term.source,
        });
        rows.push(RemainingRow { terms: terms.collect(), name: row.name.clone(), input: row.input });
    }
    let mut solutions = Vec::with_capacity(state.solutions.len() + 1);
    for solution in &state.solutions {
        let value = substitution.apply(model, &solution.value);
        solutions.push(Solution { value, ..solution.clone() });
    }
    solutions.push(Solution {
        coordinate: candidate.coordinate,
        value,
        equation: state.rows[candidate.row].name.clone(),
        divisor: candidate.factor.clone(),
    });
    let remaining = state.remaining.iter().copied().filter(|c| *c != candidate.coordinate).collect();
    State { rows, solutions, remaining }
}

/// Replacement of one coordinate and all its time derivatives.
struct Substitution {
    coordinate: Coordinate,
    /// The coordinate's value and its time derivatives, as far as they were needed.
    derivatives: Vec<Fraction<ExprId>>,
}

impl Substitution {
    fn new(coordinate: Coordinate, value: Fraction<ExprId>) -> Self {
        Self { coordinate, derivatives: vec![value] }
    }

    fn derivative(&mut self, model: &mut ExactModel, order: u32) -> Fraction<ExprId> {
        while self.derivatives.len() <= order as usize {
            let last = self.derivatives.last().expect("invariant: the value itself is present").clone();
            let numerator = time_derivative(&mut model.graph, last.numerator());
            self.derivatives.push(last.with_numerator(numerator));
        }
        self.derivatives[order as usize].clone()
    }

    fn apply(&mut self, model: &mut ExactModel, value: &Fraction<ExprId>) -> Fraction<ExprId> {
        // Terms with the same factors of the eliminated coordinate are multiplied out together.
        let mut groups: BTreeMap<Monomial<ExprId>, Vec<(Monomial<ExprId>, Rational)>> = BTreeMap::new();
        for (monomial, coefficient) in value.numerator().terms() {
            let (own, rest) = monomial.partition(|&atom| involves(&model.graph, atom, self.coordinate));
            groups.entry(own).or_default().push((rest, coefficient.clone()));
        }
        if groups.keys().all(Monomial::is_one) {
            return value.clone();
        }
        let mut sum = Fraction::zero();
        for (own, rest) in groups {
            let mut factors = vec![(Fraction::polynomial(rest.into_iter().collect()), 1)];
            factors.extend(own.factors().map(|(&atom, exponent)| self.power(model, atom, exponent)));
            let factors: Vec<(&Fraction<ExprId>, u32)> = factors.iter().map(|(value, power)| (value, *power)).collect();
            sum = sum.add(&Fraction::product_of_powers(&factors));
        }
        // The denominator contains parameters only, so the substitution does not change it.
        value.denominator().fold(sum, |sum, (factor, exponent)| {
            let exponent = i32::try_from(exponent).expect("invariant: exponents are small");
            let inverse = Fraction::polynomial(factor.clone()).pow(-exponent);
            sum.mul(&inverse.expect("invariant: a denominator is not zero"))
        })
    }

    /// The replacement of a power of an atom that contains the coordinate, as a value and an exponent.
    fn power(&mut self, model: &mut ExactModel, atom: ExprId, exponent: i32) -> (Fraction<ExprId>, u32) {
        if let (&Node::Derivative(_, order), Ok(exponent)) = (model.graph.node(atom), u32::try_from(exponent)) {
            return (self.derivative(model, order), exponent);
        }
        // A function or quotient of the coordinate is replaced by the same one of the coordinate's expression.
        let mut replacement: HashMap<ExprId, ExprId> = HashMap::new();
        for leaf in model.graph.leaves(atom) {
            if let Node::Derivative(found, order) = *model.graph.node(leaf)
                && found == self.coordinate
            {
                let value = self.derivative(model, order);
                replacement.insert(leaf, expression(&mut model.graph, &value));
            }
        }
        let replaced = model.graph.substitute(atom, &replacement);
        let replaced = model.graph.pow(replaced, exponent);
        (Fraction::polynomial(model.graph.polynomial(replaced)), 1)
    }
}

/// The total time derivative of a Laurent polynomial over atoms of the graph.
pub(crate) fn time_derivative(graph: &mut Graph, polynomial: &Polynomial<ExprId>) -> Polynomial<ExprId> {
    let atoms: BTreeSet<ExprId> =
        polynomial.terms().flat_map(|(m, _)| m.factors().map(|(&atom, _)| atom).collect::<Vec<_>>()).collect();
    let mut sum = Polynomial::zero();
    for atom in atoms.into_iter().collect::<Vec<_>>() {
        let rate = match *graph.node(atom) {
            Node::Derivative(coordinate, order) => Polynomial::variable(graph.derivative_of(coordinate, order + 1)),
            Node::Symbol(_) | Node::Pi | Node::Number(_) => continue,
            _ => {
                let rate = graph.time_derivative(atom);
                graph.polynomial(rate)
            }
        };
        if !rate.is_zero() {
            sum.add_assign(&polynomial.derivative(&atom).mul(&rate));
        }
    }
    sum
}

/// A fraction as an expression of the graph.
pub(crate) fn expression(graph: &mut Graph, value: &Fraction<ExprId>) -> ExprId {
    let numerator = graph.from_polynomial(value.numerator());
    let mut factors = vec![numerator];
    for (factor, exponent) in value.denominator() {
        let base = graph.from_polynomial(factor);
        let exponent = i32::try_from(exponent).expect("invariant: exponents are small");
        factors.push(graph.pow(base, -exponent));
    }
    graph.product(&factors)
}

/// A fraction as a Laurent polynomial over atoms, where sums in the denominator are atoms with negative exponents.
pub(crate) fn over_atoms(graph: &mut Graph, value: &Fraction<ExprId>) -> Polynomial<ExprId> {
    let mut inverse = Monomial::one();
    for (factor, exponent) in value.denominator() {
        let base = graph.from_polynomial(factor);
        let exponent = i32::try_from(exponent).expect("invariant: exponents are small");
        inverse = inverse.mul(&Monomial::power_of(base, -exponent));
    }
    value.numerator().mul_monomial(&inverse)
}
