//! The forward dynamics of a model as one plan.
//!
//! The rows `Phi(q, q', ...; c) theta + known = B u` of equations of motion are affine in the highest derivatives a of the
//! coordinates, so that
//!
//! ```text
//! M a = B u - Phi|_{a = 0} theta - known|_{a = 0},    M = d(Phi theta + known)/da .
//! ```
//!
//! Invariant: M is formed exactly, entry by entry, before any number is rounded, so that a small mass beside a large
//! spring force loses no digits. Where M is symmetric as it is written, its factors are steps of the plan too
//! ([`Dynamics::factored`]): M = L D L^T, joint after joint, of which the zeros between branches are left out
//! (Featherstone, Rigid Body Dynamics Algorithms, 8.5).

use crate::expr::graph::{ExprId, Graph, Node};
use crate::number::rational::Rational;
use crate::plan::draft::Draft;
use crate::plan::entries::Entries;
use crate::plan::leaf::Leaf;
use crate::plan::operation::{Op, Slot};
use crate::plan::straight_line::{Merger, Plan};
use num_traits::{One, Zero};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// The plan of M and of the right-hand side.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dynamics {
    /// M, rows times coordinates, row-major, then the right-hand side, one entry per row. Its leaves are derivatives of
    /// coordinates below the highest ones, run-time constants, inputs, and the parameters theta as
    /// [`Leaf::Column`].
    pub plan: Plan,
}

impl Dynamics {
    /// `None` where the rows are not as many as the coordinates, or not written as affine in the highest derivatives.
    pub(crate) fn new(entries: Entries) -> Option<Self> {
        let Entries { graph, coordinates, inputs, regressor, known, input_map } = entries;
        let mut draft = Draft::new(graph);
        let graph = &mut draft.graph;
        let rows = known.len();
        if rows != coordinates.len() || rows == 0 {
            return None;
        }
        let highest: Vec<ExprId> =
            coordinates.iter().map(|&(coordinate, order)| graph.derivative_of(coordinate, order)).collect();
        let degrees = Degrees::new(graph, &highest);
        let affine = regressor.iter().chain(&known).all(|&entry| degrees.of(entry).is_some_and(|degree| degree <= 1));
        if !affine || input_map.iter().any(|&entry| degrees.of(entry) != Some(0)) {
            return None;
        }
        let columns = regressor.len() / rows;
        let theta: Vec<ExprId> = (0..columns).map(|column| draft.leaf(Leaf::Column(column))).collect();
        let graph = &mut draft.graph;
        let zero = graph.integer(0);
        // Entries share subexpressions, whose results are computed once for all entries.
        let mut rest: HashMap<ExprId, ExprId> = highest.iter().map(|&leaf| (leaf, zero)).collect();
        let mut slopes: Vec<HashMap<ExprId, ExprId>> = vec![HashMap::new(); highest.len()];
        let (mut matrix, mut right) = (Vec::with_capacity(rows * rows), Vec::with_capacity(rows));
        for row in 0..rows {
            let of_row = |graph: &mut Graph, part: &mut dyn FnMut(&mut Graph, ExprId) -> ExprId| {
                let entries = &regressor[row * columns..(row + 1) * columns];
                let mut terms = Vec::with_capacity(columns + 1);
                for (&entry, &value) in entries.iter().zip(&theta) {
                    let entry = part(graph, entry);
                    terms.push(graph.mul(value, entry));
                }
                terms.push(part(graph, known[row]));
                graph.sum(&terms)
            };
            for (&leaf, known) in highest.iter().zip(&mut slopes) {
                matrix.push(of_row(graph, &mut |graph, entry| graph.differentiate_beside(entry, leaf, known)));
            }
            let bias = of_row(graph, &mut |graph, entry| graph.substitute_beside(entry, &mut rest));
            let mut terms = vec![graph.neg(bias)];
            for (&factor, &input) in input_map[row * inputs.len()..].iter().zip(&inputs) {
                let input = graph.symbol(input);
                terms.push(graph.mul(factor, input));
            }
            right.push(graph.sum(&terms));
        }
        matrix.append(&mut right);
        Some(Self { plan: draft.plan(&matrix) })
    }
}

impl Dynamics {
    /// The plan of M alone.
    #[must_use]
    pub fn mass_matrix(&self) -> Plan {
        let mut merger = Merger::default();
        let mut outputs = merger.append(&self.plan);
        outputs.truncate(self.rows() * self.rows());
        merger.finish(outputs)
    }

    /// The plan with the steps of M = L D L^T behind those of M and of the right-hand side: its further outputs are the pivots
    /// (the entries of D) and the accelerations, coordinate by coordinate. `None` where M is not symmetric as it is
    /// written. With positive pivots this is as accurate as elimination with pivoting; whether they are is for the
    /// code that evaluates the plan to see.
    ///
    /// A joint is eliminated when the fewest pairs of others become coupled by it. Of a tree these are none when outward
    /// joints come first, so that joints of different branches stay apart.
    #[must_use]
    pub fn factored(&self) -> Option<Plan> {
        let n = self.rows();
        let mut merger = Merger::default();
        let mut outputs = merger.append(&self.plan);
        let mut matrix: Vec<Vec<Option<Slot>>> = Vec::with_capacity(n);
        for (i, row) in outputs.chunks(n).take(n).enumerate() {
            if (0..i).any(|j| outputs[j * n + i] != row[j]) {
                return None;
            }
            matrix.push(row.iter().map(|&slot| (!merger.is_number(slot, Zero::is_zero)).then_some(slot)).collect());
        }
        let mut right = outputs[n * n..].to_vec();
        let one = merger.emit(Op::Constant(Rational::one()));
        let mut left: Vec<usize> = (0..n).collect();
        let mut pivots = right.clone();
        // Of every eliminated coordinate: its number, the inverse pivot times what stood on the right, its factors.
        let mut eliminated: Vec<(usize, Slot, Factors)> = Vec::with_capacity(n);
        while !left.is_empty() {
            let beside = |k: usize| left.iter().copied().filter(move |&i| i != k);
            let coupled = |k: usize| beside(k).filter(|&i| matrix[k][i].is_some()).collect::<Vec<usize>>();
            let new_pairs = |k: usize| {
                let others = coupled(k);
                let pairs = others.iter().enumerate().flat_map(|(at, &i)| others[..at].iter().map(move |&j| (i, j)));
                pairs.filter(|&(i, j)| matrix[i][j].is_none()).count()
            };
            let k = left.iter().copied().min_by_key(|&k| (new_pairs(k), n - k))?;
            let others = coupled(k);
            left.retain(|&i| i != k);
            let pivot = matrix[k][k]?;
            pivots[k] = pivot;
            let inverse = merger.emit(Op::Div(one, pivot));
            let mut factors = Vec::with_capacity(others.len());
            for (at, &i) in others.iter().enumerate() {
                let entry = matrix[k][i]?;
                let factor = merger.emit(Op::Mul(entry, inverse));
                for &j in &others[..=at] {
                    let taken = merger.emit(Op::Mul(factor, matrix[k][j]?));
                    let entry = merger.emit(match matrix[i][j] {
                        Some(entry) => Op::Sub(entry, taken),
                        None => Op::Neg(taken),
                    });
                    (matrix[i][j], matrix[j][i]) = (Some(entry), Some(entry));
                }
                let taken = merger.emit(Op::Mul(factor, right[k]));
                right[i] = merger.emit(Op::Sub(right[i], taken));
                factors.push((i, factor));
            }
            let own = merger.emit(Op::Mul(right[k], inverse));
            eliminated.push((k, own, factors));
        }
        let mut accelerations = right;
        for (k, own, factors) in eliminated.into_iter().rev() {
            accelerations[k] = factors.into_iter().fold(own, |sum, (i, factor)| {
                let taken = merger.emit(Op::Mul(factor, accelerations[i]));
                merger.emit(Op::Sub(sum, taken))
            });
        }
        outputs.append(&mut pivots);
        outputs.append(&mut accelerations);
        Some(merger.finish(outputs).scheduled())
    }

    /// The number of rows, and of coordinates.
    #[must_use]
    pub fn rows(&self) -> usize {
        // The plan has n rows of M and one of the right-hand side.
        (1..).find(|n| n * n + n >= self.plan.outputs.len()).unwrap_or_default()
    }
}

/// Coordinates that stood beside an eliminated one, with their factors.
type Factors = Vec<(usize, Slot)>;

/// Degrees of expressions in some of the leaves, in the written form; `None` where such a leaf occurs inside a function
/// or in a denominator.
pub(super) struct Degrees(Vec<Option<u32>>);

impl Degrees {
    pub(super) fn new(graph: &Graph, variables: &[ExprId]) -> Self {
        let mut degrees: Vec<Option<u32>> = Vec::with_capacity(graph.len());
        for id in graph.ids() {
            let of = |id: &ExprId| degrees[id.index()];
            let degree = match graph.node(id) {
                _ if variables.contains(&id) => Some(1),
                Node::Sum(terms) => terms.iter().map(of).try_fold(0, |most, of| Some(of?.max(most))),
                Node::Product(factors) => factors.iter().map(of).try_fold(0_u32, |sum, of| sum.checked_add(of?)),
                Node::Power(base, exponent) if *exponent > 0 => {
                    of(base).and_then(|degree| degree.checked_mul(exponent.unsigned_abs()))
                }
                _ if graph.operands(id).all(|operand| of(&operand) == Some(0)) => Some(0),
                _ => None,
            };
            degrees.push(degree);
        }
        Self(degrees)
    }

    pub(super) fn of(&self, id: ExprId) -> Option<u32> {
        self.0[id.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::Dynamics;
    use crate::expr::graph::Function;
    use crate::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
    use crate::number::rational::{self, Rational};
    use crate::plan::entries::Entries;
    use crate::plan::leaf::Leaf;
    use crate::regressor::form::regressor_form;

    /// An arm whose inertia depends on its angle, a cart that couples to it, and a term of degree `power` in the acceleration:
    /// (J + m q2^2) q1'' + m q2 q2'' + k q1 + c s(q1)^power = u, m q2 q1'' + m q2'' - 3 q2'^2 = 0 (c known at run time).
    fn model(power: i32, inside: bool) -> ExactModel {
        let mut model = ExactModel { name: "Arm".into(), ..ExactModel::default() };
        let [q1, q2] = ["q1", "q2"].map(|name| model.declare_coordinate(name, None));
        let u = model.declare("u", None, Kind::Input);
        let [inertia, mass, spring] = ["J", "m", "k"].map(|name| model.declare(name, None, Kind::Parameter));
        let c = model.declare("c", None, Kind::Constant { value: None });
        let graph = &mut model.graph;
        let [u, inertia, mass, spring, c] = [u, inertia, mass, spring, c].map(|symbol| graph.symbol(symbol));
        let [x, y, y1] = [(q1, 0), (q2, 0), (q2, 1)].map(|(q, order)| graph.derivative_of(q, order));
        let [x2, y2] = [q1, q2].map(|q| graph.derivative_of(q, 2));
        let square = graph.pow(y, 2);
        let of = if inside { graph.function(Function::Sin, x2) } else { graph.pow(x2, power) };
        let rows = [
            vec![
                vec![inertia, x2],
                vec![mass, square, x2],
                vec![mass, y, y2],
                vec![spring, x],
                vec![c, of],
                vec![graph.integer(-1), u],
            ],
            vec![vec![mass, y, x2], vec![mass, y2], vec![graph.integer(-3), y1, y1]],
        ];
        for (index, row) in rows.into_iter().enumerate() {
            let terms = row.iter().map(|factors| graph.product(factors)).zip(0..);
            let terms = terms.map(|(expr, id)| SourceTerm { id: TermId(id), expr }).collect();
            model.equations.push(Equation { name: format!("eq{}", index + 1), terms });
        }
        model
    }

    #[test]
    fn the_matrix_and_the_right_hand_side_are_those_of_the_rows() {
        let model = model(1, false);
        let form = regressor_form(&model).expect("linear in the parameters");
        let dynamics = Dynamics::new(Entries::new(&model, &form)).expect("affine in the accelerations");
        // J, m, k = 5, 7, 11; c = 2; q1, q2 = 1/2, 1/3; q2' = 4; u = 9.
        let value = |leaf: &Leaf| -> Option<Rational> {
            Some(match *leaf {
                Leaf::Motion(q, 0) => rational::ratio(1, 2 + i64::from(q.0)),
                Leaf::Motion(_, 1) => rational::ratio(4, 1),
                Leaf::Column(column) => match &*form.columns[column].name {
                    "J" => rational::ratio(5, 1),
                    "m" => rational::ratio(7, 1),
                    _ => rational::ratio(11, 1),
                },
                Leaf::Symbol(symbol) if &*model.quantity(symbol).name == "c" => rational::ratio(2, 1),
                Leaf::Symbol(_) => rational::ratio(9, 1),
                _ => return None,
            })
        };
        let found = dynamics.plan.evaluate_exact(value).expect("rational, and no acceleration is read");
        let ninth = rational::ratio(7, 9);
        let expected = [
            rational::ratio(5 + 2, 1) + ninth,
            rational::ratio(7, 3),
            rational::ratio(7, 3),
            rational::ratio(7, 1),
            rational::ratio(9, 1) - rational::ratio(11, 2),
            rational::ratio(3 * 16, 1),
        ];
        assert_eq!(found, expected);

        let factored = dynamics.factored().expect("M is symmetric").evaluate_exact(value).expect("rational");
        let [m11, m12, _, m22, r1, r2] = expected;
        let a2 = (&r2 * &m11 - &m12 * &r1) / (&m11 * &m22 - &m12 * &m12);
        let a1 = (r1 - &m12 * &a2) / &m11;
        // The last coordinate is eliminated first.
        assert_eq!(factored[6..], [m11 - &m12 * &m12 / &m22, m22, a1, a2]);
    }

    #[test]
    fn rows_that_are_not_affine_in_the_accelerations_have_none() {
        for model in [model(2, false), model(-1, false), model(1, true)] {
            let form = regressor_form(&model).expect("linear in the parameters");
            assert_eq!(Dynamics::new(Entries::new(&model, &form)), None);
        }
    }
}
