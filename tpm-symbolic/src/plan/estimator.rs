//! Straight-line plans of everything that an emitted estimator computes.
//!
//! Invariant of [`EstimatorPlan`]: every operation of a plan is needed by one of its outputs. Emitters print these
//! plans and decide no mathematics.

use crate::expr::graph::Function;
use crate::expr::size::Sizes;
use crate::harmonic::expand::expand;
use crate::harmonic::table::HarmonicTable;
use crate::mechanics::model::ExactModel;
use crate::mechanics::tree::mechanism::Mechanism;
use crate::plan::evaluation::Evaluation;
use crate::plan::forces;
use crate::plan::leaf::Leaf;
use crate::plan::lumping::{UnlumpGap, Unlumping, lumping, unlumping};
use crate::plan::operation::{Op, Slot};
use crate::plan::pattern::{PatternGap, PatternPlan};
use crate::plan::split::split_form;
use crate::plan::straight_line::{Merger, Plan};
use crate::plan::written;
use crate::regressor::form::RegressorForm;
use crate::regressor::solved::{Solved, Step};
use num_traits::{One, Zero};
use thiserror::Error;

/// Most terms of equations whose feed-forward is split; more would take longer than some seconds and give megabytes of
/// code.
const MOST_PARTED: f64 = 2_000_000.0;

/// The equations have too many terms, multiplied out, for their feed-forward to be split.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error(
    "the feed-forward is parted term by term, and the equations may have more than {most} terms when they are multiplied out"
)]
pub struct TooLong {
    /// The most terms that are multiplied out.
    pub most: u64,
}

/// The plans of a model.
#[derive(Clone, Debug)]
pub struct EstimatorPlan {
    /// Phi, known terms and input map.
    pub evaluation: Evaluation,
    /// Phi theta + known, one output per row.
    pub inverse_dynamics: Plan,
    /// The inputs, when every input occurs in exactly one equation, and that equation has no other input.
    pub feed_forward: Option<Plan>,
    /// The feed-forward in two parts whose sum it is, the motion-independent one first ([`crate::plan::split`]). `None`
    /// where there is no feed-forward, where its terms cannot be divided between the parts, and where the equations are
    /// not multiplied out ([`Self::part_feed_forward`]).
    pub feed_forward_parts: Option<[Plan; 2]>,
    /// The columns from the physical parameters; `None` when every column is one of them.
    pub lumping: Option<Plan>,
    /// The physical parameters from the columns, when `lumping` is some.
    pub unlumping: Option<Result<Unlumping, UnlumpGap>>,
    /// The plans of every pattern of the model.
    pub patterns: Vec<PatternPlan>,
    /// Inputs that stand in functions. In the form's place for them is what their equation makes of them; the feed-forward solves for them.
    pub solved: Vec<Solved>,
}

impl EstimatorPlan {
    /// The plans of `form`, which belongs to `model`.
    #[must_use]
    pub fn new(model: &ExactModel, form: &RegressorForm) -> Self {
        let table = |pattern| expand(model, form, pattern).map_err(PatternGap::from);
        Self::with_tables(model, form, model.patterns.iter().map(table))
    }

    /// The plans of `form`, which belongs to `model`, with one given table per pattern of the model. A table may come
    /// from declared Taylor polynomials or have a declared number of harmonics; its symbols are the model's and its
    /// columns are the form's.
    #[must_use]
    pub fn with_tables(
        model: &ExactModel,
        form: &RegressorForm,
        tables: impl IntoIterator<Item = Result<HarmonicTable, PatternGap>>,
    ) -> Self {
        let evaluation = Evaluation::new(model, form);
        let mut merger = Merger::default();
        let forces = match written::forces(model, form) {
            Some(written) => merger.append(&written),
            None => inverse_dynamics(&mut merger, &evaluation, form),
        };
        let inverse_dynamics = merger.clone().finish(forces.clone());
        Self {
            feed_forward: feed_forward(merger, &forces, &evaluation, form),
            feed_forward_parts: if form.is_expanded(&model.graph) { feed_forward_parts(model, form) } else { None },
            inverse_dynamics,
            lumping: lumping(model, form),
            unlumping: unlumping(model, form),
            patterns: model
                .patterns
                .iter()
                .zip(tables)
                .map(|(pattern, table)| PatternPlan::new(model, &evaluation, pattern, table))
                .collect(),
            evaluation,
            solved: Vec::new(),
        }
    }

    /// The plans of a form in which something else takes the place of these inputs, which the feed-forward solves for. Harmonics would be
    /// those of what takes their place, so that there are none.
    #[must_use]
    pub fn with_solved(model: &ExactModel, form: &RegressorForm, solved: Vec<Solved>) -> Self {
        let gap = |input: &Solved| PatternGap::Solved(model.quantity(input.input).name.to_string());
        let tables = model.patterns.iter().flat_map(|_| solved.first().map(|input| Err(gap(input))));
        let mut plan = Self::with_tables(model, form, tables);
        plan.feed_forward_parts = None;
        plan.feed_forward = plan.feed_forward.map(|own| solve(&own, &plan.evaluation, &solved));
        plan.solved = solved;
        plan
    }
}

impl EstimatorPlan {
    /// Computes the row forces by the recursion of the mechanism from which the equations were derived, where that is
    /// shorter than Phi theta.
    #[must_use]
    pub fn with_recursion(mut self, model: &ExactModel, form: &RegressorForm, mechanism: &Mechanism) -> Self {
        if form.is_expanded(&model.graph) {
            return self;
        }
        let Some(recursion) = forces::by_recursion(model, form, mechanism) else { return self };
        let Some(shorter) = forces::shorter(Some(self.inverse_dynamics.clone()), Some(recursion)) else { return self };
        let mut merger = Merger::default();
        let forces = merger.append(&shorter);
        self.feed_forward = feed_forward(merger, &forces, &self.evaluation, form);
        self.inverse_dynamics = shorter;
        self
    }

    /// Computes [`Self::feed_forward_parts`] for equations in their written form: they are multiplied out, which may
    /// increase their length many times. `model` and `form` are those of the plans.
    ///
    /// # Errors
    /// [`TooLong`] when the equations would have too many terms.
    pub fn part_feed_forward(&mut self, model: &ExactModel, form: &RegressorForm) -> Result<(), TooLong> {
        let mut sizes = Sizes::default();
        let terms = form.rows.iter().flat_map(|row| &row.terms);
        let terms = terms.map(|term| term.size(&model.graph, &mut sizes)).sum::<f64>();
        if terms > MOST_PARTED {
            return Err(TooLong { most: MOST_PARTED as u64 });
        }
        if self.feed_forward_parts.is_none() {
            self.feed_forward_parts = feed_forward_parts(model, &form.expanded(&model.graph));
        }
        Ok(())
    }
}

/// Row forces as products of the regressor's own entries, so that a program that needs both computes each entry once.
fn inverse_dynamics(merger: &mut Merger, evaluation: &Evaluation, form: &RegressorForm) -> Vec<Slot> {
    let phi = merger.append(&evaluation.regressor);
    let known = merger.append(&evaluation.known);
    let columns = form.columns.len();
    let row = |(r, &known): (usize, &Slot)| {
        let mut total = if merger.is_number(known, Zero::is_zero) { None } else { Some(known) };
        for c in 0..columns {
            let entry = phi[r * columns + c];
            if merger.is_number(entry, Zero::is_zero) {
                continue;
            }
            let theta = merger.load(Leaf::Column(c));
            // A negative entry is subtracted from the terms before it. As the first term it is not negated, since the
            // regressor computes the entry with its sign.
            let (factor, negative) = match *merger.op(entry) {
                Op::Neg(positive) if total.is_some() || merger.is_number(positive, One::is_one) => (positive, true),
                _ => (entry, false),
            };
            let product =
                if merger.is_number(factor, One::is_one) { theta } else { merger.emit(Op::Mul(factor, theta)) };
            total = Some(match (total, negative) {
                (None, false) => product,
                (None, true) => merger.emit(Op::Neg(product)),
                (Some(sum), false) => merger.emit(Op::Add(sum, product)),
                (Some(sum), true) => merger.emit(Op::Sub(sum, product)),
            });
        }
        total.unwrap_or(known)
    };
    known.iter().enumerate().map(row).collect()
}

/// The inputs from the row forces, when every relevant row and column of B has one entry.
fn feed_forward(mut merger: Merger, forces: &[Slot], evaluation: &Evaluation, form: &RegressorForm) -> Option<Plan> {
    let factors = merger.append(&evaluation.input_map);
    let inputs = evaluation.inputs.len();
    let mut outputs = Vec::with_capacity(inputs);
    for (i, input) in evaluation.inputs.iter().enumerate() {
        let mut rows = form.rows.iter().enumerate().filter(|(_, row)| row.inputs.iter().any(|(s, _)| s == input));
        let ((r, row), None) = (rows.next()?, rows.next()) else { return None };
        if row.inputs.len() != 1 {
            return None;
        }
        let factor = factors[r * inputs + i];
        outputs.push(if merger.is_number(factor, One::is_one) {
            forces[r]
        } else {
            merger.emit(Op::Div(forces[r], factor))
        });
    }
    Some(merger.finish(outputs))
}

/// The inputs from what takes their place.
fn solve(plan: &Plan, evaluation: &Evaluation, solved: &[Solved]) -> Plan {
    let mut merger = Merger::default();
    let mut outputs = merger.append(plan);
    for own in solved {
        let Some(place) = evaluation.inputs.iter().position(|input| *input == own.input) else { continue };
        let mut value = outputs[place];
        if let Some(column) = own.column {
            let parameter = merger.load(Leaf::Column(column));
            value = merger.emit(Op::Div(value, parameter));
        }
        for step in &own.steps {
            value = match step {
                Step::Reciprocal => {
                    let one = merger.emit(Op::Constant(One::one()));
                    merger.emit(Op::Div(one, value))
                }
                Step::Function(function) => merger.emit(Op::Function(*function, value)),
                Step::Square => merger.emit(Op::Mul(value, value)),
                Step::NotNegative => {
                    let root = merger.emit(Op::Function(Function::Sqrt, value));
                    merger.emit(Op::Mul(root, root))
                }
                Step::SignedRoot => {
                    let size = merger.emit(Op::Function(Function::Abs, value));
                    let root = merger.emit(Op::Function(Function::Sqrt, size));
                    let sign = merger.emit(Op::Function(Function::Sign, value));
                    merger.emit(Op::Mul(sign, root))
                }
            };
        }
        outputs[place] = value;
    }
    merger.finish(outputs)
}

/// The feed-forward of each part of the split rows.
fn feed_forward_parts(model: &ExactModel, form: &RegressorForm) -> Option<[Plan; 2]> {
    let [resting, moving] = split_form(model, form)?;
    let plan = |part: &RegressorForm| {
        let evaluation = Evaluation::new(model, part);
        let mut merger = Merger::default();
        let forces = inverse_dynamics(&mut merger, &evaluation, part);
        feed_forward(merger, &forces, &evaluation, part)
    };
    Some([plan(&resting)?, plan(&moving)?])
}

#[cfg(test)]
mod tests {
    use super::EstimatorPlan;
    use crate::algebra::fourier::{Fourier, Trig};
    use crate::algebra::polynomial::Monomial;
    use crate::expr::graph::ExprId;
    use crate::mechanics::model::{Equation, ExactModel, Kind, SourceTerm, TermId};
    use crate::mechanics::pattern::{Motion, Pattern, rest_to_rest};
    use crate::number::rational::{Rational, integer, ratio};
    use crate::plan::leaf::Leaf;
    use crate::plan::table::entry_formula;
    use crate::regressor::form::regressor_form;

    /// m x'' - k x^2 - 3 g = G u with x on the pattern of order 5 about the constant x0.
    fn model() -> ExactModel {
        let mut model = ExactModel { name: "Test".to_owned(), ..ExactModel::default() };
        let x = model.declare_coordinate("x", None);
        let mut quantity = |name: &str, kind: Kind| model.declare(name, None, kind);
        let constant = || Kind::Constant { value: None };
        let symbols = [
            quantity("u", Kind::Input),
            quantity("m", Kind::Parameter),
            quantity("k", Kind::Parameter),
            quantity("g", constant()),
            quantity("G", constant()),
        ];
        let [x0, lambda, w] =
            [("x0", constant()), ("lambda", Kind::Amplitude), ("w", Kind::Frequency)].map(|(n, k)| quantity(n, k));
        let graph = &mut model.graph;
        let [u, m, k, g, big] = symbols.map(|symbol| graph.symbol(symbol));
        let (position, acceleration) = (graph.derivative_of(x, 0), graph.derivative_of(x, 2));
        let (square, minus_three, minus_one) = (graph.pow(position, 2), graph.integer(-3), graph.integer(-1));
        let terms: Vec<ExprId> = vec![
            graph.mul(m, acceleration),
            graph.product(&[minus_one, k, square]),
            graph.mul(minus_three, g),
            graph.product(&[minus_one, big, u]),
        ];
        let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
        model.equations.push(Equation { name: "u".to_owned(), terms });
        let motion = Motion::term(Monomial::power_of(x0, 1), Fourier::constant(integer(1)))
            .add(&Motion::term(Monomial::power_of(lambda, 1), rest_to_rest(5).expect("odd order")));
        let pattern = Pattern { name: None, amplitudes: vec![lambda], frequency: w, motions: vec![Some(motion)] };
        model.patterns.push(pattern);
        model
    }

    fn value(model: &ExactModel, name: &str) -> Rational {
        let position = model.symbols.iter().position(|quantity| quantity.name == name).expect("declared");
        ratio(i64::try_from(position).expect("small") + 2, 7)
    }

    /// Leaves at fixed rational values; the phase is the one with tan(theta/2) = 1/2.
    fn leaf(model: &ExactModel, leaf: &Leaf) -> Option<Rational> {
        Some(match *leaf {
            Leaf::Motion(_, order) => ratio(i64::from(order) + 3, 5),
            Leaf::Symbol(symbol) => value(model, &model.quantity(symbol).name),
            Leaf::Column(index) => ratio(i64::try_from(index).expect("small") + 1, 11),
            Leaf::Cos => ratio(3, 5),
            Leaf::Sin => ratio(4, 5),
            Leaf::Signal(_) => integer(7),
            Leaf::Harmonic(_) => return None,
        })
    }

    #[test]
    fn feed_forward_is_the_row_divided_by_the_input_factor() {
        let model = model();
        let plan = EstimatorPlan::new(&model, &regressor_form(&model).expect("linear"));
        let (m, k) = (ratio(1, 11), ratio(2, 11));
        let (x, a) = (ratio(3, 5), ratio(5, 5));
        // G multiplies the input, so that it divides the feed-forward but not the table.
        let (g, big) = (value(&model, "g"), value(&model, "G"));
        let row = m * a - k * &x * &x - integer(3) * g;
        let outputs = plan.feed_forward.as_ref().and_then(|p| p.evaluate_exact(|read| leaf(&model, read)));
        assert_eq!(outputs, Some(vec![row / big]));
    }

    #[test]
    fn reference_and_bank_are_exact_at_a_rational_phase() {
        let model = model();
        let plan = EstimatorPlan::new(&model, &regressor_form(&model).expect("linear"));
        let pattern = &plan.patterns[0];
        // (3/5 + 4/5 j)^k by repeated multiplication.
        let mut powers = vec![(integer(1), integer(0))];
        for k in 0..12 {
            let (c, s) = powers[k].clone();
            powers.push((&c * ratio(3, 5) - &s * ratio(4, 5), &s * ratio(3, 5) + &c * ratio(4, 5)));
        }
        let (x0, lambda, w) = (value(&model, "x0"), value(&model, "lambda"), value(&model, "w"));
        let c = |k: usize| powers[k].0.clone();
        let shape = c(1) - ratio(1, 6) * c(3) + ratio(1, 50) * c(5);
        let second = -c(1) + ratio(9, 6) * c(3) - ratio(25, 50) * c(5);
        let s = |k: usize| powers[k].1.clone();
        let first = -s(1) + ratio(3, 6) * s(3) - ratio(5, 50) * s(5);
        let expected = vec![&x0 + &lambda * shape, &lambda * &w * first, &lambda * &w * &w * second];
        let reference = pattern.reference.as_ref().expect("every coordinate moves");
        assert_eq!(reference.evaluate_exact(|read| leaf(&model, read)), Some(expected));
        let table = pattern.table.as_ref().expect("finite");
        let bank = table.bank.evaluate_exact(|read| leaf(&model, read)).expect("rational");
        assert_eq!(bank.len(), table.rows.len());
        for (found, &(_, harmonic, function)) in bank.iter().zip(&table.rows) {
            let (cos, sin) = &powers[harmonic];
            assert_eq!(*found, integer(7) * if function == Trig::Cos { cos } else { sin });
        }
    }

    #[test]
    fn the_matrix_holds_every_entry_of_the_table_once() {
        let model = model();
        let plan = EstimatorPlan::new(&model, &regressor_form(&model).expect("linear"));
        let table = plan.patterns[0].table.as_ref().expect("finite");
        let values = table.matrix.evaluate_exact(|read| leaf(&model, read)).expect("rational");
        for (&(row, column), found) in table.places.iter().zip(&values) {
            let (equation, harmonic, function) = table.rows[row];
            let expected: Rational = table
                .table
                .at(equation, harmonic, function, column)
                .map(|entry| {
                    let powers = entry.powers.factors().map(|(&symbol, exponent)| {
                        crate::number::rational::power(&value(&model, &table.table.symbols[symbol]), exponent)
                    });
                    powers.product::<Rational>() * &entry.coefficient
                })
                .sum();
            assert_eq!(*found, expected);
        }
        assert!(table.places.iter().any(|(_, column)| column.is_none()), "the known term is in the table");
        let formulas: Vec<String> = table.table.entries().map(|entry| entry_formula(&table.table, &entry)).collect();
        assert!(formulas.contains(&"-lambda*w^2".to_owned()), "{formulas:?}");
    }

    #[test]
    fn a_power_of_a_difference_stays_one() {
        // k (x - x0)^2 x'' - 2 c (x - x0)^3 = u
        let mut model = ExactModel { name: "Test".to_owned(), ..ExactModel::default() };
        let x = model.declare_coordinate("x", None);
        let u = model.declare("u", None, Kind::Input);
        let k = model.declare("k", None, Kind::Parameter);
        let [x0, c] = ["x0", "c"].map(|name| model.declare(name, None, Kind::Constant { value: None }));
        let graph = &mut model.graph;
        let [u, k, x0, c] = [u, k, x0, c].map(|symbol| graph.symbol(symbol));
        let (position, acceleration) = (graph.derivative_of(x, 0), graph.derivative_of(x, 2));
        let distance = graph.sub(position, x0);
        let (square, cube, minus_two) = (graph.pow(distance, 2), graph.pow(distance, 3), graph.integer(-2));
        let terms = [graph.product(&[k, square, acceleration]), graph.product(&[minus_two, c, cube]), graph.neg(u)];
        let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
        model.equations.push(Equation { name: "u".to_owned(), terms });
        let form = regressor_form(&model).expect("linear");
        assert_eq!(form.rows[0].terms.len(), 7, "the form itself is multiplied out");
        let plan = EstimatorPlan::new(&model, &form);
        let counts = [&plan.evaluation.regressor, &plan.evaluation.known].map(|plan| {
            let counts = plan.counts();
            (counts.additions, counts.multiplications)
        });
        // x - x0, its square, times x''; x - x0, its cube, times c, times 2, negated.
        assert_eq!(counts, [(1, 2), (2, 4)]);
        let leaf = |read: &Leaf| leaf(&model, read);
        let (distance, acceleration) = (ratio(3, 5) - value(&model, "x0"), ratio(1, 1));
        let square = &distance * &distance;
        assert_eq!(plan.evaluation.regressor.evaluate_exact(leaf), Some(vec![&square * acceleration]));
        let known = -integer(2) * value(&model, "c") * square * distance;
        assert_eq!(plan.evaluation.known.evaluate_exact(leaf), Some(vec![known]));
    }
}
