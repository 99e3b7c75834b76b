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
//! spring force loses no digits. No system is solved symbolically.

use crate::expr::graph::{ExprId, Graph, Node};
use crate::plan::draft::Draft;
use crate::plan::entries::Entries;
use crate::plan::leaf::Leaf;
use crate::plan::straight_line::{Merger, Plan};
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

    /// The number of rows, and of coordinates.
    #[must_use]
    pub fn rows(&self) -> usize {
        // The plan has n rows of M and one of the right-hand side.
        (1..).find(|n| n * n + n >= self.plan.outputs.len()).unwrap_or_default()
    }
}

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
    }

    #[test]
    fn rows_that_are_not_affine_in_the_accelerations_have_none() {
        for model in [model(2, false), model(-1, false), model(1, true)] {
            let form = regressor_form(&model).expect("linear in the parameters");
            assert_eq!(Dynamics::new(Entries::new(&model, &form)), None);
        }
    }
}
