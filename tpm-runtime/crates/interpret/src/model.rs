//! Numerical evaluation of a model's rows and forward dynamics.

use crate::leaves::{Leaves, require_motion};
use crate::program::{LANES, Program};
use tpm_controller::linear;
use tpm_controller::model::{
    Buffer, Dims, EvalError, Label, Model, Presliding, Take, difference_workspace_len, forward_by_differences,
    require_forward, require_len, split_workspace,
};
use tpm_symbolic::expr::graph::Symbol;
use tpm_symbolic::mechanics::model::ExactModel as Declared;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::evaluation::Evaluation;
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

/// A declared model, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Interpreted {
    name: String,
    dims: Dims,
    coordinates: Vec<Name>,
    orders: Vec<usize>,
    measured: Vec<bool>,
    presliding: Vec<Option<Presliding<f64>>>,
    inputs: Vec<Name>,
    parameters: Vec<Name>,
    constants: Vec<Name>,
    rows: Vec<Name>,
    workspace_len: usize,
    /// Whether an input does not stand alone, so that it is a leaf of the regressor and the known terms.
    needs_inputs: bool,
    regressor: Program,
    known: Program,
    input_map: Program,
    /// Program of the matrix and the right-hand side of the equations for the highest derivatives; nothing where the
    /// rows are not affine in these derivatives.
    dynamics: Option<Program>,
}

impl Interpreted {
    /// Compiles the rows of a model for evaluation; `form` is the regressor form of `model`.
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
        let leaves = Leaves::new(&evaluation, form);
        let needs_inputs = form.driven(model).is_some();
        let of_rows = if needs_inputs { leaves.without_parameters() } else { leaves.of_motion().to_vec() };
        let [regressor, known] = [&evaluation.regressor, &evaluation.known].map(|plan| Program::new(plan, &of_rows));
        let input_map = Program::new(&evaluation.input_map, leaves.of_motion());
        let dynamics = dynamics.map(|dynamics| Program::new(&dynamics.plan, leaves.all()));
        let workspace_len = [&regressor, &known, &input_map].map(|program| program.workspace_len).into_iter().max();
        Self {
            name: model.name.clone(),
            dims: leaves.dims,
            coordinates,
            measured: (evaluation.coordinates.iter())
                .map(|(coordinate, _)| !model.coordinates[coordinate.0 as usize].unmeasured)
                .collect(),
            presliding: (evaluation.coordinates.iter())
                .map(|(coordinate, _)| {
                    let own = model.coordinates[coordinate.0 as usize].presliding.as_ref()?;
                    let of = evaluation.coordinates.iter().position(|(other, _)| *other == own.of)?;
                    Some(Presliding { of, travel: rational::to_f64(&own.travel) })
                })
                .collect(),
            orders: evaluation.coordinates.iter().map(|(_, order)| *order as usize).collect(),
            inputs: evaluation.inputs.iter().map(quantity).collect(),
            parameters: form.columns.iter().map(|column| name(&column.name, column.unit.as_ref())).collect(),
            constants: evaluation.constants.iter().map(quantity).collect(),
            rows,
            workspace_len: workspace_len.unwrap_or(0),
            needs_inputs,
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
        require_motion(self.dims, motion, constants)?;
        require_len(Buffer::Output, out.len(), program.output_len())?;
        let (scratch, _) = split_workspace(workspace, self.workspace_len)?;
        program.run(&[motion, constants], scratch, out);
        Ok(())
    }

    /// Refuses to evaluate rows without the inputs that they depend on.
    const fn require_no_inputs(&self) -> Result<(), EvalError> {
        if self.needs_inputs { Err(EvalError::InputsNeeded) } else { Ok(()) }
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

    fn is_measured(&self, index: usize) -> bool {
        self.measured.get(index).copied().unwrap_or(true)
    }

    fn presliding(&self, index: usize) -> Option<Presliding<f64>> {
        self.presliding.get(index).copied().flatten()
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
        self.require_no_inputs()?;
        self.run(&self.regressor, motion, constants, workspace, out)
    }

    fn known(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.require_no_inputs()?;
        self.run(&self.known, motion, constants, workspace, out)
    }

    fn needs_inputs(&self) -> bool {
        self.needs_inputs
    }

    fn rows_under(
        &self,
        motion: &[f64],
        inputs: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        (phi, known): (&mut [f64], &mut [f64]),
    ) -> Result<(), EvalError> {
        require_motion(self.dims, motion, constants)?;
        require_len(Buffer::Inputs, inputs.len(), self.dims.inputs)?;
        let (scratch, _) = split_workspace(workspace, self.workspace_len)?;
        // Programs of rows in which inputs stand alone have no leaves for them.
        let own = if self.needs_inputs { inputs } else { &[] };
        for (program, out) in [(&self.regressor, phi), (&self.known, known)] {
            require_len(Buffer::Output, out.len(), program.output_len())?;
            program.run(&[motion, constants, own], scratch, out);
        }
        Ok(())
    }

    fn rows_along(
        &self,
        motions: &[f64],
        constants: &[f64],
        _: &mut [f64],
        (phi, known): (&mut [f64], &mut [f64]),
        take: &mut Take<'_, f64>,
    ) -> Result<(), EvalError> {
        self.require_no_inputs()?;
        let slots = self.dims.motion_len();
        require_len(Buffer::Constants, constants.len(), self.dims.constants)?;
        require_len(Buffer::Output, phi.len(), self.regressor.output_len())?;
        require_len(Buffer::Output, known.len(), self.known.output_len())?;
        require_len(Buffer::Motion, motions.len() % slots.max(1), 0)?;
        let (mut regressor, mut sides) = (Vec::new(), Vec::new());
        for (group, instants) in motions.chunks(slots.max(1) * LANES).enumerate() {
            let count = instants.len() / slots.max(1);
            self.regressor.run_lanes(instants, slots, constants, &mut regressor);
            self.known.run_lanes(instants, slots, constants, &mut sides);
            for lane in 0..count {
                self.regressor.results(&regressor, lane, phi);
                self.known.results(&sides, lane, known);
                take(group * LANES + lane, phi, known);
            }
        }
        Ok(())
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
            .map_or_else(|| difference_workspace_len(self), |program| program.workspace_len + program.output_len())
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
        let (results, _) = split_workspace(rest, program.output_len())?;
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
mod tests {
    use super::Interpreted;
    use tpm_controller::model::{EvalError, Model, difference_workspace_len, forward_by_differences};
    use tpm_symbolic::expr::graph::Function;
    use tpm_symbolic::mechanics::model::{Equation, ExactModel as Declared, Kind, SourceTerm, TermId};
    use tpm_symbolic::regressor::form::regressor_form;
    use tpm_test_support::models::Emps;

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
        // Rows that are not affine in the accelerations have no program for the dynamics; difference quotients replace
        // it.
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
