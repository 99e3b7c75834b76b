//! The split of every input into two parts: the input that holds the driven joint still while all others move, and the
//! rest, which moves it (Feng, section 6.2).
//!
//! The equations of motion are solved for the inputs, u = f(q, q', q'', ...). Of input i, which drives the coordinates D(i),
//!
//! ```text
//! motion-independent part   f_i with q_d = const for every d in D(i), all derivatives of q_d being 0
//! motion-dependent part     f_i minus the motion-independent part
//! ```
//!
//! The first part is a reaction: an actuator supplies it at standstill, as fast as its amplifier permits. The second
//! part also depends on the joint's own inertia and speed. For the driven pendulum on a driven cart these are Feng's
//! F_MI, F_MD, tau_MI and tau_MD (Eqns 6.6 and 6.7).
//!
//! Invariants of [`Split`]: `independent` and `dependent` are sums of monomials over the atoms of the equations. Every
//! monomial that does not depend on a derivative of the driven coordinates belongs unchanged to `independent`, every
//! one that vanishes with these derivatives belongs unchanged to `dependent`, and their sum is exactly the solved
//! input.

use crate::algebra::characteristic::{self, Matrix};
use crate::algebra::polynomial::{Monomial, Polynomial};
use crate::budget;
use crate::expr::graph::{Coordinate, ExprId, Graph, Node, Symbol};
use crate::expr::normal_form::NormalForms;
use crate::expr::size::Sizes;
use crate::expr::trigonometric;
use crate::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
use crate::number::rational::{self, Rational};
use crate::regressor::form::RegressorForm;
use crate::regressor::prepare::{PrepareError, prepare};
use num_traits::One;
use std::collections::HashMap;
use thiserror::Error;

/// One input and its parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InputParts {
    /// The input.
    pub input: Symbol,
    /// The coordinates that it drives.
    pub motions: Vec<Coordinate>,
    /// The motion-independent part, term by term, each with the source term from which it was derived.
    pub independent: Vec<SourceTerm>,
    /// The motion-dependent part.
    pub dependent: Vec<SourceTerm>,
}

/// The parts of all inputs.
#[derive(Clone, Debug)]
pub struct Split {
    /// The model whose graph holds the expressions; its equations are the given ones.
    pub model: ExactModel,
    /// The inputs in order of declaration.
    pub inputs: Vec<InputParts>,
}

/// Why the inputs of a model cannot be split.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum SplitError {
    /// The model has no input.
    #[error("the model has no input")]
    NoInput,
    /// There are fewer equations with an input than inputs.
    #[error(
        "{inputs} inputs stand in {rows} equations only, so that the motion does not determine them; combine inputs that act together into one"
    )]
    Undetermined {
        /// Number of inputs.
        inputs: usize,
        /// Number of equations with an input.
        rows: usize,
    },
    /// Some inputs act on the same equations in the same proportion.
    #[error("the inputs act on the same equations in the same proportion, so that the motion does not determine them")]
    Dependent,
    /// An input does not enter linearly.
    #[error("`{input}` does not enter linearly here")]
    NotLinear {
        /// The source term at fault.
        term: TermId,
        /// The input.
        input: String,
    },
    /// The equations do not determine which coordinate an input drives.
    #[error("it does not follow from the equations which coordinate `{input}` drives; say which")]
    Motion {
        /// The input.
        input: String,
    },
    /// The equations are too long to be multiplied out.
    #[error(
        "the equations have up to {terms:.0e} terms when they are multiplied out, and parts are written down up to {most:.0e}; hold joints that need not move, or state known inertias as numbers"
    )]
    TooLong {
        /// An upper bound of the number of terms.
        terms: u64,
        /// The most terms that are written down.
        most: u64,
    },
    /// A term has no value when the joint stands still.
    #[error("`{atom}` has no value while `{input}`'s coordinate stands still, so there is no motion-independent part")]
    Singular {
        /// The source term at fault.
        term: TermId,
        /// The input.
        input: String,
        /// The quotient or function.
        atom: String,
    },
}

impl SplitError {
    /// The source term at fault, when there is one.
    #[must_use]
    pub fn term(&self) -> Option<TermId> {
        match self {
            Self::NotLinear { term, .. } | Self::Singular { term, .. } => Some(*term),
            _ => None,
        }
    }
}

/// Most terms of equations that are split, multiplied out; more would take longer than some seconds and give text that
/// nobody reads.
const MOST_TERMS: u64 = 1_000_000;

/// Splits every input of a model. `motions` names the coordinates that an input drives. For an input that is not
/// listed, its row belongs to the coordinate whose highest derivative the row determines. Where that coordinate is no
/// motion (a current, whose highest derivative is the first), the input drives the motions whose derivatives stand in
/// its row.
///
/// Inputs that act on more rows than there are inputs are solved for by least squares, as the feed-forward does.
///
/// # Errors
/// When the model has no input, the equations are too long or do not determine the inputs or the coordinate that an input drives, an
/// input does not enter linearly, or a term has no value when the joint stands still.
pub fn split(model: &ExactModel, motions: &[(Symbol, Vec<Coordinate>)]) -> Result<Split, SplitError> {
    let whole = model;
    let mut model = whole.clone();
    let inputs: Vec<Symbol> = model.inputs().collect();
    if inputs.is_empty() {
        return Err(SplitError::NoInput);
    }
    let mut sizes = Sizes::default();
    let terms = model.equations.iter().flat_map(|equation| &equation.terms);
    let terms = terms.map(|term| sizes.of(&model.graph, term.expr)).sum::<f64>() as u64;
    if terms > MOST_TERMS {
        return Err(SplitError::TooLong { terms, most: MOST_TERMS });
    }
    let rows = solved_for(&mut model, &inputs)?;
    let orders = Orders::of(&model);
    let pairs = pairing(&orders);
    let order = model.order();
    let mut found = Vec::with_capacity(inputs.len());
    for (index, &input) in inputs.iter().enumerate() {
        let name = || model.quantity(input).name.to_string();
        let driven = match motions.iter().find(|(symbol, _)| *symbol == input) {
            Some((_, given)) => given.clone(),
            None => {
                let acts = rows.iter().filter(|row| row.acts[index]).map(|row| row.equation);
                driven(&orders, pairs.as_deref(), acts).ok_or_else(|| SplitError::Motion { input: name() })?
            }
        };
        let name = name();
        let zero = model.graph.integer(0);
        let still = standing_still(&mut model.graph, &driven, order);
        let (mut independent, mut dependent) = (Vec::new(), Vec::new());
        for row in &rows {
            let Some(weight) = row.weights[index] else { continue };
            for term in &row.rest {
                let product = model.graph.mul(weight, term.expr);
                let parts = budget::within(|| whole.display_source(term.id), || parts_of(&mut model, product, &still));
                let (stays, moves) =
                    parts.map_err(|atom| SplitError::Singular { term: term.id, input: name.clone(), atom })?;
                let add = |list: &mut Vec<SourceTerm>, expr: ExprId| {
                    if expr != zero {
                        list.push(SourceTerm { id: term.id, expr });
                    }
                };
                add(&mut independent, stays);
                add(&mut dependent, moves);
            }
        }
        found.push(InputParts { input, motions: driven, independent, dependent });
    }
    Ok(Split { model, inputs: found })
}

impl Split {
    /// The sum of a part's terms, in this model's graph.
    pub fn expression(&mut self, part: &[SourceTerm]) -> ExprId {
        let terms: Vec<ExprId> = part.iter().map(|term| term.expr).collect();
        self.model.graph.sum(&terms)
    }

    /// A model with one equation for every part that is not 0, `F_independent = ...` and `F_dependent = ...`, ready for
    /// regressor form and expansion. Coordinates that the model asks to eliminate are replaced by their solutions.
    ///
    /// # Errors
    /// When a coordinate cannot be eliminated.
    pub fn parts(&self) -> Result<ExactModel, PrepareError> {
        let mut model = self.model.clone();
        let mut replacement = HashMap::new();
        if !model.eliminations.is_empty() {
            let order = model.order();
            let prepared = prepare(model)?;
            model = prepared.model;
            for reconstruction in &prepared.reconstructions {
                let mut value = reconstruction.expr;
                for n in 0..=order {
                    replacement.insert(model.graph.derivative_of(reconstruction.coordinate, n), value);
                    value = model.graph.time_derivative(value);
                }
            }
        }
        model.eliminations.clear();
        // The parts are lumped anew, since a name for a lumped parameter of the whole need not fit one of the parts.
        model.lumps.clear();
        model.equations.clear();
        for input in &self.inputs {
            let quantity = model.quantity(input.input).clone();
            for (part, suffix) in [(&input.independent, "independent"), (&input.dependent, "dependent")] {
                if part.is_empty() {
                    continue;
                }
                let mut name = format!("{}_{suffix}", quantity.name);
                while model.find_symbol(&name).is_some() {
                    name.push('_');
                }
                let symbol = model.declare(&name, quantity.unit.clone(), Kind::Input);
                let mut terms = Vec::with_capacity(part.len() + 1);
                for term in part {
                    let expr = model.graph.substitute(term.expr, &replacement);
                    terms.push(SourceTerm { id: term.id, expr });
                }
                let leaf = model.graph.symbol(symbol);
                let expr = model.graph.neg(leaf);
                terms.push(SourceTerm { id: terms[0].id, expr });
                model.equations.push(Equation { name, terms });
            }
        }
        Ok(model)
    }
}

/// The regressor form in its two parts, the motion-independent and the motion-dependent one, for rows that each hold
/// one input. Every term of a row goes to one of the parts, so that Phi theta + known of both add up to the whole.
///
/// `None` where that cannot be done term by term: a row holds several inputs, an input's coordinate does not follow from the
/// equations or is eliminated, or a term has a share in both parts.
#[must_use]
pub fn split_form(model: &ExactModel, form: &RegressorForm) -> Option<[RegressorForm; 2]> {
    let orders = Orders::of(model);
    let pairs = pairing(&orders)?;
    let mut graph = model.graph.clone();
    let zero = graph.integer(0);
    let order = model.order();
    let leaves = |equation: &Equation| model.graph.leaves_of(equation.terms.iter().map(|term| term.expr));
    let leaves: Vec<Vec<ExprId>> = model.equations.iter().map(leaves).collect();
    let mut parts = [form.clone(), form.clone()];
    for (index, row) in form.rows.iter().enumerate() {
        let [resting, moving] = &mut parts;
        resting.rows[index].terms.clear();
        moving.rows[index].terms.clear();
        let (input, rest) = row.inputs.split_first().map(|((symbol, _), rest)| (*symbol, rest)).unzip();
        let Some(input) = input else { continue };
        if rest.is_some_and(|rest| !rest.is_empty()) {
            return None;
        }
        let leaf = graph.symbol(input);
        // Leaves are listed in increasing order.
        let acts = (0..leaves.len()).filter(|&equation| leaves[equation].binary_search(&leaf).is_ok());
        let driven = driven(&orders, Some(&pairs), acts)?;
        if model.eliminations.iter().flat_map(|e| &e.coordinates).any(|coordinate| driven.contains(coordinate)) {
            return None;
        }
        let still = standing_still(&mut graph, &driven, order);
        for term in &row.terms {
            let values: Vec<(ExprId, ExprId, i32)> = term
                .atoms
                .factors()
                .map(|(&atom, exponent)| (atom, graph.substitute(atom, &still), exponent))
                .collect();
            let part = if values.iter().any(|(_, value, exponent)| *value == zero && *exponent > 0) {
                &mut *moving
            } else if values.iter().all(|(atom, value, _)| atom == value) {
                &mut *resting
            } else {
                return None;
            };
            part.rows[index].terms.push(term.clone());
        }
    }
    Some(parts)
}

/// Maps every derivative of the fixed coordinates to zero.
fn standing_still(graph: &mut Graph, coordinates: &[Coordinate], order: u32) -> HashMap<ExprId, ExprId> {
    let zero = graph.integer(0);
    let mut still = HashMap::new();
    for &coordinate in coordinates {
        for n in 1..=order {
            still.insert(graph.derivative_of(coordinate, n), zero);
        }
    }
    still
}

/// A row with inputs, and its weight in each input's solution.
struct Solved {
    equation: usize,
    rest: Vec<SourceTerm>,
    weights: Vec<Option<ExprId>>,
    acts: Vec<bool>,
}

/// The rows with inputs, solved for these: u_j = sum_r weight_jr rest_r.
fn solved_for(model: &mut ExactModel, inputs: &[Symbol]) -> Result<Vec<Solved>, SplitError> {
    let leaves: Vec<ExprId> = inputs.iter().map(|&input| model.graph.symbol(input)).collect();
    let mut rows: Vec<Solved> = Vec::new();
    let mut map: Matrix<Polynomial<ExprId>> = Vec::new();
    // Separate every row into the factors of the inputs and the other terms.
    for (equation, declared) in model.equations.clone().iter().enumerate() {
        let mut factors = vec![Polynomial::zero(); inputs.len()];
        let mut rest = Vec::with_capacity(declared.terms.len());
        for term in &declared.terms {
            let polynomial = model.graph.polynomial(term.expr);
            let mut without = Polynomial::zero();
            for (monomial, coefficient) in polynomial.terms() {
                let (of_inputs, other) =
                    monomial.partition(|&atom| model.graph.leaves(atom).iter().any(|leaf| leaves.contains(leaf)));
                let mut atoms = of_inputs.factors();
                match (atoms.next(), atoms.next()) {
                    (None, _) => without.add_term(other, coefficient.clone()),
                    (Some((atom, 1)), None) if leaves.contains(atom) => {
                        let which = leaves.iter().position(|leaf| leaf == atom);
                        let which = which.expect("invariant: the guard has found it");
                        factors[which].add_term(other, coefficient.clone());
                    }
                    (Some((&atom, _)), _) => {
                        let leaf = model.graph.leaves(atom).into_iter().find(|leaf| leaves.contains(leaf));
                        let input = leaf.map_or_else(String::new, |leaf| model.display(leaf));
                        return Err(SplitError::NotLinear { term: term.id, input });
                    }
                }
            }
            if !without.is_zero() {
                let expr = model.graph.from_polynomial(&without);
                rest.push(SourceTerm { id: term.id, expr });
            }
        }
        if factors.iter().any(|factor| !factor.is_zero()) {
            let acts = factors.iter().map(|factor| !factor.is_zero()).collect();
            rows.push(Solved { equation, rest, weights: vec![None; inputs.len()], acts });
            map.push(factors);
        }
    }
    if rows.len() < inputs.len() {
        return Err(SplitError::Undetermined { inputs: inputs.len(), rows: rows.len() });
    }
    // Where every row has a single input, each row gives its input.
    let minus_one = rational::integer(-1);
    let single = |row: &Vec<Polynomial<ExprId>>| row.iter().filter(|factor| !factor.is_zero()).count() == 1;
    if rows.len() == inputs.len() && map.iter().all(single) {
        for (row, factors) in rows.iter_mut().zip(&map) {
            for (slot, factor) in row.weights.iter_mut().zip(factors).filter(|(_, factor)| !factor.is_zero()) {
                let factor = model.graph.from_polynomial(&factor.scale(&minus_one));
                *slot = Some(model.graph.pow(factor, -1));
            }
        }
        let driven_once = |j: usize| rows.iter().filter(|row| row.acts[j]).count() == 1;
        return if (0..inputs.len()).all(driven_once) { Ok(rows) } else { Err(SplitError::Dependent) };
    }
    // B u = -rest: B^-1 where B is square, (B^T B)^-1 B^T where it has more rows.
    let graph = &mut model.graph;
    let map: Matrix<Polynomial<ExprId>> = map
        .iter()
        .map(|row| {
            row.iter()
                .map(|entry| {
                    let entry = graph.from_polynomial(entry);
                    trigonometric::normal(graph, entry)
                })
                .collect()
        })
        .collect();
    let transposed: Matrix<Polynomial<ExprId>> =
        (0..inputs.len()).map(|j| map.iter().map(|row| row[j].clone()).collect()).collect();
    let square = if map.len() == inputs.len() {
        map
    } else {
        characteristic::multiply(&mut NormalForms(graph), &transposed, &map)
    };
    let (determinant, mut inverse) = characteristic::adjugate(&mut NormalForms(graph), &square);
    if trigonometric::numerator(graph, &determinant).is_zero() {
        return Err(SplitError::Dependent);
    }
    if square.len() < rows.len() {
        inverse = characteristic::multiply(&mut NormalForms(graph), &inverse, &transposed);
    }
    let below = graph.from_polynomial(&determinant.scale(&minus_one));
    let below = graph.pow(below, -1);
    for (j, weights) in inverse.iter().enumerate() {
        for (row, weight) in rows.iter_mut().zip(weights).filter(|(_, weight)| !weight.is_zero()) {
            let above = graph.from_polynomial(weight);
            row.weights[j] = Some(graph.mul(above, below));
        }
    }
    Ok(rows)
}

/// The highest derivatives of the coordinates.
struct Orders {
    /// In every equation, of the coordinates that stand in it.
    of_equations: Vec<HashMap<usize, u32>>,
    /// In all equations, of every coordinate.
    highest: Vec<u32>,
}

impl Orders {
    fn of(model: &ExactModel) -> Self {
        let mut highest = vec![0; model.coordinates.len()];
        let of_equation = |equation: &Equation| {
            let mut own = HashMap::new();
            for leaf in model.graph.leaves_of(equation.terms.iter().map(|term| term.expr)) {
                if let Node::Derivative(coordinate, order) = *model.graph.node(leaf) {
                    let coordinate = coordinate.0 as usize;
                    for slot in [own.entry(coordinate).or_insert(0), &mut highest[coordinate]] {
                        *slot = order.max(*slot);
                    }
                }
            }
            own
        };
        let of_equations = model.equations.iter().map(of_equation).collect();
        Self { of_equations, highest }
    }

    /// Whether a derivative of at least this order occurs in an equation.
    fn stands(&self, equation: usize, coordinate: usize, order: u32) -> bool {
        self.of_equations[equation].get(&coordinate).is_some_and(|own| *own >= order)
    }
}

/// For every equation the coordinate whose highest derivative it determines: the one of the same index where that is
/// possible, as for Euler-Lagrange equations, otherwise the unique assignment; `None` when there is none or more than
/// one.
fn pairing(orders: &Orders) -> Option<Vec<usize>> {
    let n = orders.highest.len();
    if orders.of_equations.len() != n {
        return None;
    }
    let fits = |equation: usize, c: usize| orders.highest[c] > 0 && orders.stands(equation, c, orders.highest[c]);
    if (0..n).all(|r| fits(r, r)) {
        return Some((0..n).collect());
    }
    let fits: Vec<Vec<bool>> = (0..n).map(|r| (0..n).map(|c| fits(r, c)).collect()).collect();
    let mut ways = Vec::new();
    search(&fits, &mut Vec::new(), &mut ways);
    match ways.len() {
        1 => ways.pop(),
        _ => None,
    }
}

fn search(fits: &[Vec<bool>], chosen: &mut Vec<usize>, ways: &mut Vec<Vec<usize>>) {
    if ways.len() > 1 {
        return;
    }
    let Some(row) = fits.get(chosen.len()) else {
        ways.push(chosen.clone());
        return;
    };
    for c in (0..row.len()).filter(|&c| row[c]) {
        if !chosen.contains(&c) {
            chosen.push(c);
            search(fits, chosen, ways);
            chosen.pop();
        }
    }
}

/// The coordinates that an input acting on these equations drives.
fn driven(orders: &Orders, pairs: Option<&[usize]>, acts: impl Iterator<Item = usize>) -> Option<Vec<Coordinate>> {
    let pairs = pairs?;
    let mut found = Vec::new();
    for equation in acts {
        let own = pairs[equation];
        let mut coordinates = vec![own];
        if orders.highest[own] < 2 {
            // A coordinate of first order, such as a current, is no motion; the input then drives the motions in its
            // row.
            let moving = (0..orders.highest.len()).filter(|&c| orders.highest[c] >= 2);
            let moving: Vec<usize> = moving.filter(|&c| orders.stands(equation, c, 1)).collect();
            if !moving.is_empty() {
                coordinates = moving;
            }
        }
        for c in coordinates {
            let c = Coordinate(u32::try_from(c).expect("invariant: fewer than 2^32 coordinates"));
            if !found.contains(&c) {
                found.push(c);
            }
        }
    }
    Some(found)
}

/// The two parts of a product or sum; an error with the atom that has no value at rest.
fn parts_of(model: &mut ExactModel, expr: ExprId, still: &HashMap<ExprId, ExprId>) -> Result<(ExprId, ExprId), String> {
    let graph = &mut model.graph;
    let polynomial = graph.polynomial(expr);
    let (mut stays, mut moves) = (Vec::new(), Vec::new());
    for (monomial, coefficient) in polynomial.terms() {
        let term = one_term(graph, monomial, coefficient);
        if let Some(atom) = without_value(graph, term, still) {
            return Err(model.display_brief(atom));
        }
        let at_rest = graph.substitute(term, still);
        stays.push(at_rest);
        if at_rest != term {
            moves.push(graph.sub(term, at_rest));
        }
    }
    Ok((graph.sum(&stays), graph.sum(&moves)))
}

fn one_term(graph: &mut Graph, monomial: &Monomial<ExprId>, coefficient: &Rational) -> ExprId {
    let mut factors = Vec::with_capacity(monomial.factors().count() + 1);
    if !coefficient.is_one() {
        factors.push(graph.number(coefficient.clone()));
    }
    for (&atom, exponent) in monomial.factors() {
        factors.push(graph.pow(atom, exponent));
    }
    graph.product(&factors)
}

/// A quotient whose denominator vanishes, or an angle of the origin, where `still` replaces leaves.
fn without_value(graph: &mut Graph, expr: ExprId, still: &HashMap<ExprId, ExprId>) -> Option<ExprId> {
    let mut seen = vec![false; expr.index() + 1];
    let mut stack = vec![expr];
    while let Some(id) = stack.pop() {
        if std::mem::replace(&mut seen[id.index()], true) {
            continue;
        }
        stack.extend(graph.operands(id));
        let vanishing: Vec<ExprId> = match *graph.node(id) {
            Node::Power(base, i32::MIN..0) => vec![base],
            Node::Atan2(y, x) => vec![y, x],
            _ => continue,
        };
        let vanish = |graph: &mut Graph, part: ExprId| {
            let value = graph.substitute(part, still);
            value != part && trigonometric::is_zero(graph, value)
        };
        if vanishing.into_iter().all(|part| vanish(graph, part)) {
            return Some(id);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::{SplitError, split};
    use crate::expr::graph::{ExprId, Symbol};
    use crate::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};

    struct Two {
        model: ExactModel,
        a: [ExprId; 2],
        u: [ExprId; 2],
        k: ExprId,
    }

    /// Two coordinates with their accelerations, two inputs, one parameter.
    fn two() -> Two {
        let mut model = ExactModel { name: "Two".into(), ..ExactModel::default() };
        let q = ["q", "p"].map(|name| model.declare_coordinate(name, None));
        let u = ["u", "v"].map(|name| model.declare(name, None, Kind::Input));
        let k = model.declare("k", None, Kind::Parameter);
        let a = q.map(|q| model.graph.derivative_of(q, 2));
        let u = u.map(|u| model.graph.symbol(u));
        let k = model.graph.symbol(k);
        Two { model, a, u, k }
    }

    fn equation(model: &mut ExactModel, terms: &[ExprId]) {
        let first = model.equations.len() * 10;
        let terms = (first..).zip(terms).map(|(id, &expr)| SourceTerm { id: TermId(id as u32), expr }).collect();
        model.equations.push(Equation { name: format!("eq{}", model.equations.len() + 1), terms });
    }

    fn shown(model: &ExactModel, motions: &[(Symbol, Vec<crate::expr::graph::Coordinate>)]) -> Vec<[String; 2]> {
        let mut parts = split(model, motions).expect("can be split");
        let inputs = parts.inputs.clone();
        inputs
            .iter()
            .map(|input| {
                [&input.independent, &input.dependent].map(|part| {
                    let expr = parts.expression(part);
                    parts.model.display(expr)
                })
            })
            .collect()
    }

    #[test]
    fn rows_in_any_order_and_mixed_inputs() {
        // v = k q'' + p'' comes first, q'' + k p'' = 3 u second; the assignment by index is used only if it is
        // possible.
        let Two { mut model, a, u, k } = two();
        let g = &mut model.graph;
        let coupled = g.mul(k, a[0]);
        let (minus_v, triple) = (g.neg(u[1]), g.scale(u[0], crate::number::rational::integer(-3)));
        equation(&mut model, &[a[1], minus_v]);
        equation(&mut model, &[a[0], triple]);
        let found = shown(&model, &[]);
        assert_eq!(found, [["0", "ddot(q)/3"], ["0", "ddot(p)"]].map(|pair| pair.map(String::from)));
        model.equations[0].terms.insert(0, SourceTerm { id: TermId(99), expr: coupled });
        let found = shown(&model, &[]);
        assert_eq!(found[1], ["ddot(q)*k", "ddot(p)"].map(String::from));
        // One row holds both inputs: u + v = q'', u = p'' gives v = q'' - p''.
        let Two { mut model, a, u, .. } = two();
        let minus = u.map(|u| model.graph.neg(u));
        equation(&mut model, &[a[0], minus[0], minus[1]]);
        equation(&mut model, &[a[1], minus[0]]);
        let found = shown(&model, &[]);
        // u acts on both rows, so it drives both coordinates.
        assert_eq!(found, [["0", "ddot(p)"], ["-ddot(p)", "ddot(q)"]].map(|pair| pair.map(String::from)));
    }

    #[test]
    fn least_squares_where_an_input_acts_on_more_rows() {
        // q'' = u, p'' = 2 u, no second input: u = (q'' + 2 p'')/5.
        let mut model = ExactModel { name: "One".into(), ..ExactModel::default() };
        let q = ["q", "p"].map(|name| model.declare_coordinate(name, None));
        let symbol = model.declare("u", None, Kind::Input);
        let a = q.map(|q| model.graph.derivative_of(q, 2));
        let u = model.graph.symbol(symbol);
        let (once, twice) = (model.graph.neg(u), model.graph.scale(u, crate::number::rational::integer(-2)));
        equation(&mut model, &[a[0], once]);
        equation(&mut model, &[a[1], twice]);
        let found = shown(&model, &[(symbol, vec![q[0]])]);
        assert_eq!(found[0], ["2*ddot(p)/5", "ddot(q)/5"].map(String::from));
    }

    #[test]
    fn faults_are_named() {
        let Two { mut model, a, u, k } = two();
        let g = &mut model.graph;
        let square = g.pow(u[0], 2);
        let minus = u.map(|u| g.neg(u));
        let rate = g.derivative_of(crate::expr::graph::Coordinate(0), 1);
        let inverse = g.div(k, rate);
        equation(&mut model, &[a[0], minus[0]]);
        assert_eq!(split(&model, &[]).err(), Some(SplitError::Undetermined { inputs: 2, rows: 1 }));
        equation(&mut model, &[a[1], minus[0]]);
        assert_eq!(split(&model, &[]).err(), Some(SplitError::Dependent));
        model.equations.pop();
        equation(&mut model, &[a[1], square, minus[1]]);
        let error = split(&model, &[]).expect_err("a square of an input");
        assert_eq!((error.term(), error.to_string().contains("`u`")), (Some(TermId(11)), true));
        model.equations.pop();
        equation(&mut model, &[a[1], minus[1]]);
        model.equations[0].terms.push(SourceTerm { id: TermId(7), expr: inverse });
        let error = split(&model, &[]).expect_err("a pole at rest");
        assert!(
            matches!(&error, SplitError::Singular { term: TermId(7), atom, .. } if atom.contains("dot(q)")),
            "{error}"
        );
        assert_eq!(split(&ExactModel::default(), &[]).err(), Some(SplitError::NoInput));
    }
}
