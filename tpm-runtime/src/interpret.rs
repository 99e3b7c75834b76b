//! A model that is run without being compiled: the evaluation plans, executed operation by operation.
//!
//! Invariant: the operations are those of [`tpm_symbolic::evaluation::Evaluation`], in the same order and with one
//! rounding each, so that the numbers are those of the emitted code.

use crate::linear;
use crate::model::{
    Buffer, Dims, EvalError, Label, Model, difference_workspace_len, forward_by_differences, require_forward,
    require_len, split_workspace,
};
use crate::real::Real;
use std::string::{String, ToString};
use std::vec;
use std::vec::Vec;
use tpm_symbolic::evaluation::Evaluation;
use tpm_symbolic::expr::{Function, Node, Symbol};
use tpm_symbolic::model::Model as Declared;
use tpm_symbolic::plan::{Op, Plan};
use tpm_symbolic::rational;
use tpm_symbolic::regressor::RegressorForm;

/// A name and unit, owned.
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

/// One operation on the workspace; operation i writes entry i.
#[derive(Clone, Copy, Debug)]
enum Step {
    Constant(f64),
    Motion(usize),
    RunTimeConstant(usize),
    Parameter(usize),
    Input(usize),
    Add(usize, usize),
    Sub(usize, usize),
    Mul(usize, usize),
    Div(usize, usize),
    Neg(usize),
    Function(Function, usize),
    Atan2(usize, usize),
}

/// What the leaves of a plan are read from.
#[derive(Clone, Copy, Debug, Default)]
struct Leaves<'a> {
    motion: &'a [f64],
    constants: &'a [f64],
    parameters: &'a [f64],
    inputs: &'a [f64],
}

/// A plan with its constants rounded and its leaves resolved to places in the caller's slices.
#[derive(Clone, Debug)]
struct Program {
    steps: Vec<Step>,
    outputs: Vec<usize>,
    /// The results, where neither motion nor run-time constants have a part in them.
    fixed: Option<Vec<f64>>,
}

impl Program {
    /// `parameters` are the symbols that stand for the unknown parameters, where a plan reads any.
    fn new(plan: &Plan, evaluation: &Evaluation, parameters: &[Symbol]) -> Self {
        let count = evaluation.coordinates.len();
        let at = |symbols: &[Symbol], symbol: Symbol| symbols.iter().position(|present| *present == symbol);
        let load = |index: u32| match plan.inputs[index as usize] {
            Node::Derivative(coordinate, order) => {
                let position = evaluation.coordinates.iter().position(|(present, _)| *present == coordinate);
                Step::Motion(
                    order as usize * count + position.expect("invariant: the evaluation lists its coordinates"),
                )
            }
            Node::Symbol(symbol) => at(&evaluation.constants, symbol)
                .map(Step::RunTimeConstant)
                .or_else(|| at(parameters, symbol).map(Step::Parameter))
                .or_else(|| at(&evaluation.inputs, symbol).map(Step::Input))
                .expect("invariant: the evaluation lists its constants and inputs"),
            _ => unreachable!("invariant: a plan loads leaves only"),
        };
        let steps = plan.ops.iter().map(|op| match op {
            Op::Constant(value) => Step::Constant(rational::to_f64(value)),
            Op::Pi => Step::Constant(core::f64::consts::PI),
            Op::Load(index) => load(*index),
            Op::Add(a, b) => Step::Add(a.index(), b.index()),
            Op::Sub(a, b) => Step::Sub(a.index(), b.index()),
            Op::Mul(a, b) => Step::Mul(a.index(), b.index()),
            Op::Div(a, b) => Step::Div(a.index(), b.index()),
            Op::Neg(a) => Step::Neg(a.index()),
            Op::Function(function, a) => Step::Function(*function, a.index()),
            Op::Atan2(y, x) => Step::Atan2(y.index(), x.index()),
        });
        let outputs = plan.outputs.iter().map(|slot| slot.index()).collect();
        let mut program = Self { steps: steps.collect(), outputs, fixed: None };
        if plan.inputs.is_empty() {
            let mut results = vec![0.0; program.outputs.len()];
            program.run(Leaves::default(), &mut vec![0.0; program.steps.len()], &mut results);
            program.fixed = Some(results);
        }
        program
    }

    fn run(&self, leaves: Leaves<'_>, workspace: &mut [f64], out: &mut [f64]) {
        if let Some(fixed) = &self.fixed {
            for (result, &value) in out.iter_mut().zip(fixed) {
                *result = value;
            }
            return;
        }
        for (i, step) in self.steps.iter().enumerate() {
            workspace[i] = match *step {
                Step::Constant(value) => value,
                Step::Motion(index) => leaves.motion[index],
                Step::RunTimeConstant(index) => leaves.constants[index],
                Step::Parameter(index) => leaves.parameters[index],
                Step::Input(index) => leaves.inputs[index],
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

/// The core's own functions rather than the standard library's, so that every machine gets the same bits.
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
    /// The matrix of the highest derivatives, then the right-hand side; nothing where the rows are not affine in them.
    dynamics: Option<Program>,
}

impl Interpreted {
    /// Makes the model runnable; `form` is the regressor form of `model`.
    #[must_use]
    pub fn new(model: &Declared, form: &RegressorForm) -> Self {
        let (evaluation, dynamics) = Evaluation::with_dynamics(model, form);
        let name = |name: &str, unit: Option<&tpm_symbolic::unit::Unit>| Name {
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
        let [regressor, known, input_map] = [&evaluation.regressor, &evaluation.known, &evaluation.input_map]
            .map(|plan| Program::new(plan, &evaluation, &[]));
        let dynamics = dynamics.map(|dynamics| Program::new(&dynamics.plan, &evaluation, &dynamics.parameters));
        let workspace_len = [&regressor, &known, &input_map].map(|program| program.steps.len()).into_iter().max();
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
        program.run(Leaves { motion, constants, ..Leaves::default() }, scratch, out);
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
            .map_or_else(|| difference_workspace_len(self), |program| program.steps.len() + program.outputs.len())
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
        let (scratch, rest) = split_workspace(workspace, program.steps.len())?;
        let (results, _) = split_workspace(rest, program.outputs.len())?;
        program.run(Leaves { motion, constants, parameters, inputs }, scratch, results);
        let (matrix, right) = results.split_at_mut(n * n);
        linear::solve_in_place(matrix, right).map_err(|coordinate| EvalError::Singular { coordinate })?;
        for (c, (&order, &value)) in self.orders.iter().zip(&*right).enumerate() {
            motion[order * n + c] = value;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::Interpreted;
    use crate::model::Model;
    use crate::test_models::Emps;
    use std::vec;
    use tpm_symbolic::expr::Function;
    use tpm_symbolic::model::{Equation, Kind, Model as Declared, SourceTerm, TermId};
    use tpm_symbolic::regressor::regressor_form;

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
