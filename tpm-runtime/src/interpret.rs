//! A model that is run without being compiled: its evaluation plans, executed operation by operation.
//!
//! Invariant: the operations are those of the plans of [`tpm_symbolic::plan`], in their order and each rounded once, so
//! that the numbers equal those of the emitted code.

use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_core::Real;
use tpm_core::derivatives::RowDerivatives;
use tpm_core::linear;
use tpm_core::model::{
    Buffer, Dims, EvalError, Label, Model, difference_workspace_len, forward_by_differences, require_forward,
    require_len, split_workspace,
};
use tpm_symbolic::expr::graph::{Function, Symbol};
use tpm_symbolic::mechanics::model::ExactModel as Declared;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::derivatives::Derivatives;
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::plan::leaf::Leaf;
use tpm_symbolic::plan::operation::{Op, Slot};
use tpm_symbolic::plan::pattern::PatternPlan;
use tpm_symbolic::plan::straight_line::Plan;
use tpm_symbolic::regressor::form::RegressorForm;

/// An owned name and unit.
#[derive(Clone, Debug)]
struct Name {
    name: String,
    unit: Option<String>,
}

impl Name {
    fn label(&self) -> Label<'_> {
        match &self.unit {
            Some(unit) => Label::new(&self.name, unit),
            None => Label::bare(&self.name),
        }
    }
}

/// One operation on the workspace.
#[derive(Clone, Copy, Debug)]
enum Step {
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Neg(usize),
    Function(Function, usize),
    Atan2(usize, usize),
}

/// A plan with its constants rounded to double precision.
///
/// Invariant: a workspace holds the plan's own constants, then all leaves, then the result of every step. A step reads
/// only entries before its own.
#[derive(Clone, Debug)]
struct Program {
    constants: Vec<f64>,
    steps: Vec<Step>,
    outputs: Vec<usize>,
    workspace_len: usize,
    /// The results of a plan that depends on no leaf.
    fixed: Option<Vec<f64>>,
}

impl Program {
    /// A plan that reads some of `leaves`, which occupy a workspace in this order.
    fn new(plan: &Plan, leaves: &[Leaf]) -> Self {
        let value = |op: &Op| match op {
            Op::Constant(value) => Some(rational::to_f64(value)),
            Op::Pi => Some(core::f64::consts::PI),
            _ => None,
        };
        let constants: Vec<f64> = plan.ops.iter().filter_map(value).collect();
        let leaf = |index: u32| {
            let place = leaves.iter().position(|present| *present == plan.inputs[index as usize]);
            constants.len() + place.expect("invariant: the plan reads leaves that it is given")
        };
        let first = constants.len() + leaves.len();
        let mut places: Vec<usize> = Vec::with_capacity(plan.ops.len());
        let (mut steps, mut constant) = (Vec::new(), 0);
        for op in &plan.ops {
            let at = |slot: &Slot| places[slot.index()];
            let step = match op {
                Op::Constant(_) | Op::Pi => {
                    places.push(constant);
                    constant += 1;
                    continue;
                }
                Op::Load(index) => {
                    places.push(leaf(*index));
                    continue;
                }
                Op::Add(a, b) => Step::Add(at(a), at(b)),
                Op::Sub(a, b) => Step::Sub(at(a), at(b)),
                Op::Mul(a, b) => Step::Mul(at(a), at(b)),
                Op::Div(a, b) => Step::Div(at(a), at(b)),
                Op::Neg(a) => Step::Neg(at(a)),
                Op::Function(function, a) => Step::Function(*function, at(a)),
                Op::Atan2(a, b) => Step::Atan2(at(a), at(b)),
            };
            places.push(first + steps.len());
            steps.push(step);
        }
        let outputs = plan.outputs.iter().map(|slot| places[slot.index()]).collect();
        let workspace_len = first + steps.len();
        let mut program = Self { constants, steps, outputs, workspace_len, fixed: None };
        if plan.inputs.is_empty() {
            let mut results = vec![0.0; program.outputs.len()];
            program.run(&[&vec![0.0; leaves.len()]], &mut vec![0.0; workspace_len], &mut results);
            program.fixed = Some(results);
        }
        program
    }

    /// Executes the steps on the values of all leaves, which come in order and in any number of slices.
    fn run(&self, leaves: &[&[f64]], workspace: &mut [f64], out: &mut [f64]) {
        if let Some(fixed) = &self.fixed {
            for (result, &value) in out.iter_mut().zip(fixed) {
                *result = value;
            }
            return;
        }
        let mut at = 0;
        for part in core::iter::once(self.constants.as_slice()).chain(leaves.iter().copied()) {
            workspace[at..at + part.len()].copy_from_slice(part);
            at += part.len();
        }
        for (i, step) in self.steps.iter().enumerate() {
            workspace[at + i] = match *step {
                Step::Add(a, b) => workspace[a] + workspace[b],
                Step::Sub(a, b) => workspace[a] - workspace[b],
                Step::Mul(a, b) => workspace[a] * workspace[b],
                Step::Div(a, b) => workspace[a] / workspace[b],
                Step::Neg(a) => -workspace[a],
                Step::Function(function, a) => apply(function, workspace[a]),
                Step::Atan2(y, x) => Real::atan2(workspace[y], workspace[x]),
            };
        }
        for (result, &slot) in out.iter_mut().zip(&self.outputs) {
            *result = workspace[slot];
        }
    }
}

/// Applies a function of the core, not of the standard library, so that every machine gets the same bits.
fn apply(function: Function, x: f64) -> f64 {
    match function {
        Function::Sin => Real::sin(x),
        Function::Cos => Real::cos(x),
        Function::Tan => Real::tan(x),
        Function::Asin => Real::asin(x),
        Function::Acos => Real::acos(x),
        Function::Atan => Real::atan(x),
        Function::Sqrt => Real::sqrt(x),
        Function::Abs => Real::abs(x),
        Function::Sign => Real::sign(x),
    }
}

/// A declared model, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Interpreted {
    name: String,
    dims: Dims,
    coordinates: Vec<Name>,
    orders: Vec<usize>,
    inputs: Vec<Name>,
    parameters: Vec<Name>,
    constants: Vec<Name>,
    rows: Vec<Name>,
    workspace_len: usize,
    regressor: Program,
    known: Program,
    input_map: Program,
    /// Program of the matrix of the highest derivatives, then the right-hand side; nothing where the rows are not
    /// affine in these derivatives.
    dynamics: Option<Program>,
}

impl Interpreted {
    /// Makes a model runnable; `form` is the regressor form of `model`.
    #[must_use]
    pub fn new(model: &Declared, form: &RegressorForm) -> Self {
        let (evaluation, dynamics) = Evaluation::with_dynamics(model, form);
        let name = |name: &str, unit: Option<&tpm_symbolic::mechanics::unit::Unit>| Name {
            name: name.to_string(),
            unit: unit.map(ToString::to_string),
        };
        let quantity = |symbol: &Symbol| {
            let quantity = model.quantity(*symbol);
            name(&quantity.name, quantity.unit.as_ref())
        };
        let coordinates: Vec<Name> = evaluation
            .coordinates
            .iter()
            .map(|(coordinate, _)| {
                let info = &model.coordinates[coordinate.0 as usize];
                name(&info.name, info.unit.as_ref())
            })
            .collect();
        let rows: Vec<Name> = form
            .rows
            .iter()
            .map(|row| {
                let unit = match row.inputs.as_slice() {
                    [(symbol, factor)] if factor.as_constant().is_some() => model.quantity(*symbol).unit.as_ref(),
                    _ => None,
                };
                name(&row.name, unit)
            })
            .collect();
        let mut leaves: Vec<Leaf> = (0..=evaluation.order())
            .flat_map(|order| evaluation.coordinates.iter().map(move |(q, _)| Leaf::Motion(*q, order)))
            .collect();
        leaves.extend(evaluation.constants.iter().map(|&constant| Leaf::Symbol(constant)));
        let [regressor, known, input_map] =
            [&evaluation.regressor, &evaluation.known, &evaluation.input_map].map(|plan| Program::new(plan, &leaves));
        leaves.extend((0..form.columns.len()).map(Leaf::Column));
        leaves.extend(evaluation.inputs.iter().map(|&input| Leaf::Symbol(input)));
        let dynamics = dynamics.map(|dynamics| Program::new(&dynamics.plan, &leaves));
        let workspace_len = [&regressor, &known, &input_map].map(|program| program.workspace_len).into_iter().max();
        Self {
            name: model.name.clone(),
            dims: Dims {
                coordinates: coordinates.len(),
                order: evaluation.order() as usize,
                inputs: evaluation.inputs.len(),
                rows: rows.len(),
                parameters: form.columns.len(),
                constants: evaluation.constants.len(),
            },
            coordinates,
            orders: evaluation.coordinates.iter().map(|(_, order)| *order as usize).collect(),
            inputs: evaluation.inputs.iter().map(quantity).collect(),
            parameters: form.columns.iter().map(|column| name(&column.name, column.unit.as_ref())).collect(),
            constants: evaluation.constants.iter().map(quantity).collect(),
            rows,
            workspace_len: workspace_len.unwrap_or(0),
            regressor,
            known,
            input_map,
            dynamics,
        }
    }

    fn run(
        &self,
        program: &Program,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Motion, motion.len(), self.dims.motion_len())?;
        require_len(Buffer::Constants, constants.len(), self.dims.constants)?;
        require_len(Buffer::Output, out.len(), program.outputs.len())?;
        let (scratch, _) = split_workspace(workspace, self.workspace_len)?;
        program.run(&[motion, constants], scratch, out);
        Ok(())
    }
}

/// The derivatives of a declared model's rows, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct InterpretedDerivatives {
    dims: Dims,
    /// Place of every slot of the program in a motion; nothing where the motion does not reach so high.
    places: Vec<usize>,
    switches: usize,
    rows: Program,
    switching: Program,
}

impl InterpretedDerivatives {
    /// Makes the derivatives of a model runnable; `form` is the regressor form of `model`.
    #[must_use]
    pub fn new(model: &Declared, form: &RegressorForm) -> Self {
        let evaluation = Evaluation::new(model, form);
        let derivatives = Derivatives::new(model, form);
        let mut leaves: Vec<Leaf> = (0..=evaluation.order())
            .flat_map(|order| evaluation.coordinates.iter().map(move |(q, _)| Leaf::Motion(*q, order)))
            .collect();
        leaves.extend(evaluation.constants.iter().map(|&constant| Leaf::Symbol(constant)));
        leaves.extend((0..form.columns.len()).map(Leaf::Column));
        leaves.extend(evaluation.inputs.iter().map(|&input| Leaf::Symbol(input)));
        let n = evaluation.coordinates.len();
        let position = |q| evaluation.coordinates.iter().position(|(present, _)| *present == q);
        let place = |&(q, order): &(_, u32)| {
            let coordinate = position(q).expect("invariant: a slot belongs to a coordinate of the rows");
            order as usize * n + coordinate
        };
        Self {
            dims: Dims {
                coordinates: n,
                order: evaluation.order() as usize,
                inputs: evaluation.inputs.len(),
                rows: form.rows.len(),
                parameters: form.columns.len(),
                constants: evaluation.constants.len(),
            },
            places: derivatives.slots.iter().map(place).collect(),
            switches: derivatives.switches,
            rows: Program::new(&derivatives.rows, &leaves),
            switching: Program::new(&derivatives.switching, &leaves),
        }
    }

    fn check(&self, motion: &[f64], parameters: &[f64], constants: &[f64], inputs: &[f64]) -> Result<(), EvalError> {
        require_len(Buffer::Motion, motion.len(), self.dims.motion_len())?;
        require_len(Buffer::Parameters, parameters.len(), self.dims.parameters)?;
        require_len(Buffer::Constants, constants.len(), self.dims.constants)?;
        require_len(Buffer::Inputs, inputs.len(), self.dims.inputs)
    }
}

impl RowDerivatives<f64> for InterpretedDerivatives {
    fn workspace_len(&self) -> usize {
        self.rows.workspace_len.max(self.switching.workspace_len) + self.rows.outputs.len()
    }

    fn rows(
        &self,
        motion: &[f64],
        parameters: &[f64],
        constants: &[f64],
        inputs: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.check(motion, parameters, constants, inputs)?;
        let width = self.dims.motion_len();
        require_len(Buffer::Output, out.len(), self.dims.rows * width)?;
        let (results, scratch) = split_workspace(workspace, self.rows.outputs.len())?;
        let (scratch, _) = split_workspace(scratch, self.rows.workspace_len)?;
        self.rows.run(&[motion, constants, parameters, inputs], scratch, results);
        out.fill(0.0);
        let slots = self.places.len();
        for (row, results) in results.chunks_exact(slots.max(1)).enumerate() {
            for (&place, &value) in self.places.iter().zip(results) {
                out[row * width + place] = value;
            }
        }
        Ok(())
    }

    fn switches(&self) -> usize {
        self.switches
    }

    fn switching(
        &self,
        motion: &[f64],
        parameters: &[f64],
        constants: &[f64],
        inputs: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.check(motion, parameters, constants, inputs)?;
        require_len(Buffer::Output, out.len(), self.switching.outputs.len())?;
        let (scratch, _) = split_workspace(workspace, self.switching.workspace_len)?;
        self.switching.run(&[motion, constants, parameters, inputs], scratch, out);
        Ok(())
    }
}

/// The exact pseudo-inverse of a pattern's estimator matrix, ready to be evaluated: parameters from harmonics without a
/// decomposition.
#[derive(Clone, Debug)]
pub struct InterpretedInverse {
    /// Number of amplitudes plus one, for the frequency.
    symbols: usize,
    constants: usize,
    harmonics: usize,
    program: Program,
}

impl InterpretedInverse {
    /// Makes the pseudo-inverse of a pattern runnable; `None` where the pattern has none. `constants` are the constants of the
    /// model that are known at run time only.
    #[must_use]
    pub fn new(pattern: &PatternPlan, constants: &[Symbol]) -> Option<Self> {
        let (inverse, table) = (pattern.pseudo_inverse.as_ref()?, pattern.table.as_ref().ok()?);
        let symbols = pattern.amplitudes.iter().chain([&pattern.frequency]).chain(constants);
        let leaves: Vec<Leaf> =
            symbols.map(|&symbol| Leaf::Symbol(symbol)).chain((0..table.rows.len()).map(Leaf::Harmonic)).collect();
        Some(Self {
            symbols: pattern.amplitudes.len() + 1,
            constants: constants.len(),
            harmonics: table.rows.len(),
            program: Program::new(&inverse.plan, &leaves),
        })
    }

    /// Number of entries that a workspace needs.
    #[must_use]
    pub fn workspace_len(&self) -> usize {
        self.program.workspace_len
    }

    /// Least-squares estimates of the parameters from harmonics of the force along the pattern. `pattern` holds the
    /// amplitudes and the frequency, none of them zero; `harmonics` are in the order of the rows of the harmonic table.
    ///
    /// # Errors
    /// [`EvalError::Length`] when a slice has the wrong length.
    pub fn parameters(
        &self,
        pattern: &[f64],
        constants: &[f64],
        harmonics: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Pattern, pattern.len(), self.symbols)?;
        require_len(Buffer::Constants, constants.len(), self.constants)?;
        require_len(Buffer::Harmonics, harmonics.len(), self.harmonics)?;
        require_len(Buffer::Output, out.len(), self.program.outputs.len())?;
        let (scratch, _) = split_workspace(workspace, self.program.workspace_len)?;
        self.program.run(&[pattern, constants, harmonics], scratch, out);
        Ok(())
    }
}

fn label(names: &[Name], index: usize) -> Label<'_> {
    names.get(index).map_or(Label::bare(""), Name::label)
}

impl Model<f64> for Interpreted {
    fn name(&self) -> &str {
        &self.name
    }

    fn dims(&self) -> Dims {
        self.dims
    }

    fn coordinate(&self, index: usize) -> Label<'_> {
        label(&self.coordinates, index)
    }

    fn input(&self, index: usize) -> Label<'_> {
        label(&self.inputs, index)
    }

    fn parameter(&self, index: usize) -> Label<'_> {
        label(&self.parameters, index)
    }

    fn constant(&self, index: usize) -> Label<'_> {
        label(&self.constants, index)
    }

    fn row(&self, index: usize) -> Label<'_> {
        label(&self.rows, index)
    }

    fn coordinate_order(&self, index: usize) -> usize {
        self.orders.get(index).copied().unwrap_or(self.dims.order)
    }

    fn workspace_len(&self) -> usize {
        self.workspace_len
    }

    fn regressor(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.run(&self.regressor, motion, constants, workspace, out)
    }

    fn known(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.run(&self.known, motion, constants, workspace, out)
    }

    fn input_map(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.run(&self.input_map, motion, constants, workspace, out)
    }

    fn forward_workspace_len(&self) -> usize {
        self.dynamics
            .as_ref()
            .map_or_else(|| difference_workspace_len(self), |program| program.workspace_len + program.outputs.len())
    }

    fn forward_dynamics(
        &self,
        motion: &mut [f64],
        parameters: &[f64],
        constants: &[f64],
        inputs: &[f64],
        workspace: &mut [f64],
    ) -> Result<(), EvalError> {
        let Some(program) = &self.dynamics else {
            return forward_by_differences(self, motion, parameters, constants, inputs, workspace);
        };
        let n = self.dims.coordinates;
        require_forward(self.dims, motion, parameters, inputs)?;
        require_len(Buffer::Constants, constants.len(), self.dims.constants)?;
        let (scratch, rest) = split_workspace(workspace, program.workspace_len)?;
        let (results, _) = split_workspace(rest, program.outputs.len())?;
        program.run(&[motion, constants, parameters, inputs], scratch, results);
        let (matrix, right) = results.split_at_mut(n * n);
        linear::solve_in_place(matrix, right).map_err(|coordinate| EvalError::Singular { coordinate })?;
        for (c, (&order, &value)) in self.orders.iter().zip(&*right).enumerate() {
            motion[order * n + c] = value;
        }
        Ok(())
    }
}

#[cfg(test)]
mod derivatives_tests;

#[cfg(test)]
mod tests {
    use super::Interpreted;
    use crate::test_models::Emps;
    use std::vec;
    use tpm_core::model::{EvalError, Model, difference_workspace_len, forward_by_differences};
    use tpm_symbolic::expr::graph::Function;
    use tpm_symbolic::mechanics::model::{Equation, ExactModel as Declared, Kind, SourceTerm, TermId};
    use tpm_symbolic::regressor::form::regressor_form;

    /// M q'' + Fv q' + Fc sign(q') + OF = force.
    fn emps() -> Interpreted {
        let mut model = Declared { name: "Emps".into(), ..Declared::default() };
        let q = model.declare_coordinate("q", None);
        let force = model.declare("force", None, Kind::Input);
        let parameters = ["M", "Fv", "Fc", "OF"].map(|name| model.declare(name, None, Kind::Parameter));
        let graph = &mut model.graph;
        let force = graph.symbol(force);
        let [mass, viscous, dry, offset] = parameters.map(|symbol| graph.symbol(symbol));
        let (speed, acceleration) = (graph.derivative_of(q, 1), graph.derivative_of(q, 2));
        let sign = graph.function(Function::Sign, speed);
        let terms =
            [graph.mul(mass, acceleration), graph.mul(viscous, speed), graph.mul(dry, sign), offset, graph.neg(force)];
        let terms = (0..).zip(terms).map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
        model.equations.push(Equation { name: "eq1".into(), terms });
        let form = regressor_form(&model).expect("linear in the parameters");
        Interpreted::new(&model, &form)
    }

    /// (J + m q2^2) q1'' + m q2 q2'' + 2 m q2 q1' q2' + k q1 = u and m q2 q1'' + m q2'' - c sin(q1)^`power` q2''^`power` = 0, in
    /// which c is known at run time.
    fn arm(power: i32) -> Interpreted {
        let mut model = Declared { name: "Arm".into(), ..Declared::default() };
        let [q1, q2] = ["q1", "q2"].map(|name| model.declare_coordinate(name, None));
        let u = model.declare("u", None, Kind::Input);
        let [inertia, mass, spring] = ["J", "m", "k"].map(|name| model.declare(name, None, Kind::Parameter));
        let c = model.declare("c", None, Kind::Constant { value: None });
        let graph = &mut model.graph;
        let [u, inertia, mass, spring, c] = [u, inertia, mass, spring, c].map(|symbol| graph.symbol(symbol));
        let [x, x1, x2] = [0, 1, 2].map(|order| graph.derivative_of(q1, order));
        let [y, y1, y2] = [0, 1, 2].map(|order| graph.derivative_of(q2, order));
        let [minus, two] = [-1, 2].map(|value| graph.integer(value));
        let sine = graph.function(Function::Sin, x);
        let product = [graph.pow(sine, power), graph.pow(y2, power)];
        let rows = [
            vec![
                vec![inertia, x2],
                vec![mass, y, y, x2],
                vec![mass, y, y2],
                vec![two, mass, y, x1, y1],
                vec![spring, x],
                vec![minus, u],
            ],
            vec![vec![mass, y, x2], vec![mass, y2], vec![minus, c, product[0], product[1]]],
        ];
        for row in rows {
            let terms = (0..).zip(row.iter().map(|factors| graph.product(factors)));
            let terms = terms.map(|(id, expr)| SourceTerm { id: TermId(id), expr }).collect();
            model.equations.push(Equation { name: "eq".into(), terms });
        }
        let form = regressor_form(&model).expect("linear in the parameters");
        Interpreted::new(&model, &form)
    }

    #[test]
    fn forward_dynamics_are_those_of_the_differences_and_allocate_nothing() {
        let (theta, constants, inputs) = ([0.7, 1.3, 5.0], [0.4], [2.5]);
        let model = arm(1);
        assert!(model.dynamics.is_some());
        let mut workspace = vec![0.0; model.forward_workspace_len()];
        let mut differences = vec![0.0; difference_workspace_len(&model)];
        for state in [[0.1, -0.3, 2.0, 0.4], [1.5, 0.8, -1.0, 3.0], [-0.4, 0.0, 0.0, 0.0]] {
            let [q1, q2, r1, r2] = state;
            let mut found = [q1, q2, r1, r2, f64::NAN, f64::NAN];
            let mut expected = found;
            let mut result = Ok(());
            let counted = allocation_counter::measure(|| {
                result = model.forward_dynamics(&mut found, &theta, &constants, &inputs, &mut workspace);
            });
            assert_eq!((result, counted.count_total), (Ok(()), 0));
            forward_by_differences(&model, &mut expected, &theta, &constants, &inputs, &mut differences).expect("fits");
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b).abs() <= 1e-13 * (1.0 + b.abs()), "{found:?} {expected:?}");
            }
        }
        let massless = model.forward_dynamics(&mut [0.1; 6], &[0.7, 0.0, 5.0], &[0.0], &inputs, &mut workspace);
        assert_eq!(massless, Err(EvalError::Singular { coordinate: 1 }));
        // Rows that are not affine in the accelerations have no program for the dynamics; differences take its place.
        assert!(arm(2).dynamics.is_none());
    }

    #[test]
    fn interpreted_and_hand_written_models_agree() {
        let model = emps();
        assert_eq!(model.dims(), Model::<f64>::dims(&Emps));
        assert_eq!(model.row(0).name, "force");
        let mut workspace = vec![0.0; model.workspace_len()];
        for motion in [[0.1, -0.3, 2.0], [0.0, 0.0, 1.0], [1.0, 4.0, -7.5]] {
            let (mut found, mut expected, mut known, mut map) = ([0.0; 4], [0.0; 4], [1.0], [0.0]);
            model.regressor(&motion, &[], &mut workspace, &mut found).expect("lengths fit");
            Emps.regressor(&motion, &[], &mut [], &mut expected).expect("lengths fit");
            model.known(&motion, &[], &mut workspace, &mut known).expect("lengths fit");
            model.input_map(&motion, &[], &mut workspace, &mut map).expect("lengths fit");
            assert_eq!((found, known, map), (expected, [0.0], [1.0]));
        }
    }
}
