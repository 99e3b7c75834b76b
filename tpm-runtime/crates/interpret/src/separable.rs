//! A model whose rows are nonlinear in some parameters, presented as a model that is linear about a point.
//!
//! With `r = Phi(z) theta + known(z) - B u`, the parameters are theta followed by z. Invariant: the regressor is the
//! exact derivative of the rows at a point (theta0, z0), and the known terms are such that the rows are exact at this
//! point:
//!
//! ```text
//! [Phi(z0) | dr/dz(theta0, z0)] (theta, z) + known(z0) - dr/dz(theta0, z0) z0 = B u
//! ```
//!
//! Where theta0 is the least-squares solution for z0, one Gauss-Newton step of z with these rows is that of variable
//! projection in the variant of Kaufman (1975), and the covariance of the rows' least squares is the joint covariance
//! of theta and z. Forces and simulated motions are computed from the nonlinear rows, at any theta and z.

use crate::leaves::{Leaves, require_motion};
use crate::model::Interpreted;
use crate::program::Program;
use tpm_controller::model::{
    Buffer, Dims, EvalError, Label, Model, Presliding, require_forward, require_len, split_workspace,
};
use tpm_symbolic::mechanics::model::ExactModel as Declared;
use tpm_symbolic::number::rational;
use tpm_symbolic::plan::derivatives::Derivatives;
use tpm_symbolic::plan::evaluation::Evaluation;
use tpm_symbolic::regressor::form::RegressorForm;

/// Source of the value of a run-time constant of the rows.
#[derive(Clone, Copy, Debug)]
enum Place {
    /// Index among the constants.
    Constant(usize),
    /// Index among the nonlinear parameters.
    Nonlinear(usize),
}

/// A nonlinear parameter.
#[derive(Clone, Debug)]
struct Nonlinear {
    name: String,
    unit: Option<String>,
    interval: [f64; 2],
}

/// A declared model with nonlinear parameters, ready to be evaluated.
#[derive(Clone, Debug)]
pub struct Separable {
    rows: Interpreted,
    dims: Dims,
    /// Source of the value of each run-time constant of the rows.
    places: Vec<Place>,
    nonlinear: Vec<Nonlinear>,
    /// The derivative `dr/dz`, a matrix of rows times nonlinear parameters.
    slopes: Program,
    /// The point of linearisation: theta, then z.
    point: Vec<f64>,
}

impl Separable {
    /// Compiles a model with nonlinear parameters, linear about zero theta and the middle of the intervals of z;
    /// nothing for a model without nonlinear parameters. `form` is the regressor form of `model`.
    #[must_use]
    pub fn new(model: &Declared, form: &RegressorForm) -> Option<Self> {
        if model.nonlinear.is_empty() {
            return None;
        }
        let evaluation = Evaluation::new(model, form);
        let leaves = Leaves::separable(model, &evaluation, form);
        let dims = leaves.dims;
        let known: Vec<_> = model.known_constants().collect();
        let nonlinear_place = |symbol| model.nonlinear.iter().position(|own| own.symbol == symbol);
        let place = |symbol| match nonlinear_place(symbol) {
            Some(index) => Place::Nonlinear(index),
            None => {
                let index = known.iter().position(|constant| *constant == symbol);
                Place::Constant(index.expect("invariant: a run-time constant is known or a nonlinear parameter"))
            }
        };
        let nonlinear = model.nonlinear.iter().map(|own| {
            let quantity = model.quantity(own.symbol);
            Nonlinear {
                name: quantity.name.to_string(),
                unit: quantity.unit.as_ref().map(ToString::to_string),
                interval: [rational::to_f64(&own.from), rational::to_f64(&own.to)],
            }
        });
        let nonlinear: Vec<Nonlinear> = nonlinear.collect();
        let mut point = vec![0.0; form.columns.len()];
        point.extend(nonlinear.iter().map(|own| 0.5 * (own.interval[0] + own.interval[1])));
        Some(Self {
            rows: Interpreted::new(model, form),
            dims,
            places: evaluation.constants.iter().map(|&symbol| place(symbol)).collect(),
            nonlinear,
            slopes: Program::new(&Derivatives::by_nonlinear(model, form), leaves.all()),
            point,
        })
    }

    /// The model, linearised about another point: theta, then z.
    ///
    /// # Errors
    /// [`EvalError::Length`] when the length of the point differs from the number of parameters.
    pub fn at(&self, point: Vec<f64>) -> Result<Self, EvalError> {
        require_len(Buffer::Parameters, point.len(), self.dims.parameters)?;
        Ok(Self { point, ..self.clone() })
    }

    /// The point of linearisation: theta, then z.
    #[must_use]
    pub fn point(&self) -> &[f64] {
        &self.point
    }

    /// Number of parameters in which the rows are linear. The nonlinear ones follow them.
    #[must_use]
    pub fn linear(&self) -> usize {
        self.dims.parameters - self.nonlinear.len()
    }

    /// Least and largest value of every nonlinear parameter.
    pub fn intervals(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.nonlinear.iter().map(|own| own.interval)
    }

    /// Writes the values of all run-time constants of the rows into `all`, taken from the constants and from z.
    fn constants(&self, constants: &[f64], z: &[f64], all: &mut [f64]) -> Result<(), EvalError> {
        require_len(Buffer::Constants, constants.len(), self.dims.constants)?;
        for (value, place) in all.iter_mut().zip(&self.places) {
            *value = match *place {
                Place::Constant(index) => constants[index],
                Place::Nonlinear(index) => z[index],
            };
        }
        Ok(())
    }

    /// The derivative `dr/dz` at given parameters and inputs.
    fn slopes(
        &self,
        (motion, inputs): (&[f64], &[f64]),
        constants: &[f64],
        parameters: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        require_motion(self.dims, motion, constants)?;
        require_len(Buffer::Parameters, parameters.len(), self.dims.parameters)?;
        require_len(Buffer::Inputs, inputs.len(), self.dims.inputs)?;
        let (scratch, _) = split_workspace(workspace, self.slopes.workspace_len)?;
        self.slopes.run(&[motion, constants, parameters, inputs], scratch, out);
        Ok(())
    }
}

impl Separable {
    /// Takes from the known terms what the derivative by z gives at the point of linearisation.
    fn less_than_linear(&self, slopes: &[f64], known: &mut [f64]) {
        let z = &self.point[self.linear()..];
        for (known, slopes) in known.iter_mut().zip(slopes.chunks_exact(z.len())) {
            *known -= slopes.iter().zip(z).map(|(slope, z)| slope * z).sum::<f64>();
        }
    }

    /// Phi beside the derivative by z, row by row.
    fn side_by_side(&self, phi: &[f64], slopes: &[f64], out: &mut [f64]) {
        let (linear, whole) = (self.linear(), self.dims.parameters);
        for (r, row) in out.chunks_exact_mut(whole).enumerate() {
            row[..linear].copy_from_slice(&phi[r * linear..(r + 1) * linear]);
            row[linear..].copy_from_slice(&slopes[r * (whole - linear)..(r + 1) * (whole - linear)]);
        }
    }
}

impl Model<f64> for Separable {
    fn name(&self) -> &str {
        self.rows.name()
    }

    fn dims(&self) -> Dims {
        self.dims
    }

    fn coordinate(&self, index: usize) -> Label<'_> {
        self.rows.coordinate(index)
    }

    fn is_measured(&self, index: usize) -> bool {
        self.rows.is_measured(index)
    }

    fn presliding(&self, index: usize) -> Option<Presliding<f64>> {
        self.rows.presliding(index)
    }

    fn input(&self, index: usize) -> Label<'_> {
        self.rows.input(index)
    }

    fn parameter(&self, index: usize) -> Label<'_> {
        match index.checked_sub(self.linear()).map(|index| self.nonlinear.get(index)) {
            None => self.rows.parameter(index),
            Some(None) => Label::bare(""),
            Some(Some(Nonlinear { name, unit: Some(unit), .. })) => Label::new(name, unit),
            Some(Some(Nonlinear { name, unit: None, .. })) => Label::bare(name),
        }
    }

    fn parameter_interval(&self, index: usize) -> Option<[f64; 2]> {
        Some(self.nonlinear.get(index.checked_sub(self.linear())?)?.interval)
    }

    fn constant(&self, index: usize) -> Label<'_> {
        let own = |place: &Place| matches!(place, Place::Constant(of) if *of == index);
        self.places.iter().position(own).map_or(Label::bare(""), |at| self.rows.constant(at))
    }

    fn row(&self, index: usize) -> Label<'_> {
        self.rows.row(index)
    }

    fn coordinate_order(&self, index: usize) -> usize {
        self.rows.coordinate_order(index)
    }

    fn workspace_len(&self) -> usize {
        let scratch = self.dims.inputs + self.rows.workspace_len().max(self.slopes.workspace_len);
        self.places.len() + self.dims.regressor_len() + scratch
    }

    fn regressor(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        self.sensitivity(motion, &self.point, constants, workspace, out)
    }

    fn known(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        let z = &self.point[self.linear()..];
        let (all, rest) = split_workspace(workspace, self.places.len())?;
        let (slopes, rest) = split_workspace(rest, self.dims.rows * z.len())?;
        let (inputs, scratch) = split_workspace(rest, self.dims.inputs)?;
        self.constants(constants, z, all)?;
        self.rows.known(motion, all, scratch, out)?;
        // Where inputs stand alone none is multiplied by a nonlinear parameter, so that the derivative does not depend on them.
        inputs.fill(0.0);
        self.slopes((motion, inputs), constants, &self.point, scratch, slopes)?;
        self.less_than_linear(slopes, out);
        Ok(())
    }

    fn needs_inputs(&self) -> bool {
        self.rows.needs_inputs()
    }

    fn rows_under(
        &self,
        motion: &[f64],
        inputs: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        (phi, known): (&mut [f64], &mut [f64]),
    ) -> Result<(), EvalError> {
        require_len(Buffer::Output, phi.len(), self.dims.regressor_len())?;
        let (all, rest) = split_workspace(workspace, self.places.len())?;
        let (parts, scratch) = split_workspace(rest, self.dims.regressor_len())?;
        let (linear, slopes) = parts.split_at_mut(self.dims.rows * self.linear());
        self.constants(constants, &self.point[self.linear()..], all)?;
        self.rows.rows_under(motion, inputs, all, scratch, (linear, known))?;
        self.slopes((motion, inputs), constants, &self.point, scratch, slopes)?;
        self.less_than_linear(slopes, known);
        self.side_by_side(linear, slopes, phi);
        Ok(())
    }

    fn input_map(
        &self,
        motion: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        let (all, scratch) = split_workspace(workspace, self.places.len())?;
        self.constants(constants, &self.point[self.linear()..], all)?;
        self.rows.input_map(motion, all, scratch, out)
    }

    fn sensitivity(
        &self,
        motion: &[f64],
        parameters: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Parameters, parameters.len(), self.dims.parameters)?;
        require_len(Buffer::Output, out.len(), self.dims.regressor_len())?;
        let linear = self.linear();
        let (all, rest) = split_workspace(workspace, self.places.len())?;
        let (parts, rest) = split_workspace(rest, self.dims.regressor_len())?;
        let (inputs, scratch) = split_workspace(rest, self.dims.inputs)?;
        let (phi, slopes) = parts.split_at_mut(self.dims.rows * linear);
        self.constants(constants, &parameters[linear..], all)?;
        self.rows.regressor(motion, all, scratch, phi)?;
        inputs.fill(0.0);
        self.slopes((motion, inputs), constants, parameters, scratch, slopes)?;
        self.side_by_side(phi, slopes, out);
        Ok(())
    }

    fn inverse_workspace_len(&self) -> usize {
        self.places.len() + self.rows.inverse_workspace_len()
    }

    fn inverse_dynamics(
        &self,
        motion: &[f64],
        parameters: &[f64],
        constants: &[f64],
        workspace: &mut [f64],
        out: &mut [f64],
    ) -> Result<(), EvalError> {
        require_len(Buffer::Parameters, parameters.len(), self.dims.parameters)?;
        let (theta, z) = parameters.split_at(self.linear());
        let (all, scratch) = split_workspace(workspace, self.places.len())?;
        self.constants(constants, z, all)?;
        self.rows.inverse_dynamics(motion, theta, all, scratch, out)
    }

    fn forward_workspace_len(&self) -> usize {
        self.places.len() + self.rows.forward_workspace_len()
    }

    fn forward_dynamics(
        &self,
        motion: &mut [f64],
        parameters: &[f64],
        constants: &[f64],
        inputs: &[f64],
        workspace: &mut [f64],
    ) -> Result<(), EvalError> {
        require_forward(self.dims, motion, parameters, inputs)?;
        let (theta, z) = parameters.split_at(self.linear());
        let (all, scratch) = split_workspace(workspace, self.places.len())?;
        self.constants(constants, z, all)?;
        self.rows.forward_dynamics(motion, theta, all, inputs, scratch)
    }
}
